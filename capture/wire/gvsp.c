#include "capture/wire/gvsp.h"

#include "capture/wire/be.h"

size_t cap_gvsp_put_head(uint8_t *out, const struct cap_gvsp_head *h)
{
    cap_put16(out, h->status);
    if (!h->wide) {
        cap_put16(out + 2, (uint16_t)h->block);
        cap_put32(out + 4, (uint32_t)h->content << 24 | (h->packet & 0xffffffu));
        return CAP_GVSP_HEAD;
    }
    cap_put16(out + 2, 0);
    cap_put32(out + 4, (0x80u | h->content) << 24);
    cap_put64(out + 8, h->block);
    cap_put32(out + 16, h->packet);
    return CAP_GVSP_HEAD_WIDE;
}

size_t cap_gvsp_put_leader(uint8_t *out, const struct cap_gvsp_leader *l)
{
    cap_put16(out, 0);
    cap_put16(out + 2, l->payload);
    cap_put64(out + 4, l->ticks);
    cap_put32(out + 12, l->pixel_format);
    cap_put32(out + 16, l->width);
    cap_put32(out + 20, l->height);
    cap_put32(out + 24, l->x);
    cap_put32(out + 28, l->y);
    cap_put32(out + 32, 0);
    return CAP_GVSP_LEADER;
}

size_t cap_gvsp_put_trailer(uint8_t *out, uint16_t payload, uint32_t rows, uint32_t chunk_bytes)
{
    cap_put16(out, 0);
    cap_put16(out + 2, payload);
    if (payload == CAP_GVSP_EXTENDED_CHUNK) { /* the order in 1.2 */
        cap_put32(out + 4, chunk_bytes);
        cap_put32(out + 8, rows);
    } else {
        cap_put32(out + 4, rows);
        cap_put32(out + 8, chunk_bytes);
    }
    cap_put32(out + 12, 0);
    return payload == CAP_GVSP_IMAGE ? 8 : 16;
}

uint64_t cap_gvsp_next(uint64_t block, bool wide)
{
    uint64_t next = block + 1;
    if (!wide)
        next &= 0xffff;
    return next == 0 ? 1 : next;
}
