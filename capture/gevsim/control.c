/* control.c - answering GVCP: which client may do what, registers, memory, actions, resend. */
#include <string.h>

#include "base/clock.h"
#include "capture/gevsim/gevsim.h"

static bool same_peer(const struct sockaddr_in *a, const struct sockaddr_in *b)
{
    return a->sin_addr.s_addr == b->sin_addr.s_addr && a->sin_port == b->sin_port;
}

static bool owns(const struct cap_gvcam *c, const struct sockaddr_in *from)
{
    return c->control.ccp != 0 && same_peer(&c->control.owner, from);
}

static void reply(const struct cap_gvcam *c, const uint8_t *p, size_t n,
                  const struct sockaddr_in *to)
{
    if (!gvcam_link_silent(c->link, pvx_now_real()))
        (void)sendto(c->control.fd, p, n, MSG_DONTWAIT, (const struct sockaddr *)to, sizeof *to);
}

static void control_release(struct cap_gvcam *c)
{
    c->control.ccp = 0;
    gvcam_expose_stop(c);
    (void)gvcam_reg_write(c, GVB_SCP, 0, 0);
}

void gvcam_control_reboot(struct cap_gvcam *c, int64_t now, double seconds)
{
    control_release(c);
    gvcam_reg_reboot(c);
    gvcam_expose_restart_ids(c, 0);
    c->control.last.id = 0;
    c->stats.reboots++;
    c->control.gone_until = now + (int64_t)((seconds > 0 ? seconds : c->c.reboot_s) * 1e9);
}

/* Control privilege: any client may take it when no other has it. Its owner may change or give it back. */
static uint16_t write_ccp(struct cap_gvcam *c, const struct sockaddr_in *from, int64_t now,
                          uint32_t v)
{
    v &= GVCAM_CCP_EXCLUSIVE | GVCAM_CCP_CONTROL;
    if (c->control.ccp != 0 && !owns(c, from))
        return CAP_GVCP_ACCESS_DENIED;
    if (v == 0) {
        control_release(c);
        return CAP_GVCP_OK;
    }
    c->control.ccp = v;
    c->control.owner = *from;
    c->control.heartbeat_at = now;
    return CAP_GVCP_OK;
}

static uint16_t control_write_one(struct cap_gvcam *c, const struct sockaddr_in *from, int64_t now,
                                  uint32_t address, uint32_t value)
{
    if (address == GVB_CCP)
        return write_ccp(c, from, now, value);
    if (!owns(c, from))
        return CAP_GVCP_ACCESS_DENIED;
    uint16_t status = gvcam_reg_write(c, address, now, value);
    if (c->reg.reset)
        gvcam_control_reboot(c, now, 0);
    return status;
}

static uint16_t read_one(struct cap_gvcam *c, int64_t now, uint32_t address, uint32_t *out)
{
    const struct gvcam_control *k = &c->control;
    switch (address) {
    case GVB_CCP: *out = k->ccp; return CAP_GVCP_OK;
    case GVB_PRIMARY_PORT: *out = k->ccp != 0 ? ntohs(k->owner.sin_port) : 0; return CAP_GVCP_OK;
    case GVB_PRIMARY_IP:
        *out = k->ccp != 0 ? ntohl(k->owner.sin_addr.s_addr) : 0;
        return CAP_GVCP_OK;
    default: return gvcam_reg_read(c, address, now, out);
    }
}

/* With exclusive access, other clients may not even read. */
static bool control_may_read(const struct cap_gvcam *c, const struct sockaddr_in *from)
{
    return (c->control.ccp & GVCAM_CCP_EXCLUSIVE) == 0 || owns(c, from);
}

struct answer {
    uint16_t status;
    size_t n; /* payload */
    uint8_t *out;
};

static void read_registers(struct cap_gvcam *c, const struct cap_gvcp_request *r, int64_t now,
                           struct answer *a)
{
    for (size_t k = 0; k + 4 <= r->n && a->status == CAP_GVCP_OK; k += 4) {
        uint32_t v;
        a->status = read_one(c, now, cap_get32(r->data + k), &v);
        if (a->status == CAP_GVCP_OK) {
            cap_put32(a->out + k, v);
            a->n = k + 4;
        }
    }
}

static void write_registers(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                            const struct sockaddr_in *from, int64_t now, struct answer *a)
{
    uint16_t done = 0;
    for (size_t k = 0; k + 8 <= r->n && a->status == CAP_GVCP_OK; k += 8) {
        a->status =
            control_write_one(c, from, now, cap_get32(r->data + k), cap_get32(r->data + k + 4));
        done = (uint16_t)(done + (a->status == CAP_GVCP_OK));
    }
    cap_put32(a->out, done);
    a->n = 4;
}

static void read_memory(struct cap_gvcam *c, const struct cap_gvcp_request *r, int64_t now,
                        struct answer *a)
{
    uint32_t address = cap_get32(r->data), n = cap_get16(r->data + 6);
    if (address % 4 != 0 || n % 4 != 0)
        a->status = CAP_GVCP_BAD_ALIGNMENT;
    else if (n == 0 || n > CAP_GVCP_DATA_MAX)
        a->status = CAP_GVCP_INVALID_PARAMETER;
    for (uint32_t k = 0; k < n && a->status == CAP_GVCP_OK; k += 4) {
        uint32_t v;
        a->status = read_one(c, now, address + k, &v);
        cap_put32(a->out + 4 + k, v);
    }
    cap_put32(a->out, address);
    a->n = a->status == CAP_GVCP_OK ? 4 + n : 0;
}

