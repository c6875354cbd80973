/* pvp_preview.c - the message with the cameras' pictures. */
#include "proto/encoder.h"

enum { HAS_LEFT_OUT = 1 }; /* bits of a camera's flags; others are ignored */

/* Offsets of a camera's bytes from the start of the body. */
struct place {
    uint32_t jpeg_at, jpeg_len, bits_at, bits_len;
};

static void head_fields(struct wire *w, struct pvp_preview *p, uint32_t *head, uint32_t *each)
{
    wire_u32(w, head);
    wire_u32(w, each);
    wire_u64(w, &p->set);
    wire_i64(w, &p->t_exposure_ns);
    uint32_t reserved = 0;
    wire_u32(w, &p->n_cameras);
    wire_u32(w, &reserved);
}

static void camera_fields(struct wire *w, struct pvp_preview_camera *c, struct place *at)
{
    uint32_t flags = c->left_out ? HAS_LEFT_OUT : 0, reserved = 0;
    wire_text(w, c->name, sizeof c->name);
    wire_u32(w, &flags);
    wire_u16(w, &c->width);
    wire_u16(w, &c->height);
    wire_u16(w, &c->across);
    wire_u16(w, &c->down);
    wire_u32(w, &c->lit);
    wire_u32(w, &c->saturated);
    wire_u32(w, &at->jpeg_at);
    wire_u32(w, &at->jpeg_len);
    wire_u32(w, &at->bits_at);
    wire_u32(w, &at->bits_len);
    wire_u32(w, &reserved); /* keeps the next camera aligned to 8 */
    c->left_out = (flags & HAS_LEFT_OUT) != 0;
}

static size_t bits_len(const struct pvp_preview_camera *c)
{
    return (size_t)c->down * ((c->across + 7) / 8);
}

/* Whether the sizes fit each other and the limits of the format. */
static bool valid(const struct pvp_preview_camera *c)
{
    bool picture = c->width > 0 && c->height > 0 && c->width <= PVP_PREVIEW_SIDE &&
                   c->height <= PVP_PREVIEW_SIDE;
    bool counts = (uint64_t)c->lit <= (uint64_t)c->across * c->down &&
                  (uint64_t)c->saturated <= (uint64_t)c->across * c->down;
    return (c->jpeg_len > 0 ? picture : c->width == 0 && c->height == 0) &&
           (c->across == 0) == (c->down == 0) && c->across <= 0xffff && c->down <= 0xffff && counts;
}

pvx_err pvp_encode_preview(pvp_encoder *e, uint64_t sequence, const struct pvp_preview *p,
                           const void **msg, size_t *len)
{
    if (p->n_cameras > PVP_CAMERAS_MAX)
        return PVX_EINVAL;
    size_t end = WIRE_PREVIEW + (size_t)p->n_cameras * WIRE_CAMERA;
    struct wire w = {.out = e->msg, .at = WIRE_HEADER};
    struct pvp_preview head = {
        .set = p->set, .t_exposure_ns = p->t_exposure_ns, .n_cameras = p->n_cameras};
    uint32_t head_len = WIRE_PREVIEW, each = WIRE_CAMERA;
    head_fields(&w, &head, &head_len, &each);
    for (uint32_t c = 0; c < p->n_cameras; c++) {
        struct pvp_preview_camera k = p->camera[c];
        size_t bits = bits_len(&k);
        if (!valid(&k))
            return PVX_EINVAL;
        if (k.jpeg_len > PVP_PREVIEW_MAX - end || bits > PVP_PREVIEW_MAX - end - k.jpeg_len)
            return PVX_ERANGE;
        struct place at = {(uint32_t)end, (uint32_t)k.jpeg_len, (uint32_t)(end + k.jpeg_len),
                           (uint32_t)bits};
        camera_fields(&w, &k, &at);
        if (k.jpeg_len > 0)
            memcpy(e->msg + WIRE_HEADER + at.jpeg_at, k.jpeg, k.jpeg_len);
        if (bits > 0)
            memcpy(e->msg + WIRE_HEADER + at.bits_at, k.lit_bits, bits);
        end += k.jpeg_len + bits;
    }
    pvp_finish(
        e,
        (struct pvp_header){PVP_PREVIEW, .sequence = sequence, .session = e->session, .body = end},
        msg, len);
    return PVX_OK;
}

static bool inside(uint32_t at, uint32_t len, size_t body)
{
    return at <= body && len <= body - at;
}

pvx_err pvp_decode_preview(const void *msg, size_t len, struct pvp_preview *out, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire in = {0};
    uint32_t head = 0, each = 0;
    *out = (struct pvp_preview){0};
    PVX_TRY(pvp_open_body(msg, len, PVP_PREVIEW, &h, &in, d));
    out->session = h.session;
    head_fields(&in, out, &head, &each);
    uint32_t n = out->n_cameras;
    out->n_cameras = 0; /* until they are read */
    if (in.bad || n > PVP_CAMERAS_MAX || head < WIRE_PREVIEW || each < WIRE_CAMERA ||
        head > h.body || (uint64_t)each * n > h.body - head || h.body > PVP_PREVIEW_MAX)
        return pvx_fail(d, PVX_EFORMAT, "preview message is cut short");
    for (uint32_t c = 0; c < n; c++) {
        struct pvp_preview_camera *k = &out->camera[c];
        struct place at = {0};
        in.at = head + (size_t)c * each;
        camera_fields(&in, k, &at);
        k->jpeg_len = at.jpeg_len;
        if (in.bad || !valid(k) || at.bits_len != bits_len(k) ||
            !inside(at.jpeg_at, at.jpeg_len, h.body) || !inside(at.bits_at, at.bits_len, h.body))
            return pvx_fail(d, PVX_EFORMAT, "preview message: camera %u of %u does not fit", c, n);
        k->jpeg = at.jpeg_len > 0 ? in.in + at.jpeg_at : NULL;
        k->lit_bits = at.bits_len > 0 ? in.in + at.bits_at : NULL;
    }
    out->n_cameras = n;
    return PVX_OK;
}
