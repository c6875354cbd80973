#include "proto/pvp_grid.h"

#include <math.h>

#include "proto/wire.h"

void pvp_subscription(enum pvp_type type, uint8_t prefix[PVP_SUBSCRIBE_LEN])
{
    memcpy(prefix, PVP_SUBSCRIBE_ALL, 4);
    wire_store16(prefix + 4, (uint32_t)type);
}

size_t pvp_grid_count(const struct pvp_grid *g)
{
    return (size_t)g->n[0] * g->n[1] * g->n[2] * g->channels;
}

bool pvp_grid_valid(const struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        if (g->n[a] < 1 || g->n[a] > PVP_GRID_MAX || !isfinite(g->min[a]) || !isfinite(g->max[a]) ||
            !(g->min[a] < g->max[a]))
            return false;
    return g->basis <= 1 && (g->channels == 1 || g->channels == 3);
}

uint32_t pvp_grid_bricks(const struct pvp_grid *g, uint32_t nb[3])
{
    for (int a = 0; a < 3; a++)
        nb[a] = (g->n[a] + PVP_BRICK - 1) / PVP_BRICK;
    return nb[0] * nb[1] * nb[2];
}

size_t pvp_sample_size(enum pvp_sample s)
{
    return s == PVP_F16 ? 2 : 4;
}
