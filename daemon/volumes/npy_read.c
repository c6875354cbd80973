/* npy_read.c - reads the folder of npy.c; also folders and single files of `pyrovox reconstruct`. */
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
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
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/folder.h"
#include "recon/solve/solve.h"

#define VERSION 1 /* of recording.json */

#define TEXT_MAX ((size_t)4 << 20)

struct in {
    char *dir; /* NULL: files has the path of one file */
    struct vol_folder files;
    struct pvp_start start;
    char *rig, *config;
    struct vol_gap *gap;
    uint64_t n_gaps;
    struct vol_store store, bars;
    bool spare; /* damaged bars are left out */
};

static bool npy_is(const char *path)
{
    return vol_folder_has(path, ".npy");
}

/* The whole number after "key":, read from the text because a double would lose nanoseconds. */
static int64_t npy_read_whole(const char *text, const char *key)
{
    char quoted[48];
    snprintf(quoted, sizeof quoted, "\"%s\"", key);
    const char *p = strstr(text, quoted);
    if (p == NULL)
        return 0;
    p += strlen(quoted);
    p += strspn(p, ": \t");
    errno = 0;
    long long v = strtoll(p, NULL, 10);
    return errno == 0 ? v : 0;
}

static uint64_t npy_read_hex(const cJSON *o, const char *key)
{
    const char *s = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, key));
    return s != NULL ? strtoull(s, NULL, 16) : 0;
}

static double npy_read_number(const cJSON *o, const char *key)
{
    const cJSON *v = cJSON_GetObjectItemCaseSensitive(o, key);
    return cJSON_IsNumber(v) ? v->valuedouble : NAN;
}

/* A count from the file, which may hold anything. */
static uint32_t npy_read_count(const cJSON *o, const char *key)
{
    double v = npy_read_number(o, key);
    return v >= 0 && v <= UINT32_MAX ? (uint32_t)v : 0;
}

static uint64_t big(const cJSON *o, const char *key)
{
    double v = npy_read_number(o, key);
    return v >= 0 && v < 0x1p63 ? (uint64_t)v : 0;
}

/* The same with all its digits, which stand in the text behind `at`: the double tells whether it is this number. */
static uint64_t npy_read_big(const cJSON *o, const char *key, const char *at)
{
    char quoted[48];
    snprintf(quoted, sizeof quoted, "\"%s\"", key);
    const char *p = at != NULL ? strstr(at, quoted) : NULL;
    uint64_t about = big(o, key), all;
    if (p == NULL)
        return about;
    p += strlen(quoted);
    all = strtoull(p + strspn(p, ": \t"), NULL, 10);
    return (double)all == (double)about ? all : about;
}

static bool npy_read_triple(const cJSON *o, const char *key, double out[3])
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(o, key);
    for (int a = 0; a < 3; a++) {
        const cJSON *v = cJSON_GetArrayItem(list, a);
        if (!cJSON_IsNumber(v) || !isfinite(v->valuedouble) || fabs(v->valuedouble) >= 1e9)
            return false;
        out[a] = v->valuedouble;
    }
    return cJSON_GetArraySize(list) == 3;
}

/* The text up to its first control character, cut to size. */
static void npy_read_text_of(const cJSON *o, const char *key, char *out, size_t size)
{
    const char *s = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, key));
    size_t n = 0;
    while (s != NULL && n + 1 < size && (unsigned char)s[n] >= ' ' && s[n] != 0x7f)
        n++;
    snprintf(out, size, "%.*s", (int)n, s != NULL ? s : "");
}

static uint32_t status_of(const cJSON *report)
{
    const char *s = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(report, "status"));
    for (uint32_t k = 0; s != NULL && k <= REC_EMPTY; k++)
        if (strcmp(s, rec_status_name((enum rec_status)k)) == 0)
            return k;
    return 0;
}

static void read_report(const cJSON *o, struct pvp_report *r)
{
    const cJSON *report = cJSON_GetObjectItemCaseSensitive(o, "report");
    if (report == NULL)
        report = cJSON_GetObjectItemCaseSensitive(o, "solver"); /* of `pyrovox reconstruct` */
    const cJSON *ms = cJSON_GetObjectItemCaseSensitive(report, "ms");
    const struct {
        const char *key;
        int64_t *ns;
    } times[] = {{"photometry", &r->photometry_ns},
                 {"hull", &r->hull_ns},
                 {"restrict", &r->restrict_ns},
                 {"solve", &r->solve_ns},
                 {"total", &r->total_ns}};
    for (size_t k = 0; k < sizeof times / sizeof times[0]; k++) {
        double v = npy_read_number(ms, times[k].key);
        *times[k].ns = fabs(v) < 1e12 ? (int64_t)llround(v * 1e6) : 0;
    }
    r->status = status_of(report);
    npy_read_text_of(report, "solver", r->solver, sizeof r->solver);
    r->iterations = npy_read_count(report, "iterations");
    r->rel_residual = npy_read_number(report, "rel_residual");
    r->active_voxels = npy_read_count(report, "active_voxels");
    r->active_rays = npy_read_count(report, "active_rays");
    r->entries = big(report, "entries");
}

