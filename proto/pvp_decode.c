#include <lz4.h>
#include <math.h>
#include <stdlib.h>
#include <zstd.h>

#include "base/mem.h"
#include "proto/half.h"
#include "proto/pvp.h"
#include "proto/pvp_grid.h"
#include "proto/wire.h"

pvx_err pvp_decode_header(const void *msg, size_t len, struct pvp_header *h, struct pvx_diag *d)
{
    struct wire_in in = {.p = msg, .len = len};
    *h = (struct pvp_header){0};
    if (len < WIRE_HEADER || memcmp(msg, PVP_SUBSCRIBE_ALL, 4) != 0)
        return pvx_fail(d, PVX_EFORMAT, "not a Pyrovox message (%zu bytes)", len);
    in.at = 4;
    h->type = (enum pvp_type)get_u16(&in);
    h->head = get_u16(&in);
    uint32_t major = get_u16(&in), minor = get_u16(&in);
    h->version = major << 16 | minor;
    h->flags = get_u32(&in);
    h->sequence = get_u64(&in);
    h->type_sequence = get_u64(&in);
    h->session = get_u64(&in);
    uint64_t body = get_u64(&in);
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

/* Header of a message that must be of `type`; *in = its body. */
static pvx_err open_body(const void *msg, size_t len, enum pvp_type type, struct pvp_header *h,
                         struct wire_in *in, struct pvx_diag *d)
{
    PVX_TRY(pvp_decode_header(msg, len, h, d));
    if (h->type != type)
        return pvx_fail(d, PVX_EFORMAT, "message of type %u where %u was expected",
                        (unsigned)h->type, (unsigned)type);
    *in = (struct wire_in){.p = (const uint8_t *)msg + h->head, .len = h->body};
    return PVX_OK;
}

static void get_grid(struct wire_in *in, struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        g->n[a] = get_u32(in);
    g->basis = get_u32(in);
    g->channels = get_u32(in);
}

static void get_box(struct wire_in *in, struct pvp_grid *g)
{
    for (int a = 0; a < 3; a++)
        g->min[a] = get_f64(in);
    for (int a = 0; a < 3; a++)
        g->max[a] = get_f64(in);
}

static pvx_err bad_grid(const struct pvp_grid *g, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_EFORMAT,
                    "message's grid is outside the format's limits: %u x %u x %u, basis %u, "
                    "%u channels",
                    g->n[0], g->n[1], g->n[2], g->basis, g->channels);
}

pvx_err pvp_decode_start(const void *msg, size_t len, struct pvp_start *s, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire_in in = {0};
    *s = (struct pvp_start){0};
    PVX_TRY(open_body(msg, len, PVP_START, &h, &in, d));
    s->session = h.session;
    get_grid(&in, &s->grid);
    s->n_cameras = get_u32(&in);
    get_box(&in, &s->grid);
    s->rig_hash = get_u64(&in);
    s->fps = get_f64(&in);
    get_text(&in, s->units, sizeof s->units);
    get_text(&in, s->software, sizeof s->software);
    if (in.bad)
        return pvx_fail(d, PVX_EFORMAT, "start message is cut short or has a bad text field");
    if (!pvp_grid_valid(&s->grid))
        return bad_grid(&s->grid, d);
    if (!isfinite(s->fps) || s->fps < 0)
        return pvx_fail(d, PVX_EFORMAT, "start message: frame rate %g", s->fps);
    return PVX_OK;
}

pvx_err pvp_decode_status(const void *msg, size_t len, const char **json, size_t *json_len,
                          struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire_in in = {0};
    *json = "";
    *json_len = 0;
    PVX_TRY(open_body(msg, len, PVP_STATUS, &h, &in, d));
    if (h.body > PVP_STATUS_MAX)
        return pvx_fail(d, PVX_EFORMAT, "status text of %zu bytes", h.body);
    *json = (const char *)in.p;
    *json_len = h.body;
    return PVX_OK;
}

pvx_err pvp_decode_end(const void *msg, size_t len, uint64_t *session, char reason[PVP_REASON_MAX],
                       struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire_in in = {0};
    *session = 0;
    reason[0] = '\0';
    PVX_TRY(open_body(msg, len, PVP_END, &h, &in, d));
    *session = h.session;
    get_text(&in, reason, WIRE_END);
    if (in.bad)
        return pvx_fail(d, PVX_EFORMAT, "end message is cut short or has a bad text field");
    return PVX_OK;
}

static void get_report(struct wire_in *in, struct pvp_report *r)
{
    r->status = get_u32(in);
    r->iterations = get_u32(in);
    get_text(in, r->solver, sizeof r->solver);
    r->rel_residual = get_f64(in);
    r->active_voxels = get_u32(in);
    r->active_rays = get_u32(in);
    r->entries = get_u64(in);
    r->photometry_ns = get_i64(in);
    r->hull_ns = get_i64(in);
    r->restrict_ns = get_i64(in);
    r->solve_ns = get_i64(in);
    r->total_ns = get_i64(in);
}

