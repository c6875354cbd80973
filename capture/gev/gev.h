/* gev.h - shared by the files of the aravis: source (private to them).
 *
 * Threads: the supervisor's (open, start, trigger, health, stop, close), Aravis' receiving thread (stream.c) and our
 * slow loop (watch.c).  For a camera that no longer answers, one more thread waits until Aravis gives it up (gev.c).
 * Aravis' heartbeat thread never calls us (last.h).
 * Locks: `device` around every use of the camera's features, which Aravis does not guard.  `lock` around the other
 * state that threads share.  A thread may hold `device` for seconds when a camera is dead, so no thread takes it
 * while it holds another lock. */
#ifndef CAP_ARAVIS_INT_H
#define CAP_ARAVIS_INT_H
#include <arv.h>
#include <pthread.h>

#include "capture/gev/chunk.h"
#include "capture/gev/find.h"
#include "capture/gev/ids.h"
#include "capture/gev/setup.h"
#include "capture/gev/trigger.h"
#include "capture/source/gate.h"
#include "capture/source/lend.h"
#include "capture/source/source.h"

struct aravis_buffers;

struct aravis_source {
    struct cap_source base;
    struct cap_source_config c; /* strings are copies */
    char *uri, *name;
    ArvCamera *camera;
    struct aravis_layout layout;
    struct aravis_route route;
    char serial[CAP_SERIAL_MAX];
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
    bool dead;           /* did not answer when it was stopped */
    bool watching, quit; /* the slow loop has a thread; it should end */
    pthread_t watch;
    struct cap_health health;
};

/* stream.c */
PVX_MUST_CHECK pvx_err aravis_make_buffers(struct aravis_source *s);
PVX_MUST_CHECK pvx_err aravis_begin_stream(struct aravis_source *s, struct pvx_diag *d);
void aravis_cut_stream(struct aravis_source *s); /* released frames no longer go back to it */
void aravis_end_stream(struct aravis_source *s); /* seconds, when the camera does not answer */

/* watch.c: the slow loop. */
void aravis_watch_start(struct aravis_source *s);
void aravis_watch_quit(struct aravis_source *s); /* does not wait */
void aravis_watch_join(struct aravis_source *s);

/* Report the camera as lost, so that it is opened again: it is gone, or cannot be corrected while it runs. */
static inline void aravis_say_lost(struct aravis_source *s)
{
    cap_gate_lost(&s->gate, &s->sink, s->c.camera);
}
#endif
