#include "daemon/pipeline/volume_file.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "daemon/volumes/folder.h"
#include "proto/pvp.h"

static double volume_file_ms(int64_t ns)
{
    return (double)(ns / 1000) * 1e-3; /* whole microseconds */
}

static cJSON *volume_file_pair(const float v[2])
{
    return cJSON_CreateFloatArray(v, 2);
}

void dmn_selfcal_to_json(cJSON *o, const struct rec_selfcal_report *r)
{
    cJSON *to = cJSON_AddObjectToObject(o, "selfcal");
    cJSON_AddNumberToObject(to, "sets", r->sets);
    cJSON_AddBoolToObject(to, "gain", r->gain);
    cJSON_AddBoolToObject(to, "shift", r->shift);
    cJSON_AddItemToObject(to, "sigmas", cJSON_CreateDoubleArray(r->test, 2));
    cJSON *list = cJSON_AddArrayToObject(to, "cameras");
    for (uint32_t c = 0; c < r->cameras; c++) {
        const struct rec_selfcal_camera *k = &r->camera[c];
        cJSON *one = k->known ? cJSON_CreateObject() : cJSON_CreateNull();
        cJSON_AddItemToArray(list, one);
        if (!k->known)
            continue;
        cJSON_AddNumberToObject(one, "gain", (double)k->gain);
        cJSON_AddNumberToObject(one, "gain_error", (double)k->gain_error);
        cJSON_AddItemToObject(one, "shift_px", volume_file_pair(k->shift));
        cJSON_AddItemToObject(one, "shift_error_px", volume_file_pair(k->shift_error));
    }
}

void dmn_report_to_json(cJSON *o, const struct rec_frame_report *r)
{
    cJSON_AddStringToObject(o, "solver", r->solve.solver != NULL ? r->solve.solver : "");
    cJSON_AddStringToObject(o, "status", rec_status_name(r->solve.status));
    cJSON_AddNumberToObject(o, "iterations", r->solve.iterations);
    cJSON_AddNumberToObject(o, "blended_iterations", r->solve.blended);
    cJSON_AddNumberToObject(o, "coarse_iterations", r->coarse_iterations);
    cJSON_AddNumberToObject(o, "best_iteration", r->solve.best);
    cJSON_AddNumberToObject(o, "rel_residual", r->solve.rel_residual);
    cJSON_AddNumberToObject(o, "lambda", r->solve.lambda);
    cJSON_AddNumberToObject(o, "active_voxels", (double)r->active_voxels);
    cJSON_AddNumberToObject(o, "active_rays", (double)r->active_rays);
    cJSON_AddNumberToObject(o, "entries", (double)r->entries);
    cJSON_AddNumberToObject(o, "cameras", r->cameras);
    cJSON_AddNumberToObject(o, "sigma", r->sigma);
    if (r->absorption > 0)
        cJSON_AddNumberToObject(o, "absorption", r->absorption);
    cJSON_AddNumberToObject(o, "saturated", r->saturated);
    cJSON_AddNumberToObject(o, "not_finite", r->not_finite);
    cJSON *hull = cJSON_AddObjectToObject(o, "hull");
    cJSON_AddNumberToObject(hull, "inside", (double)r->hull.inside);
    cJSON_AddNumberToObject(hull, "partial", (double)r->hull.partial);
    cJSON_AddNumberToObject(hull, "outside", (double)r->hull.outside);
    if (r->selfcal.cameras > 0)
        dmn_selfcal_to_json(o, &r->selfcal);
    cJSON *t = cJSON_AddObjectToObject(o, "ms");
    cJSON_AddNumberToObject(t, "photometry", volume_file_ms(r->photo_ns));
    cJSON_AddNumberToObject(t, "vote", volume_file_ms(r->vote_ns));
    cJSON_AddNumberToObject(t, "hull", volume_file_ms(r->hull_ns));
    cJSON_AddNumberToObject(t, "restrict", volume_file_ms(r->restrict_ns));
    cJSON_AddNumberToObject(t, "solve", volume_file_ms(r->solve_ns));
    cJSON_AddNumberToObject(t, "total", volume_file_ms(rec_frame_total_ns(r)));
}

