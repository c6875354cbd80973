/* syncwatch_int.h - what syncwatch.c and syncnumber.c share (private to them). */
#ifndef CAP_SYNCWATCH_INT_H
#define CAP_SYNCWATCH_INT_H
#include "capture/sync/syncwatch.h"

#define CAP_SYNC_ROUND_OFF 0.25 /* of an interval, from a multiple of the period */

/* Count it, and say what is wrong. */
void cap_sync_found(struct cap_syncwatch *w, uint32_t c, enum cap_count what, uint64_t n,
                    const char *text);

/* Numbers are what a camera says, all 64 bits of them: they wrap, and so does what is made of them. */
static inline int64_t cap_sync_plus(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a + (uint64_t)b);
}

static inline int64_t cap_sync_minus(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a - (uint64_t)b);
}

#endif
