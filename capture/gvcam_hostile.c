/* gvcam_hostile.c - what a broken or evil camera sends: malformed acknowledges and packets. */
#include <string.h>

#include "capture/gvcam_int.h"

static void say(struct cap_gvcam *c, int fd, const uint8_t *p, size_t n,
                const struct sockaddr_in *to)
{
    if (!gvnet_pass(c, n + CAP_GVSP_UDP_IP, gvcam_now()))
        return;
    c->stats.hostile++;
    (void)sendto(fd, p, n, MSG_DONTWAIT, (const struct sockaddr *)to, sizeof *to);
}

void gvcam_hostile_acks(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                        const struct sockaddr_in *to)
{
    uint8_t p[CAP_GVCP_MAX];
    memset(p, 0xa5, sizeof p);
    say(c, c->control, p, 0, to); /* empty */
    say(c, c->control, p, 3, to); /* not even a head */
    cap_gvcp_put_ack(p, CAP_GVCP_OK, r->command, (uint16_t)(r->id + 77), 4);
    say(c, c->control, p, 12, to); /* to another request */
    cap_gvcp_put_ack(p, CAP_GVCP_OK, r->command, r->id, 500);
    say(c, c->control, p, CAP_GVCP_HEAD, to); /* says 500 bytes, has none */
    cap_gvcp_put_ack(p, CAP_GVCP_OK, 0x7770, r->id, 4);
    say(c, c->control, p, 12, to); /* of an unknown command */
    cap_gvcp_put_command(p, CAP_GVCP_ACK, CAP_GVCP_READREG, r->id, "\0\0\0\0", 4);
    say(c, c->control, p, 12, to); /* a request instead */
}

void gvcam_hostile_packets(struct cap_gvcam *c, const struct gvcam_shot *s)
{
    uint8_t p[512];
    struct sockaddr_in to = gvcam_target(c);
    struct cap_gvsp_head h = {.wide = c->wide, .content = CAP_GVSP_DATA, .block = s->id};
    memset(p, 0x5a, sizeof p);
    h.block = s->id > 2000 ? s->id - 1999 : s->id + 40000; /* of no frame near by */
    h.packet = 3;
    cap_gvsp_put_head(p, &h);
    say(c, c->stream, p, sizeof p, &to);
    h.block = s->id;
    h.packet = 0xfffff0; /* far behind the end */
    cap_gvsp_put_head(p, &h);
    say(c, c->stream, p, sizeof p, &to);
    h.packet = 1;
    h.content = 0x7d; /* of no known kind */
    cap_gvsp_put_head(p, &h);
    say(c, c->stream, p, sizeof p, &to);
}
