/* npy.c - a folder: SET.npy, float32 [nz][ny][nx][channels], and SET.json beside it, each pair whole or not
 * there; sd/SET.npy with its error bars, if it has any; and recording.json with the gaps, rig.yaml and config.yaml as far as they are known. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cjson/cJSON.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/control/json.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/folder.h"
#include "recon/solve/solve.h"

static void npy_triple(struct dmn_json *j, const char *key, const double v[3])
{
    dmn_json_open(j, key, '[');
    for (int a = 0; a < 3; a++)
        dmn_json_exact(j, NULL, v[a]);
    dmn_json_close(j, ']');
}

/* 64 bits as text: many JSON readers keep numbers as doubles. */
static void npy_hex(struct dmn_json *j, const char *key, uint64_t v)
{
    char text[20];
    snprintf(text, sizeof text, "%016llx", (unsigned long long)v);
    dmn_json_str(j, key, text);
}

/* The number comes from outside and may be any. */
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
    dmn_json_exact(j, "rel_residual", r->rel_residual);
    dmn_json_int(j, "active_voxels", r->active_voxels);
    dmn_json_int(j, "active_rays", r->active_rays);
    dmn_json_int(j, "entries", (long long)r->entries);
    dmn_json_open(j, "ms", '{');
    for (size_t i = 0; i < sizeof ms / sizeof ms[0]; i++)
        dmn_json_exact(j, ms[i].key, (double)ms[i].ns * 1e-6);
    dmn_json_close(j, '}');
    dmn_json_close(j, '}');
}

