#include "proto/relay.h"

#include <lz4.h>
#include <stdlib.h>

#include "base/mem.h"
#include "proto/fields.h"

/* Offsets of the fields that change (PROTOCOL.md). */
enum { AT_BODY_LENGTH = 40, AT_COMPRESSION = 8, AT_STORED = 240 };

struct pvp_relay {
    pvp_decoder *decoder;
    uint8_t *msg;
    size_t size;
};

pvx_err pvp_relay_new(pvp_relay **out)
{
    *out = calloc(1, sizeof **out);
    PVX_NEED(*out);
    pvx_err e = pvp_decoder_new(&(*out)->decoder);
    if (e != PVX_OK)
        PVX_FREE(*out);
    return e;
}

void pvp_relay_free(pvp_relay **r)
{
    if (*r == NULL)
        return;
    pvp_decoder_free(&(*r)->decoder);
    free((*r)->msg);
    PVX_FREE(*r);
}

/* Returns the bytes stored at `to`, which has room for raw_len. */
static size_t relay_pack(const uint8_t *raw, size_t raw_len, uint8_t *to, enum pvp_compress *comp)
{
    int n = 0;
    if (raw_len > 1 && raw_len <= LZ4_MAX_INPUT_SIZE)
        n = LZ4_compress_default((const char *)raw, (char *)to, (int)raw_len, (int)raw_len - 1);
    *comp = n > 0 ? PVP_LZ4 : PVP_RAW;
    if (n > 0)
        return (size_t)n;
    memcpy(to, raw, raw_len);
    return raw_len;
}

pvx_err pvp_relay_volume(pvp_relay *r, const void *msg, size_t len, bool small, const void **out,
                         size_t *out_len, struct pvx_diag *d)
{
    struct pvp_view v;
    struct pvp_header h;
    *out = msg;
    *out_len = len;
    uint32_t doubt;
    PVX_TRY(pvp_decode_header(msg, len, &h, d));
    PVX_TRY(pvp_decode_bricks(msg, len, h.type == PVP_BARS ? PVP_BARS : PVP_VOLUME, &v, &doubt, d));
    if (v.comp == PVP_LZ4 || v.raw_len == 0 || (v.comp == PVP_RAW && !small))
        return PVX_OK;
    const uint8_t *raw;
    PVX_TRY(pvp_volume_payload(r->decoder, &v, &raw, d));
    size_t front = (size_t)(v.payload - (const uint8_t *)msg), room = front + v.raw_len;
    if (room > r->size) {
        free(r->msg);
        r->size = 0;
        r->msg = malloc(room);
        if (r->msg == NULL)
            return pvx_fail(d, PVX_ENOMEM, "no memory for a message of %zu bytes", room);
        r->size = room;
    }
    enum pvp_compress comp;
    size_t stored = relay_pack(raw, v.raw_len, r->msg + front, &comp);
    memcpy(r->msg, msg, front);
    wire_store64(r->msg + AT_BODY_LENGTH, front - h.head + stored);
    wire_store32(r->msg + h.head + AT_COMPRESSION, comp);
    wire_store64(r->msg + h.head + AT_STORED, stored);
    *out = r->msg;
    *out_len = front + stored;
    return PVX_OK;
}
