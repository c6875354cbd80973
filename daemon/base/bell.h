/* bell.h - one thread sleeps until another rings.  Ringing takes no lock and never waits.  A ring before the wait
 * is not lost.  One wait may answer several rings, and may end without one, so check the condition again.
 * Writes before the ring are visible after the wait that it ends. */
#ifndef PVX_BELL_H
#define PVX_BELL_H
#include <semaphore.h>
#include <stdint.h>

struct pvx_bell {
    sem_t rings;
};
void pvx_bell_init(struct pvx_bell *b);
void pvx_bell_fini(struct pvx_bell *b);
void pvx_bell_ring(struct pvx_bell *b); /* any thread */
/* One thread at a time.  Until `mono_ns` at most; INT64_MAX = for ever. */
void pvx_bell_wait(struct pvx_bell *b, int64_t mono_ns);

#endif