/* The ids ascend and lie inside the grid: then bricks are unique and unpacking stays inside. */
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

pvx_err pvp_decode_volume(const void *msg, size_t len, struct pvp_view *out, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire_in in = {0};
    *out = (struct pvp_view){0};
    PVX_TRY(open_body(msg, len, PVP_VOLUME, &h, &in, d));
    struct pvp_volume *v = &out->v;
    v->session = h.session;
    out->clamped = (h.flags & PVP_FLAG_CLAMPED) != 0;
    uint32_t description = get_u32(&in);
    uint32_t sample = get_u32(&in), comp = get_u32(&in), side = get_u32(&in);
    v->set = get_u64(&in);
    v->t_exposure_ns = get_i64(&in);
    v->t_publish_ns = get_i64(&in);
    v->spread_ns = get_i64(&in);
    v->latency_ns = get_i64(&in);
    v->camera_mask = get_u64(&in);
    v->cameras_present = get_u32(&in);
    get_grid(&in, &v->grid);
    get_box(&in, &v->grid);
    get_report(&in, &v->report);
    out->n_bricks = get_u32(&in);
    get_u32(&in);
    uint64_t raw_len = get_u64(&in), stored = get_u64(&in);
    if (in.bad || description < WIRE_VOLUME || description > in.len)
        return pvx_fail(d, PVX_EFORMAT, "volume message is cut short or has a bad text field");
    if ((sample != PVP_F32 && sample != PVP_F16) || comp > PVP_ZSTD || side != PVP_BRICK)
        return pvx_fail(d, PVX_EUNSUP,
                        "volume message with sample format %u, compression %u, bricks of %u: not "
                        "known to this reader",
                        sample, comp, side);
    if (!pvp_grid_valid(&v->grid))
        return bad_grid(&v->grid, d);
    out->sample = (enum pvp_sample)sample;
    out->comp = (enum pvp_compress)comp;
    uint32_t nb[3], bricks = pvp_grid_bricks(&v->grid, nb);
    if (out->n_bricks > bricks)
        return pvx_fail(d, PVX_EFORMAT, "volume message with %u bricks in a grid of %u",
                        out->n_bricks, bricks);
    in.at = description;
    out->ids = get_bytes(&in, 4 * (size_t)out->n_bricks);
    size_t want =
        (size_t)out->n_bricks * WIRE_CELLS * v->grid.channels * pvp_sample_size(out->sample);
    if (raw_len != want || stored > raw_len || (comp == PVP_RAW && stored != raw_len))
        return pvx_fail(
            d, PVX_EFORMAT, "volume message: %u bricks are %zu bytes, it says %llu, stored as %llu",
            out->n_bricks, want, (unsigned long long)raw_len, (unsigned long long)stored);
    out->raw_len = want;
    out->payload_len = (size_t)stored;
    out->payload = get_bytes(&in, out->payload_len);
    if (in.bad)
        return pvx_fail(d, PVX_EFORMAT, "volume message is cut short");
    return check_ids(out, bricks, d);
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

/* *raw = the uncompressed payload, in the message or in the decoder. */
static pvx_err decompress(struct pvp_decoder *dec, const struct pvp_view *v, const uint8_t **raw,
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

/* `n` samples at p to floats; false when one is not finite. */
static bool load_samples(const uint8_t *p, enum pvp_sample sample, size_t n, float *out)
{
    uint32_t unfit = 0;
    for (size_t i = 0; i < n; i++) {
        if (sample == PVP_F16) {
            uint32_t h = wire_load16(p + 2 * i);
            unfit |= (h & 0x7c00u) == 0x7c00u;
            out[i] = pvp_half_to_float(h);
        } else {
            uint32_t bits = wire_load32(p + 4 * i);
            unfit |= (bits & 0x7f800000u) == 0x7f800000u;
            memcpy(out + i, &bits, sizeof bits);
        }
    }
    return unfit == 0;
}

pvx_err pvp_volume_unpack(pvp_decoder *dec, const struct pvp_view *v, float *dense, size_t count,
                          struct pvx_diag *d)
{
    const struct pvp_grid *g = &v->v.grid;
    if (count != pvp_grid_count(g))
        return pvx_fail(d, PVX_EINVAL, "room for %zu values, the volume has %zu", count,
                        pvp_grid_count(g));
    const uint8_t *raw;
    PVX_TRY(decompress(dec, v, &raw, d));
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
    if (!finite)
        return pvx_fail(d, PVX_ECORRUPT, "volume message holds a value that is not finite");
    return PVX_OK;
}