/* Whether the array has the shape that the file says, if it says one. */
static bool npy_read_shaped(const cJSON *o, const size_t shape[4])
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(o, "shape");
    int n = cJSON_GetArraySize(list);
    bool same = list == NULL || n == 4 || (n == 3 && shape[3] == 1);
    for (int a = 0; a < n && same; a++)
        same = cJSON_GetNumberValue(cJSON_GetArrayItem(list, a)) == (double)shape[a];
    return same;
}

static pvx_err read_json(const char *npy, const size_t shape[4], struct vol_volume *out,
                         struct pvp_start *start, bool *barred, struct pvx_diag *d)
{
    char path[PATH_MAX + 8], *text;
    size_t len;
    snprintf(path, sizeof path, "%.*s.json", (int)(strlen(npy) - 4), npy);
    PVX_TRY(pvx_file_read(path, TEXT_MAX, &text, &len, d));
    cJSON *o = cJSON_ParseWithLength(text, len);
    struct pvp_volume *v = &out->v;
    struct pvp_grid *g = &v->grid;
    double h[3];
    const char *basis = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "basis"));
    bool ok = npy_read_triple(o, "origin", g->min) && npy_read_triple(o, "spacing", h) &&
              npy_read_shaped(o, shape) && basis != NULL && h[0] > 0 && h[1] > 0 && h[2] > 0;
    for (int a = 0; a < 3 && ok; a++) {
        g->n[a] = (uint32_t)shape[2 - a];
        g->max[a] = g->min[a] + h[a] * g->n[a];
    }
    if (ok) {
        g->channels = (uint32_t)shape[3];
        ok = pvp_grid_valid(g);
    }
    if (ok) {
        bool wire = cJSON_HasObjectItem(o, "set");
        g->basis = strcmp(basis, "trilinear") == 0;
        v->set = (uint64_t)npy_read_whole(text, wire ? "set" : "frame");
        v->t_exposure_ns = npy_read_whole(text, wire ? "t_exposure_ns" : "time_ns");
        v->t_publish_ns = npy_read_whole(text, "t_publish_ns");
        v->spread_ns = npy_read_whole(text, "spread_ns");
        v->latency_ns = npy_read_whole(text, "latency_ns");
        v->cameras_present = npy_read_count(o, "cameras_present");
        v->camera_mask = npy_read_hex(o, "camera_mask");
        v->session = npy_read_hex(o, "session");
        const char *sample = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "sample"));
        out->sample = sample != NULL && strcmp(sample, "float16") == 0 ? PVP_F16 : PVP_F32;
        out->clamped = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(o, "clamped"));
        read_report(o, &v->report);
        const cJSON *bars = cJSON_GetObjectItemCaseSensitive(o, "bars");
        *barred = bars != NULL; /* else what lies in sd is of another volume of that name */
        out->bars.doubt = npy_read_count(bars, "doubt");
        start->grid = *g;
        start->session = v->session;
        start->rig_hash = npy_read_hex(o, "rig_hash");
        npy_read_text_of(o, "units", start->units, sizeof start->units);
        npy_read_text_of(o, "software", start->software, sizeof start->software);
        if (!wire)
            snprintf(start->units, sizeof start->units, "1/m");
    }
    cJSON_Delete(o);
    free(text);
    return ok ? PVX_OK
              : pvx_fail(d, PVX_EFORMAT,
                         "%s: does not describe the .npy beside it (origin, spacing, basis, shape)",
                         path);
}

/* The .json of a file NUMBER.npy says that number; else it was copied from another one. */
static pvx_err npy_read_numbered(const char *path, uint64_t set, struct pvx_diag *d)
{
    const char *slash = strrchr(path, '/'), *name = slash != NULL ? slash + 1 : path;
    if (strcmp(name + strspn(name, "0123456789"), ".npy") != 0 || strtoull(name, NULL, 10) == set)
        return PVX_OK;
    return pvx_fail(d, PVX_ERANGE,
                    "%s: its .json is of set %llu, of another file; name the two alike after their "
                    "set",
                    path, (unsigned long long)set);
}

