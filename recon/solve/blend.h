/* blend.h - the middle of a long solve: the channels are solved as one, and each voxel keeps its colour.
 *
 * A is the same matrix in every channel.  So a weighted sum of the channels is a picture of the same kind, at a
 * third of the work:
 *     b = sum_l c_l b_l,  c_l = light_l / sigma_l^2, the largest is 1                               (1)
 *     x = sum_l c_l x_l,  r = A x - b = sum_l c_l r_l: no product is needed                         (2)
 *     lambda / unit, and the formula's: geometric means of the channels', weighted by c_l light_l   (3)
 * With the sum at s from s_0, every voxel keeps the colour that it had:
 *     x_l = (x_l + e k_l) s / (s_0 + e),  k_l = sum of x_l / sum of s_0,  e = 0.02 mean of s_0      (4)
 * sum_l c_l k_l = 1, so the sum of (4) is s.  Where s_0 is 0 the colour is that of the whole flame.  lambda of each
 * channel then changes by the factor by which that of the sum changed.
 *
 * A flame with sharp detail needs 10 to 30 iterations on the finest grid, and most of them are for brightness.  A smooth
 * flame takes a few, which are mostly for its colours.  How far the first and the fifth iteration move x tells them
 * apart.  A solve that breaks one of the rules of blend.c never blends, and its bits do not change (NUMERICS.md, 4).
 * Threads: same bits for any number.  Private to the solver. */
#ifndef REC_BLEND_H
#define REC_BLEND_H
#include "recon/solve/passes/pcg_pass.h"
#include "recon/solve/stop.h"

#define REC_BLEND_AFTER 5 /* iterations; V and lambda were renewed in them */

/* 0: all channels go on; else the factor on the shares of stop.h with which the sum stops.  renewals: done. */
double rec_blend_helps(const struct rec_pcg *t, const struct rec_stopper *stop, uint32_t renewals);
/* Fills `one` from `t`, which keeps x and b alone: their sums by (1) and (2), V, and the areas of t's other vectors.
 * one->pb is the problem of (1); rwr: r'W r of it. */
void rec_blend_begin(struct rec_pcg *t, struct rec_pcg *one, double rwr[4]);
/* (4) in t->x, and t->lambda. */
void rec_blend_end(struct rec_pcg *t, const struct rec_pcg *one);

#endif
