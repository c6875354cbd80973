/* test_kelvin.c - temperatures as volumes (daemon/volumes/thermal_volumes.c), and what refuses them. */
#include "../t.h"

#include <unistd.h>

#include "daemon/volumes/share.h"
#include "daemon/volumes/thermal_read.h"
#include "tests/lib/plugins.h"

#define CELLS ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)
enum { FIELDS = 4, NX = 9, NY = 8, NZ = 8 };

static char dir[] = "/tmp/pyrovox-test-kelvin-XXXXXX", path[64], out[64];
static struct pvx_diag d;

/* Diagnoses keep what came first. */
static struct pvx_diag *anew(void)
{
    d = (struct pvx_diag){""};
    return &d;
}

/* Two sets of two bricks.  Voxel q of set k has T = 1000 + q + k, soot = 1 + q / 100, where q is a multiple of three. */
static void write_file(const char *name, bool absolute)
{
    static const struct vol_thermal_field field[FIELDS] = {{"temperature", "K", false},
                                                           {"temperature_sd", "K", false},
                                                           {"soot", "ppm", false},
                                                           {"soot_sd", "ppm", false}};
    static const uint32_t ids[2] = {0, 1};
    static float value[FIELDS][2 * CELLS];
    struct vol_head head = {.start = {.grid = {.n = {NX, NY, NZ}, .max = {9, 8, 8}, .channels = 3},
                                      .session = 40,
                                      .rig_hash = 7},
                            .rig = "version: 1\n"};
    const struct vol_thermal_modes none = {.n = 0};
    vol_thermal *w;
    snprintf(path, sizeof path, "%s/%s.h5", dir, name);
    T_CHECK_(vol_thermal_open(path, &head, field, FIELDS, &w, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(vol_thermal_note(w, "absolute", absolute, NULL, &d), PVX_OK);
    for (uint64_t k = 0; k < 2; k++) {
        for (size_t q = 0; q < 2 * CELLS; q++) {
            float base = (float)(q % CELLS), on = q % 3 == 0 ? 1 : NAN;
            value[0][q] = on * (1000 + base + (float)k);
            value[1][q] = on * (20 + base / 64);
            value[2][q] = absolute ? on * (base / 100 + 1) : NAN;
            value[3][q] = absolute ? on * 0.5F : NAN;
        }
        const struct vol_volume v = {
            .v = {.set = 3 + k, .t_exposure_ns = (int64_t)k * 50000000, .grid = head.start.grid},
            .n_bricks = 2,
            .ids = ids};
        const float *const all[FIELDS] = {value[0], value[1], value[2], value[3]};
        T_EQ_I(vol_thermal_put(w, &v, all, &none, &d), PVX_OK);
    }
    T_EQ_I(vol_thermal_close(&w, true, &d), PVX_OK);
}

/* Each voxel inside the grid is what was written, else 0, and so is its bar. */
static void check_set(vol_reader *r, uint64_t k, float at, float per, float sd, float sd_per)
{
    struct vol_volume v;
    T_CHECK_(vol_reader_get(r, k, &v, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(v.v.set, 3 + k);
    T_EQ_I(v.n_bricks, 2);
    T_EQ_I(v.v.grid.channels, 1);
    T_EQ_I(v.v.grid.basis, 0);
    T_OK(v.bars.sd != NULL && v.bars.n_modes == 0);
    int known = 0;
    for (size_t q = 0; q < 2 * CELLS; q++) {
        bool inside = q < CELLS || q % PVP_BRICK == 0; /* the second brick has one column */
        bool on = inside && q % 3 == 0;
        float base = (float)(q % CELLS);
        T_NEAR(v.brick[q], on ? at + per * base : 0, 1e-3);
        T_NEAR(v.bars.sd[q], on ? sd + sd_per * base : 0, 1e-4);
        known += on;
    }
    T_EQ_I(v.v.report.active_voxels, known);
    T_OK(known > 170);
}

T_CASE(temperatures_are_volumes_in_kelvin)
{
    vol_reader *r;
    write_file("t", true);
    T_CHECK_(vol_reader_open(path, &r, anew()) == PVX_OK, "%s", d.text);
    T_EQ_I(vol_reader_count(r), 2);
    const struct vol_head *h = vol_reader_head(r);
    T_EQ_S(h->start.units, "K");
    T_EQ_S(h->rig, "version: 1\n");
    T_EQ_I(h->start.rig_hash, 7);
    T_EQ_I(h->start.session, 40);
    T_NEAR(h->start.fps, 20, 1e-9);
    check_set(r, 1, 1001, 1, 20, 1.0F / 64);
    check_set(r, 0, 1000, 1, 20, 1.0F / 64);
    T_EQ_I(vol_reader_emission(r, "t.h5", anew()), PVX_EINVAL);
    T_CONTAINS(d.text, "t.h5: has temperatures [K], and emission [1/m] is needed");
    vol_reader_close(&r);
    T_CHECK_(vol_reader_open_soot(path, &r, anew()) == PVX_OK, "%s", d.text);
    T_EQ_S(vol_reader_head(r)->start.units, "ppm");
    T_EQ_I(vol_reader_head(r)->start.session, 41); /* another quantity, another session */
    check_set(r, 1, 1, 0.01F, 0.5F, 0);
    T_EQ_I(vol_reader_emission(r, "t.h5", anew()), PVX_EINVAL);
    T_CONTAINS(d.text, "amounts of soot");
    vol_reader_close(&r);
}

T_CASE(soot_that_is_not_known)
{
    vol_reader *r;
    write_file("couple", false);
    T_EQ_I(vol_reader_open_soot(path, &r, anew()), PVX_EINVAL);
    T_CONTAINS(d.text, "calibrated by a thermocouple");
    T_EQ_I(vol_reader_open_soot(dir, &r, anew()), PVX_EFORMAT);
    T_CONTAINS(d.text, "has no amounts of soot");
    T_EQ_I(vol_reader_open_soot("/nowhere.h5", &r, anew()), PVX_ENOENT);
}

T_CASE(a_renderer_does_not_get_kelvin_as_light)
{
    struct vol_head head = {
        .start = {.grid = {.n = {8, 8, 8}, .max = {1, 1, 1}, .channels = 1}, .units = "K"}};
    static const uint32_t ids[1] = {0};
    static float brick[CELLS] = {1500};
    const struct vol_volume v = {
        .v = {.grid = head.start.grid}, .n_bricks = 1, .ids = ids, .brick = brick};
    vol_writer *w;
    vol_share *s;
    snprintf(out, sizeof out, "%s/nano", dir);
    pvx_err e = vol_writer_open(VOL_NVDB, out, &head, NULL, &w, anew());
    T_EQ_I(e, PVX_EUNSUP);
    T_CONTAINS(d.text, "temperatures are not written as .nvdb");
    T_OK(access(out, F_OK) != 0);
    e = vol_share_new(&(struct vol_share_config){.name = "pyrovox-test-kelvin", .mode = 0600}, &s,
                      anew());
    if (e != PVX_OK) {
        T_SKIP("the module pyrovox-openvdb is not built");
        return;
    }
    T_EQ_I(vol_share_put(s, &head.start, &v, anew()), PVX_EUNSUP);
    T_CONTAINS(d.text, "temperatures are not shared");
    vol_share_free(&s);
}

static void begin(void)
{
    plugins_of_this_build();
    if (mkdtemp(dir) == NULL)
        exit(1);
}

static void end(void)
{
    static const char *const files[] = {"t.h5", "couple.h5"};
    for (size_t i = 0; i < 2; i++) {
        snprintf(out, sizeof out, "%s/%s", dir, files[i]);
        unlink(out);
    }
    rmdir(dir);
}

T_MAIN(begin(), end())
