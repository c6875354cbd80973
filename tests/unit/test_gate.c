/* test_gate.c - no call of the sink after stop, and "lost" once a run, with callbacks from many threads. */
#include "../t.h"

#include <pthread.h>
#include <stdatomic.h>

#include "base/clock.h"
#include "capture/source/gate.h"
#include "tests/lib/patience.h"

#define THREADS 4
#define RUNS    200

static struct cap_gate gate;
static atomic_int told, inside, after_stop, entered;
static atomic_bool may_be_called, over;

static void event(void *ctx, uint32_t camera, enum cap_event ev)
{
    (void)ctx;
    atomic_fetch_add(&inside, 1);
    if (!atomic_load(&may_be_called))
        atomic_fetch_add(&after_stop, 1);
    if (camera == 5 && ev == CAP_EV_LOST)
        atomic_fetch_add(&told, 1);
    atomic_fetch_sub(&inside, 1);
}
static const struct cap_sink sink = {.event = event};

T_CASE(is_told_once_a_run)
{
    told = 0;
    may_be_called = true;
    cap_gate_init(&gate);
    T_OK(!cap_gate_enter(&gate)); /* not started */
    cap_gate_lost(&gate, &sink, 5);
    T_EQ_I(told, 0);
    T_OK(cap_gate_is_lost(&gate));
    for (int run = 1; run <= 3; run++) {
        cap_gate_open(&gate);
        T_OK(!cap_gate_is_lost(&gate)); /* of this run */
        T_OK(cap_gate_enter(&gate));
        cap_gate_lost(&gate, &sink, 5); /* from within a callback */
        cap_gate_leave(&gate);
        cap_gate_lost(&gate, &sink, 5);
        T_EQ_I(told, run);
        cap_gate_shut(&gate);
        T_OK(cap_gate_is_lost(&gate)); /* still known: stop asks */
        T_OK(!cap_gate_enter(&gate));
        cap_gate_lost(&gate, &sink, 5);
        T_EQ_I(told, run);
    }
    cap_gate_fini(&gate);
}

static void *callbacks(void *arg)
{
    (void)arg;
    while (!atomic_load(&over)) {
        if (cap_gate_enter(&gate)) {
            atomic_fetch_add(&inside, 1);
            if (!atomic_load(&may_be_called))
                atomic_fetch_add(&after_stop, 1);
            atomic_fetch_add(&entered, 1);
            atomic_fetch_sub(&inside, 1);
            cap_gate_leave(&gate);
        }
        cap_gate_lost(&gate, &sink, 5);
    }
    return NULL;
}

T_CASE(nothing_comes_after_stop)
{
    pthread_t t[THREADS];
    told = inside = after_stop = entered = 0;
    over = may_be_called = false;
    cap_gate_init(&gate);
    for (int i = 0; i < THREADS; i++)
        T_EQ_I(pthread_create(&t[i], NULL, callbacks, NULL), 0);
    for (int run = 1; run <= RUNS; run++) {
        may_be_called = true;
        int before = entered;
        cap_gate_open(&gate);
        for (int64_t until = pvx_now_mono() + PATIENCE_NS;
             (atomic_load(&entered) == before || atomic_load(&told) < run) &&
             pvx_now_mono() < until;)
            pvx_sleep_until_mono(pvx_now_mono() + 10000);
        cap_gate_shut(&gate);
        may_be_called = false;
        T_EQ_I(inside, 0);
        T_EQ_I(told, run);
    }
    over = true;
    for (int i = 0; i < THREADS; i++)
        pthread_join(t[i], NULL);
    T_EQ_I(after_stop, 0);
    cap_gate_fini(&gate);
}
