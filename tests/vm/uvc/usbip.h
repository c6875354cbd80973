/* usbip.h - the device's end of Linux' USB/IP protocol, for one device with endpoint 0 and one bulk
 * IN endpoint (1), on a stream socket whose other end vhci_hcd was given.
 *
 * Protocol: Documentation/usb/usbip_protocol.rst, the URB part (no OP_ exchange: the socket is
 * attached through sysfs).  Control transfers are answered while they are read; bulk IN transfers
 * wait in a queue until usbip_bulk_answer.
 *
 * Unlinking.  The host takes a transfer back with CMD_UNLINK and must get exactly one answer for
 * the transfer, or vhci_hcd drops the device ("cannot find a urb of seqnum") or waits for ever:
 *   still queued here                        RET_UNLINK -ECONNRESET, the transfer is forgotten
 *   answered before                          RET_UNLINK 0
 *   not seen yet (its number is above all    nothing now; when the CMD_SUBMIT comes, RET_UNLINK
 *   that came): vhci's sending thread sends   -ECONNRESET instead of queueing it
 *   an unlink that arrives between its two
 *   loops first
 * Threads: one per device. */
#ifndef VM_USBIP_H
#define VM_USBIP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define USBIP_MAX_QUEUE  64   /* bulk transfers that wait; uvcvideo has 5 */
#define USBIP_MAX_EARLY  16   /* unlinks that came before their transfer */
#define USBIP_MAX_OUT    4096 /* bytes of a control OUT transfer */
#define USBIP_MAX_ANSWER 2048 /* bytes of a control IN transfer */

/* A control transfer: setup as on the wire; data [n] of an OUT.  Answer of an IN goes to answer
 * [USBIP_MAX_ANSWER].  Returns its bytes (0 for an OUT), or -errno: -EPIPE = stall. */
typedef int (*usbip_control_fn)(void *ctx, const uint8_t setup[8], const uint8_t *data, size_t n,
                                uint8_t *answer);

struct usbip {
    int fd;
    usbip_control_fn control;
    void *ctx;
    struct usbip_transfer {
        uint32_t seq, room;
    } queue[USBIP_MAX_QUEUE]; /* ring */
    unsigned head, n;
    struct usbip_early {
        uint32_t victim, by; /* by = 0: free; numbers begin at 1 */
    } early[USBIP_MAX_EARLY];
    uint32_t last_seq;
    bool any;
    uint64_t unlinked;
};

/* Read one command and do it.  False: the host has gone, or says what no host says. */
bool usbip_serve(struct usbip *u);
/* Bytes that the oldest waiting bulk transfer can take; 0 = none waits. */
size_t usbip_bulk_room(const struct usbip *u);
/* Complete it with `n` bytes (0 = a packet of length zero).  False: the host has gone. */
bool usbip_bulk_answer(struct usbip *u, const void *data, size_t n);
#endif
