/* The wire format: round trips, limits, hostile input, and the golden messages of proto/vectors.
 * `test_pvp --write-vectors DIR` writes those anew (after a deliberate change of the format). */
#include <unistd.h>
#include <zstd.h>

#include "base/file.h"
#include "proto/half.h"
#include "proto/pvp.h"
#include "tests/t.h"

#define VECTORS "proto/vectors"

/* --- sample volumes, the same on every machine --- */
struct sample {
    struct pvp_volume v;
    enum pvp_sample sample;
    enum pvp_compress comp;
    uint32_t n;
    int32_t *index;
    float *value; /* [n][channels] */
};

static struct pvp_volume describe(uint32_t nx, uint32_t ny, uint32_t nz, uint32_t channels)
{
    return (struct pvp_volume){
        .session = 0x1122334455667788u,
        .set = 42,
        .t_exposure_ns = 1767225600123456789,
        .t_publish_ns = 1767225600143456789,
        .spread_ns = 12345,
        .latency_ns = 17000001,
        .cameras_present = 7,
        .camera_mask = 0xf7,
        .grid = {.n = {nx, ny, nz},
                 .min = {-0.5, -0.25, 0},
                 .max = {0.5, 0.25, 1.5},
                 .basis = channels == 3,
                 .channels = channels},
        .report = {.status = 2,
                   .solver = "mrnsd",
                   .iterations = 11,
                   .rel_residual = 0.0625,
                   .active_voxels = 1234,
                   .active_rays = 56789,
                   .entries = 5000000000,
                   .photometry_ns = 1,
                   .hull_ns = 2,
                   .restrict_ns = 3,
                   .solve_ns = 4,
                   .total_ns = 10},
    };
}

/* Every `every`-th voxel of the cells x >= x0, so that some bricks stay empty. */
static struct sample sample_new(struct pvp_volume v, enum pvp_sample s, enum pvp_compress comp,
                                uint32_t x0, uint32_t every)
{
    struct sample out = {.v = v, .sample = s, .comp = comp};
    uint32_t cells = v.grid.n[0] * v.grid.n[1] * v.grid.n[2], nch = v.grid.channels;
    out.index = calloc(cells, sizeof *out.index);
    out.value = calloc(cells * nch, sizeof *out.value);
    for (uint32_t i = 0; i < cells; i++) {
        if (i % v.grid.n[0] < x0 || i % every != 0)
            continue;
        for (uint32_t c = 0; c < nch; c++)
            out.value[out.n * nch + c] = (float)(i * 37 % 101) / 8 + 0.3f * (float)c;
        out.index[out.n++] = (int32_t)i;
    }
    return out;
}
static void sample_free(struct sample *s)
{
    free(s->index);
    free(s->value);
}

/* What a reader must get for `x`. */
static float as_sent(enum pvp_sample s, float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return s == PVP_F32 ? x : pvp_half_to_float(pvp_half_from_bits(bits));
}

/* Encodes with a fresh encoder; the message is the caller's copy. */
static uint8_t *encode(const struct sample *s, uint64_t sequence, size_t *len)
{
    pvp_encoder *e;
    const void *msg;
    *len = 0;
    T_EQ_I(pvp_encoder_new(&s->v.grid, s->sample, s->comp, &e), PVX_OK);
    T_EQ_I(pvp_encode_volume(
               e, sequence, &s->v,
               &(struct pvp_voxels){s->n, s->index, s->value, (int)s->v.grid.channels}, &msg, len),
           PVX_OK);
    uint8_t *copy = malloc(*len);
    memcpy(copy, msg, *len);
    pvp_encoder_free(&e);
    return copy;
}

static pvx_err unpack(const uint8_t *msg, size_t len, float **dense, struct pvp_view *view)
{
    pvp_decoder *dec;
    *dense = NULL;
    pvx_err e = pvp_decode_volume(msg, len, view, NULL);
    if (e != PVX_OK)
        return e;
    size_t count = pvp_grid_count(&view->v.grid);
    *dense = malloc(count * sizeof **dense);
    T_EQ_I(pvp_decoder_new(&dec), PVX_OK);
    e = pvp_volume_unpack(dec, view, *dense, count, NULL);
    pvp_decoder_free(&dec);
    return e;
}

/* The message is the sample's; what else it says. */
static struct pvp_view check_volume(const struct sample *s, const uint8_t *msg, size_t len)
{
    struct pvp_view view = {0};
    float *dense;
    T_EQ_I(unpack(msg, len, &dense, &view), PVX_OK);
    if (dense == NULL)
        return view;
    const struct pvp_volume *a = &view.v, *b = &s->v;
    T_OK(a->session == b->session && a->set == b->set && a->t_exposure_ns == b->t_exposure_ns);
    T_OK(a->t_publish_ns == b->t_publish_ns && a->spread_ns == b->spread_ns);
    T_OK(a->latency_ns == b->latency_ns && a->cameras_present == b->cameras_present);
    T_OK(a->camera_mask == b->camera_mask && a->grid.basis == b->grid.basis);
    for (int i = 0; i < 3; i++) {
        T_EQ_I(a->grid.n[i], b->grid.n[i]);
        T_NEAR(a->grid.min[i], b->grid.min[i], 0);
        T_NEAR(a->grid.max[i], b->grid.max[i], 0);
    }
    T_EQ_I(a->grid.channels, b->grid.channels);
    T_EQ_I(a->report.status, b->report.status);
    T_EQ_S(a->report.solver, b->report.solver);
    T_EQ_I(a->report.iterations, b->report.iterations);
    T_NEAR(a->report.rel_residual, b->report.rel_residual, 0);
    T_EQ_I(a->report.active_voxels, b->report.active_voxels);
    T_EQ_I(a->report.active_rays, b->report.active_rays);
    T_EQ_I(a->report.entries, b->report.entries);
    T_OK(a->report.photometry_ns == b->report.photometry_ns);
    T_OK(a->report.hull_ns == b->report.hull_ns && a->report.solve_ns == b->report.solve_ns);
    T_OK(a->report.restrict_ns == b->report.restrict_ns);
    T_OK(a->report.total_ns == b->report.total_ns);
    size_t count = pvp_grid_count(&a->grid), wrong = 0, nch = a->grid.channels, at = 0;
    for (size_t i = 0; i < count / nch; i++) {
        bool active = at < s->n && s->index[at] == (int32_t)i;
        for (size_t c = 0; c < nch; c++) {
            float want = active ? as_sent(s->sample, s->value[at * nch + c]) : 0;
            wrong += memcmp(&want, &dense[i * nch + c], sizeof want) != 0;
        }
        at += active;
    }
    T_EQ_I(wrong, 0);
    free(dense);
    return view;
}

