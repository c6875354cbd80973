/* gate.h - guards a source's sink against a library's threads.  They may call the sink only between start and stop,
 * and report the loss of the camera only once.
 *
 *     start   cap_gate_open       before the first callback can come, or when it may go on
 *             cap_gate_enter      callback: true = the sink may be called until cap_gate_leave
 *             cap_gate_lost       callback, trigger: the camera is gone
 *     stop    cap_gate_shut       when it returns, no call of the sink is running or will begin
 *
 * A source with one thread of its own, which stop joins, needs no gate (player.h, v4l2/v4l2.c).
 * Threads: all functions from any thread; shut never between enter and leave. */
#ifndef CAP_GATE_H
#define CAP_GATE_H
#include <pthread.h>
#include "capture/source/source.h"

struct cap_gate {
    pthread_mutex_t lock;
    pthread_cond_t idle;
    bool open, lost;
    unsigned busy; /* between enter and leave */
};
void cap_gate_init(struct cap_gate *g);
void cap_gate_fini(struct cap_gate *g);

void cap_gate_open(struct cap_gate *g); /* the camera is there */
void cap_gate_shut(struct cap_gate *g);
bool cap_gate_enter(struct cap_gate *g);
void cap_gate_leave(struct cap_gate *g);
/* Mark the camera as lost.  Tell the sink if the gate is open and no loss was reported since it was opened. */
void cap_gate_lost(struct cap_gate *g, const struct cap_sink *sink, uint32_t camera);
bool cap_gate_is_lost(struct cap_gate *g); /* since the gate was opened */
#endif
