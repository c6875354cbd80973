#include "capture/source/source.h"

#include <math.h>

#define ROW(number, ...) [number] = {__VA_ARGS__},
const struct cap_count_def cap_count_defs[CAP_N_COUNT] = {CAP_COUNTS(ROW)};

const struct cap_health cap_health_unknown = {
    .temperature_c = NAN, .ptp_offset_ns = NAN, .link_mbps = NAN, .clock = {.bound_ns = -1}};

void cap_frame_release(struct cap_frame *f)
{
    if (f != NULL)
        f->release(f);
}