/* "x.npy" -> "x.json". */
static pvx_err sidecar(const char *path, char *out, size_t size, struct pvx_diag *d)
{
    size_t n = strlen(path);
    if (!pvx_path_ends(path, ".npy"))
        return pvx_fail(d, PVX_EINVAL, "%s: a volume's file name ends in .npy", path);
    if (n + 2 > size)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", path);
    memcpy(out, path, n - 4);
    memcpy(out + n - 4, ".json", 6);
    return PVX_OK;
}

static cJSON *volume_file_describe(const char *path, const struct dmn_volume_meta *m)
{
    const struct rec_grid *g = &m->grid;
    const char *slash = strrchr(path, '/');
    double spacing[3] = {rec_grid_h(g, 0), rec_grid_h(g, 1), rec_grid_h(g, 2)};
    int shape[4] = {g->n[2], g->n[1], g->n[0], m->nch};
    cJSON *o = cJSON_CreateObject();
    cJSON_AddStringToObject(o, "format", "pyrovox volume");
    cJSON_AddNumberToObject(o, "version", 1);
    cJSON_AddStringToObject(o, "file", slash != NULL ? slash + 1 : path);
    cJSON_AddItemToObject(o, "shape", cJSON_CreateIntArray(shape, 4));
    cJSON_AddStringToObject(o, "axes", "z y x channel");
    cJSON_AddItemToObject(o, "origin", cJSON_CreateDoubleArray(g->min, 3));
    cJSON_AddItemToObject(o, "spacing", cJSON_CreateDoubleArray(spacing, 3));
    cJSON_AddItemToObject(o, "min", cJSON_CreateDoubleArray(g->min, 3));
    cJSON_AddItemToObject(o, "max", cJSON_CreateDoubleArray(g->max, 3));
    cJSON_AddStringToObject(o, "basis", rec_basis_name(g->basis));
    cJSON_AddStringToObject(o, "units",
                            "emission per metre; 1.0 over 1 m is a pixel at full scale");
    char whole[24]; /* as text: a double would lose nanoseconds */
    snprintf(whole, sizeof whole, "%lld", (long long)m->frame);
    cJSON_AddRawToObject(o, "frame", whole);
    snprintf(whole, sizeof whole, "%lld", (long long)m->time_ns);
    cJSON_AddRawToObject(o, "time_ns", whole);
    cJSON_AddStringToObject(o, "clock", m->clock);
    if (m->bars) { /* as the recorder writes it (daemon/volumes/npy.c) */
        cJSON *bars = cJSON_AddObjectToObject(o, "bars");
        cJSON_AddNumberToObject(bars, "doubt", m->doubt);
        cJSON *names = cJSON_AddArrayToObject(bars, "doubts");
        for (unsigned b = 0; pvp_doubt_name(b) != NULL; b++)
            if ((m->doubt >> b & 1) != 0)
                cJSON_AddItemToArray(names, cJSON_CreateString(pvp_doubt_name(b)));
    }
    if (m->report != NULL)
        dmn_report_to_json(cJSON_AddObjectToObject(o, "solver"), m->report);
    return o;
}

static pvx_err save_bars(const char *path, const float *sd, const size_t shape[4],
                         struct pvx_diag *d)
{
    char bars[PATH_MAX], *slash;
    if (!vol_sd_path(path, bars, sizeof bars) || (slash = strrchr(bars, '/')) == NULL)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", path);
    *slash = '\0';
    PVX_TRY(pvx_mkdirs(bars, d));
    *slash = '/';
    return cap_npy_save(bars, sd, shape, 4, d);
}

