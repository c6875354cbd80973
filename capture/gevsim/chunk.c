/* chunk.c - chunk data, which a frame carries after its image. */
#include <string.h>

#include "capture/gevsim/gevsim.h"

static size_t put_mark(uint8_t *out, uint32_t id, size_t bytes)
{
    cap_put32(out, id);
    cap_put32(out + 4, (uint32_t)bytes);
    return 8;
}

static void put_value(enum gvcam_chunk which, const struct gvcam_shot *s, uint8_t *out)
{
    uint32_t bits;
    switch (which) {
    case GVC_TIMESTAMP: cap_put64(out, s->ticks); return;
    case GVC_FRAME_ID: cap_put64(out, s->id); return;
    case GVC_FRAME_COUNTER: cap_put32(out, s->count); return;
    case GVC_LINES: cap_put32(out, s->line); return;
    case GVC_EXPOSURE: memcpy(&bits, &s->exposure_us, 4); break;
    default: memcpy(&bits, &s->gain, 4); break;
    }
    cap_put32(out, bits);
}

static bool enabled(const struct cap_gvcam *c, unsigned k)
{
    return k == GVC_IMAGE || (c->reg.v[GVF_CHUNKS_ON] >> k & 1) != 0;
}

/* The image's own mark comes first, because the image's bytes lie before it. */
size_t gvcam_chunks(const struct cap_gvcam *c, const struct gvcam_shot *s, uint8_t *out)
{
    size_t n = put_mark(out, gvcam_chunk_defs[GVC_IMAGE].id, c->image.frame_bytes);
    for (unsigned k = GVC_IMAGE + 1; k < GVCAM_N_CHUNKS; k++)
        if (enabled(c, k)) {
            put_value((enum gvcam_chunk)k, s, out + n);
            n += gvcam_chunk_defs[k].bytes;
            n += put_mark(out + n, gvcam_chunk_defs[k].id, gvcam_chunk_defs[k].bytes);
        }
    return n;
}

size_t gvcam_chunks_max(const struct cap_gvcam *c)
{
    size_t n = 8;
    for (unsigned k = GVC_IMAGE + 1; k < GVCAM_N_CHUNKS; k++)
        if (enabled(c, k))
            n += gvcam_chunk_defs[k].bytes + 8;
    return n;
}