/* sd/NAME.npy beside NAME.npy, or NULL: there is none. */
static pvx_err load_sd(const char *npy, const size_t want[4], float **out, struct pvx_diag *d)
{
    char path[PATH_MAX + 8];
    size_t shape[4];
    int ndim;
    *out = NULL;
    if (!vol_sd_path(npy, path, sizeof path) || access(path, F_OK) != 0)
        return PVX_OK;
    PVX_TRY(cap_npy_load(path, out, shape, &ndim, d));
    bool good = ndim >= 3 && memcmp(shape, want, sizeof shape) == 0;
    for (size_t i = 0, n = shape[0] * shape[1] * shape[2] * shape[3]; i < n && good; i++)
        good = (*out)[i] >= 0 && isfinite((*out)[i]);
    if (good)
        return PVX_OK;
    free(*out);
    *out = NULL;
    return pvx_fail(d, PVX_ECORRUPT,
                    "%s: is not a deviation, of 0 or more, for each value of the .npy beside it; "
                    "move it away to read the volume without error bars",
                    path);
}

/* The bricks of the volume and of its bars. */
static pvx_err npy_read_bricks(struct in *r, const char *path, const size_t shape[4],
                               const float *dense, bool barred, struct vol_volume *out,
                               struct pvx_diag *d)
{
    float *sd = NULL;
    const struct pvp_grid *g = &out->v.grid;
    pvx_err es = barred ? load_sd(path, shape, &sd, d) : PVX_OK;
    const bool less = r->spare && vol_damaged(es);
    if (es != PVX_OK && !less)
        return es;
    pvx_err e = sd != NULL ? vol_from_dense_bars(&r->store, &r->bars, g, dense, sd)
                           : vol_from_dense(&r->store, g, dense);
    out->bars = (struct vol_bars){.sd = sd != NULL ? r->bars.brick : NULL,
                                  .doubt = sd != NULL ? out->bars.doubt : 0,
                                  .damaged = less};
    free(sd);
    return e == PVX_ECORRUPT ? pvx_fail(d, e, "%s: holds a value that is not finite", path) : e;
}

static pvx_err npy_read_load(struct in *r, uint64_t k, struct vol_volume *out,
                             struct pvp_start *start, struct pvx_diag *d)
{
    char path[PATH_MAX];
    size_t shape[4];
    int ndim;
    float *dense;
    bool barred = false;
    snprintf(path, sizeof path, "%s%s%s", r->dir != NULL ? r->dir : "", r->dir != NULL ? "/" : "",
             r->files.name[k]);
    PVX_TRY(cap_npy_load(path, &dense, shape, &ndim, d));
    pvx_err e = PVX_OK;
    *out = (struct vol_volume){.sample = PVP_F32};
    for (int a = 0; a < 3; a++)
        if (ndim < 3 || shape[a] < 1 || shape[a] > PVP_GRID_MAX)
            e = PVX_EFORMAT;
    if (e != PVX_OK || (shape[3] != 1 && shape[3] != 3))
        e = pvx_fail(d, PVX_EFORMAT, "%s: a volume is [nz][ny][nx] or [nz][ny][nx][1 or 3]", path);
    PVX_THEN(e, read_json(path, shape, out, start, &barred, d));
    PVX_THEN(e, npy_read_numbered(path, out->v.set, d));
    PVX_THEN(e, npy_read_bricks(r, path, shape, dense, barred, out, d));
    free(dense);
    out->n_bricks = r->store.n;
    out->ids = r->store.ids;
    out->brick = r->store.brick;
    return e;
}

static char *text_file(const char *dir, const char *name)
{
    char path[1200], *text = NULL;
    size_t len;
    snprintf(path, sizeof path, "%s/%s", dir, name);
    return pvx_file_read(path, TEXT_MAX, &text, &len, NULL) == PVX_OK ? text : NULL;
}

/* *cut: it was not closed. */
static pvx_err read_list(struct in *r, const char *dir, bool *cut, struct pvx_diag *d)
{
    char *text = text_file(dir, "recording.json");
    cJSON *o = text != NULL ? cJSON_Parse(text) : NULL;
    if (o == NULL) {
        free(text);
        return PVX_OK; /* of `pyrovox reconstruct`, or of an earlier version */
    }
    double version = npy_read_number(o, "version");
    if (version > VERSION) {
        cJSON_Delete(o);
        free(text);
        return pvx_fail(d, PVX_EFORMAT,
                        "%s/recording.json: version %g of the layout; this program reads %d: "
                        "update it",
                        dir, version, VERSION);
    }
    *cut = !cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(o, "closed"));
    double fps = npy_read_number(o, "fps");
    r->start.fps = isfinite(fps) && fps >= 0 ? fps : 0;
    uint32_t cameras = npy_read_count(o, "n_cameras");
    r->start.n_cameras = cameras <= PVP_CAMERAS_MAX ? cameras : 0;
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(o, "gaps"), *g;
    r->gap = pvx_calloc((size_t)cJSON_GetArraySize(list), sizeof *r->gap);
    const char *at = strstr(text, "\"gaps\"");
    cJSON_ArrayForEach(g, list)
    {
        at = at != NULL ? strchr(at + 1, '{') : NULL;
        const char *why = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(g, "why"));
        if (r->gap == NULL || why == NULL)
            break;
        int known = VOL_GAPS - 1;
        while (known > VOL_GAP_LOST && strcmp(why, vol_gap_names[known]) != 0)
            known--;
        r->gap[r->n_gaps++] = (struct vol_gap){.why = (enum vol_gap_why)known,
                                               .set_first = npy_read_big(g, "set_first", at),
                                               .set_last = npy_read_big(g, "set_last", at),
                                               .volumes = npy_read_big(g, "volumes", at)};
    }
    cJSON_Delete(o);
    free(text);
    return r->gap != NULL ? PVX_OK : PVX_ENOMEM;
}

