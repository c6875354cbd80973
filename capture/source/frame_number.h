/* frame_number.h - widens a driver's 32-bit frame counter to frame numbers that do not wrap (V4L2, libcamera).
 * Threads: one per stream. */
#ifndef CAP_FRAME_NUMBER_H
#define CAP_FRAME_NUMBER_H
#include <stdbool.h>
#include <stdint.h>

/* All 0 before the first frame of a stream. */
struct cap_numbering {
    bool numbered; /* a good frame was seen */
    uint32_t last; /* counter of the last good frame */
    uint64_t id;   /* and its number */
    uint64_t bad;  /* frames since then with another count: they leave no gap */
};
/* Number of the next good frame.  *gap: frames missing before it that are not counted yet.  If the counter stands
 * still or goes back, the number goes on by one. */
static inline uint64_t cap_numbering_next(struct cap_numbering *s, uint32_t counter, uint64_t *gap)
{
    uint32_t step = counter - s->last;
    uint64_t missing = s->numbered && step > 0 && step < 1u << 31 ? step - 1 : 0;
    s->id = s->numbered ? s->id + 1 + missing : counter;
    *gap = missing > s->bad ? missing - s->bad : 0;
    s->numbered = true;
    s->last = counter;
    s->bad = 0;
    return s->id;
}
#endif
