#include "base/ring.h"

#include <stdatomic.h>
#include <stdlib.h>

#include "base/mem.h"

struct pvx_ring {
    size_t cap;
    _Alignas(PVX_ALIGN) atomic_size_t head; /* each on a cache line of its own */
    _Alignas(PVX_ALIGN) atomic_size_t tail;
    _Alignas(PVX_ALIGN) void *_Atomic item[];
};

pvx_err pvx_ring_new(size_t capacity, pvx_ring **out)
{
    *out = NULL;
    if (capacity == 0 || capacity > 1u << 20)
        return PVX_EINVAL;
    pvx_ring *r = pvx_calloc(1, sizeof *r + capacity * sizeof r->item[0]);
    PVX_NEED(r);
    r->cap = capacity;
    *out = r;
    return PVX_OK;
}

void pvx_ring_free(pvx_ring **r)
{
    PVX_FREE(*r);
}

/* The item at `head`; NULL: another thread was faster. */
static void *pop_at(pvx_ring *r, size_t head)
{
    void *item = atomic_load_explicit(&r->item[head % r->cap], memory_order_relaxed);
    return atomic_compare_exchange_strong_explicit(&r->head, &head, head + 1, memory_order_acq_rel,
                                                   memory_order_acquire)
               ? item
               : NULL;
}

static void ring_add(pvx_ring *r, size_t tail, void *item)
{
    atomic_store_explicit(&r->item[tail % r->cap], item, memory_order_relaxed);
    atomic_store_explicit(&r->tail, tail + 1, memory_order_release);
}

void *pvx_ring_push(pvx_ring *r, void *item)
{
    size_t tail = atomic_load_explicit(&r->tail, memory_order_relaxed);
    size_t head = atomic_load_explicit(&r->head, memory_order_acquire);
    void *gone = tail - head == r->cap ? pop_at(r, head) : NULL;
    ring_add(r, tail, item);
    return gone;
}

bool pvx_ring_put(pvx_ring *r, void *item)
{
    size_t tail = atomic_load_explicit(&r->tail, memory_order_relaxed);
    if (tail - atomic_load_explicit(&r->head, memory_order_acquire) == r->cap)
        return false;
    ring_add(r, tail, item);
    return true;
}

void *pvx_ring_pop(pvx_ring *r)
{
    for (;;) {
        size_t head = atomic_load_explicit(&r->head, memory_order_acquire);
        if (head == atomic_load_explicit(&r->tail, memory_order_acquire))
            return NULL;
        void *item = pop_at(r, head);
        if (item != NULL)
            return item;
    }
}

size_t pvx_ring_length(const pvx_ring *r)
{
    size_t head = atomic_load_explicit(&r->head, memory_order_acquire);
    return atomic_load_explicit(&r->tail, memory_order_acquire) - head;
}
