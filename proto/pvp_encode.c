#include <lz4.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/mem.h"
#include "proto/encoder.h"
#include "proto/half.h"

pvx_err pvp_encoder_new(const struct pvp_grid *g, enum pvp_sample sample, enum pvp_compress comp,
                        pvp_encoder **out)
{
    *out = NULL;
    if (!pvp_grid_valid(g) || (sample != PVP_F32 && sample != PVP_F16) ||
        (comp != PVP_RAW && comp != PVP_LZ4 && comp != PVP_ZSTD))
        return PVX_EINVAL;
    struct pvp_encoder *e = calloc(1, sizeof *e);
    PVX_NEED(e);
    e->grid = *g;
    e->sample = sample;
    e->comp = comp;
    e->bricks = pvp_grid_bricks(g, e->nb);
    /* Worst case, every brick active: only address space, memory is taken when used. */
    e->raw_size = (size_t)e->bricks * WIRE_CELLS * g->channels * pvp_sample_size(sample);
    size_t volume = WIRE_VOLUME + 4 * (size_t)e->bricks + e->raw_size;
    e->msg_size = WIRE_HEADER + (volume > PVP_PREVIEW_MAX ? volume : PVP_PREVIEW_MAX);
    e->msg = pvx_reserve(e->msg_size);
    e->marked = pvx_calloc((e->bricks + 63) / 64, sizeof *e->marked);
    e->slot = pvx_calloc(e->bricks, sizeof *e->slot);
    /* For any `comp`, since it may be changed later. */
    e->raw = pvx_reserve(e->raw_size);
    e->lz4 = malloc((size_t)LZ4_sizeofState());
    e->zstd = ZSTD_createCCtx();
    if (e->msg == NULL || e->marked == NULL || e->slot == NULL || e->raw == NULL ||
        e->lz4 == NULL || e->zstd == NULL ||
        ZSTD_isError(ZSTD_CCtx_setParameter(e->zstd, ZSTD_c_compressionLevel, 1))) {
        pvp_encoder_free(&e);
        return PVX_ENOMEM;
    }
    *out = e;
    return PVX_OK;
}

void pvp_encoder_compress(pvp_encoder *e, enum pvp_compress comp)
{
    e->comp = comp;
}

void pvp_encoder_free(pvp_encoder **e)
{
    if (*e == NULL)
        return;
    pvx_unreserve((*e)->msg, (*e)->msg_size);
    pvx_unreserve((*e)->raw, (*e)->raw_size);
    free((*e)->marked);
    free((*e)->slot);
    free((*e)->lz4);
    ZSTD_freeCCtx((*e)->zstd);
    PVX_FREE(*e);
}

void pvp_finish(struct pvp_encoder *e, struct pvp_header h, const void **msg, size_t *len)
{
    struct wire w = {.out = e->msg};
    uint64_t body = h.body;
    memcpy(wire_write(&w, 4), PVP_SUBSCRIBE_ALL, 4);
    h.head = WIRE_HEADER;
    h.version = PVP_VERSION_MAJOR << 16 | PVP_VERSION_MINOR;
    h.type_sequence = e->sent[h.type / 100 - 1]++;
    pvp_header_fields(&w, &h, &body);
    *msg = e->msg;
    *len = WIRE_HEADER + h.body;
}

/* Voxel index -> brick and place in it.  Indices ascend, so the row is kept, and the divisions
 * are done once per row, not once per voxel. */
struct walk {
    uint32_t nx, ny, nbx, nby;
    uint32_t row_begin, row_end; /* indices of the row; empty at first */
    uint32_t brick_row, cell_row;
};

static inline uint32_t walk_to(struct walk *w, uint32_t index, uint32_t *cell)
{
    if (index >= w->row_end) {
        uint32_t row = index / w->nx, j = row % w->ny, k = row / w->ny;
        w->row_begin = row * w->nx;
        w->row_end = w->row_begin + w->nx;
        w->brick_row = ((k / PVP_BRICK) * w->nby + j / PVP_BRICK) * w->nbx;
        w->cell_row = ((k % PVP_BRICK) * PVP_BRICK + j % PVP_BRICK) * PVP_BRICK;
    }
    uint32_t i = index - w->row_begin;
    *cell = w->cell_row + i % PVP_BRICK;
    return w->brick_row + i / PVP_BRICK;
}

static struct walk walk_start(const struct pvp_encoder *e)
{
    return (struct walk){.nx = e->grid.n[0], .ny = e->grid.n[1], .nbx = e->nb[0], .nby = e->nb[1]};
}

/* Marks the bricks of the voxels.  On a bad index the marks are cleared. */
static pvx_err mark_bricks(struct pvp_encoder *e, uint32_t n, const int32_t *index)
{
    int64_t last = -1;
    int64_t end = (int64_t)e->grid.n[0] * e->grid.n[1] * e->grid.n[2];
    struct walk w = walk_start(e);
    for (uint32_t v = 0; v < n; v++) {
        if (index[v] <= last || index[v] >= end) {
            memset(e->marked, 0, (e->bricks + 63) / 64 * sizeof *e->marked);
            return PVX_EINVAL;
        }
        last = index[v];
        uint32_t cell, brick = walk_to(&w, (uint32_t)index[v], &cell);
        e->marked[brick / 64] |= 1ull << brick % 64;
    }
    return PVX_OK;
}

