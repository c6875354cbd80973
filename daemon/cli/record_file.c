#include "daemon/cli/record_file.h"

#include <stdio.h>
#include <unistd.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "daemon/control/json.h"
#include "recon/solve/solve.h"

static void triple(struct dmn_json *j, const char *key, const double v[3])
{
    dmn_json_open(j, key, '[');
    for (int a = 0; a < 3; a++)
        dmn_json_num(j, NULL, v[a]);
    dmn_json_close(j, ']');
}

/* 64 bits as text: many JSON readers keep numbers as doubles. */
static void hex(struct dmn_json *j, const char *key, uint64_t v)
{
    char text[20];
    snprintf(text, sizeof text, "%016llx", (unsigned long long)v);
    dmn_json_str(j, key, text);
}

/* The number comes from outside. */
static const char *status_name(uint32_t status)
{
    return status <= REC_EMPTY ? rec_status_name((enum rec_status)status) : "unknown";
}

static void put_report(struct dmn_json *j, const struct pvp_report *r)
{
    const struct {
        const char *key;
        int64_t ns;
    } ms[] = {{"photometry", r->photometry_ns},
              {"hull", r->hull_ns},
              {"restrict", r->restrict_ns},
              {"solve", r->solve_ns},
              {"total", r->total_ns}};
    dmn_json_open(j, "report", '{');
    dmn_json_str(j, "status", status_name(r->status));
    dmn_json_str(j, "solver", r->solver);
    dmn_json_int(j, "iterations", r->iterations);
    dmn_json_num(j, "rel_residual", r->rel_residual);
    dmn_json_int(j, "active_voxels", r->active_voxels);
    dmn_json_int(j, "active_rays", r->active_rays);
    dmn_json_int(j, "entries", (long long)r->entries);
    dmn_json_open(j, "ms", '{');
    for (size_t i = 0; i < sizeof ms / sizeof ms[0]; i++)
        dmn_json_num(j, ms[i].key, (double)ms[i].ns * 1e-6);
    dmn_json_close(j, '}');
    dmn_json_close(j, '}');
}

static size_t describe(const struct pvp_view *view, const struct pvp_start *start, char *text,
                       size_t size)
{
    const struct pvp_volume *v = &view->v;
    const struct pvp_grid *g = &v->grid;
    double spacing[3];
    struct dmn_json j;
    for (int a = 0; a < 3; a++)
        spacing[a] = (g->max[a] - g->min[a]) / g->n[a];
    dmn_json_init(&j, text, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_int(&j, "set", (long long)v->set);
    dmn_json_open(&j, "shape", '['); /* of the array: nz ny nx channels */
    for (int a = 2; a >= 0; a--)
        dmn_json_int(&j, NULL, g->n[a]);
    dmn_json_int(&j, NULL, g->channels);
    dmn_json_close(&j, ']');
    triple(&j, "origin", g->min); /* corner of the box, x y z, m */
    triple(&j, "spacing", spacing);
    dmn_json_str(&j, "basis", g->basis == 1 ? "trilinear" : "box");
    dmn_json_str(&j, "units", start->units);
    dmn_json_int(&j, "t_exposure_ns", v->t_exposure_ns);
    dmn_json_int(&j, "t_publish_ns", v->t_publish_ns);
    dmn_json_int(&j, "spread_ns", v->spread_ns);
    dmn_json_int(&j, "latency_ns", v->latency_ns);
    dmn_json_int(&j, "cameras_present", v->cameras_present);
    hex(&j, "camera_mask", v->camera_mask);
    hex(&j, "session", v->session);
    hex(&j, "rig_hash", start->rig_hash);
    dmn_json_str(&j, "software", start->software);
    dmn_json_str(&j, "sample", view->sample == PVP_F16 ? "float16" : "float32");
    dmn_json_bool(&j, "clamped", view->clamped);
    put_report(&j, &v->report);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

pvx_err record_file_save(const char *dir, const struct pvp_view *view,
                         const struct pvp_start *start, const float *dense, struct pvx_diag *d)
{
    const struct pvp_grid *g = &view->v.grid;
    char path[1100], npy[1100], text[4096];
    size_t shape[4] = {g->n[2], g->n[1], g->n[0], g->channels};
    unsigned long long set = view->v.set;
    snprintf(npy, sizeof npy, "%s/%06llu.npy", dir, set);
    snprintf(path, sizeof path, "%s/%06llu.json", dir, set);
    size_t len = describe(view, start, text, sizeof text - 1);
    if (len == 0)
        return pvx_fail(d, PVX_ERANGE, "%s: description longer than %zu bytes", path, sizeof text);
    text[len++] = '\n';
    PVX_TRY(cap_npy_save(npy, dense, shape, 4, d));
    pvx_err e = pvx_file_write(path, text, len, d);
    if (e != PVX_OK)
        unlink(npy);
    return e;
}
