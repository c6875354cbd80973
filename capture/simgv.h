/* simgv.h - simulated GigE Vision cameras: real GVCP/GVSP on the wire, our pixels in the payload.
 *
 * Aravis' fake camera speaks the protocol; each camera serves a ring of images rendered before, the
 * image i of instant i/ring_fps, over and over.  All cameras of a host show the same instant:
 *     free run    frames are taken at multiples T of the frame period (host CLOCK_REALTIME);
 *                 image floor(T ring_fps), and the device stamp is that image's own instant
 *                 i/ring_fps, so that what the stamp says about the scene is exact.  A camera set
 *                 faster than the ring shows images more than once, stamped T.
 *     software trigger   taken when the trigger is seen (trigger_hz), stamped then.
 * cap_simgv_index gives the image for a stamp in both cases.  Other device clocks, lost frames and
 * packets, late and frozen cameras: struct cap_simgv_fault, live, per camera.
 * Frame ids are the protocol's 16 bit: 65401 first, 65535 is followed by 1.
 * A client that asks for another pixel format gets black; for another region, the part of the image
 * that lies there.
 *
 * Addresses must belong to an interface: netns.h has a private network for an ordinary user.
 * The fake's 100 ms stall (CAPTURE notes: unsigned poll timeout) is cured by simgv_poll.c, which
 * has to be linked into the executable: that happens by itself. */
#ifndef CAP_SIMGV_H
#define CAP_SIMGV_H
#include <math.h>
#include <stdbool.h>
#include "base/err.h"
#include "capture/pixel/image.h"

#define CAP_SIMGV_NAME_MAX 15 /* characters */

struct cap_simgv_config {
    const char *address;   /* "127.0.0.2" */
    const char *serial;    /* "SIM00", at most CAP_SIMGV_NAME_MAX */
    const char *user_name; /* "cam0", likewise; NULL = none */
    enum cap_pixfmt fmt;   /* CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8 */
    int32_t width, height;
    const void *const *ring; /* [n_ring] images, tightly packed, borrowed */
    size_t n_ring;
    double ring_fps;   /* images per second of scene time */
    double trigger_hz; /* how often a software trigger is looked for; 0 = 500 */
};
struct cap_simgv_fault {
    double skew_us, drift_ppm; /* of the camera's clock */
    double drop;               /* share of frames never sent, 0..1 (ids go on: they are gaps) */
    double packet_loss;        /* share of packets lost, 0..1 */
    double delay_ms;           /* each frame is sent this much late (stamp unchanged; to a fifth of
                                  the frame period) */
    bool freeze;               /* sends the same image and time stamp again and again */
};
struct cap_simgv_stats {
    uint64_t frames;  /* sent */
    uint64_t dropped; /* numbered but not sent: drop */
};

typedef struct cap_simgv cap_simgv;
/* Starts serving.  PVX_EBUSY: address in use; PVX_ENOENT: not an address of this host (diag: how to
 * get it); PVX_EINVAL; PVX_ENOMEM; PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_simgv_new(const struct cap_simgv_config *c, cap_simgv **out,
                                     struct pvx_diag *d);
void cap_simgv_set_fault(cap_simgv *s, const struct cap_simgv_fault *f);
void cap_simgv_stats(cap_simgv *s, struct cap_simgv_stats *out);
void cap_simgv_free(cap_simgv **s); /* = kill: stops answering, within 0.1 s */

/* Number (not yet modulo n_ring) of the ring image that belongs to stamp t.  A quarter of the ring
 * period of tolerance below, three quarters above, for stamps that went through a clock map. */
static inline int64_t cap_simgv_index(int64_t t_ns, double ring_fps)
{
    return (int64_t)floorl((long double)t_ns * (long double)ring_fps / 1e9L + 0.25L);
}
#endif
