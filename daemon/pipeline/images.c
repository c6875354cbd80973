#include "daemon/pipeline/images_impl.h"

#include <stdio.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/pipeline/raw.h"
#include "recon/frame/inside.h"

#define BANDS DMN_IMAGES_BANDS

pvx_err dmn_images_new(const struct dmn_images_params *p, const struct rec_rig *rig, pvx_pool *pool,
                       dmn_images **out, struct pvx_diag *d)
{
    *out = NULL;
    dmn_images *i = pvx_calloc(1, sizeof *i);
    PVX_NEED(i);
    *i = (dmn_images){.p = *p, .rig = rig, .pool = pool};
    i->p.look = p->look > 1 ? p->look : 1;
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

void dmn_images_seen(dmn_images *i, size_t c, const struct cap_depth *d)
{
    i->all[c] = *d;
    i->bits[c] = cap_depth_bits(d, 1);
}

void dmn_images_black(dmn_images *i, float black)
{
    atomic_store(&i->black, black);
}

/* ---- the images of a set ---- */

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

static struct cap_convert_params images_how(const dmn_images *i, size_t c)
{
    return (struct cap_convert_params){.binning = i->p.binning,
                                       .nch = i->p.nch,
                                       .transfer = i->p.transfer,
                                       .mosaic = i->p.mosaic,
                                       .maps = i->maps[c],
                                       .clip = i->bits[c] > 0 ? (1u << i->bits[c]) - 1 : 0};
}

static float saturated_now(const dmn_images *i, size_t c)
{
    float s = i->image[c].data != NULL ? cap_saturated(&i->image[c], &i->how[c]) : 1;
    return s == 1 ? 0 : s;
}

/* Find the maps for camera c's picture.  They are made when the first picture of its format comes. */
static void find_maps(dmn_images *i, size_t c)
{
    const struct cap_photometry *light = dmn_photometry_of(i->p.light, c);
    struct cap_image *img = &i->image[c];
    if (img->data == NULL || light == NULL)
        return;
    if (i->maps_for[c] != img->fmt) {
        cap_maps_free(&i->maps[c]);
        i->maps_for[c] = img->fmt;
        i->maps_why[c].text[0] = '\0';
        const struct cap_convert_params p = images_how(i, c);
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

/* Rows of bins of a band, from *y0 on; returns where they end. */
static int32_t band_rows(const dmn_images *i, size_t c, size_t band, int32_t *y0)
{
    int64_t rows = i->rig->cameras[c].height / i->p.binning;
    *y0 = (int32_t)(rows * (int64_t)band / BANDS);
    return (int32_t)(rows * (int64_t)(band + 1) / BANDS);
}

static void look_piece(void *ctx, size_t task)
{
    dmn_images *i = ctx;
    size_t c = task / BANDS, band = task % BANDS;
    int32_t y0, y1 = band_rows(i, c, band, &y0);
    if (i->image[c].data != NULL)
        cap_depth_look(&i->depth[c][band], &i->image[c], y0 * i->p.binning + i->row,
                       y1 * i->p.binning, i->p.look);
}

static void bin_piece(void *ctx, size_t task)
{
    dmn_images *i = ctx;
    size_t c = task / BANDS, band = task % BANDS;
    const struct cap_image *img = &i->image[c];
    int32_t y0, y1 = band_rows(i, c, band, &y0);
    if (img->data == NULL)
        return;
    pvx_err e = y0 < y1 ? cap_convert(img, &i->how[c], y0, y1, i->out[c]) : PVX_OK;
    if (e != PVX_OK)
        atomic_store(&i->bad[c], (int)e);
}

static void look_and_bin_piece(void *ctx, size_t task)
{
    look_piece(ctx, task);
    bin_piece(ctx, task);
}

/* Take camera c's image and check its size.  Returns whether it is a JPEG to decode. */
static bool images_look_at(dmn_images *i, const struct cap_image *img, size_t c)
{
    const struct rec_camera *k = &i->rig->cameras[c];
    i->why[c].text[0] = '\0';
    i->fault[c] = DMN_N_IMAGE;
    atomic_store(&i->bad[c], PVX_OK);
    memset(i->depth[c], 0, sizeof i->depth[c]);
    i->image[c] = img != NULL ? *img : (struct cap_image){0};
    if (img != NULL && (img->width != k->width || img->height != k->height)) {
        i->fault[c] = DMN_IMAGE_SIZE;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 "is %dx%d, but the rig says camera %s takes %dx%d%s", img->width, img->height,
                 k->name, k->width, k->height,
                 img->width == k->height && img->height == k->width
                     ? ": width and height are swapped in its size"
                     : "");
        i->image[c].data = NULL;
    }
    return i->image[c].data != NULL && img->fmt == CAP_JPEG;
}

/* ---- raw pictures (recon/frame/inside.h) ---- */

/* Bins the pictures of the last set, which the frame has kept. */
static bool images_bin_kept(void *ctx, uint64_t number, const struct rec_cl_raw *raw,
                            float *const *out)
{
    dmn_images *i = ctx;
    if (number != i->number)
        return false;
    for (size_t c = 0; c < i->rig->n_cameras; c++)
        i->image[c].data = raw[c].layout != REC_CL_LAYOUT_NONE ? raw[c].data : NULL;
    i->out = out;
    pvx_pool_run(i->pool, i->rig->n_cameras * BANDS, bin_piece, i);
    return true;
}

/* Whether the frame takes the pictures as they are. */
static bool images_stay_raw(dmn_images *i, rec_frame *f)
{
    const struct rec_frame_binner bin = {images_bin_kept, i, i->number};
    struct rec_cl_raw raw[REC_MAX_CAMERAS] = {{0}};
    for (size_t c = 0; c < i->rig->n_cameras; c++)
        if (i->image[c].data != NULL && !dmn_raw_of(&i->image[c], &i->how[c], &raw[c]))
            return false;
    return rec_frame_raw(f, raw, &bin);
}

/* ---- one set ---- */

/* Judges the set's images, and prepares them for binning. */
static void images_begin(dmn_images *i, const struct cap_image *const *image)
{
    size_t n = i->rig->n_cameras;
    bool jpeg = false;
    i->number++;
    for (size_t c = 0; c < n; c++)
        jpeg |= images_look_at(i, image[c], c);
    if (jpeg)
        pvx_pool_run(i->pool, n, decode_piece, i);
    dmn_images_check(i);
    for (size_t c = 0; c < n && i->p.light != NULL; c++)
        find_maps(i, c);
    for (size_t c = 0; c < n; c++) {
        i->how[c] = images_how(i, c);
        i->saturated[c] = saturated_now(i, c);
    }
}

/* After binning; the number of usable images, with their bits in *mask. */
static uint32_t images_end(dmn_images *i, const struct cap_image *const *image, uint64_t *mask)
{
    uint32_t present = 0;
    i->row = (i->row + 1) % i->p.look;
    *mask = 0;
    for (size_t c = 0; c < i->rig->n_cameras; c++) {
        bool good = dmn_images_account(i, image[c] != NULL, c);
        present += good;
        *mask |= good ? 1ull << c : 0;
    }
    return present;
}

uint32_t dmn_images_bin(dmn_images *i, const struct cap_image *const *image, float *const *out,
                        uint64_t *mask)
{
    images_begin(i, image);
    i->out = out;
    pvx_pool_run(i->pool, i->rig->n_cameras * BANDS, look_and_bin_piece, i);
    return images_end(i, image, mask);
}

/* dmn_images_bin into a frame's inputs, or its room for raw pictures. */
static uint32_t images_give(dmn_images *i, const struct cap_image *const *image, rec_frame *f,
                            uint64_t *mask)
{
    float *out[REC_MAX_CAMERAS] = {0};
    size_t n = i->rig->n_cameras;
    images_begin(i, image);
    bool raw = images_stay_raw(i, f);
    for (size_t c = 0; c < n && !raw; c++)
        out[c] = rec_frame_input(f, c);
    i->out = raw ? NULL : out;
    pvx_pool_run(i->pool, n * BANDS, raw ? look_piece : look_and_bin_piece, i);
    return images_end(i, image, mask);
}

uint32_t dmn_images_bin_frame(dmn_images *i, const struct cap_image *const *image, rec_frame *f,
                              uint64_t *mask)
{
    uint32_t present = images_give(i, image, f, mask);
    for (size_t c = 0; c < i->rig->n_cameras; c++) {
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

/* ---- what is known of a set ---- */

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
    return i->saturated[c];
}

int dmn_images_bits(const dmn_images *i, size_t c)
{
    return i->bits[c];
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