/* Writes the brick ids, ascending, and sets their slots; clears the marks.  Returns the number of bricks. */
static uint32_t put_ids(struct pvp_encoder *e, struct wire *w)
{
    uint32_t n = 0;
    for (uint32_t word = 0; word < (e->bricks + 63) / 64; word++) {
        for (uint64_t m = e->marked[word]; m != 0; m &= m - 1) {
            uint32_t id = word * 64 + (uint32_t)__builtin_ctzll(m);
            e->slot[id] = n++;
            wire_u32(w, &id);
        }
        e->marked[word] = 0;
    }
    return n;
}

/* Converts floats to the message's samples, in place; the loops are vectorised. */
static pvx_err pvp_encode_convert(enum pvp_sample sample, size_t n, uint32_t *bits, bool *clamped)
{
    uint32_t cut = 0, unfit = 0;
    for (size_t i = 0; i < n; i++) {
        uint32_t mag = bits[i] & 0x7fffffffu;
        unfit |= mag >= 0x7f800000u;
        cut |= mag > 0x477fe000u; /* 65504, the largest half */
    }
    for (size_t i = 0; sample == PVP_F16 && i < n; i++)
        bits[i] = pvp_half_from_bits(bits[i]);
    *clamped |= sample == PVP_F16 && cut != 0;
    return unfit ? PVX_EINVAL : PVX_OK;
}

/* Puts the voxels' values into zeroed bricks at `p`. */
static pvx_err put_values(const struct pvp_encoder *e, const struct pvp_voxels *x, uint8_t *p,
                          bool *clamped)
{
    enum { BLOCK = 128 };
    const float *value = x->value;
    uint32_t nch = e->grid.channels, bits[BLOCK * 3];
    struct walk w = walk_start(e);
    *clamped = false;
    for (uint32_t from = 0, n; from < x->n; from += n) {
        n = x->n - from < BLOCK ? x->n - from : BLOCK;
        for (uint32_t v = 0; v < n; v++, value += x->stride)
            memcpy(bits + v * nch, value, nch * sizeof *bits);
        PVX_TRY(pvp_encode_convert(e->sample, (size_t)n * nch, bits, clamped));
        const uint32_t *in = bits;
        for (uint32_t v = 0; v < n; v++) {
            uint32_t cell, brick = walk_to(&w, (uint32_t)x->index[from + v], &cell);
            size_t at = ((size_t)e->slot[brick] * WIRE_CELLS + cell) * nch;
            for (uint32_t c = 0; c < nch; c++, in++)
                if (e->sample == PVP_F32)
                    wire_store32(p + 4 * (at + c), *in);
                else
                    wire_store16(p + 2 * (at + c), *in);
        }
    }
    return PVX_OK;
}

/* Compresses raw into msg at `dst`.  Returns 0 when it would not become smaller (or LZ4 cannot take that much). */
static size_t compress(struct pvp_encoder *e, size_t raw_len, uint8_t *dst)
{
    if (raw_len == 0)
        return 0;
    if (e->comp == PVP_LZ4) {
        if (raw_len > LZ4_MAX_INPUT_SIZE)
            return 0;
        int n = LZ4_compress_fast_extState(e->lz4, (const char *)e->raw, (char *)dst, (int)raw_len,
                                           (int)raw_len - 1, 1);
        return n > 0 ? (size_t)n : 0;
    }
    size_t n = ZSTD_compress2(e->zstd, dst, raw_len - 1, e->raw, raw_len);
    return ZSTD_isError(n) ? 0 : n;
}

pvx_err pvp_encode_bricks(struct pvp_encoder *e, struct pvp_header h, const struct pvp_volume *v,
                          uint32_t doubt, const struct pvp_voxels *x, const void **msg, size_t *len)
{
    if (!pvp_grid_same(&v->grid, &e->grid) || (x->n > 0 && x->stride < (int)e->grid.channels))
        return PVX_EINVAL;
    PVX_TRY(mark_bricks(e, x->n, x->index));
    struct wire ids = {.out = e->msg, .at = WIRE_HEADER + WIRE_VOLUME};
    uint32_t n_bricks = put_ids(e, &ids);
    size_t raw_len = (size_t)n_bricks * WIRE_CELLS * e->grid.channels * pvp_sample_size(e->sample);
    uint8_t *payload = e->msg + ids.at;
    uint8_t *raw = e->comp == PVP_RAW ? payload : e->raw;
    bool clamped;
    memset(raw, 0, raw_len);
    PVX_TRY(put_values(e, x, raw, &clamped));
    enum pvp_compress comp = e->comp;
    size_t stored = comp == PVP_RAW ? raw_len : compress(e, raw_len, payload);
    if (comp != PVP_RAW && stored == 0) {
        comp = PVP_RAW;
        stored = raw_len;
        memcpy(payload, raw, raw_len);
    }
    struct wire w = {.out = e->msg, .at = WIRE_HEADER};
    struct pvp_volume fields = *v;
    struct pvp_payload p = {.description = WIRE_VOLUME,
                            .sample = (uint32_t)e->sample,
                            .comp = (uint32_t)comp,
                            .side = PVP_BRICK,
                            .n_bricks = n_bricks,
                            .doubt = doubt,
                            .raw_len = raw_len,
                            .stored = stored};
    pvp_volume_fields(&w, &fields, &p);
    h.flags = clamped ? PVP_FLAG_CLAMPED : 0;
    h.session = v->session;
    h.body = ids.at - WIRE_HEADER + stored;
    pvp_finish(e, h, msg, len);
    return PVX_OK;
}

pvx_err pvp_encode_volume(pvp_encoder *e, uint64_t sequence, const struct pvp_volume *v,
                          const struct pvp_voxels *x, const void **msg, size_t *len)
{
    return pvp_encode_bricks(e, (struct pvp_header){PVP_VOLUME, .sequence = sequence}, v, 0, x, msg,
                             len);
}
