#include "daemon/pipeline/photometry.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"

#define MAP_BYTES_MAX ((size_t)4 << 30) /* 16384 x 16384 pixels of one channel and a head fit */

struct dmn_photometry {
    struct light {
        bool acts;
        float *dark, *flat;
        uint8_t *mask;
        double response[REC_RESPONSE_MAX], matrix[9];
        struct cap_photometry of;
    } camera[REC_MAX_CAMERAS];
};

/* Path of a file that rig.yaml names relative to its own folder. */
static void photometry_beside(const char *rig_path, const char *file, char *out, size_t size)
{
    const char *slash = strrchr(rig_path, '/');
    if (file[0] == '/' || slash == NULL)
        snprintf(out, size, "%s", file);
    else
        snprintf(out, size, "%.*s/%s", (int)(slash - rig_path), rig_path, file);
}

/* Folder of a file, without symbolic links and with a slash at its end.  out[PATH_MAX + 1]. */
static pvx_err folder_of(const char *path, char *out, struct pvx_diag *d)
{
    char name[PATH_MAX];
    const char *slash = strrchr(path, '/');
    snprintf(name, sizeof name, "%.*s", slash == NULL ? 1 : (int)(slash - path) + 1,
             slash == NULL ? "." : path);
    if (realpath(name, out) == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", name, strerror(errno));
    size_t n = strlen(out);
    if (n > 1) { /* realpath leaves room for it */
        out[n] = '/';
        out[n + 1] = '\0';
    }
    return PVX_OK;
}

/* From one folder to another: "", or "../" as often as needed and the rest. */
static void way_between(const char *from, const char *to, char *out, size_t size)
{
    size_t same = 0, n = 0;
    for (size_t i = 0; from[i] != '\0' && from[i] == to[i]; i++)
        if (from[i] == '/')
            same = i + 1;
    out[0] = '\0';
    for (const char *s = from + same; *s != '\0'; s++)
        if (*s == '/' && n + 3 < size)
            n += (size_t)snprintf(out + n, size - n, "../");
    snprintf(out + n, size - n, "%s", to + same);
}

pvx_err dmn_photometry_move(struct rec_rig *rig, const char *from, const char *to,
                            struct pvx_diag *d)
{
    char old[PATH_MAX + 1], new[PATH_MAX + 1], way[2 * PATH_MAX], name[3 * PATH_MAX];
    PVX_TRY(folder_of(from, old, d));
    if (to != NULL)
        PVX_TRY(folder_of(to, new, d));
    if (to != NULL)
        way_between(new, old, way, sizeof way);
    else
        snprintf(way, sizeof way, "%s", old);
    for (size_t c = 0; c < rig->n_cameras && way[0] != '\0'; c++) {
        struct rec_photometry *of = &rig->cameras[c].photometry;
        char *file[] = {of->dark.file, of->flat.file, of->mask};
        for (size_t i = 0; i < sizeof file / sizeof *file; i++) {
            if (file[i][0] == '\0' || file[i][0] == '/')
                continue;
            snprintf(name, sizeof name, "%s%s", way, file[i]);
            if (strlen(name) >= REC_MAP_FILE_MAX || strpbrk(way, "\"\\") != NULL)
                return pvx_fail(d, PVX_ERANGE,
                                "%s: camera %s: its map would be called %s, which no rig can hold: "
                                "write the rig beside %s",
                                to != NULL ? to : from, rig->cameras[c].name, name, from);
            snprintf(file[i], REC_MAP_FILE_MAX, "%.*s", REC_MAP_FILE_MAX - 1, name);
        }
    }
    return PVX_OK;
}

pvx_err dmn_photometry_hash(const char *path, uint64_t *out, struct pvx_diag *d)
{
    char *bytes;
    size_t n;
    PVX_TRY(pvx_file_read(path, MAP_BYTES_MAX, &bytes, &n, d));
    *out = XXH3_64bits(bytes, n);
    free(bytes);
    return PVX_OK;
}

static pvx_err photometry_read_map(const char *rig_path, const struct rec_camera *k,
                                   const struct rec_map *m, float **out, int *channels,
                                   struct pvx_diag *d)
{
    char path[PATH_MAX], *bytes;
    size_t len, shape[4];
    int ndim;
    struct pvx_diag why = {""};
    photometry_beside(rig_path, m->file, path, sizeof path);
    pvx_err e = pvx_file_read(path, MAP_BYTES_MAX, &bytes, &len, &why);
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: camera %s: %s", rig_path, k->name, pvx_diag_text(&why, e));
    if (XXH3_64bits(bytes, len) != m->hash)
        e = pvx_fail(d, PVX_ECORRUPT,
                     "%s: camera %s: %s is not the file that this rig was made with: put that one "
                     "back, or measure anew (pyrovox calibrate dark, flat)",
                     rig_path, k->name, path);
    PVX_THEN(e, cap_npy_parse(bytes, len, path, out, shape, &ndim, d));
    free(bytes);
    if (e != PVX_OK)
        return e;
    int has = ndim == 3 ? (int)shape[2] : 1;
    bool fits = (ndim == 2 || (ndim == 3 && (has == 1 || has == 3))) &&
                shape[0] == (size_t)k->height && shape[1] == (size_t)k->width;
    if (!fits || (*channels != 0 && has != *channels))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: camera %s: %s has %zux%zu pixels of %d channels, but the camera takes "
                        "%dx%d: measure anew (pyrovox calibrate dark, flat)",
                        rig_path, k->name, path, shape[1], shape[0], has, k->width, k->height);
    *channels = has;
    return PVX_OK;
}

