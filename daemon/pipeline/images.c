#include "daemon/pipeline/images.h"

#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "base/mem.h"
#include "capture/pixel/jpeg.h"

#define BANDS 4 /* an image is converted in so many pieces */
#define PILE  8 /* samples at the end of a depth show that it is the end */

struct dmn_images {
    struct dmn_images_params p;
    const struct rec_rig *rig;
    pvx_pool *pool;
    cap_jpeg *decoder[REC_MAX_CAMERAS]; /* NULL: no JPEG will come */
    struct cap_maps *maps[REC_MAX_CAMERAS];
    enum cap_pixfmt maps_for[REC_MAX_CAMERAS]; /* NONE: not made, nor tried */
    bool coloured[REC_MAX_CAMERAS];            /* the camera's last picture was */
    _Atomic float black;                       /* that is subtracted later */
    struct pvx_diag maps_why[REC_MAX_CAMERAS];
    /* one set: */
    struct cap_image image[REC_MAX_CAMERAS]; /* data NULL = missing or bad */
    struct pvx_diag why[REC_MAX_CAMERAS];
    float saturated[REC_MAX_CAMERAS]; /* value of saturated bins, 0: 1 */
    int fault[REC_MAX_CAMERAS];       /* enum dmn_image_fault, DMN_N_IMAGE = none */
    _Atomic int bad[REC_MAX_CAMERAS];
    struct cap_depth depth[REC_MAX_CAMERAS][BANDS];
    int32_t row; /* the first that is looked at */
    /* all sets: */
    struct cap_depth all[REC_MAX_CAMERAS]; /* words of 16 bits */
    int bits[REC_MAX_CAMERAS];
    float *const *out;

    atomic_uint_fast64_t count[REC_MAX_CAMERAS][DMN_N_IMAGE];
};

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

/* Refuse the pictures of another kind (`alike`). */
static void check_kinds(dmn_images *i)
{
    bool colour = false;
    for (size_t c = 0; c < i->rig->n_cameras; c++) {
        if (i->image[c].data != NULL)
            i->coloured[c] = cap_pixfmt_channels(i->image[c].fmt) == 3;
        colour |= i->coloured[c];
    }
    for (size_t c = 0; c < i->rig->n_cameras && i->p.alike; c++) {
        struct cap_image *img = &i->image[c];
        if (img->data == NULL || i->coloured[c] == (i->p.nch == 3) || !colour)
            continue;
        i->fault[c] = DMN_IMAGE_KIND;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 i->coloured[c] ? "is a %s image, with colour, but the first images were grey: "
                                  "solve one channel (--grey), or leave the camera out"
                                : "is a %s image, grey, but other cameras have colour: solve one "
                                  "channel (--grey, in pyrovoxd.yaml channels: 1), set the camera "
                                  "to colour, or leave it out",
                 cap_pixfmt_name(img->fmt));
        img->data = NULL;
    }
}

/* Refuse integers where a black level above their full scale would be subtracted. */
static void check_black(dmn_images *i)
{
    float black = atomic_load(&i->black);
    for (size_t c = 0; c < i->rig->n_cameras && black > 1; c++) {
        struct cap_image *img = &i->image[c];
        if (img->data == NULL || dmn_images_floats(i, c))
            continue;
        i->fault[c] = DMN_IMAGE_FORMAT;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 "is a %s image, whose black level is a share of full scale, 0 to 1: "
                 "photometry.black is %g",
                 cap_pixfmt_name(img->fmt), (double)black);
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
    struct cap_convert_params p = images_how(i, c);
    float s = i->image[c].data != NULL ? cap_saturated(&i->image[c], &p) : 1;
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

static void bin_piece(void *ctx, size_t task)
{
    dmn_images *i = ctx;
    size_t c = task / BANDS, band = task % BANDS;
    const struct cap_image *img = &i->image[c];
    if (img->data == NULL)
        return;
    const struct cap_convert_params p = images_how(i, c);
    int64_t rows = i->rig->cameras[c].height / i->p.binning;
    int32_t y0 = (int32_t)(rows * (int64_t)band / BANDS);
    int32_t y1 = (int32_t)(rows * (int64_t)(band + 1) / BANDS);
    cap_depth_look(&i->depth[c][band], img, y0 * i->p.binning + i->row, y1 * i->p.binning,
                   i->p.look);
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

/* Whether a bin has a number in all its channels (Bayer pixels as they are: in one). */
static bool has_number(const dmn_images *i, size_t c)
{
    const struct rec_camera *k = &i->rig->cameras[c];
    size_t cs = i->p.nch == 3 ? 4 : 1, numbers = 0;
    size_t n = (size_t)(k->width / i->p.binning) * (size_t)(k->height / i->p.binning);
    bool one =
        i->p.mosaic == CAP_MOSAIC_RAYS && i->p.binning == 1 && dmn_images_bayer(i, c) != NULL;
    size_t needed = one ? 1 : (size_t)i->p.nch;
    for (size_t b = 0; b < n && numbers < needed; b++) {
        numbers = 0;
        for (size_t l = 0; l < (size_t)i->p.nch; l++)
            numbers += fabsf(i->out[c][b * cs + l]) <= REC_PHOTO_LIMIT;
    }
    return numbers >= needed;
}

/* Judge the depth of camera c's samples. */
static void judge_depth(dmn_images *i, size_t c)
{
    enum cap_pixfmt fmt = i->image[c].fmt;
    struct cap_depth now = {0};
    unsigned most = (1u << cap_pixfmt_depth(fmt) % 32) - 1;
    for (size_t b = 0; b < BANDS; b++)
        cap_depth_join(&now, &i->depth[c][b]);
    if (cap_pixfmt_depth(fmt) == 16) {
        cap_depth_join(&i->all[c], &now);
        i->bits[c] = cap_depth_bits(&i->all[c], PILE);
    } else if (now.top > most) {
        i->fault[c] = DMN_IMAGE_FORMAT;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 "%s image: a sample is %u, but %d bits end at %u: its samples have more bits, or "
                 "lie in the upper ones (%s)",
                 cap_pixfmt_name(fmt), now.top, cap_pixfmt_depth(fmt), most,
                 cap_pixfmt_name(cap_pixfmt_of_depth(fmt, 16)));
    }
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
    if (came && i->fault[c] == DMN_N_IMAGE)
        judge_depth(i, c);
    if (came && i->fault[c] == DMN_N_IMAGE && !has_number(i, c)) {
        i->fault[c] = DMN_IMAGE_NO_NUMBER;
        snprintf(i->why[c].text, sizeof i->why[c].text,
                 "camera %s: no pixel is a finite number below %g: was a dark or a flat applied "
                 "that does not fit?",
                 i->rig->cameras[c].name, (double)REC_PHOTO_LIMIT);
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
    check_kinds(i);
    check_black(i);
    for (size_t c = 0; c < n && i->p.light != NULL; c++)
        find_maps(i, c);
    for (size_t c = 0; c < n; c++)
        i->saturated[c] = saturated_now(i, c);
    pvx_pool_run(i->pool, n * BANDS, bin_piece, i);
    i->row = (i->row + 1) % i->p.look;
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
