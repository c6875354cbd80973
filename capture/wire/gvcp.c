#include "capture/wire/gvcp.h"

#include <string.h>

#include "capture/wire/be.h"

/* Whether the payload has a length that the command takes. */
static uint16_t check_payload(const struct cap_gvcp_request *r)
{
    switch (r->command) {
    case CAP_GVCP_DISCOVERY: return CAP_GVCP_OK;
    case CAP_GVCP_FORCEIP: return r->n >= 56 ? CAP_GVCP_OK : CAP_GVCP_INVALID_HEADER;
    case CAP_GVCP_RESEND:
        return r->n >= ((r->flags & CAP_GVCP_EXTENDED) != 0 ? 20 : 12) ? CAP_GVCP_OK
                                                                       : CAP_GVCP_INVALID_HEADER;
    case CAP_GVCP_READREG:
        return r->n >= 4 && r->n % 4 == 0 ? CAP_GVCP_OK : CAP_GVCP_INVALID_HEADER;
    case CAP_GVCP_WRITEREG:
        return r->n >= 8 && r->n % 8 == 0 ? CAP_GVCP_OK : CAP_GVCP_INVALID_HEADER;
    case CAP_GVCP_READMEM: return r->n == 8 ? CAP_GVCP_OK : CAP_GVCP_INVALID_HEADER;
    case CAP_GVCP_WRITEMEM:
        return r->n >= 8 && r->n <= 4 + CAP_GVCP_DATA_MAX ? CAP_GVCP_OK : CAP_GVCP_INVALID_HEADER;
    case CAP_GVCP_ACTION:
        return r->n >= ((r->flags & CAP_GVCP_SCHEDULED) != 0 ? 20 : 12) ? CAP_GVCP_OK
                                                                        : CAP_GVCP_INVALID_HEADER;
    default: return CAP_GVCP_NOT_IMPLEMENTED;
    }
}

uint16_t cap_gvcp_parse(const void *packet, size_t bytes, struct cap_gvcp_request *out)
{
    const uint8_t *p = packet;
    memset(out, 0, sizeof *out);
    if (bytes < CAP_GVCP_HEAD || p[0] != CAP_GVCP_CMD_KEY)
        return CAP_GVCP_SILENT;
    out->flags = p[1];
    out->command = cap_get16(p + 2);
    out->id = cap_get16(p + 6);
    size_t n = cap_get16(p + 4);
    if (out->id == 0)
        return CAP_GVCP_SILENT;
    if (n > bytes - CAP_GVCP_HEAD || bytes > CAP_GVCP_MAX)
        return CAP_GVCP_INVALID_HEADER;
    out->data = p + CAP_GVCP_HEAD;
    out->n = n;
    return check_payload(out);
}

void cap_gvcp_get_resend(const struct cap_gvcp_request *r, struct cap_gvcp_resend *out)
{
    bool wide = (r->flags & CAP_GVCP_EXTENDED) != 0;
    out->block = wide ? cap_get64(r->data + 12) : cap_get16(r->data + 2);
    out->first = cap_get32(r->data + 4) & (wide ? 0xffffffffu : 0xffffffu);
    out->last = cap_get32(r->data + 8) & (wide ? 0xffffffffu : 0xffffffu);
}

void cap_gvcp_get_action(const struct cap_gvcp_request *r, struct cap_gvcp_action *out)
{
    out->device_key = cap_get32(r->data);
    out->group_key = cap_get32(r->data + 4);
    out->group_mask = cap_get32(r->data + 8);
    out->scheduled = (r->flags & CAP_GVCP_SCHEDULED) != 0;
    out->time = out->scheduled ? cap_get64(r->data + 12) : 0;
}

size_t cap_gvcp_put_command(uint8_t *out, uint8_t flags, uint16_t command, uint16_t id,
                            const void *data, size_t n)
{
    out[0] = CAP_GVCP_CMD_KEY;
    out[1] = flags;
    cap_put16(out + 2, command);
    cap_put16(out + 4, (uint16_t)n);
    cap_put16(out + 6, id);
    if (n > 0)
        memcpy(out + CAP_GVCP_HEAD, data, n);
    return CAP_GVCP_HEAD + n;
}

size_t cap_gvcp_put_action(uint8_t *out, const struct cap_gvcp_action *a, bool want_ack,
                           uint16_t id)
{
    uint8_t data[20];
    cap_put32(data, a->device_key);
    cap_put32(data + 4, a->group_key);
    cap_put32(data + 8, a->group_mask);
    cap_put64(data + 12, a->time);
    uint8_t flags =
        (uint8_t)((want_ack ? CAP_GVCP_ACK : 0) | (a->scheduled ? CAP_GVCP_SCHEDULED : 0));
    return cap_gvcp_put_command(out, flags, CAP_GVCP_ACTION, id, data, a->scheduled ? 20 : 12);
}

size_t cap_gvcp_put_ack(uint8_t *out, uint16_t status, uint16_t command, uint16_t id, size_t n)
{
    cap_put16(out, status);
    cap_put16(out + 2, (uint16_t)(command + 1));
    cap_put16(out + 4, (uint16_t)n);
    cap_put16(out + 6, id);
    return CAP_GVCP_HEAD + n;
}

bool cap_gvcp_parse_ack(const void *packet, size_t bytes, struct cap_gvcp_answer *out)
{
    const uint8_t *p = packet;
    memset(out, 0, sizeof *out);
    if (bytes < CAP_GVCP_HEAD || p[0] == CAP_GVCP_CMD_KEY ||
        cap_get16(p + 4) > bytes - CAP_GVCP_HEAD)
        return false;
    out->status = cap_get16(p);
    out->command = cap_get16(p + 2);
    out->n = cap_get16(p + 4);
    out->id = cap_get16(p + 6);
    out->data = p + CAP_GVCP_HEAD;
    return true;
}