static void npy_read_npy_close(void *self)
{
    struct in *r = self;
    vol_folder_free(&r->files);
    free(r->dir);
    free(r->rig);
    free(r->config);
    free(r->gap);
    vol_store_free(&r->store);
    vol_store_free(&r->bars);
    free(r);
}

static pvx_err npy_read_find(struct in *r, const char *path, struct pvx_diag *d)
{
    struct stat st;
    if (stat(path, &st) == 0 && S_ISDIR(st.st_mode)) {
        r->dir = strdup(path);
        PVX_TRY(vol_folder_list(path, ".npy", &r->files, d));
        return r->dir != NULL ? PVX_OK : PVX_ENOMEM;
    }
    r->files.name = pvx_calloc(1, sizeof *r->files.name);
    if (r->files.name == NULL || (r->files.name[0] = strdup(path)) == NULL)
        return PVX_ENOMEM;
    r->files.n = 1;
    return PVX_OK;
}

/* The head: as the first file says that is not damaged. */
static pvx_err npy_read_first(struct in *r, struct pvx_diag *d)
{
    struct vol_volume v;
    struct pvx_diag first = {""};
    pvx_err e = PVX_OK, why = PVX_ENOENT;
    r->spare = true;
    for (size_t k = 0; k < r->files.n; k++) {
        struct pvx_diag one = {""};
        e = npy_read_load(r, k, &v, &r->start, &one);
        if (!vol_damaged(e)) {
            r->spare = false;
            return e == PVX_OK ? e : pvx_fail(d, e, "%s", pvx_diag_text(&one, e));
        }
        if (k == 0) {
            first = one;
            why = e;
        }
    }
    return pvx_fail(d, why, "%s", pvx_diag_text(&first, why));
}

static pvx_err npy_read_npy_open(void **self, const char *path, struct vol_head *head, uint64_t *n,
                                 bool *cut, struct pvx_diag *d)
{
    struct in *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    pvx_err e = npy_read_find(r, path, d);
    PVX_THEN(e, npy_read_first(r, d));
    if (e == PVX_OK && r->dir != NULL) {
        r->rig = text_file(path, "rig.yaml");
        r->config = text_file(path, "config.yaml");
        e = read_list(r, path, cut, d);
    }
    if (e != PVX_OK) {
        npy_read_npy_close(r);
        return e;
    }
    *head = (struct vol_head){.start = r->start, .rig = r->rig, .config = r->config};
    *n = r->files.n;
    *self = r;
    return PVX_OK;
}

static pvx_err npy_get(void *self, uint64_t k, struct vol_volume *out, struct pvx_diag *d)
{
    struct in *r = self;
    struct pvp_start start;
    PVX_TRY(npy_read_load(r, k, out, &start, d));
    return pvp_grid_same(&out->v.grid, &r->start.grid)
               ? PVX_OK
               : pvx_fail(d, PVX_ERANGE,
                          "%s: set %llu: its grid is not that of the volumes before it: of another "
                          "recording",
                          r->dir, (unsigned long long)out->v.set);
}

static const struct vol_gap *npy_read_npy_gap(const void *self, uint64_t k)
{
    const struct in *r = self;
    return k < r->n_gaps ? &r->gap[k] : NULL;
}

static void npy_spare(void *self, uint64_t *count, bool *cut)
{
    (void)count; /* all files count */
    (void)cut;
    ((struct in *)self)->spare = true;
}

const struct vol_reader_ops vol_npy_reader = {.is = npy_is,
                                              .open = npy_read_npy_open,
                                              .get = npy_get,
                                              .gap = npy_read_npy_gap,
                                              .spare = npy_spare,
                                              .close = npy_read_npy_close};