static void write_memory(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                         const struct sockaddr_in *from, int64_t now, struct answer *a)
{
    uint32_t address = cap_get32(r->data);
    size_t n = r->n - 4;
    if (address % 4 != 0 || n % 4 != 0)
        a->status = CAP_GVCP_BAD_ALIGNMENT;
    uint16_t done = 0;
    for (size_t k = 0; k < n && a->status == CAP_GVCP_OK; k += 4) {
        a->status =
            control_write_one(c, from, now, address + (uint32_t)k, cap_get32(r->data + 4 + k));
        done = (uint16_t)(done + (a->status == CAP_GVCP_OK ? 4 : 0));
    }
    cap_put32(a->out, done);
    a->n = 4;
}

/* A command for another camera gets no answer, as the protocol requires.  One for this camera is refused, because the
 * simulation chooses the address. */
static uint16_t force_ip(const struct cap_gvcam *c, const struct cap_gvcp_request *r)
{
    return memcmp(r->data + 2, c->reg.boot + GVB_MAC_HIGH + 2, 6) == 0 ? CAP_GVCP_ACCESS_DENIED
                                                                       : CAP_GVCP_SILENT;
}

static void execute(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                    const struct sockaddr_in *from, int64_t now, struct answer *a)
{
    struct cap_gvcp_resend resend;
    struct cap_gvcp_action action;
    switch (r->command) {
    case CAP_GVCP_DISCOVERY:
        memcpy(a->out, c->reg.boot, CAP_GVCP_DISCOVER);
        a->n = CAP_GVCP_DISCOVER;
        break;
    case CAP_GVCP_FORCEIP: a->status = force_ip(c, r); break;
    case CAP_GVCP_RESEND: /* comes from the stream's own socket, so only the owner's host is checked */
        if (c->control.ccp == 0 || c->control.owner.sin_addr.s_addr != from->sin_addr.s_addr) {
            a->status = CAP_GVCP_ACCESS_DENIED;
            break;
        }
        c->stats.asked++;
        if (c->c.no_resend) {
            a->status = CAP_GVCP_NOT_IMPLEMENTED;
            break;
        }
        cap_gvcp_get_resend(r, &resend);
        gvcam_send_again(c, &resend);
        break;
    case CAP_GVCP_ACTION:
        cap_gvcp_get_action(r, &action);
        a->status = gvcam_action(c, &action, now);
        break;
    case CAP_GVCP_WRITEREG: write_registers(c, r, from, now, a); break;
    case CAP_GVCP_WRITEMEM: write_memory(c, r, from, now, a); break;
    default:
        if (!control_may_read(c, from))
            a->status = CAP_GVCP_ACCESS_DENIED;
        else if (r->command == CAP_GVCP_READREG)
            read_registers(c, r, now, a);
        else
            read_memory(c, r, now, a);
    }
}

/* Whether a command changes something.  Such a command is not executed again when it comes twice with the same
 * number, because its acknowledge was lost, or by a second broadcast address. */
static bool changes(uint16_t command)
{
    return command == CAP_GVCP_WRITEREG || command == CAP_GVCP_WRITEMEM ||
           command == CAP_GVCP_ACTION;
}

static bool control_again(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                          const struct sockaddr_in *from)
{
    return changes(r->command) && c->control.last.id == r->id &&
           c->control.last.command == r->command && same_peer(&c->control.last.from, from);
}

void gvcam_control_datagram(struct cap_gvcam *c, const uint8_t *p, size_t n,
                            const struct sockaddr_in *from, int64_t now)
{
    struct cap_gvcp_request r;
    uint8_t out[CAP_GVCP_MAX + 8];
    if (c->control.gone_until != 0 || gvcam_link_silent(c->link, now))
        return;
    struct answer a = {.status = cap_gvcp_parse(p, n, &r), .out = out + CAP_GVCP_HEAD};
    if (owns(c, from))
        c->control.heartbeat_at = now;
    if (a.status == CAP_GVCP_OK && control_again(c, &r, from)) {
        if (c->control.last.n > 0)
            reply(c, c->control.last.ack, c->control.last.n, from);
        return;
    }
    if (a.status == CAP_GVCP_OK)
        execute(c, &r, from, now, &a);
    *(a.status == CAP_GVCP_OK ? &c->stats.commands : &c->stats.refused) += 1;
    if (a.status == CAP_GVCP_SILENT)
        return;
    size_t bytes = cap_gvcp_put_ack(out, a.status, r.command, r.id, a.n);
    bool wanted = ((r.flags & CAP_GVCP_ACK) != 0 || r.command == CAP_GVCP_DISCOVERY) &&
                  r.command != CAP_GVCP_RESEND;
    if (changes(r.command)) {
        c->control.last.from = *from;
        c->control.last.id = r.id;
        c->control.last.command = r.command;
        c->control.last.n = wanted ? bytes : 0;
        memcpy(c->control.last.ack, out, bytes);
    }
    if (!wanted)
        return;
    if (gvcam_chance(c, c->fault.hostile))
        gvcam_hostile_acks(c, &r, from);
    reply(c, out, bytes, from);
}

int64_t gvcam_control_step(struct cap_gvcam *c, int64_t now)
{
    if (c->control.gone_until != 0) {
        if (now < c->control.gone_until)
            return c->control.gone_until;
        c->control.gone_until = 0;
        gvcam_clock_start(&c->clock, &c->c, now);
    }
    if (c->control.ccp == 0)
        return GVCAM_NEVER;
    int64_t end = c->control.heartbeat_at + (int64_t)c->reg.v[GVF_HEARTBEAT] * PVX_NS_PER_MS;
    if (now < end)
        return end;
    c->stats.heartbeats++;
    control_release(c);
    return GVCAM_NEVER;
}
