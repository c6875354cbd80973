#include "base/bell.h"

#include <time.h>

#include "base/clock.h"

void pvx_bell_init(struct pvx_bell *b)
{
    sem_init(&b->rings, 0, 0);
}

void pvx_bell_fini(struct pvx_bell *b)
{
    sem_destroy(&b->rings);
}

void pvx_bell_ring(struct pvx_bell *b)
{
    sem_post(&b->rings);
}

void pvx_bell_wait(struct pvx_bell *b, int64_t mono_ns)
{
    struct timespec ts = {.tv_sec = mono_ns / PVX_NS_PER_S, .tv_nsec = mono_ns % PVX_NS_PER_S};
    sem_clockwait(&b->rings, CLOCK_MONOTONIC, &ts);
    while (sem_trywait(&b->rings) == 0)
        ;
}
