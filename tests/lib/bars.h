/* bars.h - what the tests of error bars share: frames of a scene with noise, and whether bars hold its truth. */
#ifndef T_BARS_H
#define T_BARS_H
#include <math.h>

#include "recon/frame/bars.h"
#include "recon/frame/inside.h"
#include "tests/lib/scene.h"

static inline struct rec_frame_params bars_params(int nch)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.photo.saturation = 1e30f;
    p.nch = nch;
    return p;
}

/* Pictures with noise, of all channels, or of the first for a grey frame. */
static inline void bars_shoot(const struct scene *s, rec_frame *f, double noise)
{
    if (rec_frame_channels(f) == 3) {
        scene_shoot(s, f, noise);
        return;
    }
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = s->S->row0[c + 1] - s->S->row0[c];
        for (size_t r = 0; r < n; r++)
            rec_frame_input(f, c)[r] = s->image[c][r * 4] + (float)(noise * t_normal());
        rec_frame_camera(f, c)->present = true;
    }
}

/* Share in percent of the voxels above 2 % of the brightest whose bars of 95 % hold the truth, 0 without such voxels; *over,
 * unless NULL: mean square of sd over that of the error. */
static inline double bars_covered(const struct scene *s, const rec_frame *f,
                                  const struct rec_bars_view *v, double *over)
{
    size_t cs = (size_t)v->cs, nch = (size_t)v->nch;
    double top = 0, in = 0, all = 0, e2 = 0, s2 = 0;
    struct rec_sparse x;
    rec_frame_volume(f, &x);
    for (size_t i = 0; i < s->voxels; i++)
        top = fmax(top, s->truth[i * 3]);
    for (size_t q = 0; q < (size_t)v->n; q++)
        for (size_t l = 0; l < nch; l++) {
            double truth = s->truth[(size_t)v->index[q] * 3 + l];
            double e = (double)x.value[q * cs + l] - truth, sd = (double)v->sd[q * cs + l];
            if (truth < 0.02 * top)
                continue;
            in += fabs(e) <= 1.96 * sd;
            all++;
            e2 += e * e;
            s2 += sd * sd;
        }
    if (over != NULL)
        *over = s2 / e2;
    return all > 0 ? 100 * in / all : 0;
}

#endif
