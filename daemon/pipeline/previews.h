/* previews.h - what the cameras see, for a page or a person: small JPEGs and silhouettes on an endpoint of their own.
 *
 * A thread of the lowest priority (nice 19) asks for a set at most ten times a second, and only while there are
 * subscribers.  The carve stage then copies at most 320 by 320 pixels and the silhouette of each camera; otherwise it
 * does nothing.  The thread encodes and sends.  Only the newest set is ever sent; a slow subscriber misses some.
 * Pictures show every n-th of the binned pixels, with the sRGB curve; full scale is white.
 * Memory: one set's copies, taken at new.
 * Threads: new, free: one; offer: the carve stage; counts: any. */
#ifndef DMN_PREVIEWS_H
#define DMN_PREVIEWS_H
#include "daemon/config/config.h"
#include "daemon/pipeline/pipeline.h"
#include "proto/pub.h"

#define DMN_PREVIEWS_HZ 10

typedef struct dmn_previews dmn_previews;

struct dmn_previews_params { /* borrowed */
    const struct dmn_config *config;
    const struct rec_rig *rig;
    const rec_sysmat *S;
    pvx_pool *pool;
    pvp_auth *auth; /* as for the volumes; NULL: no keys */
    const struct pvp_start *start;
    const char *rig_text;
};
/* *out NULL: no previews (publish.previews: off, or no ipc:// endpoint of the volumes to put them beside).
 * Errors: PVX_EBUSY (endpoint in use), PVX_EINVAL, PVX_ENOMEM, PVX_EIO (no thread could be started). */
PVX_MUST_CHECK pvx_err dmn_previews_new(const struct dmn_previews_params *p, dmn_previews **out,
                                        struct pvx_diag *d);
void dmn_previews_free(dmn_previews **v);
/* Call after rec_frame_carve.  v may be NULL. */
void dmn_previews_offer(dmn_previews *v, const struct dmn_slot *s);
/* Fills the previews' part of a snapshot.  v may be NULL. */
void dmn_previews_state(dmn_previews *v, struct dmn_state *out);
#endif
