/* action.h - GigE Vision action commands: one datagram makes all cameras of a network act together.
 *
 * ACTION_CMD (GigE Vision 2.0; all big-endian; packed by gvcp.h), to UDP port 3956:
 *     0x42 | flags: 0x01 answer, 0x80 scheduled | 0x0100 | length 12 or 20 | number 1..65535
 *     device key | group key | group mask | scheduled: time, 64 bit, on the cameras' clock
 * A camera acts if the device key and the group key are its own and the masks share a bit.  It acts at once, or at
 * `time`.  If that time has passed, it acts at once or not at all, depending on its maker, so a late command is not
 * synchronized.  ACTION_ACK: status | 0x0101 | length 0 | number.
 * Threads: one thread per sender.  Allocates nothing after new. */
#ifndef CAP_ACTION_H
#define CAP_ACTION_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "capture/source/source.h"

#define CAP_ACTION_BYTES 28

/* Returns the bytes written: 20, or 28 if at_ns, the time on the cameras' clock, is above 0. */
size_t cap_action_encode(const struct cap_action_keys *k, uint16_t number, int64_t at_ns,
                         bool answer, uint8_t out[CAP_ACTION_BYTES]);

struct cap_action_ack {
    /* enum cap_gvcp_status.  CAP_GVCP_OK: done, or will be.  CAP_GVCP_NO_REFERENCE_TIME: the camera's clock is not
     * synchronized.  CAP_GVCP_ACTION_LATE: the time had passed. */
    uint16_t status;
    uint16_t number;
};
/* False: not an answer to an action command. */
bool cap_action_decode(const uint8_t *p, size_t n, struct cap_action_ack *out);

typedef struct cap_action_sender cap_action_sender;
/* Errors: PVX_ENOMEM, PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_action_sender_new(cap_action_sender **out, struct pvx_diag *d);
void cap_action_sender_free(cap_action_sender **s);
int cap_action_sender_fd(const cap_action_sender *s); /* readable when answers have come */
/* Sends one datagram to an IPv4 address (host order), unicast or broadcast.  PVX_EIO: the host refuses (no route, not
 * a broadcast address of its interfaces); see errno. */
PVX_MUST_CHECK pvx_err cap_action_send(cap_action_sender *s, uint32_t address, const uint8_t *p,
                                       size_t n);
/* The next answer that has arrived; false = none.  from: the camera's address, host order. */
bool cap_action_answer(cap_action_sender *s, uint32_t *from, struct cap_action_ack *out);
#endif
