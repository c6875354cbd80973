/* player.h - the thread of a source that makes its frames itself (files:, take:, sim:), and its frame pool.
 *
 *     open    cap_player_init       the player is a member of the source's struct; its pool may come later
 *     start   cap_player_start      run(arg) in a thread of its own
 *             cap_player_wait_until, _get, _count, _event: by run()
 *     stop    cap_player_stop       wakes run() from all of these, and waits for it
 *     close   cap_player_fini       frames in use keep the pool's memory
 *
 * Threads: start, stop and fini from one thread at a time, the rest from any.  The source may guard its own state
 * with `lock` and `wake`.  A wait on `wake` must check `stop`. */
#ifndef CAP_PLAYER_H
#define CAP_PLAYER_H
#include <pthread.h>
#include <time.h>
#include "capture/source/bufpool.h"

struct cap_player {
    uint32_t camera;
    bool lossless;
    cap_bufpool *pool; /* owner: the player; NULL until the source makes it */
    struct cap_sink sink;
    clockid_t clock;
    pthread_mutex_t lock;
    pthread_cond_t wake; /* of that clock */
    bool stop;           /* under lock */
    bool running;        /* there is a thread to be joined */
    pthread_t thread;
};

/* clock: the clock of wait_until, CLOCK_MONOTONIC or CLOCK_REALTIME.  Uses camera and lossless of c. */
void cap_player_init(struct cap_player *p, const struct cap_source_config *c, clockid_t clock);
/* Makes the pool, of at least 4 frames.  Errors: as cap_bufpool_new. */
PVX_MUST_CHECK pvx_err cap_player_make_pool(struct cap_player *p, const struct cap_source_config *c,
                                            size_t bytes);
/* The thread's name is scheme and the camera's number. */
PVX_MUST_CHECK pvx_err cap_player_start(struct cap_player *p, const char *scheme,
                                        const struct cap_sink *sink, void *(*run)(void *arg),
                                        void *arg, struct pvx_diag *d);
void cap_player_stop(struct cap_player *p);
void cap_player_fini(struct cap_player *p);

bool cap_player_stopped(struct cap_player *p);
/* Wait until the clock shows `t` or until stop.  True = go on, false = stop. */
bool cap_player_wait_until(struct cap_player *p, int64_t t);
/* A frame of the pool.  Lossless: waits for one.  NULL: stopped, or no frame was free, which is counted. */
struct cap_frame *cap_player_get(struct cap_player *p);
void cap_player_count(struct cap_player *p, enum cap_count what, uint64_t n);
void cap_player_event(struct cap_player *p, enum cap_event ev);
#endif
