#include "cli/frames_in.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/pixel/pixfmt.h"

#define PATH_ROOM 4300

/* A take's frame gets a name for messages. */
static bool path_of(const struct frames_in *f, size_t i, size_t c, char path[PATH_ROOM])
{
    if (f->take != NULL) {
        snprintf(path, PATH_ROOM, "%s: set %u, camera %s", f->dir.dir, f->dir.number[f->set[i]],
                 f->rig->cameras[c].name);
        return f->dir.ext[f->set[i] * f->dir.n_cameras + c] != 0;
    }
    return dmn_framedir_path(&f->dir, f->rig, f->set[i], c, path, PATH_ROOM);
}

/* The file's image as the user says it is to be read. */
static pvx_err read_as(const struct frames_in *f, const char *path, struct cap_image *img,
                       struct pvx_diag *d)
{
    if (f->how.fmt == CAP_FMT_NONE)
        return PVX_OK;
    if (!cap_pixfmt_fits(img->fmt, f->how.fmt))
        return pvx_fail(d, PVX_EINVAL, "%s: a %s image cannot be read as %s", path,
                        cap_pixfmt_name(img->fmt), cap_pixfmt_name(f->how.fmt));
    img->fmt = f->how.fmt;
    return PVX_OK;
}

static pvx_err load_from_take(const struct frames_in *f, size_t i, size_t c, const char *path,
                              struct cap_loaded *l, struct pvx_diag *d)
{
    const int64_t *member;
    uint32_t camera = (uint32_t)f->take_camera[c];
    size_t size = cap_take_frame_max(f->take, camera);
    cap_take_set(f->take, f->set[i], &member);
    *l = (struct cap_loaded){.mem = malloc(size)};
    if (l->mem == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a frame", path);
    pvx_err e = cap_take_read(f->take, camera, (uint64_t)member[camera], l->mem, size, &l->img, d);
    if (e == PVX_OK && l->img.fmt == CAP_JPEG)
        e = pvx_fail(d, PVX_EUNSUP, "%s: is a JPEG; `pyrovox replay --export` makes files of them",
                     path);
    if (e != PVX_OK)
        cap_loaded_free(l);
    return e;
}

static pvx_err load(const struct frames_in *f, size_t i, size_t c, const char *path,
                    struct cap_loaded *l, struct pvx_diag *d)
{
    return f->take != NULL ? load_from_take(f, i, c, path, l, d) : cap_image_load(path, l, d);
}

static pvx_err scan_take(struct frames_in *f, const char *path, struct pvx_diag *d)
{
    PVX_TRY(cap_take_open(path, &f->take, d));
    uint64_t sets = cap_take_info(f->take)->sets;
    size_t n = f->rig->n_cameras;
    bool any = false;
    for (size_t c = 0; c < n; c++) {
        f->take_camera[c] = cap_take_find(f->take, f->rig->cameras[c].name);
        any = any || f->take_camera[c] >= 0;
    }
    if (sets == 0 || !any)
        return pvx_fail(d, PVX_ENOENT, "%s: %s", path,
                        any ? "no complete set in it" : "none of the rig's cameras is in it");
    if (cap_take_set(f->take, sets - 1, NULL)->number > UINT32_MAX)
        return pvx_fail(d, PVX_ERANGE, "%s: its sets' numbers are too large", path);
    snprintf(f->dir.dir, sizeof f->dir.dir, "%s", path);
    f->dir.n_frames = sets;
    f->dir.n_cameras = n;
    f->dir.number = pvx_calloc(sets, sizeof *f->dir.number);
    f->dir.ext = pvx_calloc(sets * n, 1);
    if (f->dir.number == NULL || f->dir.ext == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the list of frames", path);
    for (uint64_t k = 0; k < sets; k++) {
        const int64_t *member;
        f->dir.number[k] = (uint32_t)cap_take_set(f->take, k, &member)->number;
        for (size_t c = 0; c < n; c++)
            f->dir.ext[k * n + c] = f->take_camera[c] >= 0 && member[f->take_camera[c]] >= 0;
    }
    return PVX_OK;
}

static bool is_take(const char *name)
{
    size_t n = strlen(name);
    return n > 3 && strcmp(name + n - 3, ".h5") == 0;
}

/* Channels and the meaning of 1.0 come from the first image that can be read. */
static pvx_err look_at_first(struct frames_in *f, bool grey, struct pvx_diag *d)
{
    struct pvx_diag first = {""};
    pvx_err bad = PVX_ENOENT;
    for (size_t i = 0; i < f->n; i++)
        for (size_t c = 0; c < f->rig->n_cameras; c++) {
            char path[PATH_ROOM];
            struct cap_loaded l;
            if (!path_of(f, i, c, path))
                continue;
            pvx_err e = load(f, i, c, path, &l, &first);
            if (e == PVX_OK && (e = read_as(f, path, &l.img, &first)) != PVX_OK)
                cap_loaded_free(&l);
            if (e != PVX_OK) {
                bad = bad == PVX_ENOENT ? e : bad;
                continue;
            }
            if (f->take != NULL && cap_pixfmt_bayer(l.img.fmt) != NULL)
                f->how.fmt = l.img.fmt; /* a take says itself what a mosaic is */
            f->nch = grey ? 1 : cap_pixfmt_channels(l.img.fmt);
            f->full_scale = l.img.fmt != CAP_GREY_F32 && l.img.fmt != CAP_RGB_F32;
            cap_loaded_free(&l);
            return PVX_OK;
        }
    return pvx_fail(d, bad, "%s", pvx_diag_text(&first, bad));
}

pvx_err frames_in_scan(struct frames_in *f, const struct rec_rig *rig, const char *dir,
                       uint32_t first, uint32_t last, bool grey,
                       const struct frames_in_reading *how, struct pvx_diag *d)
{
    *f = (struct frames_in){.rig = rig, .binning = 1, .how = *how};
    pvx_err scanned = is_take(dir) ? scan_take(f, dir, d) : dmn_framedir_scan(dir, rig, &f->dir, d);
    if (scanned != PVX_OK) {
        frames_in_fini(f);
        return scanned;
    }
    f->set = pvx_calloc(f->dir.n_frames, sizeof *f->set);
    if (f->set == NULL) {
        frames_in_fini(f);
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the list of frames", dir);
    }
    for (size_t i = 0; i < f->dir.n_frames; i++)
        if (f->dir.number[i] >= first && f->dir.number[i] <= last)
            f->set[f->n++] = i;
    pvx_err e =
        f->n > 0 ? look_at_first(f, grey, d)
                 : pvx_fail(d, PVX_ENOENT, "%s: no frames from %06u to %06u; it has %06u to %06u",
                            dir, first, last, f->dir.number[0], f->dir.number[f->dir.n_frames - 1]);
    if (e != PVX_OK)
        frames_in_fini(f);
    return e;
}

void frames_in_fini(struct frames_in *f)
{
    dmn_framedir_fini(&f->dir);
    cap_take_free(&f->take);
    PVX_FREE(f->set);
    f->n = 0;
}

/* l is given up. */
static pvx_err bin_loaded(const struct frames_in *f, struct cap_loaded l, const char *path,
                          size_t c, float *out, int64_t *bin_ns, struct pvx_diag *d)
{
    const struct rec_camera *cam = &f->rig->cameras[c];
    const struct cap_convert_params p = {
        .binning = f->binning, .nch = f->nch, .transfer = f->how.transfer, .mosaic = f->how.mosaic};
    pvx_err e = read_as(f, path, &l.img, d);
    int64_t t0 = pvx_now_mono();
    if (e == PVX_OK && (l.img.width != cam->width || l.img.height != cam->height))
        e = pvx_fail(d, PVX_EINVAL, "%s: is %dx%d, but the rig says camera %s takes %dx%d", path,
                     l.img.width, l.img.height, cam->name, cam->width, cam->height);
    if (e == PVX_OK &&
        (e = cap_convert(&l.img, &p, 0, frames_in_bins(f, cam->height), out)) != PVX_OK)
        pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    *bin_ns += pvx_now_mono() - t0;
    cap_loaded_free(&l);
    return e;
}

enum frames_in_got frames_in_load(const struct frames_in *f, size_t i, size_t c, float *out,
                                  int64_t *bin_ns, struct pvx_diag *d)
{
    char path[PATH_ROOM];
    if (!path_of(f, i, c, path))
        return FRAMES_MISSING;
    struct cap_loaded l;
    return load(f, i, c, path, &l, d) == PVX_OK &&
                   bin_loaded(f, l, path, c, out, bin_ns, d) == PVX_OK
               ? FRAMES_LOADED
               : FRAMES_BAD;
}

pvx_err frames_in_background(const struct frames_in *f, const char *dir, size_t c, float *out,
                             struct pvx_diag *d)
{
    static const char *const ext[] = {"npy", "tif", "tiff", "png"};
    const char *name = f->rig->cameras[c].name;
    for (size_t i = 0; i < sizeof ext / sizeof ext[0]; i++) {
        char path[PATH_ROOM];
        int64_t ns = 0;
        snprintf(path, sizeof path, "%s/%s.%s", dir, name, ext[i]);
        if (access(path, F_OK) == 0) {
            struct cap_loaded l;
            PVX_TRY(cap_image_load(path, &l, d));
            return bin_loaded(f, l, path, c, out, &ns, d);
        }
    }
    return pvx_fail(d, PVX_ENOENT, "%s: no background %s.(npy|tif|tiff|png) for camera %s", dir,
                    name, name);
}
