/* pvp_bars.c - messages of error bars, which have the body of a volume message, and the names of the doubts. */
#include "proto/encoder.h"

/* A deviation is not below 0. */
static bool any_below(const struct pvp_voxels *sd, uint32_t channels)
{
    for (uint32_t v = 0; v < sd->n; v++)
        for (uint32_t c = 0; c < channels; c++)
            if (sd->value[(size_t)v * (size_t)sd->stride + c] < 0)
                return true;
    return false;
}

pvx_err pvp_encode_bars(pvp_encoder *e, uint64_t sequence, const struct pvp_volume *v,
                        uint32_t doubt, const struct pvp_voxels *sd, const void **msg, size_t *len)
{
    if (sd->n > 0 && (sd->stride < (int)e->grid.channels || any_below(sd, e->grid.channels)))
        return PVX_EINVAL;
    return pvp_encode_bricks(e, (struct pvp_header){PVP_BARS, .sequence = sequence}, v, doubt, sd,
                             msg, len);
}

pvx_err pvp_decode_bars(const void *msg, size_t len, struct pvp_view *out, uint32_t *doubt,
                        struct pvx_diag *d)
{
    return pvp_decode_bricks(msg, len, PVP_BARS, out, doubt, d);
}

bool pvp_bars_fit(const struct pvp_view *bars, const struct pvp_view *volume)
{
    return bars->v.session == volume->v.session && bars->v.set == volume->v.set &&
           pvp_grid_same(&bars->v.grid, &volume->v.grid) && bars->n_bricks == volume->n_bricks &&
           (bars->n_bricks == 0 || memcmp(bars->ids, volume->ids, 4 * (size_t)bars->n_bricks) == 0);
}

static const struct {
    const char *name, *sentence;
} doubts[] = {
#define DOUBT(bit, id, name, sentence) [bit] = {name, sentence},
    PVP_DOUBTS(DOUBT)
#undef DOUBT
};

const char *pvp_doubt_name(unsigned bit)
{
    return bit < sizeof doubts / sizeof doubts[0] ? doubts[bit].name : NULL;
}

const char *pvp_doubt_sentence(unsigned bit)
{
    return bit < sizeof doubts / sizeof doubts[0] ? doubts[bit].sentence : NULL;
}