/* A pixel darker than half in every channel is covered.  The limit is not black, since drawings have soft edges. */
static void covered(const struct cap_image *img, uint8_t *mask)
{
    int channels = cap_pixfmt_channels(img->fmt);
    size_t n = (size_t)img->width * (size_t)img->height;
    for (size_t i = 0; i < n; i++) {
        mask[i] = 0;
        for (int c = 0; c < channels; c++) {
            size_t at = i * (size_t)channels + (size_t)c;
            mask[i] |= img->fmt == CAP_GREY8 || img->fmt == CAP_RGB8
                           ? ((const uint8_t *)img->data)[at] >= 128
                       : img->fmt == CAP_GREY16 || img->fmt == CAP_RGB16
                           ? ((const uint16_t *)img->data)[at] >= 32768
                           : ((const float *)img->data)[at] >= 0.5F;
        }
    }
}

static pvx_err read_mask(const char *rig_path, const struct rec_camera *k, uint8_t **out,
                         struct pvx_diag *d)
{
    char path[PATH_MAX];
    struct cap_loaded l;
    struct pvx_diag why = {""};
    size_t n = (size_t)k->width * (size_t)k->height;
    photometry_beside(rig_path, k->photometry.mask, path, sizeof path);
    pvx_err e = pvx_file_check(path, &why); /* no frame, which would be waited for */
    PVX_THEN(e, cap_image_load(path, &l, &why));
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: camera %s: mask: %s", rig_path, k->name, pvx_diag_text(&why, e));
    if (l.img.width != k->width || l.img.height != k->height)
        e = pvx_fail(d, PVX_EINVAL,
                     "%s: camera %s: the mask %s has %dx%d pixels, but the camera takes %dx%d: "
                     "draw it over one of its pictures",
                     rig_path, k->name, path, l.img.width, l.img.height, k->width, k->height);
    else if ((*out = pvx_calloc(n, 1)) == NULL)
        e = PVX_ENOMEM;
    if (e == PVX_OK) {
        covered(&l.img, *out);
        if (memchr(*out, 1, n) == NULL)
            e = pvx_fail(d, PVX_EINVAL,
                         "%s: camera %s: the mask %s covers all of it: what is to be used has to "
                         "be bright in it; to do without a camera, leave it out of the rig",
                         rig_path, k->name, path);
    }
    cap_loaded_free(&l);
    return e;
}

/* Move the gain to the maps; scale the noise to its value behind them. */
static void take_gain(struct rec_camera *k, float gain[3])
{
    double most = 0, mean = 0;
    for (int c = 0; c < 3; c++) {
        gain[c] = k->gain[c];
        most = fmax(most, (double)gain[c]);
        mean += (double)gain[c] / 3;
        k->gain[c] = 1;
    }
    k->photometry.read_noise *= most;
    k->photometry.noise_gain *= mean;
}

