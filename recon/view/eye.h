/* eye.h - one ray of a viewpoint.  Private to the room. */
#ifndef REC_VIEW_EYE_H
#define REC_VIEW_EYE_H
#include "recon/view/render.h"

/* Entries of the ray through (px, py) up to the first body; index, value [rec_traverse_max] (traverse.h). */
size_t rec_eye_ray(const struct rec_eye *eye, const struct rec_grid *g, double px, double py,
                   int32_t *index, float *value);

#endif
