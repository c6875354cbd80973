/* log.h - what shim.c writes and power.c reads. */
#ifndef TESTS_POWER_LOG_H
#define TESTS_POWER_LOG_H
#include <stdbool.h>
#include <stdint.h>

enum power_what {
    POWER_WRITE, /* `bytes` at `at`, which follow */
    POWER_SIZE,  /* the file's size is `at` */
    POWER_SYNC,  /* what was written up to here is on the disk at this thread's next POWER_SYNCED */
    POWER_SYNCED,
};
struct power_op {
    uint32_t what, thread; /* enum power_what */
    uint64_t at, bytes;
};
#endif
