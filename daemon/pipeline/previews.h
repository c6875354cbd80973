/* previews.h - what the cameras see, for a page or a person: small JPEGs and silhouettes on an endpoint of their own.
 *
 * A thread of the lowest priority (nice 19) asks for a set at most ten times a second, and only while somebody
 * subscribes; the carve stage then copies what is shown, at most 320 by 320 pixels and the silhouette of each camera,
 * and otherwise does nothing.  Coding and sending is the thread's.  Only the newest is ever sent; who does not keep up
 * misses some.  Pictures are of the binned pixels, every so many-th, with the sRGB curve; full scale is white.
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
/* *out NULL: there are none to be (publish.previews: off, or no place for them beside the volumes).
 * Errors: PVX_EBUSY (endpoint in use), PVX_EINVAL, PVX_ENOMEM, PVX_EIO (no thread to be had). */
PVX_MUST_CHECK pvx_err dmn_previews_new(const struct dmn_previews_params *p, dmn_previews **out,
                                        struct pvx_diag *d);
void dmn_previews_free(dmn_previews **v);
/* After rec_frame_carve.  NULL is fine. */
void dmn_previews_offer(dmn_previews *v, const struct dmn_slot *s);
/* Its part of a snapshot. */
void dmn_previews_state(dmn_previews *v, struct dmn_state *out);
#endif
