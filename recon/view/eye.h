/* eye.h - one ray of a viewpoint.  Private to the room. */
#ifndef REC_VIEW_EYE_H
#define REC_VIEW_EYE_H
#include "recon/geom/bundle.h"
#include "recon/view/render.h"

/* The rays of a pixel of the eye, for volumes on g.  sub x sub even ones in a sharp camera. */
void rec_eye_rays(const struct rec_eye *eye, const struct rec_grid *g, struct rec_bundle *out);

/* Entries of ray i of a pixel (x, y) up to the first body; index, value [rec_traverse_max] (traverse.h). */
size_t rec_eye_ray(const struct rec_eye *eye, const struct rec_bundle *b, const struct rec_grid *g,
                   const int32_t pixel[2], int32_t i, int32_t *index, float *value);

#endif
