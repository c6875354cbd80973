#include "capture/source/source.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>

#include "base/log.h"
#include "base/mem.h"

#define ROW(number, ...) [number] = {__VA_ARGS__},
const struct cap_count_def cap_count_defs[CAP_N_COUNT] = {CAP_COUNTS(ROW)};

const struct cap_health cap_health_unknown = {
    .temperature_c = NAN, .ptp_offset_ns = NAN, .link_mbps = NAN, .clock = {.bound_ns = -1}};

void cap_frame_release(struct cap_frame *f)
{
    if (f != NULL)
        f->release(f);
}

void *cap_source_memory(const struct cap_source_config *c, size_t bytes)
{
    void *mem = pvx_reserve(bytes);
    if (mem == NULL)
        return NULL;
    if (mlock2(mem, bytes, MLOCK_ONFAULT) != 0 && !c->again)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "not_locked", .camera = c->name),
                  "camera %s: its %.0f MB of frames may be swapped out: %s; raise the limit of "
                  "locked memory (`ulimit -l`, systemd's LimitMEMLOCK=)",
                  c->name, (double)bytes * 1e-6, strerror(errno));
    if (!c->again)
        memset(mem, 0, bytes);
    return mem;
}
