#include "tests/soak/truth.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "capture/files/imgio.h"

static uint64_t hash_image(const struct cap_image *img)
{
    size_t row = cap_pixfmt_row(img->fmt, img->width);
    if (img->stride == (ptrdiff_t)row)
        return XXH3_64bits(img->data, row * (size_t)img->height);
    uint64_t h = 0;
    for (int32_t y = 0; y < img->height; y++)
        h = XXH3_64bits_withSeed((const char *)img->data + y * img->stride, row, h);
    return h;
}

pvx_err truth_load(struct truth *t, const char *dir, uint32_t n_cameras, struct pvx_diag *d)
{
    memset(t, 0, sizeof *t);
    t->n_cameras = n_cameras;
    for (uint32_t c = 0; c < n_cameras; c++) {
        uint32_t i = 0;
        for (;; i++) {
            char path[512];
            snprintf(path, sizeof path, "%s/cam%u/%06u.png", dir, c, i);
            if (i > 0 && access(path, R_OK) != 0)
                break;
            if (i == 64)
                return pvx_fail(d, PVX_ERANGE, "%s: more than 64 images", dir);
            struct cap_loaded l;
            PVX_TRY(cap_image_load(path, &l, d));
            t->hash[c][i] = hash_image(&l.img);
            t->width = l.img.width;
            t->height = l.img.height;
            cap_loaded_free(&l);
        }
        t->n = c == 0 || i < t->n ? i : t->n;
    }
    return PVX_OK;
}

int truth_find(const struct truth *t, uint32_t camera, const struct cap_image *img)
{
    uint64_t h = hash_image(img);
    for (uint32_t i = 0; i < t->n; i++)
        if (t->hash[camera][i] == h)
            return (int)i;
    return -1;
}
