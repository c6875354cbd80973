#include <lz4.h>
#include <stdlib.h>
#include <zstd.h>

#include "base/mem.h"
#include "proto/fields.h"
#include "proto/half.h"

pvx_err pvp_decode_header(const void *msg, size_t len, struct pvp_header *h, struct pvx_diag *d)
{
    struct wire w = {.in = msg, .len = len, .at = 4};
    uint64_t body;
    *h = (struct pvp_header){0};
    if (len < WIRE_HEADER || memcmp(msg, PVP_SUBSCRIBE_ALL, 4) != 0)
        return pvx_fail(d, PVX_EFORMAT, "not a Pyrovox message (%zu bytes)", len);
    pvp_header_fields(&w, h, &body);
    uint32_t major = h->version >> 16, minor = h->version & 0xffff;
    if (major != PVP_VERSION_MAJOR)
        return pvx_fail(d, PVX_EVERSION, "message of wire version %u.%u, this reader knows %d.x",
                        major, minor, PVP_VERSION_MAJOR);
    if ((h->flags & WIRE_FLAGS_MUST) != 0)
        return pvx_fail(d, PVX_EVERSION, "message needs a newer reader (flags 0x%08x)", h->flags);
    if (h->head < WIRE_HEADER || h->head > len || body != len - h->head)
        return pvx_fail(d, PVX_EFORMAT, "message of %zu bytes says header %zu and body %llu", len,
                        h->head, (unsigned long long)body);
    h->body = (size_t)body;
    return PVX_OK;
}

pvx_err pvp_open_body(const void *msg, size_t len, enum pvp_type type, struct pvp_header *h,
                      struct wire *in, struct pvx_diag *d)
{
    PVX_TRY(pvp_decode_header(msg, len, h, d));
    if (h->type != type)
        return pvx_fail(d, PVX_EFORMAT, "message of type %u where %u was expected",
                        (unsigned)h->type, (unsigned)type);
    *in = (struct wire){.in = (const uint8_t *)msg + h->head, .len = h->body};
    return PVX_OK;
}

/* The ids ascend and lie inside the grid: then bricks are unique and unpacking stays in bounds. */
static pvx_err check_ids(const struct pvp_view *v, uint32_t bricks, struct pvx_diag *d)
{
    int64_t last = -1;
    for (uint32_t b = 0; b < v->n_bricks; b++) {
        uint32_t id = wire_load32(v->ids + 4 * (size_t)b);
        if ((int64_t)id <= last || id >= bricks)
            return pvx_fail(d, PVX_EFORMAT,
                            "volume message: brick %u of %u has id %u, not ascending below %u", b,
                            v->n_bricks, id, bricks);
        last = id;
    }
    return PVX_OK;
}

pvx_err pvp_decode_bricks(const void *msg, size_t len, enum pvp_type type, struct pvp_view *out,
                          uint32_t *doubt, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire in = {0};
    *out = (struct pvp_view){0};
    *doubt = 0;
    PVX_TRY(pvp_open_body(msg, len, type, &h, &in, d));
    struct pvp_volume *v = &out->v;
    v->session = h.session;
    out->clamped = (h.flags & PVP_FLAG_CLAMPED) != 0;
    struct pvp_payload p;
    pvp_volume_fields(&in, v, &p);
    *doubt = p.doubt;
    if (in.bad || p.description < WIRE_VOLUME || p.description > in.len)
        return pvx_fail(d, PVX_EFORMAT, "volume message is cut short or has a bad text field");
    if ((p.sample != PVP_F32 && p.sample != PVP_F16) || p.comp > PVP_ZSTD || p.side != PVP_BRICK)
        return pvx_fail(d, PVX_EUNSUP,
                        "volume message with sample format %u, compression %u, bricks of %u: not "
                        "known to this reader",
                        p.sample, p.comp, p.side);
    if (!pvp_grid_valid(&v->grid))
        return pvp_grid_fail(&v->grid, d);
    out->sample = (enum pvp_sample)p.sample;
    out->comp = (enum pvp_compress)p.comp;
    out->n_bricks = p.n_bricks;
    uint32_t nb[3], bricks = pvp_grid_bricks(&v->grid, nb);
    if (out->n_bricks > bricks)
        return pvx_fail(d, PVX_EFORMAT, "volume message with %u bricks in a grid of %u",
                        out->n_bricks, bricks);
    in.at = p.description;
    out->ids = wire_read(&in, 4 * (size_t)out->n_bricks);
    size_t want =
        (size_t)out->n_bricks * WIRE_CELLS * v->grid.channels * pvp_sample_size(out->sample);
    if (p.raw_len != want || p.stored > p.raw_len || (p.comp == PVP_RAW && p.stored != p.raw_len))
        return pvx_fail(
            d, PVX_EFORMAT, "volume message: %u bricks are %zu bytes, it says %llu, stored as %llu",
            out->n_bricks, want, (unsigned long long)p.raw_len, (unsigned long long)p.stored);
    out->raw_len = want;
    out->payload_len = (size_t)p.stored;
    out->payload = wire_read(&in, out->payload_len);
    if (in.bad)
        return pvx_fail(d, PVX_EFORMAT, "volume message is cut short");
    return check_ids(out, bricks, d);
}

