/* camera.h - one virtual UVC camera, plugged into vhci_hcd: the kernel's uvcvideo drives it.
 *
 * Free run: image number floor(t / period) modulo the number of images, t = CLOCK_MONOTONIC, is
 * sent at every multiple of the period, so all cameras of equal rate show the same instant at the
 * same time and what a set of frames must show is known from any one of them.
 * Threads: one per camera; everything here is called from one other thread. */
#ifndef VM_UVC_CAMERA_H
#define VM_UVC_CAMERA_H
#include <stdbool.h>
#include "tests/vm/uvc/images.h"

struct uvc_camera_config {
    unsigned port; /* of vhci_hcd.0, 0..7 */
    const char *name, *serial;
    const struct uvc_images *images; /* borrowed */
    uint32_t seed;                   /* of what is dropped */
};
struct uvc_camera_stats {
    uint64_t sent, dropped, cut, busy; /* busy: the host had not taken the frame before */
    uint64_t started, unlinked;
    int exposure_100us, gain, brightness; /* as the host has set them */
    uint64_t turned;                      /* how many times it has set one */
    uint64_t turned_at;                   /* frames sent since the start when it did last */
    bool plugged;
};
enum uvc_fault {
    UVC_DROP,   /* share of frames that are never sent */
    UVC_CUT,    /* share of frames of which the second half is missing */
    UVC_FREEZE, /* not 0: no frame at all */
    UVC_N_FAULTS
};

typedef struct uvc_camera uvc_camera;
PVX_MUST_CHECK pvx_err uvc_camera_new(const struct uvc_camera_config *c, uvc_camera **out);
/* Plug it in; waits up to 10 s until the port is free.  Errors: PVX_ENOENT (no vhci_hcd), PVX_EBUSY,
 * PVX_EPERM, PVX_EIO. */
PVX_MUST_CHECK pvx_err uvc_camera_plug(uvc_camera *c, struct pvx_diag *d);
void uvc_camera_unplug(uvc_camera *c); /* pull the cable; nothing when it is out */
void uvc_camera_fault(uvc_camera *c, enum uvc_fault f, double value);
void uvc_camera_stats(uvc_camera *c, struct uvc_camera_stats *out);
void uvc_camera_free(uvc_camera **c);
#endif
