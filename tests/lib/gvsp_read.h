/* gvsp_read.h - the receiving side of capture/wire/gvsp.h. */
#ifndef GVSP_READ_H
#define GVSP_READ_H
#include <string.h>

#include "capture/wire/be.h"
#include "capture/wire/gvsp.h"

/* Bytes of the head, 0 = too short to be one. */
static inline size_t gvsp_head(const void *packet, size_t bytes, struct cap_gvsp_head *out)
{
    const uint8_t *p = packet;
    memset(out, 0, sizeof *out);
    if (bytes < CAP_GVSP_HEAD)
        return 0;
    out->status = cap_get16(p);
    out->wide = (p[4] & 0x80) != 0;
    out->content = p[4] & 0x7f;
    if (!out->wide) {
        out->block = cap_get16(p + 2);
        out->packet = cap_get32(p + 4) & 0xffffffu;
        return CAP_GVSP_HEAD;
    }
    if (bytes < CAP_GVSP_HEAD_WIDE)
        return 0;
    out->block = cap_get64(p + 8);
    out->packet = cap_get32(p + 16);
    return CAP_GVSP_HEAD_WIDE;
}

static inline bool gvsp_leader(const void *body, size_t bytes, struct cap_gvsp_leader *out)
{
    const uint8_t *p = body;
    memset(out, 0, sizeof *out);
    if (bytes < CAP_GVSP_LEADER)
        return false;
    out->payload = cap_get16(p + 2);
    out->ticks = cap_get64(p + 4);
    out->pixel_format = cap_get32(p + 12);
    out->width = cap_get32(p + 16);
    out->height = cap_get32(p + 20);
    out->x = cap_get32(p + 24);
    out->y = cap_get32(p + 28);
    return true;
}
#endif
