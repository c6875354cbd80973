/* gvnet.h - the net that simulated cameras share: its thread, its list (private to gvcam.c). */
#ifndef CAP_GVNET_H
#define CAP_GVNET_H
#include "capture/gevsim/link.h"
#include "capture/gevsim/gvcam.h"

/* Into the list: from here on it is served.  PVX_EIO, PVX_EBUSY, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err gvnet_add(cap_gvnet *n, cap_gvcam *c, struct pvx_diag *d);
void gvnet_remove(cap_gvnet *n, cap_gvcam *c);
struct gvcam_link *gvnet_link(cap_gvnet *n);
void gvnet_lock(cap_gvnet *n);
void gvnet_unlock(cap_gvnet *n); /* and lets the thread look at what has changed */
#endif
