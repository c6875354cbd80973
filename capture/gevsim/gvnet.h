/* gvnet.h - the net that simulated cameras share: its thread and its list of cameras (private to gvcam.c). */
#ifndef CAP_GVNET_H
#define CAP_GVNET_H
#include "capture/gevsim/link.h"
#include "capture/gevsim/gvcam.h"

/* Adds the camera to the list.  From now on it is served.  PVX_EIO, PVX_EBUSY, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err gvnet_add(cap_gvnet *n, cap_gvcam *c, struct pvx_diag *d);
void gvnet_remove(cap_gvnet *n, cap_gvcam *c);
struct gvcam_link *gvnet_link(cap_gvnet *n);
void gvnet_lock(cap_gvnet *n);
void gvnet_unlock(cap_gvnet *n); /* also wakes the thread, so that it sees changes */
#endif
