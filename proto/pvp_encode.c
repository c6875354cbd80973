#include <lz4.h>
#include <math.h>
#include <stdlib.h>
#include <zstd.h>

#include "base/mem.h"
#include "proto/half.h"
#include "proto/pvp.h"
#include "proto/pvp_grid.h"
#include "proto/wire.h"

struct pvp_encoder {
    struct pvp_grid grid;
    enum pvp_sample sample;
    enum pvp_compress comp;
    uint32_t nb[3], bricks;
    uint64_t session;
    uint64_t sent[4]; /* messages so far by type: the type sequence */
    uint8_t *msg;     /* the message under construction */
    size_t msg_size;
    uint8_t *raw; /* payload before compression; NULL when it is built in msg */
    size_t raw_size;
    uint64_t *marked; /* bit per brick: has an active voxel; all 0 between calls */
    uint32_t *slot;   /* place of a marked brick in the payload */
    void *lz4;
    ZSTD_CCtx *zstd;
};

pvx_err pvp_encoder_new(const struct pvp_grid *g, enum pvp_sample sample, enum pvp_compress comp,
                        pvp_encoder **out)
{
    *out = NULL;
    if (!pvp_grid_valid(g) || (sample != PVP_F32 && sample != PVP_F16) ||
        (comp != PVP_RAW && comp != PVP_LZ4 && comp != PVP_ZSTD))
        return PVX_EINVAL;
    struct pvp_encoder *e = calloc(1, sizeof *e);
    if (e == NULL)
        return PVX_ENOMEM;
    e->grid = *g;
    e->sample = sample;
    e->comp = comp;
    e->bricks = pvp_grid_bricks(g, e->nb);
    /* Worst case, every brick active: address space only, memory comes with use. */
    e->raw_size = (size_t)e->bricks * WIRE_CELLS * g->channels * pvp_sample_size(sample);
    size_t volume = WIRE_VOLUME + 4 * (size_t)e->bricks + e->raw_size;
    e->msg_size = WIRE_HEADER + (volume > PVP_STATUS_MAX ? volume : PVP_STATUS_MAX);
    e->msg = pvx_reserve(e->msg_size);
    e->marked = pvx_calloc((e->bricks + 63) / 64, sizeof *e->marked);
    e->slot = pvx_calloc(e->bricks, sizeof *e->slot);
    bool ok = e->msg != NULL && e->marked != NULL && e->slot != NULL;
    if (comp != PVP_RAW)
        ok = (e->raw = pvx_reserve(e->raw_size)) != NULL && ok;
    if (comp == PVP_LZ4)
        ok = (e->lz4 = malloc((size_t)LZ4_sizeofState())) != NULL && ok;
    if (comp == PVP_ZSTD)
        ok = (e->zstd = ZSTD_createCCtx()) != NULL &&
             !ZSTD_isError(ZSTD_CCtx_setParameter(e->zstd, ZSTD_c_compressionLevel, 1)) && ok;
    if (!ok) {
        pvp_encoder_free(&e);
        return PVX_ENOMEM;
    }
    *out = e;
    return PVX_OK;
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

/* Header in front of `body` bytes that are in place already; counts the message. */
static void finish(struct pvp_encoder *e, enum pvp_type type, uint64_t sequence, uint64_t session,
                   uint32_t flags, size_t body, const void **msg, size_t *len)
{
    struct wire_out o = {.p = e->msg};
    memcpy(o.p, PVP_SUBSCRIBE_ALL, 4);
    o.at = 4;
    put_u16(&o, (uint32_t)type);
    put_u16(&o, WIRE_HEADER);
    put_u16(&o, PVP_VERSION_MAJOR);
    put_u16(&o, PVP_VERSION_MINOR);
    put_u32(&o, flags);
    put_u64(&o, sequence);
    put_u64(&o, e->sent[type / 100 - 1]++);
    put_u64(&o, session);
    put_u64(&o, body);
    *msg = e->msg;
    *len = WIRE_HEADER + body;
}

static void put_grid(struct wire_out *o, const struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        put_u32(o, g->n[a]);
    put_u32(o, g->basis);
    put_u32(o, g->channels);
}

static void put_box(struct wire_out *o, const struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        put_f64(o, g->min[a]);
    for (int a = 0; a < 3; a++)
        put_f64(o, g->max[a]);
}

pvx_err pvp_encode_start(pvp_encoder *e, uint64_t sequence, const struct pvp_start *s,
                         const void **msg, size_t *len)
{
    if (!pvp_grid_valid(&s->grid) || !isfinite(s->fps) || s->fps < 0)
        return PVX_EINVAL;
    struct wire_out o = {.p = e->msg, .at = WIRE_HEADER};
    put_grid(&o, &s->grid);
    put_u32(&o, s->n_cameras);
    put_box(&o, &s->grid);
    put_u64(&o, s->rig_hash);
    put_f64(&o, s->fps);
    put_text(&o, s->units, sizeof s->units);
    put_text(&o, s->software, sizeof s->software);
    e->session = s->session;
    finish(e, PVP_START, sequence, s->session, 0, WIRE_START, msg, len);
    return PVX_OK;
}

pvx_err pvp_encode_status(pvp_encoder *e, uint64_t sequence, const char *json, const void **msg,
                          size_t *len)
{
    size_t n = strnlen(json, PVP_STATUS_MAX + 1);
    if (n > PVP_STATUS_MAX)
        return PVX_ERANGE;
    memcpy(e->msg + WIRE_HEADER, json, n);
    finish(e, PVP_STATUS, sequence, e->session, 0, n, msg, len);
    return PVX_OK;
}

pvx_err pvp_encode_end(pvp_encoder *e, uint64_t sequence, uint64_t session, const char *reason,
                       const void **msg, size_t *len)
{
    struct wire_out o = {.p = e->msg, .at = WIRE_HEADER};
    put_text(&o, reason, WIRE_END);
    finish(e, PVP_END, sequence, session, 0, WIRE_END, msg, len);
    return PVX_OK;
}

/* Voxel index -> brick and place in it.  Indices ascend, so the row is kept and the divisions are
 * needed once per row, not once per voxel. */
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

static bool same_grid(const struct pvp_grid *a, const struct pvp_grid *b)
{
    for (int i = 0; i < 3; i++)
        if (a->n[i] != b->n[i] || a->min[i] < b->min[i] || a->min[i] > b->min[i] ||
            a->max[i] < b->max[i] || a->max[i] > b->max[i])
            return false;
    return a->basis == b->basis && a->channels == b->channels;
}

/* Marks the bricks of the voxels.  On a bad index the marks are taken back. */
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

/* Brick ids, ascending, and their slots; clears the marks.  Returns how many. */
static uint32_t put_ids(struct pvp_encoder *e, struct wire_out *o)
{
    uint32_t n = 0;
    for (uint32_t word = 0; word < (e->bricks + 63) / 64; word++) {
        for (uint64_t m = e->marked[word]; m != 0; m &= m - 1) {
            uint32_t id = word * 64 + (uint32_t)__builtin_ctzll(m);
            e->slot[id] = n++;
            put_u32(o, id);
        }
        e->marked[word] = 0;
    }
    return n;
}

/* The voxels' values into zeroed bricks at `p`. */
static pvx_err put_values(const struct pvp_encoder *e, uint32_t n, const int32_t *index,
                          const float *value, int stride, uint8_t *p, bool *clamped)
{
    uint32_t nch = e->grid.channels;
    uint32_t cut = 0, unfit = 0;
    struct walk w = walk_start(e);
    for (uint32_t v = 0; v < n; v++, value += stride) {
        uint32_t cell, brick = walk_to(&w, (uint32_t)index[v], &cell);
        size_t at = ((size_t)e->slot[brick] * WIRE_CELLS + cell) * nch;
        for (uint32_t c = 0; c < nch; c++) {
            uint32_t bits;
            memcpy(&bits, value + c, sizeof bits);
            uint32_t mag = bits & 0x7fffffffu;
            unfit |= mag >= 0x7f800000u;
            if (e->sample == PVP_F32) {
                wire_store32(p + 4 * (at + c), bits);
            } else {
                cut |= mag > 0x477fe000u; /* PVP_HALF_MAX */
                wire_store16(p + 2 * (at + c), pvp_half_from_bits(bits));
            }
        }
    }
    *clamped = cut != 0;
    return unfit ? PVX_EINVAL : PVX_OK;
}

/* raw -> msg at `dst`.  0 when it would not become smaller (or LZ4 cannot take that much). */
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

static void put_report(struct wire_out *o, const struct pvp_report *r)
{
    put_u32(o, r->status);
    put_u32(o, r->iterations);
    put_text(o, r->solver, sizeof r->solver);
    put_f64(o, r->rel_residual);
    put_u32(o, r->active_voxels);
    put_u32(o, r->active_rays);
    put_u64(o, r->entries);
    put_i64(o, r->photometry_ns);
    put_i64(o, r->hull_ns);
    put_i64(o, r->restrict_ns);
    put_i64(o, r->solve_ns);
    put_i64(o, r->total_ns);
}

pvx_err pvp_encode_volume(pvp_encoder *e, uint64_t sequence, const struct pvp_volume *v, uint32_t n,
                          const int32_t *index, const float *value, int stride, const void **msg,
                          size_t *len)
{
    if (!same_grid(&v->grid, &e->grid) || (n > 0 && stride < (int)e->grid.channels))
        return PVX_EINVAL;
    PVX_TRY(mark_bricks(e, n, index));
    struct wire_out ids = {.p = e->msg, .at = WIRE_HEADER + WIRE_VOLUME};
    uint32_t n_bricks = put_ids(e, &ids);
    size_t raw_len = (size_t)n_bricks * WIRE_CELLS * e->grid.channels * pvp_sample_size(e->sample);
    uint8_t *payload = e->msg + ids.at;
    uint8_t *raw = e->comp == PVP_RAW ? payload : e->raw;
    bool clamped;
    memset(raw, 0, raw_len);
    PVX_TRY(put_values(e, n, index, value, stride, raw, &clamped));
    enum pvp_compress comp = e->comp;
    size_t stored = comp == PVP_RAW ? raw_len : compress(e, raw_len, payload);
    if (comp != PVP_RAW && stored == 0) {
        comp = PVP_RAW;
        stored = raw_len;
        memcpy(payload, raw, raw_len);
    }
    struct wire_out o = {.p = e->msg, .at = WIRE_HEADER};
    put_u32(&o, WIRE_VOLUME);
    put_u32(&o, (uint32_t)e->sample);
    put_u32(&o, (uint32_t)comp);
    put_u32(&o, PVP_BRICK);
    put_u64(&o, v->set);
    put_i64(&o, v->t_exposure_ns);
    put_i64(&o, v->t_publish_ns);
    put_i64(&o, v->spread_ns);
    put_i64(&o, v->latency_ns);
    put_u64(&o, v->camera_mask);
    put_u32(&o, v->cameras_present);
    put_grid(&o, &v->grid);
    put_box(&o, &v->grid);
    put_report(&o, &v->report);
    put_u32(&o, n_bricks);
    put_u32(&o, 0); /* reserved: keeps what follows aligned to 8 */
    put_u64(&o, raw_len);
    put_u64(&o, stored);
    finish(e, PVP_VOLUME, sequence, v->session, clamped ? PVP_FLAG_CLAMPED : 0,
           ids.at - WIRE_HEADER + stored, msg, len);
    return PVX_OK;
}
