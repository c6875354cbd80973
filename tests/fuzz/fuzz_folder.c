/* fuzz_folder.c - any text as the .json beside a .npy, and behind the first 0 byte as the list of its folder: refused with
 * a reason, or what is read can be published and is read again as it was written by the recorder.  The list stands for
 * that of numbered files, too. */
#include <math.h>
#include <string.h>
#include <sys/stat.h>
#include <xxhash.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "daemon/pipeline/volume_file.h"
#include "daemon/volumes/numbered.h"
#include "daemon/volumes/voxels.h"
#include "tests/fuzz/fuzz.h"

static char folder[] = "/dev/shm/fuzz_folder-XXXXXX", npy[64], json[64], list[64], numbered[64],
            again[64];

static void remove_all(void)
{
    const char *const names[] = {npy, json, list, numbered, again, folder};
    for (int i = 0; i < 6; i++)
        remove(names[i]);
}

static void make(void)
{
    static const float value[2 * 3 * 9] = {[4] = 1.5f, [5] = 0.1f, [50] = 65504};
    MUST(mkdtemp(folder) != NULL);
    snprintf(npy, sizeof npy, "%s/a_0001.npy", folder);
    snprintf(json, sizeof json, "%s/a_0001.json", folder);
    snprintf(list, sizeof list, "%s/recording.json", folder);
    snprintf(numbered, sizeof numbered, "%s/a.json", folder);
    snprintf(again, sizeof again, "%s/again.h5", folder);
    atexit(remove_all);
    MUST(cap_npy_save(npy, value, (const size_t[]){2, 3, 9}, 3, NULL) == PVX_OK);
}

/* As `pyrovox render` reads one. */
static void load_alone(void)
{
    struct rec_grid g = {.min = {0}, .max = {1, 1, 1}};
    struct pvx_diag d = {""};
    float *dense;
    int channels;
    if (dmn_volume_load(npy, &g, &channels, &dense, &d) != PVX_OK) {
        MUST(dense == NULL && d.text[0] != '\0');
        return;
    }
    free(dense);
    MUST(channels == 1 && g.n[0] == 9 && g.n[1] == 3 && g.n[2] == 2);
    for (int a = 0; a < 3; a++)
        MUST(isfinite(g.min[a]) && isfinite(g.max[a]) && g.min[a] < g.max[a]);
}

/* A hash of the messages. */
static uint64_t publish(const struct vol_head *h, const struct vol_volume *v)
{
    static float dense[2 * 3 * 9];
    struct pvp_start start;
    struct pvp_voxels x;
    struct pvp_view view;
    pvp_encoder *enc;
    pvp_decoder *dec;
    vol_voxels *voxels;
    const void *msg;
    size_t len;
    uint64_t hash;
    MUST(pvp_encoder_new(&h->start.grid, v->sample, PVP_RAW, &enc) == PVX_OK);
    MUST(pvp_encode_start(enc, 0, &h->start, &msg, &len) == PVX_OK);
    struct pvx_diag d = {""};
    if (pvp_decode_start(msg, len, &start, &d) != PVX_OK)
        fprintf(stderr, "%s\n", d.text), abort();
    MUST(strcmp(start.units, h->start.units) == 0);
    hash = XXH3_64bits(msg, len);
    MUST(vol_voxels_new(&h->start.grid, &voxels) == PVX_OK && pvp_decoder_new(&dec) == PVX_OK);
    vol_voxels_of(voxels, v, &x);
    MUST(pvp_encode_volume(enc, 1, &v->v, &x, &msg, &len) == PVX_OK);
    MUST(pvp_decode_volume(msg, len, &view, NULL) == PVX_OK && view.v.set == v->v.set);
    MUST(pvp_volume_unpack(dec, &view, dense, 2 * 3 * 9, NULL) == PVX_OK);
    hash = XXH3_64bits_withSeed(msg, len, hash);
    vol_voxels_free(&voxels);
    pvp_decoder_free(&dec);
    pvp_encoder_free(&enc);
    return hash;
}