/* Names of the doubts about the error bars in sd/SET.npy. */
static void put_bars(struct dmn_json *j, uint32_t doubt)
{
    dmn_json_open(j, "bars", '{');
    dmn_json_int(j, "doubt", doubt);
    dmn_json_open(j, "doubts", '[');
    for (unsigned bit = 0; pvp_doubt_name(bit) != NULL; bit++)
        if ((doubt >> bit & 1) != 0)
            dmn_json_str(j, NULL, pvp_doubt_name(bit));
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

static size_t npy_describe(const struct vol_volume *vol, const struct pvp_start *start, char *text,
                           size_t size)
{
    const struct pvp_volume *v = &vol->v;
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
    npy_triple(&j, "origin", g->min); /* corner of the box, x y z, m */
    npy_triple(&j, "spacing", spacing);
    dmn_json_str(&j, "basis", g->basis == 1 ? "trilinear" : "box");
    dmn_json_str(&j, "units", start->units);
    dmn_json_int(&j, "t_exposure_ns", v->t_exposure_ns);
    dmn_json_int(&j, "t_publish_ns", v->t_publish_ns);
    dmn_json_int(&j, "spread_ns", v->spread_ns);
    dmn_json_int(&j, "latency_ns", v->latency_ns);
    dmn_json_int(&j, "cameras_present", v->cameras_present);
    npy_hex(&j, "camera_mask", v->camera_mask);
    npy_hex(&j, "session", v->session);
    npy_hex(&j, "rig_hash", start->rig_hash);
    dmn_json_str(&j, "software", start->software);
    dmn_json_str(&j, "sample", vol->sample == PVP_F16 ? "float16" : "float32");
    dmn_json_bool(&j, "clamped", vol->clamped);
    if (vol->bars.sd != NULL)
        put_bars(&j, vol->bars.doubt);
    put_report(&j, &v->report);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

#define LIST "recording.json"

/* ---- writing ---- */

struct gaps {
    struct vol_gap *gap;
    uint64_t n, room;
};

static pvx_err gaps_add(struct gaps *l, const struct vol_gap *g)
{
    if (l->n == l->room) {
        uint64_t room = l->room > 0 ? 2 * l->room : 16;
        struct vol_gap *more = realloc(l->gap, room * sizeof *more);
        PVX_NEED(more);
        l->gap = more;
        l->room = room;
    }
    l->gap[l->n++] = *g;
    return PVX_OK;
}

struct out {
    char *dir;
    struct pvp_start start;
    struct gaps gaps;
    float *dense;
    size_t count;
    uint64_t bytes;
};

/* All digits, where cJSON's own numbers are doubles. */
static void npy_whole(cJSON *o, const char *key, uint64_t v)
{
    char text[24];
    snprintf(text, sizeof text, "%llu", (unsigned long long)v);
    cJSON_AddRawToObject(o, key, text);
}

void vol_npy_put_gap(cJSON *list, const struct vol_gap *g)
{
    cJSON *one = cJSON_CreateObject();
    cJSON_AddStringToObject(one, "why", vol_gap_names[g->why]);
    npy_whole(one, "set_first", g->set_first);
    npy_whole(one, "set_last", g->set_last);
    npy_whole(one, "volumes", g->volumes);
    cJSON_AddItemToArray(list, one);
}

static char *list_text(const struct out *w, bool closed)
{
    const struct pvp_start *s = &w->start;
    cJSON *o = cJSON_CreateObject(), *list = cJSON_CreateArray();
    char hash[20];
    snprintf(hash, sizeof hash, "%016llx", (unsigned long long)s->session);
    cJSON_AddStringToObject(o, "format", "pyrovox volumes");
    cJSON_AddNumberToObject(o, "version", 1);
    cJSON_AddStringToObject(o, "session", hash);
    cJSON_AddNumberToObject(o, "fps", s->fps);
    cJSON_AddNumberToObject(o, "n_cameras", s->n_cameras);
    cJSON_AddBoolToObject(o, "closed", closed);
    for (uint64_t k = 0; k < w->gaps.n; k++)
        vol_npy_put_gap(list, &w->gaps.gap[k]);
    cJSON_AddItemToObject(o, "gaps", list);
    char *text = cJSON_Print(o);
    cJSON_Delete(o);
    return text;
}

static pvx_err npy_put_list(const struct out *w, bool closed, struct pvx_diag *d)
{
    char path[1200];
    char *text = list_text(w, closed);
    PVX_NEED(text);
    snprintf(path, sizeof path, "%s/" LIST, w->dir);
    pvx_err e = pvx_file_write(path, text, strlen(text), d);
    cJSON_free(text);
    return e;
}

/* Make the folder.  An earlier recording is neither overwritten nor mixed with. */
static pvx_err make_dir(const char *dir, struct pvx_diag *d)
{
    PVX_TRY(pvx_mkdirs(dir, d));
    return vol_folder_has(dir, ".npy")
               ? pvx_fail(d, PVX_EBUSY,
                          "%s: holds volumes of an earlier recording; name another folder", dir)
               : PVX_OK;
}

static pvx_err npy_put_text(const struct out *w, const char *name, const char *text,
                            struct pvx_diag *d)
{
    char path[1200];
    if (text == NULL || text[0] == '\0')
        return PVX_OK;
    snprintf(path, sizeof path, "%s/%s", w->dir, name);
    return pvx_file_write(path, text, strlen(text), d);
}

static void npy_free_out(struct out *w)
{
    free(w->dir);
    free(w->dense);
    free(w->gaps.gap);
    free(w);
}

static pvx_err volumes_npy_open(void **self, const char *path, const struct vol_head *head,
                                const struct vol_options *o, struct pvx_diag *d)
{
    (void)o;
    struct out *w = pvx_calloc(1, sizeof *w);
    PVX_NEED(w);
    w->start = head->start;
    w->count = pvp_grid_count(&head->start.grid);
    w->dir = strdup(path);
    w->dense = malloc(w->count * sizeof *w->dense);
    pvx_err e = w->dir != NULL && w->dense != NULL && strlen(path) < 1024
                    ? make_dir(path, d)
                    : pvx_fail(d, PVX_ENOMEM, "%s: no memory for a volume", path);
    PVX_THEN(e, npy_put_text(w, "rig.yaml", head->rig, d));
    PVX_THEN(e, npy_put_text(w, "config.yaml", head->config, d));
    PVX_THEN(e, npy_put_list(w, false, d));
    if (e != PVX_OK) {
        npy_free_out(w);
        return e;
    }
    *self = w;
    return PVX_OK;
}

static pvx_err put_sd(struct out *w, const struct vol_volume *v, const size_t shape[4],
                      struct pvx_diag *d)
{
    char path[1100];
    struct vol_volume bars = *v;
    bars.brick = v->bars.sd;
    if (bars.brick == NULL)
        return PVX_OK;
    snprintf(path, sizeof path, "%s/" VOL_SD, w->dir);
    PVX_TRY(pvx_mkdirs(path, d));
    snprintf(path, sizeof path, "%s/" VOL_SD "/%06llu.npy", w->dir, (unsigned long long)v->v.set);
    memset(w->dense, 0, w->count * sizeof *w->dense);
    vol_to_dense(&bars, w->dense);
    w->bytes += w->count * sizeof *w->dense;
    return cap_npy_save(path, w->dense, shape, 4, d);
}

static pvx_err npy_put(void *self, const struct vol_volume *v, struct pvx_diag *d)
{
    struct out *w = self;
    const struct pvp_grid *g = &v->v.grid;
    char path[1100], npy[1100], text[4096];
    size_t shape[4] = {g->n[2], g->n[1], g->n[0], g->channels};
    unsigned long long set = v->v.set;
    snprintf(npy, sizeof npy, "%s/%06llu.npy", w->dir, set);
    snprintf(path, sizeof path, "%s/%06llu.json", w->dir, set);
    size_t len = npy_describe(v, &w->start, text, sizeof text - 1);
    if (len == 0)
        return pvx_fail(d, PVX_ERANGE, "%s: description longer than %zu bytes", path, sizeof text);
    text[len++] = '\n';
    PVX_TRY(pvx_file_write(path, text, len, d));
    pvx_err e = put_sd(w, v, shape, d);
    memset(w->dense, 0, w->count * sizeof *w->dense);
    vol_to_dense(v, w->dense);
    /* last: a volume that is there is described */
    PVX_THEN(e, cap_npy_save(npy, w->dense, shape, 4, d));
    if (e != PVX_OK)
        unlink(path);
    else
        w->bytes += w->count * sizeof *w->dense + len;
    return e;
}

/* The list is written when the number of gaps has doubled, and at the end, so that n gaps do not cost n squared. */
static pvx_err volumes_npy_gap(void *self, const struct vol_gap *g, struct pvx_diag *d)
{
    struct out *w = self;
    PVX_TRY(gaps_add(&w->gaps, g));
    return (w->gaps.n & (w->gaps.n - 1)) == 0 ? npy_put_list(w, false, d) : PVX_OK;
}

static uint64_t npy_bytes(const void *self)
{
    return ((const struct out *)self)->bytes;
}

static pvx_err volumes_npy_close(void *self, struct pvx_diag *d)
{
    pvx_err e = npy_put_list(self, true, d);
    npy_free_out(self);
    return e;
}

const struct vol_writer_ops vol_npy_writer = {.check = make_dir,
                                              .open = volumes_npy_open,
                                              .put = npy_put,
                                              .gap = volumes_npy_gap,
                                              .bytes = npy_bytes,
                                              .close = volumes_npy_close};
