/* control.h - GVCP: which client may do what. */
#ifndef CAP_GVCAM_CONTROL_H
#define CAP_GVCAM_CONTROL_H
#include <netinet/in.h>

#include "capture/gevsim/gvcam.h"
#include "capture/wire/gvcp.h"

struct gvcam_control {
    int fd;
    uint32_t ccp;
    struct sockaddr_in owner;
    int64_t heartbeat_at; /* last sign of life of the owner */
    struct {
        struct sockaddr_in from;
        uint16_t id, command;
        uint8_t ack[CAP_GVCP_MAX];
        size_t n;
    } last;             /* last command that changed something, for retransmissions */
    int64_t gone_until; /* rebooting; 0 = there */
};
void gvcam_control_datagram(struct cap_gvcam *c, const uint8_t *p, size_t n,
                            const struct sockaddr_in *from, int64_t now);
int64_t gvcam_control_step(struct cap_gvcam *c, int64_t now); /* heartbeat, back from a reboot */
/* Everything is as after power-up, once it is back; 0 s: in its own time. */
void gvcam_control_reboot(struct cap_gvcam *c, int64_t now, double seconds);
#endif
