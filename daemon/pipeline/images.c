#include "daemon/pipeline/images.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/mem.h"
#include "capture/pixel/jpeg.h"

#define BANDS 4 /* an image is converted in so many pieces */

struct dmn_images {
    struct dmn_images_params p;
    const struct rec_rig *rig;
    pvx_pool *pool;
    cap_jpeg *decoder[REC_MAX_CAMERAS]; /* NULL: no JPEG will come */
    struct cap_maps *maps[REC_MAX_CAMERAS];
    enum cap_pixfmt maps_for[REC_MAX_CAMERAS]; /* NONE: not made, nor tried */
    struct pvx_diag maps_why[REC_MAX_CAMERAS];
    /* one set: */
    struct cap_image image[REC_MAX_CAMERAS]; /* data NULL = missing or bad */
    struct pvx_diag why[REC_MAX_CAMERAS];
    int fault[REC_MAX_CAMERAS]; /* enum dmn_image_fault, DMN_N_IMAGE = none */
    _Atomic int bad[REC_MAX_CAMERAS];
    float *const *out;

    atomic_uint_fast64_t count[REC_MAX_CAMERAS][DMN_N_IMAGE];
};

pvx_err dmn_images_new(const struct dmn_images_params *p, const struct rec_rig *rig, pvx_pool *pool,
                       dmn_images **out, struct pvx_diag *d)
{
    *out = NULL;
    dmn_images *i = pvx_calloc(1, sizeof *i);
    if (i == NULL)
        return PVX_ENOMEM;
    *i = (dmn_images){.p = *p, .rig = rig, .pool = pool};
    bool jpeg = p->fmt == CAP_FMT_NONE || p->fmt == CAP_JPEG;
    for (size_t c = 0; c < rig->n_cameras && jpeg; c++) {
        const struct rec_camera *k = &rig->cameras[c];
        pvx_err e = cap_jpeg_new(k->width, k->height, &i->decoder[c]);
        if (e == PVX_EINVAL && p->fmt == CAP_FMT_NONE)
            continue; /* larger than a JPEG can be, so no JPEG comes */
        if (e != PVX_OK) {
            dmn_images_free(&i);
            return pvx_fail(d, e, "camera %s: no JPEG decoder for %dx%d pixels: %s", k->name,
                            k->width, k->height, pvx_strerror(e));
        }
    }
    *out = i;
    return PVX_OK;
}

void dmn_images_free(dmn_images **ip)
{
    if (*ip == NULL)
        return;
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++) {
        cap_jpeg_free(&(*ip)->decoder[c]);
        cap_maps_free(&(*ip)->maps[c]);
    }
    PVX_FREE(*ip);
}

/* ---- one set ---- */

static enum dmn_image_fault fault_of(pvx_err e)
{
    return e == PVX_ERANGE   ? DMN_IMAGE_JPEG_SIZE
           : e == PVX_EUNSUP ? DMN_IMAGE_JPEG_KIND
                             : DMN_IMAGE_JPEG_DAMAGED;
}

static void decode_piece(void *ctx, size_t c)
{
    dmn_images *i = ctx;
    struct cap_image *img = &i->image[c];
    if (img->data == NULL || img->fmt != CAP_JPEG)
        return;
    const struct cap_image coded = *img;
    pvx_err e = i->decoder[c] == NULL ? PVX_EUNSUP
                                      : cap_jpeg_decode(i->decoder[c], &coded, img, &i->why[c]);
    if (e != PVX_OK) {
        i->fault[c] = (int)fault_of(e);
        img->data = NULL;
    }
}

static struct cap_convert_params images_how(const dmn_images *i)
{
    return (struct cap_convert_params){
        .binning = i->p.binning, .nch = i->p.nch, .transfer = i->p.transfer, .mosaic = i->p.mosaic};
}

/* Find the maps for camera c's picture.  They are made when the first picture of its format comes. */
static void find_maps(dmn_images *i, size_t c)
{
    const struct cap_photometry *light = dmn_photometry_of(i->p.light, c);
    struct cap_image *img = &i->image[c];
    if (img->data == NULL || light == NULL)
        return;
    if (i->maps_for[c] != img->fmt) {
        struct cap_convert_params p = images_how(i);
        cap_maps_free(&i->maps[c]);
        i->maps_for[c] = img->fmt;
        i->maps_why[c].text[0] = '\0';
        pvx_err e = cap_maps_new(light, img, &p, &i->maps[c], &i->maps_why[c]);
        if (e == PVX_ENOMEM)
            pvx_fail(&i->maps_why[c], e, "no memory for its maps");
    }
    if (i->maps[c] == NULL) {
        i->fault[c] = DMN_IMAGE_FORMAT;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 "camera %s: %.300s: measure it anew (pyrovox calibrate)", i->rig->cameras[c].name,
                 i->maps_why[c].text);
        img->data = NULL;
    }
}

