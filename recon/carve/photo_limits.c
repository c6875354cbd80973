#include "recon/carve/photo_limits.h"

#include <math.h>
#include <string.h>

#define WIDE_MARGIN 1.25f /* false alarms of overlapping squares form groups */

struct rec_grain rec_photo_grain(const struct rec_photo_image *im)
{
    return im->cell != NULL ? rec_grain_mosaic
           : im->bayer > 0  ? rec_grain_bayer(im->bayer)
                            : rec_grain_none;
}

/* The floor.  It is lower in a dim picture: a share of the brightest bin there. */
static float photo_least(const struct rec_photo_image *im)
{
    const struct rec_photo_params *p = im->params;
    int32_t bits = 0;
    float peak;
    if (p->dim <= 0)
        return p->floor;
    for (size_t b = 0; b < rec_band_count(im->bh); b++)
        bits = im->work->band[b].peak > bits ? im->work->band[b].peak : bits;
    memcpy(&peak, &bits, sizeof peak);
    return fminf(p->floor, fmaxf(p->dim * peak, REC_PHOTO_DIMMEST));
}

void rec_photo_set_limits(const struct rec_photo_image *im)
{
    const struct rec_photo_params *p = im->params;
    struct rec_photo_work *w = im->work;
    bool automatic = p->threshold < 0;
    float low = im->absent ? p->floor : photo_least(im);
    w->means = automatic && im->bh >= 5; /* a smaller picture has no faint edges to find */
    w->limit = w->faint = w->fainter = rec_splat(INFINITY);
    for (int c = 0; c < im->nch; c++) {
        w->limit[c] = automatic
                          ? rec_clipped_before(&w->clipped[c], fmaxf(low, p->auto_k * w->sigma[c]))
                          : p->threshold;
        w->faint[c] = w->dark[c] + fmaxf(low, p->auto_k * w->sigma[c] / w->grain.near[c]);
        w->fainter[c] =
            w->dark[c] + fmaxf(low, WIDE_MARGIN * p->auto_k * w->sigma[c] / w->grain.wide[c]);
    }
}

bool rec_photo_is_clipped(const struct rec_photo_image *im)
{
    bool is = false;
    for (int c = 0; c < im->nch && !im->absent; c++)
        is |= im->work->clipped[c].is;
    return is;
}

void rec_photo_report(const struct rec_photo_image *im)
{
    const struct rec_photo_work *w = im->work;
    *im->stats = (struct rec_photo_stats){0};
    if (im->absent)
        return;
    for (size_t b = 0; b < rec_band_count(im->bh); b++) {
        im->stats->lit += w->band[b].lit;
        im->stats->saturated += w->band[b].saturated;
        im->stats->not_finite += w->band[b].not_finite;
    }
    for (int c = 0; c < im->nch; c++) {
        im->stats->sigma[c] = w->sigma[c];
        im->stats->threshold = fmaxf(im->stats->threshold, w->limit[c]);
        im->stats->cut = fmaxf(im->stats->cut, (float)w->clipped[c].share);
        im->stats->pedestal = fmaxf(im->stats->pedestal, (float)w->clipped[c].pedestal);
    }
}
