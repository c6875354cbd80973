/* pvp_text.c - messages that are a text: status and event (JSON), rig (YAML). */
#include "proto/encoder.h"

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

/* What stands before the rig's text; at: of the text, from the body's begin. */
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