static pvx_err load_one(const char *rig_path, unsigned what, struct rec_camera *k, struct light *l,
                        struct pvx_diag *d)
{
    const struct rec_photometry *p = &k->photometry;
    struct cap_photometry *of = &l->of;
    *of = (struct cap_photometry){.width = k->width, .height = k->height, .gain = {1, 1, 1}};
    if (p->dark.file[0] != '\0' && what & DMN_LIGHT_DARK)
        PVX_TRY(photometry_read_map(rig_path, k, &p->dark, &l->dark, &of->channels, d));
    if (p->flat.file[0] != '\0' && what & DMN_LIGHT_FLAT)
        PVX_TRY(photometry_read_map(rig_path, k, &p->flat, &l->flat, &of->channels, d));
    if (p->mask[0] != '\0' && what & DMN_LIGHT_MASK)
        PVX_TRY(read_mask(rig_path, k, &l->mask, d));
    of->dark = l->dark;
    of->flat = l->flat;
    of->mask = l->mask;
    if (p->n_response > 0 && what & DMN_LIGHT_RESPONSE) {
        memcpy(l->response, p->response, sizeof l->response);
        of->response = l->response;
        of->n_response = p->n_response;
    }
    if (p->has_matrix && what & DMN_LIGHT_MATRIX) {
        memcpy(l->matrix, p->matrix, sizeof l->matrix);
        of->matrix = l->matrix;
    }
    l->acts = of->dark != NULL || of->flat != NULL || of->mask != NULL || of->response != NULL ||
              of->matrix != NULL;
    if (l->acts && what & DMN_LIGHT_GAIN)
        take_gain(k, of->gain);
    return PVX_OK;
}

pvx_err dmn_photometry_load(const char *rig_path, unsigned what, struct rec_rig *rig,
                            dmn_photometry **out, struct pvx_diag *d)
{
    bool any = false;
    dmn_photometry *p = *out = pvx_calloc(1, sizeof *p);
    pvx_err e = p == NULL ? PVX_ENOMEM : PVX_OK;
    for (size_t c = 0; c < rig->n_cameras && e == PVX_OK; c++) {
        e = load_one(rig_path, what, &rig->cameras[c], &p->camera[c], d);
        any |= p->camera[c].acts;
    }
    if (e != PVX_OK || !any)
        dmn_photometry_free(out);
    return e;
}

void dmn_photometry_free(dmn_photometry **pp)
{
    dmn_photometry *p = *pp;
    for (size_t c = 0; p != NULL && c < REC_MAX_CAMERAS; c++) {
        free(p->camera[c].dark);
        free(p->camera[c].flat);
        free(p->camera[c].mask);
    }
    PVX_FREE(*pp);
}

const struct cap_photometry *dmn_photometry_of(const dmn_photometry *p, size_t c)
{
    return p != NULL && p->camera[c].acts ? &p->camera[c].of : NULL;
}

bool dmn_photometry_too_far(const struct rec_camera *k, double temperature_c)
{
    const struct rec_photometry *p = &k->photometry;
    return p->dark.file[0] != '\0' && p->has_temperature &&
           fabs(temperature_c - p->temperature) > DMN_DARK_DEGREES;
}

pvx_err dmn_photometry_check(const struct rec_camera *k, const struct dmn_photometry_taken *as,
                             const char *where, struct pvx_diag *d)
{
    const struct rec_photometry *p = &k->photometry;
    bool known = p->device[0] != '\0' && as->device != NULL && as->device[0] != '\0';
    size_t scheme = strcspn(p->serial, ":"); /* a recording's source is not that of its camera */
    bool same = known ? strcmp(p->device, as->device) == 0
                      : p->serial[0] == '\0' || as->serial == NULL ||
                            strncmp(p->serial, as->serial, scheme + 1) != 0 ||
                            strcmp(p->serial, as->serial) == 0;
    if (!same)
        return pvx_fail(
            d, PVX_EINVAL,
            "%s: camera %s is %s, but the rig's photometry was measured on %s: measure "
            "this one (pyrovox calibrate dark, flat), or take its photometry out of the rig",
            where, k->name, known ? as->device : as->serial, known ? p->device : p->serial);
    if (p->dark.file[0] == '\0')
        return PVX_OK;
    if (p->has_exposure && fabs(as->exposure_s - p->exposure) > 0.02 * p->exposure)
        return pvx_fail(
            d, PVX_EINVAL,
            "%s: camera %s exposed %.6g ms, but its dark is of %.6g ms: take darks at that "
            "exposure (pyrovox calibrate dark)",
            where, k->name, as->exposure_s * 1e3, p->exposure * 1e3);
    if (p->has_gain && fabs(as->gain_db - p->gain_db) > 0.1)
        return pvx_fail(
            d, PVX_EINVAL,
            "%s: camera %s had a gain of %g dB, but its dark is of %g dB: take darks at "
            "that gain (pyrovox calibrate dark)",
            where, k->name, as->gain_db, p->gain_db);
    if (dmn_photometry_too_far(k, as->temperature_c))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: camera %s had %.1f degrees Celsius, but its dark is of %.1f: take "
                        "darks when it is as warm as then (pyrovox calibrate dark)",
                        where, k->name, as->temperature_c, p->temperature);
    return PVX_OK;
}
