/* pvp_grid.h - what encoder and decoder both ask about a grid (private to proto). */
#ifndef PVP_GRID_H
#define PVP_GRID_H
#include "proto/pvp.h"

/* Within the limits of the format. */
bool pvp_grid_valid(const struct pvp_grid *g);
/* nb[3]: bricks along x, y, z; returns their product (at most 2^21). */
uint32_t pvp_grid_bricks(const struct pvp_grid *g, uint32_t nb[3]);
/* Bytes of one sample. */
size_t pvp_sample_size(enum pvp_sample s);
#endif
