/* bell.h - one thread sleeps until another rings.  Who rings takes no lock and waits for nobody; a ring
 * before the wait is not lost, several may be answered at once, and a wait may end without one: look.
 * What was written before the ring is seen after the wait that it ends. */
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
