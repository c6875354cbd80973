/* sub.h - C client: subscribe to a daemon's volumes (libpyrovox-client).
 *
 * Counts gaps in the sequence (messages that this subscriber lost), survives restarts of the daemon
 * (a new session resets the count), and waits for `start` before it returns volumes.  The daemon need not
 * run yet.
 * Threads: one at a time. */
#ifndef PVP_SUB_H
#define PVP_SUB_H
#include "proto/pvp.h"
#ifdef __cplusplus
extern "C" {
#endif
typedef struct pvp_sub pvp_sub;
#define PVP_SUB_MEMORY ((size_t)1 << 30) /* 645^3 voxels of one colour, 447^3 of three */
struct pvp_sub_options {
    size_t memory; /* largest volume as floats, in bytes, and half of the largest message; 0:
                    * PVP_SUB_MEMORY */
    bool newest;   /* of consecutive volumes only the last is returned; other messages all are */
    const char
        *key; /* a .key file of `pyrovox keygen`, for a daemon that asks for one; NULL: none */
};
struct pvp_sub_stats {
    uint64_t received;  /* well-formed messages, unknown types included */
    uint64_t lost;      /* missing in the sequence, since the first message of each session */
    uint64_t malformed; /* not decodable: foreign, damaged, of a later major version, or a volume
                         * with another grid than its session's start */
    uint64_t sessions;  /* runs of the daemon seen */
    uint64_t skipped;   /* volumes passed over because a newer one was there (newest) */
};
/* NULL options: all defaults.  PVX_EINVAL: not an endpoint.  PVX_ENOENT, PVX_EPERM, PVX_EFORMAT: the key. */
PVX_MUST_CHECK pvx_err pvp_sub_new(const char *endpoint, const struct pvp_sub_options *o,
                                   pvp_sub **out, struct pvx_diag *d);
/* Next message of a known type; the bytes are borrowed until the next call.  start, status, rig, event, preview and
 * end are always returned, volumes once the session's start was seen.  timeout_ns < 0: for ever.
 * A returned volume has the start's grid, so pvp_grid_count of that is enough for all.
 * PVX_ETIMEDOUT: nothing came in time, or a signal handler ran.  PVX_ERANGE: the daemon's volumes need more memory
 * than the options allow; those of its next session may not.  PVX_EPERM: the daemon refused this client, d has the
 * reason: no key, an unlisted key, another daemon's key.  This is returned once each time, and further calls wait. */
PVX_MUST_CHECK pvx_err pvp_sub_next(pvp_sub *s, int64_t timeout_ns, struct pvp_header *h,
                                    const void **msg, size_t *len, struct pvx_diag *d);
/* The latest start message, NULL before the first. */
const struct pvp_start *pvp_sub_start(const pvp_sub *s);
/* The session's rig.yaml, zero-terminated, and the start's rig_hash that it has; NULL until its message
 * arrives, soon after the start, from daemons of protocol 1.1 on.  Borrowed until the next pvp_sub_next. */
const char *pvp_sub_rig(const pvp_sub *s, uint64_t *rig_hash);
/* Error bars of the volume that pvp_sub_next returned last: a message for pvp_decode_bars, whose samples are for the
 * volume's bricks.  NULL: it has none.  pvp_sub_next does not return these messages.  Borrowed until its next call. */
const void *pvp_sub_bars(const pvp_sub *s, size_t *len);
/* For poll, select and event loops; readable = something may have come.  It is edge-triggered, as ZMQ_FD is: call
 * pvp_sub_next with timeout 0 until it says PVX_ETIMEDOUT before waiting, the first time too.  -1: none. */
int pvp_sub_fd(const pvp_sub *s);
void pvp_sub_stats(const pvp_sub *s, struct pvp_sub_stats *out);
void pvp_sub_free(pvp_sub **s);
#ifdef __cplusplus
}
#endif
#endif
