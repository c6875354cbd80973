/* sub.h - C client: subscribe to a daemon's volumes (libpyrovox-client).
 *
 * Counts gaps in the sequence (= messages this subscriber lost), survives restarts of the daemon
 * (a new session resets the count), waits for `start` before it gives volumes. */
#ifndef PVP_SUB_H
#define PVP_SUB_H
#include "proto/pvp.h"
typedef struct pvp_sub pvp_sub;
struct pvp_sub_stats { uint64_t received, lost, malformed, sessions; };
PVX_MUST_CHECK pvx_err pvp_sub_new(const char *endpoint, pvp_sub **out, struct pvx_diag *d);
/* Next message: type and borrowed bytes until the next call.  PVX_ETIMEDOUT. */
PVX_MUST_CHECK pvx_err pvp_sub_next(pvp_sub *s, int64_t timeout_ns, struct pvp_header *h,
                                    const void **msg, size_t *len);
/* The latest start message, NULL before the first. */
const struct pvp_start *pvp_sub_start(const pvp_sub *s);
void pvp_sub_stats(const pvp_sub *s, struct pvp_sub_stats *out);
void pvp_sub_free(pvp_sub **s);
#endif
