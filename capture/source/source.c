#include "capture/source/source.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>

#include "base/log.h"

#define ROW(number, ...) [number] = {__VA_ARGS__},
const struct cap_count_def cap_count_defs[CAP_N_COUNT] = {CAP_COUNTS(ROW)};

const struct cap_health cap_health_unknown = {
    .temperature_c = NAN, .ptp_offset_ns = NAN, .link_mbps = NAN, .clock = {.bound_ns = -1}};

void cap_frame_release(struct cap_frame *f)
{
    if (f != NULL)
        f->release(f);
}

void cap_source_lock(const struct cap_source_config *c, const void *mem, size_t bytes)
{
    if (c->held == 0 || mlock(mem, bytes) == 0)
        return;
    LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "not_locked", .camera = c->name),
              "camera %s: its %.0f MB of frames may be swapped out: %s; raise the limit of locked "
              "memory (`ulimit -l`, systemd's LimitMEMLOCK=)",
              c->name, (double)bytes * 1e-6, strerror(errno));
}