/* --- half precision --- */
T_CASE(half_round_trip)
{
    int wrong = 0;
    for (uint32_t h = 0; h < 65536; h++) {
        float f = pvp_half_to_float(h);
        if ((h & 0x7c00) == 0x7c00) {
            wrong += (h & 0x3ff) ? !isnan(f) : !isinf(f);
            continue;
        }
        uint32_t bits;
        memcpy(&bits, &f, sizeof bits);
        wrong += pvp_half_from_bits(bits) != h;
    }
    T_EQ_I(wrong, 0);
    T_NEAR(pvp_half_to_float(0x3c00), 1, 0);
    T_NEAR(pvp_half_to_float(0x0001), 0x1p-24, 0);
    T_NEAR(pvp_half_to_float(0xfbff), -65504, 0);
}

/* Nearest multiple of the spacing at |x|, ties to even: nearbyint's own rule. */
static double half_reference(double x)
{
    int e;
    double m = fabs(x);
    frexp(m, &e);
    double spacing = ldexp(1, (e < -13 ? -13 : e) - 11);
    m = nearbyint(m / spacing) * spacing;
    return copysign(m > 65504 ? 65504 : m, x);
}

T_CASE(half_rounding)
{
    int wrong = 0;
    for (int i = 0; i < 300000; i++) {
        float x = (float)(t_uniform(-2, 2) * exp2(t_uniform(-30, 18)));
        if (i % 3 == 0) { /* exactly between two halves */
            uint32_t h = (uint32_t)(t_rand() % 0x7bff);
            x = (pvp_half_to_float(h) + pvp_half_to_float(h + 1)) / 2;
        }
        uint32_t bits;
        memcpy(&bits, &x, sizeof bits);
        double got = pvp_half_to_float(pvp_half_from_bits(bits)), want = half_reference(x);
        if ((got < want || got > want) && wrong++ < 5)
            T_CHECK_(0, "%a -> %a, want %a", (double)x, got, want);
    }
    T_EQ_I(wrong, 0);
}

/* --- round trips --- */
T_CASE(round_trips)
{
    static const uint32_t sizes[][3] = {{1, 1, 1}, {8, 8, 8}, {9, 7, 17}, {24, 16, 8}, {13, 31, 5}};
    for (size_t g = 0; g < 5; g++)
        for (uint32_t nch = 1; nch <= 3; nch += 2)
            for (int sample = PVP_F32; sample <= PVP_F16; sample++)
                for (int comp = PVP_RAW; comp <= PVP_ZSTD; comp++) {
                    const uint32_t *n = sizes[g];
                    struct sample s =
                        sample_new(describe(n[0], n[1], n[2], nch), (enum pvp_sample)sample,
                                   (enum pvp_compress)comp, n[0] / 2, 1 + (uint32_t)g);
                    size_t len;
                    uint8_t *msg = encode(&s, 5, &len);
                    check_volume(&s, msg, len);
                    free(msg);
                    sample_free(&s);
                }
}

T_CASE(empty_volume)
{
    struct pvp_volume v = describe(20, 20, 20, 3);
    for (int comp = PVP_RAW; comp <= PVP_ZSTD; comp++) {
        struct sample s = {.v = v, .sample = PVP_F16, .comp = (enum pvp_compress)comp};
        size_t len;
        uint8_t *msg = encode(&s, 0, &len);
        struct pvp_view view = check_volume(&s, msg, len);
        T_EQ_I(view.n_bricks, 0);
        T_EQ_I(view.comp, PVP_RAW);
        T_EQ_I(len, 48 + 248);
        free(msg);
    }
}

/* Only bricks with an active voxel travel; a full brick is the size it should be. */
T_CASE(sparse_size)
{
    struct pvp_volume v = describe(64, 64, 64, 3);
    int32_t index[2] = {0, 64 * 64 * 64 - 1};
    float value[8] = {1, 2, 3, -1, 4, 5, 6, -1}; /* stride 4: the fourth is not sent */
    pvp_encoder *e;
    const void *msg;
    size_t len;
    struct pvp_view view;
    T_EQ_I(pvp_encoder_new(&v.grid, PVP_F16, PVP_RAW, &e), PVX_OK);
    T_EQ_I(pvp_encode_volume(e, 0, &v, &(struct pvp_voxels){2, index, value, 4}, &msg, &len),
           PVX_OK);
    T_EQ_I(len, 48 + 248 + 2 * 4 + 2 * 512 * 3 * 2);
    float *dense;
    T_EQ_I(unpack(msg, len, &dense, &view), PVX_OK);
    T_NEAR(dense[2], 3, 0);
    T_NEAR(dense[3], 0, 0);
    T_NEAR(dense[64 * 64 * 64 * 3 - 3], 4, 0);
    free(dense);
    pvp_encoder_free(&e);
}

/* Noise does not shrink: the payload then goes out as it is, and says so. */
T_CASE(incompressible)
{
    struct sample s = sample_new(describe(16, 16, 16, 1), PVP_F32, PVP_LZ4, 0, 1);
    for (uint32_t i = 0; i < s.n; i++)
        s.value[i] = (float)t_normal();
    for (int comp = PVP_LZ4; comp <= PVP_ZSTD; comp++) {
        size_t len;
        s.comp = (enum pvp_compress)comp;
        uint8_t *msg = encode(&s, 0, &len);
        T_LE(len, 48 + 248 + 4 * 8 + 16384);
        struct pvp_view view = check_volume(&s, msg, len);
        if (comp == PVP_LZ4)
            T_EQ_I(view.comp, PVP_RAW);
        free(msg);
    }
    sample_free(&s);
}

T_CASE(clamping)
{
    struct pvp_volume v = describe(8, 8, 8, 1);
    int32_t index[3] = {0, 1, 2};
    float value[3] = {1e6f, -3e38f, 65504};
    for (int n = 0; n < 2; n++) {
        struct sample s = {.v = v, .sample = PVP_F16, .comp = PVP_RAW};
        struct pvp_view view;
        float *dense;
        size_t len;
        s.index = n == 0 ? index : index + 2;
        s.value = n == 0 ? value : value + 2;
        s.n = n == 0 ? 3 : 1;
        uint8_t *msg = encode(&s, 0, &len);
        T_EQ_I(unpack(msg, len, &dense, &view), PVX_OK);
        T_EQ_I(view.clamped, n == 0); /* 65504 itself is no clamping */
        T_NEAR(dense[2], 65504, 0);
        if (n == 0) {
            T_NEAR(dense[0], 65504, 0);
            T_NEAR(dense[1], -65504, 0);
        }
        free(dense);
        free(msg);
    }
}

