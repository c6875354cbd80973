/* images_judge.c - which images of a set can be used. */
#include <math.h>
#include <stdio.h>

#include "daemon/pipeline/images_impl.h"

#define PILE 8 /* samples at the end of a depth show that it is the end */

/* ---- before binning ---- */

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

void dmn_images_check(dmn_images *i)
{
    check_kinds(i);
    check_black(i);
}

/* ---- after binning ---- */

/* Whether a bin has a number in all its channels (Bayer pixels as they are: in one). */
static bool has_number(const dmn_images *i, size_t c)
{
    const struct rec_camera *k = &i->rig->cameras[c];
    size_t cs = i->p.nch == 3 ? 4 : 1, numbers = 0;
    size_t n = (size_t)(k->width / i->p.binning) * (size_t)(k->height / i->p.binning);
    bool one =
        i->p.mosaic == CAP_MOSAIC_RAYS && i->p.binning == 1 && dmn_images_bayer(i, c) != NULL;
    size_t needed = one ? 1 : (size_t)i->p.nch;
    if (i->out == NULL) /* raw: integers */
        return true;
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
    for (size_t b = 0; b < DMN_IMAGES_BANDS; b++)
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

bool dmn_images_account(dmn_images *i, bool came, size_t c)
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
