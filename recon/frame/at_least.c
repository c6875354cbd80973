/* at_least.c - saturated pixels as rows that say "at least this" (recon/solve/bound.h). */
#include <string.h>

#include "recon/frame/impl.h"

/* Lower bound of b for a saturated sample, lane l at row i of camera c. */
static float full_scale(const rec_carver *k, size_t c, size_t i, size_t l)
{
    const struct rec_photo_params *p = &k->photo_params[c];
    float full = p->saturation < 0 ? REC_PHOTO_FULL : p->saturation, back = 0;
    size_t cs = k->p.nch == 3 ? 4 : 1;
    if (k->background[c] != NULL)
        back = k->background[c][(i - k->S->row0[c]) * cs + l];
    return 0.9999F * k->gain[c][l] * (full - p->black - back);
}

/* Lanes of row i that are at full scale.  Rows that were left out because of saturation keep their values. */
static uint8_t lanes_of(const rec_frame *f, size_t c, size_t i)
{
    uint8_t lanes = 0;
    if (f->weight[i] > 0)
        return 0;
    for (size_t l = 0; l < (size_t)f->nch; l++)
        if (f->b[i * (size_t)f->cs + l] >= full_scale(f->carver, c, i, l))
            lanes |= (uint8_t)(1u << l);
    return lanes;
}

/* A bin with one saturated sample has the value of full scale, but its mean may be lower.  Only a bin between other
 * saturated bins is taken as saturated as a whole. */
static bool is_inner(const rec_frame *f, size_t c, size_t i)
{
    const struct rec_sysmat_block *b = &f->S->block[c];
    size_t at = i - f->S->row0[c], w = (size_t)b->bw, x = at % w, y = at / w;
    if (f->S->binning == 1)
        return true;
    return x > 0 && y > 0 && x + 1 < w && y + 1 < (size_t)b->bh &&
           (lanes_of(f, c, i - 1) & lanes_of(f, c, i + 1) & lanes_of(f, c, i - w) &
            lanes_of(f, c, i + w)) != 0;
}

void rec_frame_mark_saturated(rec_frame *f)
{
    f->any_least = false;
    for (size_t c = 0; c < f->S->n_cameras; c++) {
        size_t from = f->S->row0[c], to = f->S->row0[c + 1];
        memset(f->least_of + from, 0, to - from);
        memset(f->least + from, 0, (to - from) * sizeof *f->least);
        if (!f->believed[c] || f->carver->stats[c].saturated == 0)
            continue;
        for (size_t i = from; i < to; i++) {
            uint8_t lanes = lanes_of(f, c, i);
            if (lanes == 0 || !is_inner(f, c, i))
                continue;
            f->least_of[i] = lanes;
            f->least[i] = 1;
            f->any_least = true;
        }
    }
}
