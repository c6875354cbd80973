/* pvp_messages.c - the short messages: start, end, status and event (JSON), rig (YAML), and the list of all types.
 * Volumes are in pvp_encode.c and pvp_decode.c, previews in pvp_preview.c. */
#include <math.h>
#include <stdio.h>

#include "proto/encoder.h"

static void start_fields(struct wire *w, struct pvp_start *s)
{
    pvp_grid_fields(w, &s->grid);
    wire_u32(w, &s->n_cameras);
    pvp_box_fields(w, &s->grid);
    wire_u64(w, &s->rig_hash);
    wire_f64(w, &s->fps);
    wire_text(w, s->units, sizeof s->units);
    wire_text(w, s->software, sizeof s->software);
}

pvx_err pvp_encode_start(pvp_encoder *e, uint64_t sequence, const struct pvp_start *s,
                         const void **msg, size_t *len)
{
    if (!pvp_grid_valid(&s->grid) || !isfinite(s->fps) || s->fps < 0)
        return PVX_EINVAL;
    struct wire w = {.out = e->msg, .at = WIRE_HEADER};
    struct pvp_start fields = *s;
    start_fields(&w, &fields);
    e->session = s->session;
    pvp_finish(e,
               (struct pvp_header){PVP_START, .sequence = sequence, .session = s->session,
                                   .body = WIRE_START},
               msg, len);
    return PVX_OK;
}

pvx_err pvp_decode_start(const void *msg, size_t len, struct pvp_start *s, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire in = {0};
    *s = (struct pvp_start){0};
    PVX_TRY(pvp_open_body(msg, len, PVP_START, &h, &in, d));
    s->session = h.session;
    start_fields(&in, s);
    if (in.bad)
        return pvx_fail(d, PVX_EFORMAT, "start message is cut short or has a bad text field");
    if (!pvp_grid_valid(&s->grid))
        return pvp_grid_fail(&s->grid, d);
    if (!isfinite(s->fps) || s->fps < 0)
        return pvx_fail(d, PVX_EFORMAT, "start message: frame rate %g", s->fps);
    return PVX_OK;
}

pvx_err pvp_encode_end(pvp_encoder *e, uint64_t sequence, uint64_t session, const char *reason,
                       const void **msg, size_t *len)
{
    struct wire w = {.out = e->msg, .at = WIRE_HEADER};
    char text[WIRE_END];
    snprintf(text, sizeof text, "%.*s", (int)sizeof text - 1, reason);
    wire_text(&w, text, sizeof text);
    pvp_finish(
        e, (struct pvp_header){PVP_END, .sequence = sequence, .session = session, .body = WIRE_END},
        msg, len);
    return PVX_OK;
}

pvx_err pvp_decode_end(const void *msg, size_t len, uint64_t *session, char reason[PVP_REASON_MAX],
                       struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire in = {0};
    *session = 0;
    reason[0] = '\0';
    PVX_TRY(pvp_open_body(msg, len, PVP_END, &h, &in, d));
    *session = h.session;
    wire_text(&in, reason, WIRE_END);
    if (in.bad)
        return pvx_fail(d, PVX_EFORMAT, "end message is cut short or has a bad text field");
    return PVX_OK;
}

/* JSON is the whole body. */
static pvx_err encode_json(struct pvp_encoder *e, struct pvp_header h, const char *json,
                           size_t most, const void **msg, size_t *len)
{
    h.body = strnlen(json, most + 1);
    if (h.body > most)
        return PVX_ERANGE;
    memcpy(e->msg + WIRE_HEADER, json, h.body);
    h.session = e->session;
    pvp_finish(e, h, msg, len);
    return PVX_OK;
}

pvx_err pvp_encode_status(pvp_encoder *e, uint64_t sequence, const char *json, const void **msg,
                          size_t *len)
{
    return encode_json(e, (struct pvp_header){PVP_STATUS, .sequence = sequence}, json,
                       PVP_STATUS_MAX, msg, len);
}

pvx_err pvp_encode_event(pvp_encoder *e, uint64_t sequence, const char *json, const void **msg,
                         size_t *len)
{
    return encode_json(e, (struct pvp_header){PVP_EVENT, .sequence = sequence}, json, PVP_EVENT_MAX,
                       msg, len);
}

