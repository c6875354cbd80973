/* frames_background.c - a picture of each camera's background. */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "base/file.h"
#include "capture/files/sequence.h"
#include "daemon/cli/common/frames_in_impl.h"

/* Bin the float images, or all others.  Floats get no photometry: `calibrate background` wrote them with it. */
static pvx_err bin_some(struct frames_in *f, bool floats, const char *dir, float **out,
                        struct pvx_diag *d)
{
    const struct cap_image *some[REC_MAX_CAMERAS] = {0};
    struct frames_in plain = *f;
    dmn_images *images = f->images;
    pvx_err e = PVX_OK;
    uint64_t mask;
    for (size_t c = 0; c < f->rig->n_cameras; c++)
        if ((cap_pixfmt_layout(f->image[c]->fmt) == CAP_LAYOUT_F32) == floats)
            some[c] = f->image[c];
    if (floats && f->light != NULL) {
        plain.light = NULL;
        plain.images = NULL;
        e = frames_in_begin(&plain, f->binning, f->mosaic, d);
        images = plain.images;
    }
    if (e == PVX_OK)
        dmn_images_bin(images, some, out, &mask);
    for (size_t c = 0; c < f->rig->n_cameras && e == PVX_OK; c++)
        if (some[c] != NULL && !(mask >> c & 1))
            e = pvx_fail(d, PVX_EINVAL, "%s/%s: %s", dir, f->rig->cameras[c].name,
                         dmn_images_why(images, c));
    if (images != f->images)
        dmn_images_free(&images);
    return e;
}

pvx_err frames_in_background_file(const char *dir, const char *camera, char *path, size_t size,
                                  struct pvx_diag *d)
{
    struct dirent *e;
    size_t n = strlen(camera);
    DIR *h = opendir(dir);
    *path = '\0';
    pvx_err r =
        h != NULL ? PVX_OK : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    while (h != NULL && r == PVX_OK && (e = readdir(h)) != NULL) {
        if (strncmp(e->d_name, camera, n) != 0 || strrchr(e->d_name, '.') != e->d_name + n ||
            !cap_is_image(e->d_name))
            continue;
        if (*path != '\0')
            r = pvx_fail(d, PVX_EINVAL, "%s and %s/%s: a camera has one background", path, dir,
                         e->d_name);
        else
            snprintf(path, size, "%s/%s", dir, e->d_name);
    }
    if (h != NULL)
        closedir(h);
    if (r == PVX_OK && *path == '\0')
        r = pvx_fail(d, PVX_ENOENT, "%s: no background %s.(npy|png|tif|jpg) for camera %s", dir,
                     camera, camera);
    return r;
}

pvx_err frames_in_background(struct frames_in *f, const char *dir, float **out, struct pvx_diag *d)
{
    char path[CAP_REEL_NAME];
    pvx_err e = PVX_OK;
    size_t n = 0;
    for (; n < f->rig->n_cameras && e == PVX_OK; n++) {
        const char *name = f->rig->cameras[n].name;
        f->loaded[n] = (struct cap_loaded){0};
        e = frames_in_background_file(dir, name, path, sizeof path, d);
        PVX_THEN(e, pvx_file_check(path, d));
        PVX_THEN(e, cap_image_load(path, &f->loaded[n], d));
        bool floats = cap_pixfmt_layout(f->loaded[n].img.fmt) == CAP_LAYOUT_F32;
        if (e == PVX_OK && !floats)
            e = frames_in_read_as(f, path, &f->loaded[n], d);
        int channels = cap_pixfmt_channels(f->loaded[n].img.fmt);
        if (e == PVX_OK && f->kinds == FRAMES_IN_SAME && channels != f->nch)
            e = pvx_fail(d, PVX_EINVAL,
                         "%s: this background %s, the pictures of %s %s: take it with the same "
                         "camera (pyrovox calibrate background), or solve one channel (--grey)",
                         path, channels == 1 ? "is grey" : "has colour", name,
                         channels == 1 ? "have colour" : "are grey");
        f->image[n] = &f->loaded[n].img;
        out[n] = frames_in_room(f, n);
        if (e == PVX_OK && out[n] == NULL)
            e = pvx_fail(d, PVX_ENOMEM, "%s: no memory for backgrounds", dir);
    }
    PVX_THEN(e, bin_some(f, false, dir, out, d));
    PVX_THEN(e, bin_some(f, true, dir, out, d));
    for (size_t c = 0; c < n; c++)
        cap_loaded_free(&f->loaded[c]);
    return e;
}
