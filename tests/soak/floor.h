/* floor.h - what the kernel alone takes for receiving the same packets: a process that does nothing but
 * recvmmsg them from UDP sockets on loopback and throw them away.
 * Capture's own cost is what it takes beyond this. */
#ifndef SOAK_FLOOR_H
#define SOAK_FLOOR_H
#include <stddef.h>
#include "base/err.h"

struct receive_floor {
    double cpu;      /* share of one core, user and system, of the receiver */
    double received; /* share of the packets sent that were received */
};
/* `cameras` streams of `frame_bytes` at `fps` in packets of `packet` bytes for `seconds`.  Errors: PVX_EIO. */
PVX_MUST_CHECK pvx_err receive_floor_measure(unsigned cameras, size_t frame_bytes, double fps,
                                             size_t packet, double seconds,
                                             struct receive_floor *out, struct pvx_diag *d);
#endif