static void bin_piece(void *ctx, size_t task)
{
    dmn_images *i = ctx;
    size_t c = task / BANDS, band = task % BANDS;
    const struct cap_image *img = &i->image[c];
    if (img->data == NULL)
        return;
    struct cap_convert_params p = images_how(i);
    p.maps = i->maps[c];
    int64_t rows = i->rig->cameras[c].height / i->p.binning;
    int32_t y0 = (int32_t)(rows * (int64_t)band / BANDS);
    int32_t y1 = (int32_t)(rows * (int64_t)(band + 1) / BANDS);
    pvx_err e = y0 < y1 ? cap_convert(img, &p, y0, y1, i->out[c]) : PVX_OK;
    if (e != PVX_OK)
        atomic_store(&i->bad[c], (int)e);
}

/* Take camera c's image and check its size.  Returns whether it is a JPEG to decode. */
static bool images_look_at(dmn_images *i, const struct cap_image *img, size_t c)
{
    const struct rec_camera *k = &i->rig->cameras[c];
    i->why[c].text[0] = '\0';
    i->fault[c] = DMN_N_IMAGE;
    atomic_store(&i->bad[c], PVX_OK);
    i->image[c] = img != NULL ? *img : (struct cap_image){0};
    if (img != NULL && (img->width != k->width || img->height != k->height)) {
        i->fault[c] = DMN_IMAGE_SIZE;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 "is %dx%d, but the rig says camera %s takes %dx%d", img->width, img->height,
                 k->name, k->width, k->height);
        i->image[c].data = NULL;
    }
    return i->image[c].data != NULL && img->fmt == CAP_JPEG;
}

/* Whether camera c's pixels are there.  If not, an image that came is counted by its fault. */
static bool account(dmn_images *i, bool came, size_t c)
{
    pvx_err e = (pvx_err)atomic_load(&i->bad[c]);
    if (e != PVX_OK) {
        i->fault[c] = DMN_IMAGE_FORMAT;
        snprintf(i->why[c].text, sizeof i->why[c].text, "%s image: %s",
                 cap_pixfmt_name(i->image[c].fmt), pvx_strerror(e));
    }
    if (came && i->fault[c] != DMN_N_IMAGE)
        atomic_fetch_add(&i->count[c][i->fault[c]], 1);
    return came && i->fault[c] == DMN_N_IMAGE;
}

uint32_t dmn_images_bin(dmn_images *i, const struct cap_image *const *image, float *const *out,
                        uint64_t *mask)
{
    size_t n = i->rig->n_cameras;
    bool jpeg = false;
    uint32_t present = 0;
    for (size_t c = 0; c < n; c++)
        jpeg |= images_look_at(i, image[c], c);
    i->out = out;
    if (jpeg)
        pvx_pool_run(i->pool, n, decode_piece, i);
    for (size_t c = 0; c < n && i->p.light != NULL; c++)
        find_maps(i, c);
    pvx_pool_run(i->pool, n * BANDS, bin_piece, i);
    *mask = 0;
    for (size_t c = 0; c < n; c++) {
        bool good = account(i, image[c] != NULL, c);
        present += good;
        *mask |= good ? 1ull << c : 0;
    }
    return present;
}

uint32_t dmn_images_bin_frame(dmn_images *i, const struct cap_image *const *image, rec_frame *f,
                              uint64_t *mask)
{
    float *out[REC_MAX_CAMERAS] = {0};
    size_t n = i->rig->n_cameras;
    for (size_t c = 0; c < n; c++)
        out[c] = rec_frame_input(f, c);
    uint32_t present = dmn_images_bin(i, image, out, mask);
    for (size_t c = 0; c < n; c++) {
        bool good = *mask >> c & 1;
        *rec_frame_camera(f, c) =
            good ? (struct rec_frame_camera){.present = true,
                                             .fine = cap_pixfmt_depth(i->image[c].fmt) > 8,
                                             .floats = dmn_images_floats(i, c),
                                             .mosaic = i->p.mosaic == CAP_MOSAIC_RAYS &&
                                                       i->p.binning == 1,
                                             .cell = dmn_images_bayer(i, c),
                                             .saturated = dmn_images_saturated(i, c)}
                 : (struct rec_frame_camera){0};
    }
    return present;
}

const uint8_t *dmn_images_bayer(const dmn_images *i, size_t c)
{
    return cap_pixfmt_bayer(i->image[c].fmt);
}

bool dmn_images_floats(const dmn_images *i, size_t c)
{
    return cap_pixfmt_layout(i->image[c].fmt) == CAP_LAYOUT_F32;
}

int dmn_images_samples(const dmn_images *i, size_t c)
{
    bool one = cap_pixfmt_bayer(i->image[c].fmt) != NULL;
    return one ? 1 : cap_pixfmt_channels(i->image[c].fmt);
}

float dmn_images_saturated(const dmn_images *i, size_t c)
{
    return i->maps[c] != NULL ? cap_maps_saturated(i->maps[c]) : 0;
}

const char *dmn_images_why(const dmn_images *i, size_t c)
{
    return pvx_diag_text(&i->why[c], PVX_EUNSUP);
}

void dmn_images_counts(dmn_images *i, uint64_t out[][DMN_N_IMAGE])
{
    for (size_t c = 0; c < i->rig->n_cameras; c++)
        for (int k = 0; k < DMN_N_IMAGE; k++)
            out[c][k] = atomic_load(&i->count[c][k]);
}
