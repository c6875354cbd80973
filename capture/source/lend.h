/* lend.h - frames around buffers that belong to a driver (mmap, DMA): zero copy.
 *
 * The driver fills its own n buffers.  The source takes a full one out of the driver's queue and lends its frame
 * to the consumer.  The release of the frame gives the buffer back to the driver, unless the source has been
 * stopped or closed meanwhile.  `spare` buffers always stay with the driver, because a driver without buffers
 * stops or worse.  A frame that would take one of them is refused.  The source then counts an underrun and gives
 * the buffer back at once.
 *
 *     open    cap_lend_new         a frame per buffer
 *     start   cap_lend_run(true)   requeue() is called for each buffer that is not lent
 *             cap_lend_out         driver thread: buffer i is full; NULL = refused
 *     stop    cap_lend_run(false)  when it returns, no requeue() is running or will be called
 *     close   cap_lend_close       destroy() when no frame is lent (now, or much later)
 *
 * Threads: all functions and frame releases from any thread.  Nothing is allocated after new. */
#ifndef CAP_LEND_H
#define CAP_LEND_H
#include "capture/source/source.h"

typedef struct cap_lend cap_lend;

struct cap_lend_ops {
    /* Give buffer `index` back to the driver.  Called under the lender's lock, only between run(true) and
     * run(false).  False = the driver refused it; cap_lend_retry tries again. */
    bool (*requeue)(void *ctx, unsigned index);
    void (*destroy)(void *ctx); /* unmap and free; no frame is lent any more */
    /* The source is closed, and buffer `index` will not be used again, while others are still lent.  May be NULL. */
    void (*unused)(void *ctx, unsigned index);
};

/* n (1..CAP_BUFFERS_MAX + spare) buffers, at least spare + 1.  ctx must live until destroy().
 * Errors: PVX_EINVAL, PVX_ENOMEM; destroy is then not called. */
PVX_MUST_CHECK pvx_err cap_lend_new(unsigned n, unsigned spare, uint32_t camera,
                                    const struct cap_lend_ops *ops, void *ctx, cap_lend **out);
void cap_lend_run(cap_lend *l, bool on);
/* The frame of buffer `index`, to be filled in (img, id, times) and pushed.  Its other fields are as in a new frame
 * of a pool (bufpool.h).  NULL: too few buffers would stay with the driver. */
struct cap_frame *cap_lend_out(cap_lend *l, unsigned index);
/* Give buffer `index` back to the driver without lending it. */
void cap_lend_back(cap_lend *l, unsigned index);
/* Offer the refused buffers to the driver again.  Returns how many it still refuses. */
unsigned cap_lend_retry(cap_lend *l);
unsigned cap_lend_n_out(cap_lend *l);
void cap_lend_close(cap_lend **l);
#endif