pvx_err pvp_decode_volume(const void *msg, size_t len, struct pvp_view *out, struct pvx_diag *d)
{
    uint32_t reserved;
    return pvp_decode_bricks(msg, len, PVP_VOLUME, out, &reserved, d);
}

struct pvp_decoder {
    uint8_t *raw; /* one decompressed payload */
    size_t raw_size;
    ZSTD_DCtx *zstd;
};

pvx_err pvp_decoder_new(pvp_decoder **out)
{
    *out = calloc(1, sizeof **out);
    return *out != NULL ? PVX_OK : PVX_ENOMEM;
}

void pvp_decoder_free(pvp_decoder **dec)
{
    if (*dec == NULL)
        return;
    free((*dec)->raw);
    ZSTD_freeDCtx((*dec)->zstd);
    PVX_FREE(*dec);
}

static bool decompress_zstd(struct pvp_decoder *dec, const struct pvp_view *v)
{
    if (ZSTD_getFrameContentSize(v->payload, v->payload_len) != v->raw_len ||
        ZSTD_findFrameCompressedSize(v->payload, v->payload_len) != v->payload_len)
        return false;
    return ZSTD_decompressDCtx(dec->zstd, dec->raw, v->raw_len, v->payload, v->payload_len) ==
           v->raw_len;
}

static bool decompress_lz4(struct pvp_decoder *dec, const struct pvp_view *v)
{
    if (v->raw_len > LZ4_MAX_INPUT_SIZE)
        return false;
    return LZ4_decompress_safe((const char *)v->payload, (char *)dec->raw, (int)v->payload_len,
                               (int)v->raw_len) == (int)v->raw_len;
}

pvx_err pvp_volume_payload(pvp_decoder *dec, const struct pvp_view *v, const uint8_t **raw,
                           struct pvx_diag *d)
{
    *raw = v->payload;
    if (v->comp == PVP_RAW)
        return PVX_OK;
    if (v->raw_len > dec->raw_size) {
        free(dec->raw);
        dec->raw_size = 0;
        dec->raw = malloc(v->raw_len);
        if (dec->raw == NULL)
            return pvx_fail(d, PVX_ENOMEM, "no memory to decompress %zu bytes", v->raw_len);
        dec->raw_size = v->raw_len;
    }
    if (v->comp == PVP_ZSTD && dec->zstd == NULL && (dec->zstd = ZSTD_createDCtx()) == NULL)
        return PVX_ENOMEM;
    if (v->raw_len > 0 && !(v->comp == PVP_ZSTD ? decompress_zstd(dec, v) : decompress_lz4(dec, v)))
        return pvx_fail(d, PVX_ECORRUPT, "volume message: %zu bytes do not decompress to %zu",
                        v->payload_len, v->raw_len);
    *raw = dec->raw;
    return PVX_OK;
}

/* Converts `n` samples at p to floats; false when one is not finite. */
static bool load_samples(const uint8_t *p, enum pvp_sample sample, size_t n, float *out)
{
    uint32_t unfit = 0;
    for (size_t i = 0; sample == PVP_F16 && i < n; i++) {
        uint32_t h = wire_load16(p + 2 * i);
        unfit |= (h & 0x7c00u) == 0x7c00u;
        out[i] = pvp_half_to_float(h);
    }
    for (size_t i = 0; sample == PVP_F32 && i < n; i++) {
        uint32_t bits = wire_load32(p + 4 * i);
        unfit |= (bits & 0x7f800000u) == 0x7f800000u;
        memcpy(out + i, &bits, sizeof bits);
    }
    return unfit == 0;
}

