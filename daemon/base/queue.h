/* queue.h - bounded hand-over of pointers between threads: many producers, one consumer.
 *
 * Live: pvx_queue_put drops the OLDEST item when full and gives it back, so that the caller frees
 * and counts it.  Replay: pvx_queue_put_wait blocks until there is room (back-pressure, no loss).
 * Invariant (tested): put == popped + displaced + still inside. */
#ifndef PVX_QUEUE_H
#define PVX_QUEUE_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

typedef struct pvx_queue pvx_queue;

PVX_MUST_CHECK pvx_err pvx_queue_new(size_t capacity, pvx_queue **out);
/* Items still inside are not freed: drain first. */
void pvx_queue_free(pvx_queue **q);

/* Put `item` (not NULL).  *displaced = the dropped item (the oldest), or `item` itself when the
 * queue is closed, or NULL.  Never blocks. */
void pvx_queue_put(pvx_queue *q, void *item, void **displaced);
/* Put, waiting for room.  PVX_ECLOSED: item stays with the caller. */
PVX_MUST_CHECK pvx_err pvx_queue_put_wait(pvx_queue *q, void *item);
/* Take the oldest, waiting at most `timeout_ns` (<0: for ever; 0: poll).
 * PVX_ETIMEDOUT, or PVX_ECLOSED when closed and empty; *item is then NULL. */
PVX_MUST_CHECK pvx_err pvx_queue_pop(pvx_queue *q, int64_t timeout_ns, void **item);
/* No more puts; waiting threads wake; items inside can still be popped. */
void pvx_queue_close(pvx_queue *q);
size_t pvx_queue_length(pvx_queue *q);

#endif