T_CASE(encoder_refuses)
{
    struct pvp_volume v = describe(10, 9, 8, 1), other = describe(10, 9, 9, 1);
    pvp_encoder *e;
    const void *msg;
    size_t len;
    struct pvp_grid g = v.grid;
    g.n[1] = 1025;
    T_EQ_I(pvp_encoder_new(&g, PVP_F32, PVP_RAW, &e), PVX_EINVAL);
    g = v.grid;
    g.channels = 2;
    T_EQ_I(pvp_encoder_new(&g, PVP_F32, PVP_RAW, &e), PVX_EINVAL);
    g = v.grid;
    g.max[2] = g.min[2];
    T_EQ_I(pvp_encoder_new(&g, PVP_F32, PVP_RAW, &e), PVX_EINVAL);
    T_EQ_I(pvp_encoder_new(&v.grid, (enum pvp_sample)3, PVP_RAW, &e), PVX_EINVAL);
    T_OK(e == NULL);
    T_EQ_I(pvp_encoder_new(&v.grid, PVP_F16, PVP_LZ4, &e), PVX_OK);
    int32_t down[3] = {5, 9, 9}, out[2] = {0, 720}, below[1] = {-1}, fine[2] = {3, 719};
    float value[3] = {1, 2, 3}, nan[2] = {1, NAN}, inf[2] = {-INFINITY, 0};
    const struct pvp_voxels good = {2, fine, value, 1},
                            bad[] = {{3, down, value, 1}, {2, out, value, 1}, {1, below, value, 1},
                                     {2, fine, nan, 1},   {2, fine, inf, 1},  {2, fine, value, 0}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        T_CHECK_(pvp_encode_volume(e, 0, &v, &bad[i], &msg, &len) == PVX_EINVAL, "bad %zu", i);
    T_EQ_I(pvp_encode_volume(e, 0, &other, &good, &msg, &len), PVX_EINVAL);
    /* ... and is none the worse for it: nothing of the refused ones is left, or was counted. */
    T_EQ_I(pvp_encode_volume(e, 0, &v, &good, &msg, &len), PVX_OK);
    struct pvp_header h;
    T_EQ_I(pvp_decode_header(msg, len, &h, NULL), PVX_OK);
    T_EQ_I(h.type_sequence, 0);
    struct sample s = {
        .v = v, .sample = PVP_F16, .comp = PVP_LZ4, .n = 2, .index = fine, .value = value};
    check_volume(&s, msg, len);
    char *big = malloc(PVP_STATUS_MAX + 2);
    memset(big, ' ', PVP_STATUS_MAX + 1);
    big[PVP_STATUS_MAX + 1] = '\0';
    T_EQ_I(pvp_encode_status(e, 0, big, &msg, &len), PVX_ERANGE);
    big[PVP_STATUS_MAX] = '\0';
    T_EQ_I(pvp_encode_status(e, 0, big, &msg, &len), PVX_OK);
    T_EQ_I(len, 48 + PVP_STATUS_MAX);
    free(big);
    pvp_encoder_free(&e);
}

T_CASE(header_counts)
{
    struct pvp_volume v = describe(8, 8, 8, 1);
    struct pvp_start st = {.grid = v.grid, .session = 99, .fps = 30};
    pvp_encoder *e;
    const void *msg;
    size_t len;
    struct pvp_header h;
    T_EQ_I(pvp_encoder_new(&v.grid, PVP_F32, PVP_RAW, &e), PVX_OK);
    T_EQ_I(pvp_encode_start(e, 0, &st, &msg, &len), PVX_OK);
    for (int i = 0; i < 3; i++) {
        T_EQ_I(pvp_encode_volume(e, 10 + i, &v, &(struct pvp_voxels){0, NULL, NULL, 1}, &msg, &len),
               PVX_OK);
        T_EQ_I(pvp_decode_header(msg, len, &h, NULL), PVX_OK);
        T_EQ_I(h.sequence, 10 + i);
        T_EQ_I(h.type_sequence, i);
        T_EQ_I(h.type, PVP_VOLUME);
        T_EQ_I(h.version, 1 << 16 | 2);
    }
    const uint8_t prefix[] = {'P', 'V', 'X', '1', PVP_VOLUME & 255, PVP_VOLUME >> 8};
    T_OK(memcmp(prefix, msg, sizeof prefix) == 0);
    T_EQ_I(pvp_encode_status(e, 13, "{}", &msg, &len), PVX_OK);
    T_EQ_I(pvp_decode_header(msg, len, &h, NULL), PVX_OK);
    T_EQ_I(h.session, 99);
    T_EQ_I(h.type_sequence, 0);
    T_OK(memcmp(prefix, msg, sizeof prefix) != 0);
    pvp_encoder_free(&e);
}

/* --- what a reader must survive --- */
static void put32(uint8_t *p, uint32_t v)
{
    for (int i = 0; i < 4; i++)
        p[i] = (uint8_t)(v >> 8 * i);
}

T_CASE(cut_short)
{
    struct sample s = sample_new(describe(10, 9, 8, 1), PVP_F16, PVP_RAW, 8, 1);
    size_t len, decoded = 0;
    uint8_t *msg = encode(&s, 0, &len);
    struct pvp_view view;
    for (size_t cut = 0; cut < len; cut++) {
        uint8_t *exact = malloc(cut > 0 ? cut : 1);
        memcpy(exact, msg, cut);
        decoded += pvp_decode_volume(exact, cut, &view, NULL) == PVX_OK;
        if (cut >= 48) { /* also with a header that agrees with the shorter length */
            put32(exact + 40, (uint32_t)(cut - 48));
            decoded += pvp_decode_volume(exact, cut, &view, NULL) == PVX_OK;
        }
        free(exact);
    }
    T_EQ_I(decoded, 0);
    free(msg);
    sample_free(&s);
}

/* One 32-bit field of a good message set to `value`: what comes back? */
static pvx_err with_field(const struct sample *s, size_t at, uint32_t value)
{
    size_t len;
    uint8_t *msg = encode(s, 0, &len);
    struct pvp_view view;
    float *dense;
    put32(msg + at, value);
    pvx_err e = unpack(msg, len, &dense, &view);
    free(dense);
    free(msg);
    return e;
}

T_CASE(hostile_fields)
{
    struct sample s = sample_new(describe(20, 9, 8, 1), PVP_F16, PVP_RAW, 0, 1);
    const size_t body = 48, ids = 48 + 248;
    T_EQ_I(with_field(&s, 0, 0x31585651), PVX_EFORMAT);         /* magic */
    T_EQ_I(with_field(&s, 4, 100 | 48u << 16), PVX_EFORMAT);    /* type start */
    T_EQ_I(with_field(&s, 4, 200 | 47u << 16), PVX_EFORMAT);    /* header too short */
    T_EQ_I(with_field(&s, 4, 200 | 65535u << 16), PVX_EFORMAT); /* header longer than all */
    T_EQ_I(with_field(&s, 8, 2), PVX_EVERSION);                 /* major */
    T_EQ_I(with_field(&s, 8, 1 | 7u << 16), PVX_OK);            /* minor */
    T_EQ_I(with_field(&s, 12, 0x8000), PVX_OK);                 /* flag that may be ignored */
    T_EQ_I(with_field(&s, 12, 0x10000), PVX_EVERSION);          /* flag that may not */
    T_EQ_I(with_field(&s, 40, 1), PVX_EFORMAT);                 /* body length */
    T_EQ_I(with_field(&s, 44, 1), PVX_EFORMAT);                 /* ... its upper half */
    T_EQ_I(with_field(&s, body, 247), PVX_EFORMAT);             /* description too short */
    T_EQ_I(with_field(&s, body, 0xffffffff), PVX_EFORMAT);
    T_EQ_I(with_field(&s, body + 4, 3), PVX_EUNSUP);   /* sample */
    T_EQ_I(with_field(&s, body + 8, 3), PVX_EUNSUP);   /* compression */
    T_EQ_I(with_field(&s, body + 8, 1), PVX_ECORRUPT); /* says LZ4, is not */
    T_EQ_I(with_field(&s, body + 8, 2), PVX_ECORRUPT); /* says Zstandard, is not */
    T_EQ_I(with_field(&s, body + 12, 16), PVX_EUNSUP); /* brick side */
    T_EQ_I(with_field(&s, body + 68, 0), PVX_EFORMAT); /* nx */
    T_EQ_I(with_field(&s, body + 68, 1025), PVX_EFORMAT);
    T_EQ_I(with_field(&s, body + 68, 0xffffffff), PVX_EFORMAT);
    T_EQ_I(with_field(&s, body + 68, 8), PVX_EFORMAT); /* fewer bricks than ids */
    T_EQ_I(with_field(&s, body + 80, 2), PVX_EFORMAT); /* basis */
    T_EQ_I(with_field(&s, body + 84, 3), PVX_EFORMAT); /* channels, payload for 1 */
    T_EQ_I(with_field(&s, body + 84, 0), PVX_EFORMAT);
    T_EQ_I(with_field(&s, body + 92, 0x7ff00000), PVX_EFORMAT);  /* min[0] infinite */
    T_EQ_I(with_field(&s, body + 144, 0x1b1b1b1b), PVX_EFORMAT); /* escapes in a text */
    T_EQ_I(with_field(&s, body + 224, 7), PVX_EFORMAT);          /* bricks */
    T_EQ_I(with_field(&s, body + 224, 0xffffffff), PVX_EFORMAT);
    T_EQ_I(with_field(&s, body + 232, 0), PVX_EFORMAT);  /* uncompressed size */
    T_EQ_I(with_field(&s, body + 240, 16), PVX_EFORMAT); /* stored size */
    T_EQ_I(with_field(&s, body + 244, 1), PVX_EFORMAT);
    T_EQ_I(with_field(&s, ids + 4, 0), PVX_EFORMAT);            /* a brick twice */
    T_EQ_I(with_field(&s, ids, 5), PVX_EFORMAT);                /* descending */
    T_EQ_I(with_field(&s, ids + 20, 6), PVX_EFORMAT);           /* outside */
    T_EQ_I(with_field(&s, ids + 24, 0x7c007c00), PVX_ECORRUPT); /* infinity */
    s.sample = PVP_F32;
    T_EQ_I(with_field(&s, ids + 24, 0x7fc00000), PVX_ECORRUPT); /* NaN */
    sample_free(&s);
}

/* Payloads that decompress, but to another size than the message says. */
T_CASE(hostile_compression)
{
    struct sample s = sample_new(describe(16, 8, 8, 1), PVP_F32, PVP_ZSTD, 0, 7);
    size_t len;
    uint8_t *msg = encode(&s, 0, &len);
    static uint8_t zeros[65536];
    static const size_t sizes[] = {0, 512, 4095, 4097, 65536};
    const size_t at = 48 + 248 + 8;
    for (size_t i = 0; i < 5; i++) {
        uint8_t *bad = malloc(at + 1024);
        struct pvp_view view;
        float *dense;
        memcpy(bad, msg, at);
        size_t n = ZSTD_compress(bad + at, 1024, zeros, sizes[i], 1);
        put32(bad + 40, (uint32_t)(at + n - 48));
        put32(bad + 48 + 240, (uint32_t)n);
        T_EQ_I(unpack(bad, at + n, &dense, &view), PVX_ECORRUPT);
        free(dense);
        free(bad);
    }
    free(msg);
    sample_free(&s);
}

/* A later minor version appends: a longer header, a longer description. */
T_CASE(later_minor)
{
    struct sample s = sample_new(describe(10, 9, 8, 3), PVP_F32, PVP_LZ4, 0, 5);
    size_t len;
    uint8_t *msg = encode(&s, 0, &len), *later = calloc(1, len + 24);
    memcpy(later, msg, 48);
    memset(later + 48, 0xee, 8);
    memcpy(later + 56, msg + 48, 248);
    memset(later + 56 + 248, 0xee, 16);
    memcpy(later + 56 + 248 + 16, msg + 48 + 248, len - 48 - 248);
    later[6] = 56;
    later[10] = 7;
    put32(later + 40, (uint32_t)(len - 48 + 16));
    put32(later + 56, 248 + 16);
    check_volume(&s, later, len + 24);
    free(later);
    free(msg);
    sample_free(&s);
}

/* Bars are a volume's body under a type of their own: a reader that wants the one refuses the other. */
T_CASE(bars)
{
    struct sample s = sample_new(describe(10, 9, 8, 3), PVP_F32, PVP_ZSTD, 0, 5);
    struct pvp_voxels x = {s.n, s.index, s.value, 3};
    struct pvp_view view, of;
    struct pvx_diag d = {""};
    const void *msg;
    uint32_t doubt = 77;
    size_t len, volume_len;
    float dense[10 * 9 * 8 * 3];
    pvp_encoder *e;
    pvp_decoder *dec;
    uint8_t *volume = encode(&s, 0, &volume_len);
    T_EQ_I(pvp_encoder_new(&s.v.grid, PVP_F32, PVP_ZSTD, &e), PVX_OK);
    T_EQ_I(pvp_decoder_new(&dec), PVX_OK);
    T_EQ_I(pvp_encode_bars(e, 3, &s.v, PVP_DOUBT_FINE, &x, &msg, &len), PVX_OK);
    T_EQ_I(pvp_decode_volume(msg, len, &view, &d), PVX_EFORMAT);
    T_EQ_I(pvp_decode_bars(volume, volume_len, &view, &doubt, &d), PVX_EFORMAT);
    T_EQ_I(pvp_decode_bars(msg, len, &view, &doubt, &d), PVX_OK);
    T_EQ_I(doubt, PVP_DOUBT_FINE);
    T_EQ_I(pvp_volume_unpack(dec, &view, dense, sizeof dense / sizeof *dense, &d), PVX_OK);
    T_OK(s.n > 0);
    for (uint32_t k = 0; k < 3 * s.n; k++)
        T_NEAR(dense[3 * s.index[k / 3] + (int)(k % 3)], s.value[k], 0);
    T_EQ_I(pvp_decode_volume(volume, volume_len, &of, &d), PVX_OK);
    T_OK(pvp_bars_fit(&view, &of));
    of.v.set++;
    T_OK(!pvp_bars_fit(&view, &of));
    of.v.set--;
    of.n_bricks--;
    T_OK(!pvp_bars_fit(&view, &of));
    s.value[4] = -1e-3f;
    T_EQ_I(pvp_encode_bars(e, 4, &s.v, 0, &x, &msg, &len), PVX_EINVAL);
    T_EQ_S(pvp_doubt_name(2), "fine-detail");
    T_OK(strstr(pvp_doubt_sentence(3), "draws") != NULL);
    T_OK(pvp_doubt_name(5) == NULL && pvp_doubt_sentence(31) == NULL);
    pvp_decoder_free(&dec);
    pvp_encoder_free(&e);
    free(volume);
    sample_free(&s);
}

/* --- golden messages --- */
static struct pvp_start start_sample(void)
{
    return (struct pvp_start){.grid = describe(10, 9, 8, 3).grid,
                              .session = 0x1122334455667788u,
                              .rig_hash = 0xfedcba9876543210u,
                              .n_cameras = 8,
                              .fps = 29.97,
                              .units = "1/m",
                              .software = "pyrovoxd 0.1.0"};
}
#define STATUS_JSON "{\"sets\":42,\"lost\":1,\"state\":\"l\xc3\xa4uft\"}"
#define END_REASON  "stopped by SIGTERM"

static const struct {
    const char *name;
    uint32_t n[3], channels;
    enum pvp_sample sample;
    enum pvp_compress comp;
    uint32_t x0, every;
} volume_vectors[] = {
    {"volume-f32-raw", {10, 9, 8}, 1, PVP_F32, PVP_RAW, 8, 1},
    {"volume-f16-raw-rgb", {10, 9, 8}, 3, PVP_F16, PVP_RAW, 8, 3},
    {"volume-f16-lz4-rgb", {17, 9, 8}, 3, PVP_F16, PVP_LZ4, 0, 7},
    {"volume-f32-zstd", {9, 8, 17}, 1, PVP_F32, PVP_ZSTD, 3, 5},
    {"volume-f16-clamped", {3, 2, 2}, 1, PVP_F16, PVP_RAW, 0, 1},
    {"volume-empty", {10, 9, 8}, 3, PVP_F16, PVP_LZ4, 10, 1},
};
#define N_VOLUME_VECTORS (sizeof volume_vectors / sizeof volume_vectors[0])
#define N_VECTORS        (N_VOLUME_VECTORS + 7)

static struct sample vector_sample(size_t i)
{
    const uint32_t *n = volume_vectors[i].n;
    struct sample s =
        sample_new(describe(n[0], n[1], n[2], volume_vectors[i].channels), volume_vectors[i].sample,
                   volume_vectors[i].comp, volume_vectors[i].x0, volume_vectors[i].every);
    if (strstr(volume_vectors[i].name, "clamped") != NULL) {
        s.value[0] = 1e6f;
        s.value[1] = -1e-6f;         /* a subnormal half */
        s.value[2] = 1.00048828125f; /* a tie */
    }
    return s;
}

#define RIG_YAML                    \
    "cameras:\n  - name: s\xc3\xbc" \
    "d\n"
#define EVENT_JSON                                                             \
    "{\"version\":1,\"time_ns\":1767225600123456789,\"kind\":\"camera_lost\"," \
    "\"camera\":\"north\"}"

/* One camera with all, one that gave no frame, one that was not believed.  Nothing looks into the pictures. */
static struct pvp_preview preview_sample(void)
{
    static const uint8_t jpeg[] = {0xff, 0xd8, 1, 2, 3, 0xff, 0xd9};
    static const uint8_t bits[] = {0x80, 0x40, 0xff, 0xc0, 0, 0}; /* 10 x 3: a corner, a row */
    struct pvp_preview p = {.session = 0x1122334455667788u,
                            .set = 42,
                            .t_exposure_ns = 1767225600123456789,
                            .n_cameras = 3};
    p.camera[0] = (struct pvp_preview_camera){.name = "north",
                                              .width = 320,
                                              .height = 200,
                                              .jpeg = jpeg,
                                              .jpeg_len = sizeof jpeg,
                                              .across = 10,
                                              .down = 3,
                                              .lit_bits = bits,
                                              .lit = 12,
                                              .saturated = 2};
    p.camera[1] = (struct pvp_preview_camera){.name = "s\xc3\xbc"
                                                      "d"};
    p.camera[2] = p.camera[0];
    snprintf(p.camera[2].name, sizeof p.camera[2].name, "east");
    p.camera[2].left_out = true;
    p.camera[2].jpeg_len = 4;
    return p;
}

static void preview_json(FILE *f, const struct pvp_preview *p)
{
    fprintf(f,
            "{\"type\":\"preview\",\"sequence\":9,\"type_sequence\":0,\"session\":%llu,\n"
            "\"set\":%llu,\"t_exposure_ns\":%lld,\"cameras\":[",
            (unsigned long long)p->session, (unsigned long long)p->set,
            (long long)p->t_exposure_ns);
    for (uint32_t c = 0; c < p->n_cameras; c++) {
        const struct pvp_preview_camera *k = &p->camera[c];
        fprintf(f,
                "%s\n{\"name\":\"%s\",\"left_out\":%s,\"width\":%u,\"height\":%u,\"lit\":%u,"
                "\"saturated\":%u,\"jpeg\":\"",
                c > 0 ? "," : "", k->name, k->left_out ? "true" : "false", k->width, k->height,
                k->lit, k->saturated);
        for (size_t i = 0; i < k->jpeg_len; i++)
            fprintf(f, "%02x", k->jpeg[i]);
        fprintf(f, "\",\"silhouette\":[");
        for (uint32_t y = 0; y < k->down; y++) {
            fprintf(f, "%s[", y > 0 ? "," : "");
            for (uint32_t x = 0; x < k->across; x++)
                fprintf(f, "%s%d", x > 0 ? "," : "",
                        k->lit_bits[y * ((k->across + 7) / 8) + x / 8] >> (7 - x % 8) & 1);
            fprintf(f, "]");
        }
        fprintf(f, "]}");
    }
    fprintf(f, "]}\n");
}

/* The description of a volume, or of bars with their doubt. */
static void bricks_json(FILE *f, const struct sample *s, const struct pvp_view *view,
                        size_t sequence, int doubt)
{
    const struct pvp_volume *v = &s->v;
    fprintf(f,
            "{\"type\":\"%s\",\"sequence\":%zu,\"type_sequence\":0,\"session\":%llu,"
            "\"clamped\":%s,\n\"sample\":%d,\"compression\":%d,\"set\":%llu,"
            "\"t_exposure_ns\":%lld,\"t_publish_ns\":%lld,\"spread_ns\":%lld,"
            "\"latency_ns\":%lld,\n\"camera_mask\":%llu,\"cameras_present\":%u,"
            "\"n\":[%u,%u,%u],\"basis\":%u,\"channels\":%u,\"min\":[%.17g,%.17g,%.17g],"
            "\"max\":[%.17g,%.17g,%.17g],\n",
            doubt < 0 ? "volume" : "bars", sequence, (unsigned long long)v->session,
            view->clamped ? "true" : "false", (int)s->sample, (int)view->comp,
            (unsigned long long)v->set, (long long)v->t_exposure_ns, (long long)v->t_publish_ns,
            (long long)v->spread_ns, (long long)v->latency_ns, (unsigned long long)v->camera_mask,
            v->cameras_present, v->grid.n[0], v->grid.n[1], v->grid.n[2], v->grid.basis,
            v->grid.channels, v->grid.min[0], v->grid.min[1], v->grid.min[2], v->grid.max[0],
            v->grid.max[1], v->grid.max[2]);
    fprintf(f,
            "\"report\":{\"status\":%u,\"solver\":\"%s\",\"iterations\":%u,"
            "\"rel_residual\":%.17g,\"active_voxels\":%u,\"active_rays\":%u,"
            "\"entries\":%llu,\"photometry_ns\":%lld,\"hull_ns\":%lld,\"restrict_ns\":%lld,"
            "\"solve_ns\":%lld,\"total_ns\":%lld},\n\"bricks\":%u,\n\"voxels\":[",
            v->report.status, v->report.solver, v->report.iterations, v->report.rel_residual,
            v->report.active_voxels, v->report.active_rays, (unsigned long long)v->report.entries,
            (long long)v->report.photometry_ns, (long long)v->report.hull_ns,
            (long long)v->report.restrict_ns, (long long)v->report.solve_ns,
            (long long)v->report.total_ns, view->n_bricks);
    for (uint32_t k = 0; k < s->n; k++) {
        fprintf(f, "%s[%d", k > 0 ? ",\n" : "", s->index[k]);
        for (uint32_t c = 0; c < v->grid.channels; c++)
            fprintf(f, ",%.9g", (double)as_sent(s->sample, s->value[k * v->grid.channels + c]));
        fprintf(f, "]");
    }
    fprintf(f, doubt < 0 ? "]}\n" : "],\n\"doubt\":%d}\n", doubt);
}

/* Bars of the first volume, with two doubts. */
enum { BARS_DOUBT = PVP_DOUBT_POOR_FIT | PVP_DOUBT_LATE };
static uint8_t *bars_make(struct sample *s, size_t *len)
{
    pvp_encoder *e;
    const void *msg = NULL;
    for (uint32_t k = 0; k < s->n; k++)
        s->value[k] = 0.25f + 0.0625f * (float)(k % 7);
    T_EQ_I(pvp_encoder_new(&s->v.grid, s->sample, s->comp, &e), PVX_OK);
    T_EQ_I(pvp_encode_bars(e, 6, &s->v, BARS_DOUBT,
                           &(struct pvp_voxels){s->n, s->index, s->value, 1}, &msg, len),
           PVX_OK);
    uint8_t *copy = malloc(*len);
    memcpy(copy, msg, *len);
    pvp_encoder_free(&e);
    return copy;
}

/* Message and its description; both malloc'ed.  i: the volumes, then start, status, rig, event,
 * preview, end, bars. */
static uint8_t *vector_make(size_t i, const char **name, size_t *len, char **json)
{
    size_t json_len;
    FILE *f = open_memstream(json, &json_len);
    uint8_t *copy;
    if (i < N_VOLUME_VECTORS) {
        struct sample s = vector_sample(i);
        *name = volume_vectors[i].name;
        copy = encode(&s, 7 + i, len);
        struct pvp_view view;
        T_EQ_I(pvp_decode_volume(copy, *len, &view, NULL), PVX_OK);
        bricks_json(f, &s, &view, 7 + i, -1);
        sample_free(&s);
    } else if (i == N_VECTORS - 1) {
        struct sample s = vector_sample(0);
        struct pvp_view view;
        uint32_t doubt;
        *name = "bars-f32-raw";
        copy = bars_make(&s, len);
        T_EQ_I(pvp_decode_bars(copy, *len, &view, &doubt, NULL), PVX_OK);
        bricks_json(f, &s, &view, 6, (int)doubt);
        sample_free(&s);
    } else {
        struct pvp_start st = start_sample();
        const void *msg;
        pvp_encoder *e;
        T_EQ_I(pvp_encoder_new(&st.grid, PVP_F16, PVP_RAW, &e), PVX_OK);
        T_EQ_I(pvp_encode_start(e, 0, &st, &msg, len), PVX_OK);
        *name = "start";
        if (i == N_VOLUME_VECTORS) {
            fprintf(f,
                    "{\"type\":\"start\",\"sequence\":0,\"type_sequence\":0,\"session\":%llu,\n"
                    "\"n\":[10,9,8],\"basis\":1,\"channels\":3,\"min\":[-0.5,-0.25,0],"
                    "\"max\":[0.5,0.25,1.5],\n\"n_cameras\":8,\"rig_hash\":%llu,\"fps\":29.97,"
                    "\"units\":\"%s\",\"software\":\"%s\"}\n",
                    (unsigned long long)st.session, (unsigned long long)st.rig_hash, st.units,
                    st.software);
        } else if (i == N_VOLUME_VECTORS + 1) {
            *name = "status";
            T_EQ_I(pvp_encode_status(e, 3, STATUS_JSON, &msg, len), PVX_OK);
            fprintf(f,
                    "{\"type\":\"status\",\"sequence\":3,\"type_sequence\":0,\"session\":%llu,\n"
                    "\"status\":%s}\n",
                    (unsigned long long)st.session, STATUS_JSON);
        } else if (i == N_VOLUME_VECTORS + 2) {
            *name = "rig";
            T_EQ_I(pvp_encode_rig(e, 1, st.rig_hash, RIG_YAML, &msg, len), PVX_OK);
            fprintf(f,
                    "{\"type\":\"rig\",\"sequence\":1,\"type_sequence\":0,\"session\":%llu,\n"
                    "\"rig_hash\":%llu,\"rig\":\"cameras:\\n  - name: s\xc3\xbc"
                    "d\\n\"}\n",
                    (unsigned long long)st.session, (unsigned long long)st.rig_hash);
        } else if (i == N_VOLUME_VECTORS + 3) {
            *name = "event";
            T_EQ_I(pvp_encode_event(e, 2, EVENT_JSON, &msg, len), PVX_OK);
            fprintf(f,
                    "{\"type\":\"event\",\"sequence\":2,\"type_sequence\":0,\"session\":%llu,\n"
                    "\"event\":%s}\n",
                    (unsigned long long)st.session, EVENT_JSON);
        } else if (i == N_VOLUME_VECTORS + 4) {
            struct pvp_preview p = preview_sample();
            *name = "preview";
            T_EQ_I(pvp_encode_preview(e, 9, &p, &msg, len), PVX_OK);
            preview_json(f, &p);
        } else {
            *name = "end";
            T_EQ_I(pvp_encode_end(e, 4, st.session, END_REASON, &msg, len), PVX_OK);
            fprintf(f,
                    "{\"type\":\"end\",\"sequence\":4,\"type_sequence\":0,\"session\":%llu,\n"
                    "\"reason\":\"%s\"}\n",
                    (unsigned long long)st.session, END_REASON);
        }
        copy = malloc(*len);
        memcpy(copy, msg, *len);
        pvp_encoder_free(&e);
    }
    fclose(f);
    return copy;
}
static int write_vectors(const char *dir)
{
    for (size_t i = 0; i < N_VECTORS; i++) {
        const char *name;
        char *json, path[512];
        size_t len;
        struct pvx_diag d = {""};
        uint8_t *msg = vector_make(i, &name, &len, &json);
        snprintf(path, sizeof path, "%s/%s.bin", dir, name);
        pvx_err e = pvx_file_write(path, msg, len, &d);
        snprintf(path, sizeof path, "%s/%s.json", dir, name);
        if (e == PVX_OK)
            e = pvx_file_write(path, json, strlen(json), &d);
        free(msg);
        free(json);
        if (e != PVX_OK) {
            fprintf(stderr, "%s\n", pvx_diag_text(&d, e));
            return 1;
        }
    }
    return 0;
}

/* The files in the repository are what this version writes, and read back as what went in.  A
 * compressor may change its output between library versions, so those only have to read back. */
T_CASE(golden_messages)
{
    for (size_t i = 0; i < N_VECTORS; i++) {
        const char *name;
        char *json, *file, *text, path[512];
        size_t len, file_len, text_len;
        uint8_t *msg = vector_make(i, &name, &len, &json);
        snprintf(path, sizeof path, VECTORS "/%s.bin", name);
        T_EQ_I(pvx_file_read(path, 1 << 20, &file, &file_len, NULL), PVX_OK);
        snprintf(path, sizeof path, VECTORS "/%s.json", name);
        T_EQ_I(pvx_file_read(path, 1 << 20, &text, &text_len, NULL), PVX_OK);
        if (file != NULL && text != NULL) {
            T_EQ_S(text, json);
            bool compressed = i < N_VOLUME_VECTORS && volume_vectors[i].comp != PVP_RAW &&
                              strstr(name, "empty") == NULL;
            if (!compressed)
                T_CHECK_(file_len == len && memcmp(file, msg, len) == 0, "%s.bin differs", name);
            if (i < N_VOLUME_VECTORS) {
                struct sample s = vector_sample(i);
                struct pvp_view view = check_volume(&s, (uint8_t *)file, file_len);
                if (compressed) /* else the vector would not show what its name says */
                    T_EQ_I(view.comp, volume_vectors[i].comp);
                sample_free(&s);
            }
        }
        free(file);
        free(text);
        free(msg);
        free(json);
    }
}

T_CASE(golden_texts)
{
    char *file;
    size_t len, json_len;
    struct pvp_start want = start_sample(), got;
    T_EQ_I(pvx_file_read(VECTORS "/start.bin", 1 << 20, &file, &len, NULL), PVX_OK);
    T_EQ_I(pvp_decode_start(file, len, &got, NULL), PVX_OK);
    T_OK(got.session == want.session && got.rig_hash == want.rig_hash);
    T_EQ_I(got.n_cameras, 8);
    T_NEAR(got.fps, 29.97, 0);
    T_EQ_S(got.units, want.units);
    T_EQ_S(got.software, want.software);
    T_EQ_I(got.grid.n[1], 9);
    T_NEAR(got.grid.max[2], 1.5, 0);
    for (size_t cut = 0; cut < len; cut++)
        T_OK(pvp_decode_start(file, cut, &got, NULL) != PVX_OK);
    memset(file + 48 + 88, 'x', 32); /* units without an end */
    T_EQ_I(pvp_decode_start(file, len, &got, NULL), PVX_EFORMAT);
    free(file);

    const char *json;
    T_EQ_I(pvx_file_read(VECTORS "/status.bin", 1 << 20, &file, &len, NULL), PVX_OK);
    T_EQ_I(pvp_decode_status(file, len, &json, &json_len, NULL), PVX_OK);
    T_OK(json_len == strlen(STATUS_JSON) && memcmp(json, STATUS_JSON, json_len) == 0);
    free(file);

    uint64_t rig_hash;
    T_EQ_I(pvx_file_read(VECTORS "/event.bin", 1 << 20, &file, &len, NULL), PVX_OK);
    T_EQ_I(pvp_decode_event(file, len, &json, &json_len, NULL), PVX_OK);
    T_OK(json_len == strlen(EVENT_JSON) && memcmp(json, EVENT_JSON, json_len) == 0);
    T_EQ_I(pvp_decode_status(file, len, &json, &json_len, NULL), PVX_EFORMAT);
    free(file);
    T_EQ_I(pvx_file_read(VECTORS "/rig.bin", 1 << 20, &file, &len, NULL), PVX_OK);
    T_EQ_I(pvp_decode_rig(file, len, &rig_hash, &json, &json_len, NULL), PVX_OK);
    T_OK(rig_hash == want.rig_hash && json_len == strlen(RIG_YAML));
    T_OK(memcmp(json, RIG_YAML, json_len) == 0);
    for (size_t cut = 0; cut < len; cut++)
        T_OK(pvp_decode_rig(file, cut, &rig_hash, &json, &json_len, NULL) != PVX_OK);
    put32((uint8_t *)file + 48 + 12,
          (uint32_t)strlen(RIG_YAML) + 1); /* one byte more than there is */
    T_EQ_I(pvp_decode_rig(file, len, &rig_hash, &json, &json_len, NULL), PVX_EFORMAT);
    free(file);

    char reason[PVP_REASON_MAX];
    uint64_t session;
    T_EQ_I(pvx_file_read(VECTORS "/end.bin", 1 << 20, &file, &len, NULL), PVX_OK);
    T_EQ_I(pvp_decode_end(file, len, &session, reason, NULL), PVX_OK);
    T_OK(session == want.session);
    T_EQ_S(reason, END_REASON);
    struct pvx_diag d = {""};
    T_EQ_I(pvp_decode_start(file, len, &got, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "type 400");
    free(file);
}

/* ---- previews ---- */

static uint8_t *encode_preview(const struct pvp_preview *p, size_t *len, pvx_err *e)
{
    struct pvp_volume v = describe(8, 8, 8, 1);
    pvp_encoder *enc;
    const void *msg;
    uint8_t *copy = NULL;
    *len = 0;
    T_EQ_I(pvp_encoder_new(&v.grid, PVP_F16, PVP_RAW, &enc), PVX_OK);
    *e = pvp_encode_preview(enc, 1, p, &msg, len);
    if (*e == PVX_OK) {
        copy = malloc(*len);
        memcpy(copy, msg, *len);
    }
    pvp_encoder_free(&enc);
    return copy;
}

T_CASE(previews)
{
    struct pvp_preview p = preview_sample(), got;
    size_t len;
    pvx_err e;
    uint8_t *msg = encode_preview(&p, &len, &e);
    T_EQ_I(e, PVX_OK);
    T_EQ_I(pvp_decode_preview(msg, len, &got, NULL), PVX_OK);
    T_EQ_I(got.n_cameras, 3);
    T_OK(got.set == 42 && got.t_exposure_ns == p.t_exposure_ns);
    for (uint32_t c = 0; c < 3; c++) {
        const struct pvp_preview_camera *a = &got.camera[c], *b = &p.camera[c];
        T_EQ_S(a->name, b->name);
        T_OK(a->left_out == b->left_out && a->width == b->width && a->height == b->height);
        T_OK(a->across == b->across && a->down == b->down && a->lit == b->lit);
        T_OK(a->saturated == b->saturated && a->jpeg_len == b->jpeg_len);
        T_OK(a->jpeg_len == 0 || memcmp(a->jpeg, b->jpeg, a->jpeg_len) == 0);
        T_OK(a->across == 0 || memcmp(a->lit_bits, b->lit_bits, 6) == 0);
    }
    for (size_t cut = 0; cut < len; cut++) {
        uint8_t *exact = malloc(cut + 1);
        memcpy(exact, msg, cut);
        T_OK(pvp_decode_preview(exact, cut, &got, NULL) != PVX_OK);
        if (cut >= 48) { /* also with a header that agrees */
            put32(exact + 40, (uint32_t)(cut - 48));
            T_OK(pvp_decode_preview(exact, cut, &got, NULL) != PVX_OK);
        }
        free(exact);
    }
    static const struct {
        size_t at;
        uint32_t value;
    } bad[] = {
        {0, 31},       {0, 0xffffffff}, {4, 103},          {4, 0xffffffff}, {24, 65},
        {24, 4},       {32 + 68, 321},  {32 + 68, 0},      {32 + 72, 11},   {32 + 72, 0x3ffff},
        {32 + 76, 31}, {32 + 80, 31},   {32 + 84, 100000}, {32 + 88, 9999}, {32 + 92, 100000},
        {32 + 96, 5},  {32 + 96, ~0u},  {32, 0x1b1b1b1b},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        uint8_t *copy = malloc(len);
        memcpy(copy, msg, len);
        put32(copy + 48 + bad[i].at, bad[i].value);
        T_CHECK_(pvp_decode_preview(copy, len, &got, NULL) == PVX_EFORMAT, "bad %zu", i);
        T_EQ_I(got.n_cameras, 0);
        free(copy);
    }
    free(msg);
}

T_CASE(previews_that_are_none)
{
    struct pvp_preview p = preview_sample();
    size_t len;
    pvx_err e;
    p.camera[0].width = 321;
    T_OK(encode_preview(&p, &len, &e) == NULL && e == PVX_EINVAL);
    p = preview_sample();
    p.camera[0].lit = 31;
    T_OK(encode_preview(&p, &len, &e) == NULL && e == PVX_EINVAL);
    p = preview_sample();
    p.n_cameras = 65;
    T_OK(encode_preview(&p, &len, &e) == NULL && e == PVX_EINVAL);
    p = preview_sample();
    p.camera[2].jpeg_len = PVP_PREVIEW_MAX;
    T_OK(encode_preview(&p, &len, &e) == NULL && e == PVX_ERANGE);
}

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "--write-vectors") == 0)
        return write_vectors(argv[2]);
    return t_run();
}
