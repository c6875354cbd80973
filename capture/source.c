#include "capture/source.h"

#include <math.h>
#include <string.h>

#include "capture/backends.h"

const struct cap_count_def cap_count_defs[CAP_N_COUNT] = {
    [CAP_RECEIVED] = {"received", "frames", "good frames handed over by the driver"},
    [CAP_INCOMPLETE] = {"incomplete", "frames",
                        "packets missing, file unreadable, or another error"},
    [CAP_BAD_SIZE] = {"bad_size", "frames", "width, height or bytes are not what is configured"},
    [CAP_BAD_FORMAT] = {"bad_format", "frames", "pixel format is not what is configured"},
    [CAP_BAD_STAMP] = {"bad_stamp", "frames", "device time ran backwards or stood still"},
    [CAP_UNDERRUN] = {"underrun", "frames", "no free buffer: the consumer was too slow"},
    [CAP_OVERFLOW] = {"overflow", "frames", "displaced by newer ones: the consumer was too slow"},
    [CAP_LATE] = {"late", "frames", "came after its set had been closed"},
    [CAP_UNMATCHED] = {"unmatched", "frames", "its set was never completed"},
    [CAP_ID_GAP] = {"id_gap", "frames", "numbered by the camera but never seen"},
    [CAP_LOST_CAMERA] = {"lost_camera", "times", "the camera stopped answering"},
};

const struct cap_health cap_health_unknown = {
    .temperature_c = NAN, .ptp_offset_ns = NAN, .link_mbps = NAN, .clock = {.bound_ns = -1}};

void cap_frame_release(struct cap_frame *f)
{
    if (f != NULL)
        f->release(f);
}

static const struct cap_source_ops *const backends[] = {
    &cap_source_aravis, &cap_source_v4l2, &cap_source_sim, &cap_source_files, NULL,
};

const struct cap_source_ops *const *cap_backends(void)
{
    return backends;
}

const struct cap_source_ops *cap_backend_find(const char *uri, const char **rest)
{
    for (const struct cap_source_ops *const *b = backends; *b != NULL; b++) {
        size_t n = strlen((*b)->scheme);
        if (strncmp(uri, (*b)->scheme, n) == 0 && uri[n] == ':') {
            *rest = uri + n + 1;
            return *b;
        }
    }
    return NULL;
}
