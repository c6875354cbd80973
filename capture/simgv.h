/* simgv.h - simulated GigE Vision cameras: real GVCP/GVSP on the wire, our pixels in the payload.
 *
 * Aravis' fake camera speaks the protocol; each camera serves a ring of pre-rendered images picked by
 * absolute time, index = floor(t * ring_fps) mod n, so all cameras show the same instant.  Device
 * stamps are host CLOCK_REALTIME + skew + drift.  Addresses must belong to an interface: see
 * netns.h for a private network that an ordinary user may have.
 * Needs g_poll interposed against the fake's 100 ms stall (CAPTURE.md); simgv_poll.c does it.
 * Faults can be switched at run time, per camera. */
#ifndef CAP_SIMGV_H
#define CAP_SIMGV_H
#include <stdbool.h>
#include "base/err.h"
#include "capture/image.h"

struct cap_simgv_config {
    const char *address;       /* "127.0.0.2" */
    const char *serial;        /* "SIM00" */
    enum cap_pixfmt fmt;       /* CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8 */
    int32_t width, height;
    const void *const *ring;   /* [n_ring] images, tightly packed, borrowed */
    size_t n_ring;
    double ring_fps;           /* images per second of scene time */
    double trigger_hz;         /* how often a software trigger is looked for; 0 = 500 */
};
struct cap_simgv_fault {
    double skew_us, drift_ppm; /* of the camera's clock */
    double drop;               /* share of frames never sent, 0..1 (ids go on: they are gaps) */
    double packet_loss;        /* share of packets lost, 0..1 */
    double delay_ms;           /* each frame is sent this much late (stamp unchanged) */
    bool freeze;               /* sends the same image and time stamp again and again */
};
struct cap_simgv_stats { uint64_t frames, dropped; };

typedef struct cap_simgv cap_simgv;
/* Starts serving.  PVX_EBUSY: address in use or not of this host (diag: how to get it). */
PVX_MUST_CHECK pvx_err cap_simgv_new(const struct cap_simgv_config *c, cap_simgv **out,
                                     struct pvx_diag *d);
void cap_simgv_set_fault(cap_simgv *s, const struct cap_simgv_fault *f);
void cap_simgv_stats(cap_simgv *s, struct cap_simgv_stats *out);
void cap_simgv_free(cap_simgv **s); /* = kill: stops answering at once */
#endif
