#include "base/board.h"

#include <assert.h>
#include <sched.h>
#include <string.h>

void pvx_board_write(struct pvx_board *b, const void *value, size_t bytes)
{
    uint64_t w[PVX_BOARD_BYTES / 8] = {0};
    assert(bytes <= sizeof w);
    memcpy(w, value, bytes);
    unsigned turn = atomic_load_explicit(&b->turn, memory_order_relaxed);
    atomic_store_explicit(&b->turn, turn + 1, memory_order_relaxed);
    for (size_t i = 0; i < (bytes + 7) / 8; i++)
        atomic_store_explicit(&b->word[i], w[i], memory_order_release);
    atomic_store_explicit(&b->turn, turn + 2, memory_order_release);
}

void pvx_board_read(const struct pvx_board *b, void *value, size_t bytes)
{
    uint64_t w[PVX_BOARD_BYTES / 8];
    assert(bytes <= sizeof w);
    for (;; sched_yield()) {
        unsigned turn = atomic_load_explicit(&b->turn, memory_order_acquire);
        for (size_t i = 0; i < (bytes + 7) / 8; i++)
            w[i] = atomic_load_explicit(&b->word[i], memory_order_acquire);
        if (turn % 2 == 0 && turn == atomic_load_explicit(&b->turn, memory_order_relaxed))
            break;
    }
    memcpy(value, w, bytes);
}
