/* publish.h - the live sink of the pipeline: volumes to ZeroMQ, and once a second the status message and
 * the start message for late subscribers.
 *
 * Ownership: the caller's struct, which must not be moved after open.  Threads: the last stage.  `lock` guards the
 * members that snapshots read; `subscribers` and `reset_latency` are for all threads. */
#ifndef DMN_PUBLISH_H
#define DMN_PUBLISH_H
#include <pthread.h>
#include <stdatomic.h>
#include "daemon/config/config.h"
#include "daemon/pipeline/events.h"
#include "daemon/pipeline/instant.h"
#include "daemon/pipeline/pipeline.h"
#include "daemon/pipeline/temperature.h"
#include "daemon/pipeline/triggers.h"
#include "proto/pub.h"

struct dmn_publish {
    pvp_pub *pub;
    const struct rec_rig *rig; /* borrowed from open on */
    const char *rig_text;   /* the rig as new subscribers get it; borrowed, for open; NULL: none */
    struct pvp_start start; /* the caller sets .session before open */
    atomic_size_t subscribers;
    atomic_int compress;              /* enum pvp_compress, from the next volume on */
    atomic_bool reset_latency;        /* the statistics start anew with the next volume */
    _Atomic(const char *) end_reason; /* NULL: the source has ended by itself */
    /* what the status message says */
    void (*snapshot)(void *ctx, struct dmn_state *out);
    void *ctx;
    dmn_triggers_run *triggers;   /* judge each volume; borrowed, or NULL */
    dmn_instant *instant;         /* may keep a volume; borrowed, or NULL */
    dmn_temperature *temperature; /* makes temperatures of some; borrowed, or NULL */

    pthread_mutex_t lock;
    struct pvx_hist latency;
    struct rec_frame_report report;
    struct dmn_votes votes;
    uint64_t last_set, bytes;
    int64_t last_exposure_ns;
    double sets_per_s;

    /* the stage's own */
    int64_t next_look_ns, next_status_ns, rate_t_ns;
    struct dmn_events events;
    uint64_t published, rate_n;
    struct dmn_state status;
    char status_json[DMN_STATE_JSON_MAX];
};

/* auth (borrowed) says which clients the endpoints with keys let in; NULL: no endpoint asks for a key.
 * Errors: PVX_EBUSY (endpoint in use), PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_publish_open(struct dmn_publish *p, const struct dmn_config *c,
                                        const struct rec_rig *rig, pvp_auth *auth,
                                        struct pvx_diag *d);
/* Compression as c says, from the next volume on.  Any thread. */
void dmn_publish_compress(struct dmn_publish *p, const struct dmn_config *c);
/* Closes it.  A struct of zeros is allowed. */
void dmn_publish_close(struct dmn_publish *p);
struct dmn_sink dmn_publish_sink(struct dmn_publish *p);
/* Fills the publisher's part of a snapshot. */
void dmn_publish_state(struct dmn_publish *p, struct dmn_state *out);
#endif