static void record(vol_reader *r, const struct vol_volume *v)
{
    const struct vol_head *h = vol_reader_head(r);
    const struct vol_gap *g, *same;
    struct vol_volume w;
    struct pvx_diag d = {""};
    vol_writer *out;
    vol_reader *in;
    uint64_t k;
    MUST(vol_writer_open(VOL_HDF5, again, h, NULL, &out, &d) == PVX_OK);
    MUST(vol_writer_put(out, v, &d) == PVX_OK);
    for (k = 0; (g = vol_reader_gap(r, k)) != NULL; k++)
        MUST(g->why < VOL_GAPS && vol_writer_gap(out, g, &d) == PVX_OK);
    MUST(vol_writer_close(&out, &d) == PVX_OK);
    if (vol_reader_open(again, &in, &d) != PVX_OK) {
        fprintf(stderr, "%s\n", d.text);
        abort();
    }
    const struct pvp_start *s = &vol_reader_head(in)->start;
    MUST(!vol_reader_cut(in) && vol_reader_count(in) == 1);
    MUST(vol_reader_get(in, 0, &w, &d) == PVX_OK && w.v.set == v->v.set &&
         w.v.t_exposure_ns == v->v.t_exposure_ns && w.sample == v->sample);
    MUST(s->rig_hash == h->start.rig_hash && s->n_cameras == h->start.n_cameras);
    for (k = 0; (g = vol_reader_gap(r, k)) != NULL; k++) {
        same = vol_reader_gap(in, k);
        MUST(same != NULL && same->why == g->why);
    }
    vol_reader_close(&in);
}

/* NAME.json of numbered files, one of which is there: its list made anew says the same of their rate. */
static void list_again(const struct vol_head *h, const struct vol_volume *v)
{
    vol_numbered *n;
    struct pvx_diag d = {""};
    MUST(vol_numbered_again(folder, "a_0001.vdb", "vdb", h, &(struct vol_options){0}, &n, &d) ==
         PVX_OK);
    MUST(vol_numbered_found(n, "a_0001.vdb", &v->v, &d) == PVX_OK);
    MUST(vol_numbered_close(&n, &d) == PVX_OK);
    char *text;
    size_t len;
    MUST(pvx_file_read(numbered, 1 << 20, &text, &len, &d) == PVX_OK);
    cJSON *o = cJSON_ParseWithLength(text, len);
    MUST(cJSON_IsNumber(cJSON_GetObjectItemCaseSensitive(o, "fps")));
    cJSON_Delete(o);
    free(text);
}

static void use(vol_reader *r)
{
    const struct vol_head *h = vol_reader_head(r);
    struct vol_volume v;
    struct pvx_diag d = {""};
    MUST(vol_reader_count(r) == 1 && vol_reader_get(r, 0, &v, &d) == PVX_OK);
    MUST(pvp_grid_valid(&h->start.grid) && pvp_grid_same(&h->start.grid, &v.v.grid));
    static uint64_t last; /* libhdf5 is slow */
    uint64_t this = publish(h, &v);
    if (this != last) {
        record(r, &v);
        remove(again);
    }
    last = this;
    list_again(h, &v);
}

static void repair(void)
{
    struct pvx_diag d = {""};
    struct vol_repaired fixed;
    if (vol_repair_folder(folder, &fixed, &d) != PVX_OK) {
        MUST(d.text[0] != '\0');
        return;
    }
    MUST(fixed.good == 1 && fixed.bad == 0);
    MUST(vol_repair_folder(folder, &fixed, &d) == PVX_OK && !fixed.done);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (npy[0] == '\0')
        make();
    const uint8_t *end = size > 0 ? memchr(data, 0, size) : NULL;
    size_t n = end != NULL ? (size_t)(end - data) : size;
    remove(list);
    MUST(pvx_file_write(json, (const char *)data, n, NULL) == PVX_OK);
    if (end != NULL) {
        MUST(pvx_file_write(list, (const char *)end + 1, size - n - 1, NULL) == PVX_OK);
        MUST(pvx_file_write(numbered, (const char *)end + 1, size - n - 1, NULL) == PVX_OK);
    }
    load_alone();
    vol_reader *r;
    struct pvx_diag d = {""};
    if (vol_reader_open(folder, &r, &d) == PVX_OK) {
        fuzz_taken++;
        use(r);
        vol_reader_close(&r);
        repair();
    } else {
        MUST(r == NULL && d.text[0] != '\0');
    }
    return 0;
}
