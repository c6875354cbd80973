/* pub.h - the publisher: one ZeroMQ PUB socket, used by one thread.
 *
 * PUB drops in silence for a subscriber that does not read; so every message carries a sequence
 * number that counts all messages of the session, and clients count gaps.  `start` is repeated every
 * second for late joiners.  Errors: PVX_EBUSY (port in use: says which), PVX_EINVAL (endpoint). */
#ifndef PVP_PUB_H
#define PVP_PUB_H
#include "proto/pvp.h"
typedef struct pvp_pub pvp_pub;
struct pvp_pub_params {
    const char *const *endpoints; /* "ipc:///run/pyrovox/volumes", "tcp://127.0.0.1:5555" */
    size_t n_endpoints;
    int send_hwm;                 /* messages kept per slow subscriber, default 8 */
    enum pvp_sample sample; enum pvp_compress comp;
};
PVX_MUST_CHECK pvx_err pvp_pub_new(const struct pvp_pub_params *p, const struct pvp_start *start,
                                   pvp_pub **out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_pub_volume(pvp_pub *p, const struct pvp_volume *v, uint32_t n,
                                      const int32_t *index, const float *value, int stride,
                                      size_t *bytes);
PVX_MUST_CHECK pvx_err pvp_pub_status(pvp_pub *p, const char *json);
void pvp_pub_tick(pvp_pub *p);  /* repeats start when a second has passed */
PVX_MUST_CHECK pvx_err pvp_pub_end(pvp_pub *p, const char *reason);
void pvp_pub_free(pvp_pub **p);
uint64_t pvp_pub_sequence(const pvp_pub *p); /* of the next message */
#endif
