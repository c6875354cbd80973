/* patience.h - the one limit of every wait: a wait is for an event, and the limit only ends what hangs. */
#ifndef TESTS_PATIENCE_H
#define TESTS_PATIENCE_H
#include "base/clock.h"

#define PATIENCE_NS (600 * PVX_NS_PER_S)

/* The statement behind it again and again until the condition holds, or until patience ends. */
#define UNTIL(condition) \
    for (int64_t end_ = pvx_now_mono() + PATIENCE_NS; !(condition) && pvx_now_mono() < end_;)
#endif
