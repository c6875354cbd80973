/* aravis_int.h - what the files of the aravis: source share (private to them).
 *
 * Threads: the supervisor's (open, start, trigger, health, stop, close), Aravis' receiving thread
 * (aravis_stream.c), its heartbeat thread (control-lost), our slow loop (aravis_watch.c) and, for a
 * camera that does not answer any more, one that waits for Aravis to give it up (src_aravis.c).
 * Locks: `device` around every use of the camera's features, which Aravis does not guard; `lock`
 * around the rest that threads share.  `device` may be held for seconds when a camera is dead; nothing
 * takes it while holding another. */
#ifndef CAP_ARAVIS_INT_H
#define CAP_ARAVIS_INT_H
#include <arv.h>
#include <pthread.h>
#include <stdatomic.h>

#include "capture/gev/chunk.h"
#include "capture/gev/find.h"
#include "capture/gev/ids.h"
#include "capture/aravis_setup.h"
#include "capture/source/gate.h"
#include "capture/source/lend.h"
#include "capture/source/source.h"

struct aravis_buffers;

struct aravis_source {
    struct cap_source base;
    atomic_uint refs; /* the owner, and the signal of a lost camera while it is connected */
    struct cap_source_config c; /* strings are copies */
    char *uri, *name;
    ArvCamera *camera;
    struct aravis_layout layout;
    struct aravis_route route;
    cap_lend *lend;
    struct aravis_buffers *buffers; /* of lend */
    bool resend;
    struct cap_sink sink;
    ArvStream *stream;

    /* The stream's thread alone, while it runs: */
    struct aravis_ids ids;
    uint64_t unnumbered; /* incomplete frames since the last good one */
    bool stamps;         /* the camera stamps its frames */
    struct aravis_chunks chunks;

    pthread_mutex_t device;
    struct aravis_mode mode; /* as it was set; under `device` */

    pthread_mutex_t lock;
    pthread_cond_t wake; /* of the slow loop, CLOCK_MONOTONIC */
    struct cap_gate gate;
    gulong lost_handler;
    bool dead;           /* did not answer when it was stopped */
    bool watching, quit; /* the slow loop has a thread; it should end */
    pthread_t watch;
    struct cap_health health;
};

/* aravis_stream.c */
PVX_MUST_CHECK pvx_err aravis_make_buffers(struct aravis_source *s);
PVX_MUST_CHECK pvx_err aravis_begin_stream(struct aravis_source *s, struct pvx_diag *d);
void aravis_cut_stream(struct aravis_source *s); /* released frames no longer go back to it */
void aravis_end_stream(struct aravis_source *s); /* seconds, when the camera does not answer */

/* aravis_host.c: the calling thread gets its priority; is there room for what is asked?  A warning, not an
 * error, when not. */
void aravis_make_realtime(const struct cap_source_config *c);
void aravis_check_room(const struct cap_source_config *c, int asked);

/* aravis_watch.c: the slow loop. */
void aravis_watch_start(struct aravis_source *s);
void aravis_watch_quit(struct aravis_source *s); /* does not wait */
void aravis_watch_join(struct aravis_source *s);

/* src_aravis.c: to be opened anew: it is gone, or cannot be put right while it runs. */
void aravis_say_lost(struct aravis_source *s);
#endif
