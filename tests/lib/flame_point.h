/* flame_point.h - what the flame emits at a point, straight from (1) of recon/view/flame.h. */
#ifndef FLAME_POINT_H
#define FLAME_POINT_H
#include <math.h>

#include "recon/view/flame.h"

static inline void flame_point(const struct rec_flame_pose *p, const double x[3], double out[3])
{
    out[0] = out[1] = out[2] = 0;
    for (int g = 0; g < p->n; g++) {
        const struct rec_blob *b = &p->blob[g];
        double q = 0;
        for (int a = 0; a < 3; a++)
            q += (x[a] - b->m[a]) * (x[a] - b->m[a]) / (b->s[a] * b->s[a]);
        double e = exp(-0.5 * q);
        for (int ch = 0; ch < 3; ch++)
            out[ch] += b->a[ch] * e;
    }
}
#endif
