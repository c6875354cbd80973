/* control.h - GVCP of a simulated camera: answers commands, and decides which client may give them. */
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
    int64_t gone_until; /* end of a reboot; 0 = not rebooting */
};
void gvcam_control_datagram(struct cap_gvcam *c, const uint8_t *p, size_t n,
                            const struct sockaddr_in *from, int64_t now);
int64_t gvcam_control_step(struct cap_gvcam *c, int64_t now); /* heartbeat, back from a reboot */
/* Reboot: silent for `seconds` (0 = the camera's own time), then as after power-up. */
void gvcam_control_reboot(struct cap_gvcam *c, int64_t now, double seconds);
#endif
