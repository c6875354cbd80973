/* board.h - a small value that one thread writes and any thread reads as a whole.  The writer never waits.  A reader
 * reads again if the value was written meanwhile (H.-J. Boehm, MSPC 2012: sequence locks).
 *
 *     turn    odd while the words change
 * The words are stored with release and loaded with acquire, so a reader of a new word sees that the turn is odd,
 * or has changed.  All zero is a board of zeros. */
#ifndef PVX_BOARD_H
#define PVX_BOARD_H
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#define PVX_BOARD_BYTES 256

struct pvx_board {
    atomic_uint turn;
    _Atomic uint64_t word[PVX_BOARD_BYTES / 8];
};
/* Writes the first `bytes` <= PVX_BOARD_BYTES of it.  One thread at a time. */
void pvx_board_write(struct pvx_board *b, const void *value, size_t bytes);
/* Any thread. */
void pvx_board_read(const struct pvx_board *b, void *value, size_t bytes);

#endif
