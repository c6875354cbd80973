/* simgv.h - the second, independent simulation of GigE Vision cameras: libaravis' fake, our pixels.
 *
 * Each camera serves a ring of images rendered before, image i of instant i/ring_fps, over and over.
 * All cameras of a host show the same instant:
 *     free run    frames are exposed at multiples T of the frame period (host CLOCK_REALTIME);
 *                 image floor(T ring_fps), and the device stamp is that image's own instant
 *                 i/ring_fps, so that what the stamp says about the scene is exact.  A camera set
 *                 faster than the ring shows images more than once, stamped T.
 *     software trigger   exposed when the trigger is seen (500 Hz), stamped then.
 * cap_gvcam_index (gvcam.h) gives the image for a stamp in both cases.  Lost frames, late and frozen
 * cameras: struct simgv_fault, live, per camera.
 * Frame ids are the protocol's 16 bit: 65401 first, 65535 is followed by 1.
 * A client that asks for another pixel format gets black; for another region, the part of the image
 * that lies there.
 *
 * Addresses must belong to an interface: netns.h has a private network for an ordinary user.
 * The fake's 100 ms stall (an unsigned poll timeout) is cured by simgv_poll.c: link both. */
#ifndef SIMGV_H
#define SIMGV_H
#include <stdbool.h>
#include "base/err.h"
#include "capture/pixel/image.h"

#define SIMGV_NAME_MAX 15 /* characters */

struct simgv_config {
    const char *address;   /* "127.0.0.2" */
    const char *serial;    /* "SIM00", at most SIMGV_NAME_MAX */
    const char *user_name; /* "cam0", likewise; NULL = none */
    enum cap_pixfmt fmt;   /* CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8 */
    int32_t width, height;
    const void *const *ring; /* [n_ring] images, tightly packed, borrowed */
    size_t n_ring;
    double ring_fps; /* images per second of scene time */
};
struct simgv_fault {
    double drop;     /* share of frames never sent, 0..1 (ids go on: they are gaps) */
    double delay_ms; /* each frame is sent this much late (stamp unchanged; to a fifth of
                                  the frame period) */
    bool freeze;     /* sends the same image and time stamp again and again */
};
struct simgv_stats {
    uint64_t dropped; /* numbered but not sent: drop */
};

typedef struct simgv simgv;
/* Starts serving.  PVX_EBUSY: address in use; PVX_ENOENT: not an address of this host (diag: how to
 * get it); PVX_EINVAL; PVX_ENOMEM; PVX_EIO. */
PVX_MUST_CHECK pvx_err simgv_new(const struct simgv_config *c, simgv **out, struct pvx_diag *d);
void simgv_set_fault(simgv *s, const struct simgv_fault *f);
void simgv_stats(simgv *s, struct simgv_stats *out);
void simgv_free(simgv **s); /* = kill: stops answering, within 0.1 s */
#endif