static pvx_err decode_json(const void *msg, size_t len, enum pvp_type type, const char **json,
                           size_t *json_len, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire in = {0};
    size_t most = type == PVP_STATUS ? PVP_STATUS_MAX : PVP_EVENT_MAX;
    *json = "";
    *json_len = 0;
    PVX_TRY(pvp_open_body(msg, len, type, &h, &in, d));
    if (h.body > most)
        return pvx_fail(d, PVX_EFORMAT, "%s text of %zu bytes",
                        type == PVP_STATUS ? "status" : "event", h.body);
    *json = (const char *)in.in;
    *json_len = h.body;
    return PVX_OK;
}

pvx_err pvp_decode_status(const void *msg, size_t len, const char **json, size_t *json_len,
                          struct pvx_diag *d)
{
    return decode_json(msg, len, PVP_STATUS, json, json_len, d);
}

pvx_err pvp_decode_event(const void *msg, size_t len, const char **json, size_t *json_len,
                         struct pvx_diag *d)
{
    return decode_json(msg, len, PVP_EVENT, json, json_len, d);
}

/* The fields before the rig's text; at: offset of the text from the start of the body. */
static void rig_fields(struct wire *w, uint64_t *rig_hash, uint32_t *at, uint32_t *size)
{
    wire_u64(w, rig_hash);
    wire_u32(w, at);
    wire_u32(w, size);
}

pvx_err pvp_encode_rig(pvp_encoder *e, uint64_t sequence, uint64_t rig_hash, const char *yaml,
                       const void **msg, size_t *len)
{
    size_t n = strnlen(yaml, PVP_RIG_MAX + 1);
    if (n > PVP_RIG_MAX)
        return PVX_ERANGE;
    struct wire w = {.out = e->msg, .at = WIRE_HEADER};
    uint32_t at = WIRE_RIG, size = (uint32_t)n;
    rig_fields(&w, &rig_hash, &at, &size);
    memcpy(wire_write(&w, n), yaml, n);
    pvp_finish(e,
               (struct pvp_header){PVP_RIG, .sequence = sequence, .session = e->session,
                                   .body = w.at - WIRE_HEADER},
               msg, len);
    return PVX_OK;
}

pvx_err pvp_decode_rig(const void *msg, size_t len, uint64_t *rig_hash, const char **yaml,
                       size_t *yaml_len, struct pvx_diag *d)
{
    struct pvp_header h;
    struct wire in = {0};
    uint32_t at = 0, size = 0;
    *yaml = "";
    *yaml_len = 0;
    *rig_hash = 0;
    PVX_TRY(pvp_open_body(msg, len, PVP_RIG, &h, &in, d));
    rig_fields(&in, rig_hash, &at, &size);
    if (in.bad || at < WIRE_RIG || at > h.body || size > h.body - at || size > PVP_RIG_MAX)
        return pvx_fail(d, PVX_EFORMAT, "rig message is cut short");
    *yaml = (const char *)in.in + at;
    *yaml_len = size;
    return PVX_OK;
}

pvx_err pvp_encode(pvp_encoder *e, uint64_t sequence, enum pvp_type type, const void *what,
                   const void **msg, size_t *len)
{
    switch (type) {
    case PVP_STATUS: return pvp_encode_status(e, sequence, what, msg, len);
    case PVP_EVENT: return pvp_encode_event(e, sequence, what, msg, len);
    case PVP_PREVIEW: return pvp_encode_preview(e, sequence, what, msg, len);
    case PVP_END: return pvp_encode_end(e, sequence, e->session, what, msg, len);
    default: return PVX_EUNSUP;
    }
}

pvx_err pvp_check(enum pvp_type type, const void *msg, size_t len)
{
    union {
        struct pvp_start start;
        struct pvp_view view;
        struct pvp_preview preview;
        char reason[PVP_REASON_MAX];
    } to;
    const char *text;
    size_t n;
    uint64_t id;
    uint32_t doubt;
    switch (type) {
    case PVP_START: return pvp_decode_start(msg, len, &to.start, NULL);
    case PVP_VOLUME: return pvp_decode_volume(msg, len, &to.view, NULL);
    case PVP_STATUS: return pvp_decode_status(msg, len, &text, &n, NULL);
    case PVP_RIG: return pvp_decode_rig(msg, len, &id, &text, &n, NULL);
    case PVP_EVENT: return pvp_decode_event(msg, len, &text, &n, NULL);
    case PVP_PREVIEW: return pvp_decode_preview(msg, len, &to.preview, NULL);
    case PVP_BARS: return pvp_decode_bars(msg, len, &to.view, &doubt, NULL);
    case PVP_END: return pvp_decode_end(msg, len, &id, to.reason, NULL);
    }
    return PVX_EUNSUP;
}
