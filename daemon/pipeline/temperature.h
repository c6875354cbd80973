/* temperature.h - the temperature of soot, live, on an endpoint of its own (publish.temperature).
 *
 * Volumes of one channel, unit K, box basis, each directly after its error bars: where a voxel has no temperature
 * (recon/spectral/soot.h) the value is 0.  The covariance of its emission is
 *     N_pq = sum_k d_kp d_kq for p != q,  N_pp = sd_p^2
 * by the set's error bars and modes d_k; bars made live have no modes, so that N_pq = 0.
 *
 * A thread of the lowest priority (nice 19) asks for a set when it has none, and only while there are subscribers.  The
 * publish stage then copies the emission and N of the set that it has just sent; otherwise it does nothing.  So a volume
 * never waits, the newest set wins, and those left out are counted.
 * Memory: address space for the largest set, taken at new.  Nothing is allocated after open (libzmq: its messages).
 * Threads: new, open, free: one; offer: the publish stage; compress, state: any. */
#ifndef DMN_TEMPERATURE_H
#define DMN_TEMPERATURE_H
#include "daemon/config/config.h"
#include "daemon/pipeline/pipeline.h"
#include "proto/auth.h"
#include "proto/pvp.h"

typedef struct dmn_temperature dmn_temperature;

/* *out NULL: publish.temperature is empty.  bars: whether sets have error bars.  PVX_EINVAL: the rig has no `spectral:`,
 * or one that says no temperature; one channel; no bars.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_temperature_new(const struct dmn_config *c, const struct rec_rig *rig,
                                           bool bars, dmn_temperature **out, struct pvx_diag *d);
struct dmn_temperature_params { /* borrowed; rig_text is copied */
    const struct dmn_config *config;
    pvp_auth *auth;                /* as for the volumes; NULL: no keys */
    const struct pvp_start *start; /* of the volumes */
    const char *rig_text;
};
/* Begins to publish.  t may be NULL.  Errors: PVX_EBUSY (endpoint in use), PVX_EINVAL, PVX_ENOMEM, PVX_EIO (no
 * thread). */
PVX_MUST_CHECK pvx_err dmn_temperature_open(dmn_temperature *t,
                                            const struct dmn_temperature_params *p,
                                            struct pvx_diag *d);
void dmn_temperature_free(dmn_temperature **t);
/* Call for each volume after it was sent; m as it was sent.  t may be NULL. */
void dmn_temperature_offer(dmn_temperature *t, const struct dmn_slot *s,
                           const struct pvp_volume *m);
/* Compression as c says, from the next volume on.  t may be NULL. */
void dmn_temperature_compress(dmn_temperature *t, const struct dmn_config *c);
/* Fills the temperatures' part of a snapshot.  t may be NULL. */
void dmn_temperature_state(dmn_temperature *t, struct dmn_state *out);
#endif
