/* ring.h - bounded hand-over of pointers from one thread to another, without a lock.  The producer never waits, even
 * if the consumer was interrupted in the middle of a pop.
 *
 *     tail    written by the producer; released after the slot is filled, so a reader of it also sees the slot
 *     head    moved by compare-exchange by the thread that takes the oldest item: the consumer, or the producer
 *             that needs its place.  The exchange acquires and releases: the slot was read before its place is
 *             seen to be free.
 * Both only grow, so an unchanged head means the same item.
 * Live: pvx_ring_push drops the OLDEST item when full and returns it, so that the caller frees and counts it.
 * Lossless: pvx_ring_put returns false when full.
 * Invariant (tested): pushed == popped + displaced + still inside.
 * Threads: push and put from one at a time, pop and length from any.  Allocates nothing after new. */
#ifndef PVX_RING_H
#define PVX_RING_H
#include <stdbool.h>
#include <stddef.h>
#include "base/err.h"

typedef struct pvx_ring pvx_ring;

/* Errors: PVX_EINVAL (capacity 1 .. 2^20), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err pvx_ring_new(size_t capacity, pvx_ring **out);
/* Items still inside are not freed: drain first. */
void pvx_ring_free(pvx_ring **r);
/* Adds `item` (not NULL).  Returns the item that was dropped for it, or NULL. */
void *pvx_ring_push(pvx_ring *r, void *item);
/* Adds `item`.  False: full, the item stays with the caller. */
bool pvx_ring_put(pvx_ring *r, void *item);
/* Removes and returns the oldest item, or NULL. */
void *pvx_ring_pop(pvx_ring *r);
/* The number of items at some moment of the call. */
size_t pvx_ring_length(const pvx_ring *r);

#endif