static pvx_err not_finite(struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ECORRUPT, "volume message holds a value that is not finite");
}

/* Sets cells outside the grid to 0, whatever the message has there. */
static void pvp_decode_trim(const struct pvp_grid *g, uint32_t id, float *brick)
{
    uint32_t nb[3], in[3], c = g->channels;
    pvp_grid_bricks(g, nb);
    const uint32_t at[3] = {id % nb[0], id / nb[0] % nb[1], id / nb[0] / nb[1]};
    for (int a = 0; a < 3; a++) {
        uint32_t left = g->n[a] - at[a] * PVP_BRICK;
        in[a] = left < PVP_BRICK ? left : PVP_BRICK;
    }
    if (in[0] == PVP_BRICK && in[1] == PVP_BRICK && in[2] == PVP_BRICK)
        return;
    for (uint32_t k = 0; k < PVP_BRICK; k++)
        for (uint32_t j = 0; j < PVP_BRICK; j++) {
            float *row = brick + (size_t)(k * PVP_BRICK + j) * PVP_BRICK * c;
            uint32_t keep = k < in[2] && j < in[1] ? in[0] : 0;
            memset(row + (size_t)keep * c, 0, (size_t)(PVP_BRICK - keep) * c * sizeof *row);
        }
}

pvx_err pvp_volume_bricks(pvp_decoder *dec, const struct pvp_view *v, uint32_t *ids, float *brick,
                          size_t count, struct pvx_diag *d)
{
    const struct pvp_grid *g = &v->v.grid;
    size_t cells = WIRE_CELLS * (size_t)g->channels, n = v->n_bricks * cells;
    if (count < n)
        return pvx_fail(d, PVX_EINVAL, "room for %zu values, the bricks have %zu", count, n);
    const uint8_t *raw;
    PVX_TRY(pvp_volume_payload(dec, v, &raw, d));
    bool finite = load_samples(raw, v->sample, n, brick);
    for (uint32_t b = 0; b < v->n_bricks; b++) {
        ids[b] = wire_load32(v->ids + 4 * (size_t)b);
        pvp_decode_trim(g, ids[b], brick + b * cells);
    }
    return finite ? PVX_OK : not_finite(d);
}

pvx_err pvp_volume_unpack(pvp_decoder *dec, const struct pvp_view *v, float *dense, size_t count,
                          struct pvx_diag *d)
{
    const struct pvp_grid *g = &v->v.grid;
    if (count != pvp_grid_count(g))
        return pvx_fail(d, PVX_EINVAL, "room for %zu values, the volume has %zu", count,
                        pvp_grid_count(g));
    const uint8_t *raw;
    PVX_TRY(pvp_volume_payload(dec, v, &raw, d));
    memset(dense, 0, count * sizeof *dense);
    uint32_t nb[3];
    pvp_grid_bricks(g, nb);
    size_t row = PVP_BRICK * g->channels * pvp_sample_size(v->sample); /* bytes of 8 voxels */
    bool finite = true;
    for (uint32_t b = 0; b < v->n_bricks; b++) {
        uint32_t id = wire_load32(v->ids + 4 * (size_t)b);
        uint32_t i = id % nb[0] * PVP_BRICK, j0 = id / nb[0] % nb[1] * PVP_BRICK;
        uint32_t k0 = id / nb[0] / nb[1] * PVP_BRICK;
        uint32_t in_row = g->n[0] - i < PVP_BRICK ? g->n[0] - i : PVP_BRICK;
        for (uint32_t k = k0; k < k0 + PVP_BRICK && k < g->n[2]; k++)
            for (uint32_t j = j0; j < j0 + PVP_BRICK && j < g->n[1]; j++) {
                size_t r = (size_t)b * 64 + (k - k0) * PVP_BRICK + (j - j0);
                size_t at = (((size_t)k * g->n[1] + j) * g->n[0] + i) * g->channels;
                finite &= load_samples(raw + r * row, v->sample, (size_t)in_row * g->channels,
                                       dense + at);
            }
    }
    return finite ? PVX_OK : not_finite(d);
}