pvx_err dmn_volume_save(const char *path, const struct dmn_volume_meta *m, const float *dense,
                        const float *sd, struct pvx_diag *d)
{
    char json[PATH_MAX];
    PVX_TRY(sidecar(path, json, sizeof json, d));
    cJSON *o = volume_file_describe(path, m);
    char *text = cJSON_Print(o);
    cJSON_Delete(o);
    if (text == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", json);
    pvx_err e = pvx_file_write(json, text, strlen(text), d);
    cJSON_free(text);
    if (e != PVX_OK)
        return e;
    size_t shape[4] = {(size_t)m->grid.n[2], (size_t)m->grid.n[1], (size_t)m->grid.n[0],
                       (size_t)m->nch};
    if (m->bars)
        PVX_TRY(save_bars(path, sd, shape, d));
    return cap_npy_save(path, dense, shape, 4, d);
}

static bool volume_file_numbers(const cJSON *array, double out[3])
{
    if (cJSON_GetArraySize(array) != 3)
        return false;
    for (int a = 0; a < 3; a++) {
        const cJSON *v = cJSON_GetArrayItem(array, a);
        if (!cJSON_IsNumber(v) || !isfinite(v->valuedouble))
            return false;
        out[a] = v->valuedouble;
    }
    return true;
}

/* Box and basis from the description; the grid keeps its own when the file is not there. */
static pvx_err read_sidecar(const char *json, const double shape[4], struct rec_grid *g,
                            struct pvx_diag *d)
{
    char *text;
    size_t len;
    pvx_err e = pvx_file_read(json, 1 << 20, &text, &len, NULL);
    if (e == PVX_ENOENT)
        return PVX_OK;
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: %s", json, pvx_strerror(e));
    cJSON *o = cJSON_ParseWithLength(text, len);
    free(text);
    double h[3];
    const char *basis = cJSON_GetStringValue(cJSON_GetObjectItem(o, "basis"));
    bool ok = volume_file_numbers(cJSON_GetObjectItem(o, "origin"), g->min) &&
              volume_file_numbers(cJSON_GetObjectItem(o, "spacing"), h) && basis != NULL &&
              (strcmp(basis, "box") == 0 || strcmp(basis, "trilinear") == 0) && h[0] > 0 &&
              h[1] > 0 && h[2] > 0;
    if (ok) {
        g->basis = strcmp(basis, "box") == 0 ? REC_BOX : REC_TRILINEAR;
        for (int a = 0; a < 3; a++) {
            g->max[a] = g->min[a] + h[a] * shape[a];
            ok &= isfinite(g->max[a]) &&
                  g->max[a] > g->min[a]; /* a spacing may be lost in rounding */
        }
        /* the shape of the .npy counts; if the .json gives one too, they must agree */
        const cJSON *s = cJSON_GetObjectItem(o, "shape");
        int n = cJSON_GetArraySize(s);
        ok &= s == NULL || n == 4 || (n == 3 && shape[3] == 1);
        for (int a = 0; a < n && ok; a++)
            ok = cJSON_GetNumberValue(cJSON_GetArrayItem(s, a)) == shape[a < 3 ? 2 - a : 3];
    }
    cJSON_Delete(o);
    return ok ? PVX_OK
              : pvx_fail(d, PVX_EFORMAT,
                         "%s: does not describe the .npy beside it (origin, spacing, basis, shape)",
                         json);
}

pvx_err dmn_volume_load(const char *path, struct rec_grid *grid, int *nch, float **dense,
                        struct pvx_diag *d)
{
    char json[PATH_MAX];
    size_t shape[4];
    int ndim;
    PVX_TRY(sidecar(path, json, sizeof json, d));
    PVX_TRY(cap_npy_load(path, dense, shape, &ndim, d));
    pvx_err e = PVX_OK;
    if (ndim < 3 || (shape[3] != 1 && shape[3] != 3))
        e = pvx_fail(d, PVX_EFORMAT, "%s: a volume is [nz][ny][nx] or [nz][ny][nx][1 or 3]", path);
    for (int a = 0; a < 3 && e == PVX_OK; a++)
        if (shape[a] > REC_GRID_MAX)
            e = pvx_fail(d, PVX_ERANGE, "%s: %zu voxels along an axis; %d is the most", path,
                         shape[a], REC_GRID_MAX);
    if (e == PVX_OK) {
        for (int a = 0; a < 3; a++)
            grid->n[a] = (int32_t)shape[2 - a];
        *nch = (int)shape[3];
        e = read_sidecar(json, (double[4]){grid->n[0], grid->n[1], grid->n[2], *nch}, grid, d);
    }
    if (e != PVX_OK) {
        free(*dense);
        *dense = NULL;
    }
    return e;
}
