/* pub.h - the publisher: a ZeroMQ XPUB socket (PUB that counts its subscribers), and a second one for endpoints that
 * need keys (auth.h).
 *
 * PUB drops messages silently for a subscriber that does not read.  So every message carries a sequence number that
 * counts all messages of the session, and clients count gaps.  `start` is repeated every second.  A new subscriber
 * also gets it at once.  `rig` follows before the first volume, and is sent at most once a second beside volumes.
 * Sending never blocks.  A subscriber that does not read costs at most send_hwm messages of memory.  The publisher
 * allocates nothing per message (libzmq copies each).
 * Threads: one at a time, not necessarily its creator. */
#ifndef PVP_PUB_H
#define PVP_PUB_H
#include "proto/auth.h"
#include "proto/pvp.h"
typedef struct pvp_pub pvp_pub;
struct pvp_pub_params {
    const char *const *endpoints; /* "ipc:///run/pyrovox/volumes", "tcp://127.0.0.1:5555" */
    size_t n_endpoints;
    const char *const *guarded; /* endpoints for listed keys only */
    size_t n_guarded;           /* with any, auth is needed; borrowed */
    pvp_auth *auth;
    int send_hwm; /* messages kept per slow subscriber, 0 = 8 */
    enum pvp_sample sample;
    enum pvp_compress comp;
    const char *rig; /* the text of `rig` messages, copied; NULL: none are sent */
    bool lossless;   /* wait for a slow subscriber, up to PVP_PUB_PATIENCE_S per message */
};
#define PVP_PUB_PATIENCE_S 5
/* Binds all endpoints and sends the first start.  Errors, diag filled: PVX_EBUSY (an endpoint is in
 * use: diag names it and the remedy), PVX_EINVAL (not an endpoint, grid), PVX_ENOENT, PVX_EPERM
 * (folder of an ipc:// endpoint), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err pvp_pub_new(const struct pvp_pub_params *p, const struct pvp_start *start,
                                   pvp_pub **out, struct pvx_diag *d);
/* As pvp_encode_volume; the session is that of the start; v's is ignored.  *bytes = size of the
 * message, may be NULL.  Repeats start first when it is due. */
PVX_MUST_CHECK pvx_err pvp_pub_volume(pvp_pub *p, const struct pvp_volume *v,
                                      const struct pvp_voxels *x, size_t *bytes);
/* Error bars of the volume that is published next, as pvp_encode_bars. */
PVX_MUST_CHECK pvx_err pvp_pub_bars(pvp_pub *p, const struct pvp_volume *v, uint32_t doubt,
                                    const struct pvp_voxels *sd, size_t *bytes);
/* Compression from the next volume on. */
void pvp_pub_compress(pvp_pub *p, enum pvp_compress comp);
/* A message of another type.  `what`: the text (const char *) of PVP_STATUS, PVP_EVENT and PVP_END, whose reason is
 * cut to 63 bytes; the struct pvp_preview of PVP_PREVIEW.  The session is the start's.
 * Errors: as the type's pvp_encode_*. */
PVX_MUST_CHECK pvx_err pvp_pub_say(pvp_pub *p, enum pvp_type type, const void *what);
void pvp_pub_tick(pvp_pub *p); /* repeats start when a second has passed */
/* Subscriptions that were open at the last tick.  All of them have been sent `start`. */
size_t pvp_pub_subscribers(const pvp_pub *p);
/* Waits at most a quarter of a second (lossless: a minute) for messages that are still being sent. */
void pvp_pub_free(pvp_pub **p);
uint64_t pvp_pub_sequence(const pvp_pub *p); /* of the next message */
#endif
