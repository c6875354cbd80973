/* syncwatch_int.h - shared by syncwatch.c and syncnumber.c (private to them). */
#ifndef CAP_SYNCWATCH_INT_H
#define CAP_SYNCWATCH_INT_H
#include "capture/sync/syncwatch.h"

#define CAP_SYNC_ROUND_OFF 0.25 /* periods: largest distance of an interval from a multiple */

/* Count the fault n times, and report the text. */
void cap_sync_found(struct cap_syncwatch *w, uint32_t c, enum cap_count what, uint64_t n,
                    const char *text);

/* Frame numbers come from the camera and may have any 64-bit value.  So their sums and differences wrap. */
static inline int64_t cap_sync_plus(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a + (uint64_t)b);
}

static inline int64_t cap_sync_minus(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a - (uint64_t)b);
}

#endif
