/* wait.c - waiting for a device that may never answer, and losing it.
 *
 * clFinish and clWaitForEvents return when the driver likes, which may be never.  So the state of an event is asked
 * again and again: at first without a pause, then with pauses that grow.
 * That makes nothing visible (clGetEventInfo: "is not a synchronization point").  clWaitForEvents does, and returns at
 * once for an event that is complete. */
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <time.h>

#include "base/clock.h"
#include "recon/opencl/impl.h"

#define SPIN_NS  50000
#define PAUSE_NS 10000 /* the first one */
#define MOST_NS  100000

static _Atomic bool hangs; /* some device */

bool rec_cl_hangs(void)
{
    return atomic_load(&hangs);
}

void rec_cl_lose(rec_cl *cl, const char *fmt, ...)
{
    int not_yet = 0;
    if (!atomic_compare_exchange_strong(&cl->lost, &not_yet, 1))
        return;
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(cl->why, sizeof cl->why, fmt, ap);
    va_end(ap);
    atomic_store(&cl->lost, 2);
}

const char *rec_cl_lost(const rec_cl *cl)
{
    return atomic_load(&cl->lost) == 2 ? cl->why : NULL;
}

bool rec_cl_ok(rec_cl *cl, cl_int e, const char *what)
{
    if (e != CL_SUCCESS)
        rec_cl_lose(cl, "%s: %s", what, rec_cl_error(e));
    return e == CL_SUCCESS;
}

cl_int rec_cl_settle(rec_cl *cl, cl_event event)
{
    const struct rec_cl_library *lib = cl->lib;
    int64_t begin = pvx_now_mono(), pause = PAUSE_NS;
    for (;;) {
        if (rec_cl_lost(cl) != NULL)
            return CL_SUCCESS;
        cl_int state = CL_QUEUED;
        cl_int e =
            lib->GetEventInfo(event, CL_EVENT_COMMAND_EXECUTION_STATUS, sizeof state, &state, NULL);
        if (!rec_cl_ok(cl, e, "clGetEventInfo"))
            return CL_SUCCESS;
        if (state == CL_COMPLETE)
            (void)rec_cl_ok(cl, lib->WaitForEvents(1, &event), "clWaitForEvents");
        if (state <= CL_COMPLETE) {
            (void)rec_cl_ok(cl, lib->ReleaseEvent(event), "clReleaseEvent");
            return state;
        }
        int64_t now = pvx_now_mono();
        if ((double)(now - begin) > cl->patience * 1e9) {
            atomic_store(&hangs, true);
            rec_cl_lose(cl, "it did not answer for %g s", cl->patience);
            return CL_SUCCESS;
        }
        if (now - begin < SPIN_NS) {
            sched_yield();
            continue;
        }
        nanosleep(&(struct timespec){0, pause}, NULL);
        pause = pause * 3 / 2 < MOST_NS ? pause * 3 / 2 : MOST_NS;
    }
}

bool rec_cl_await(rec_cl *cl, cl_event event)
{
    return rec_cl_ok(cl, rec_cl_settle(cl, event), "its work failed") && rec_cl_lost(cl) == NULL;
}
