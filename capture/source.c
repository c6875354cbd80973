#include "capture/source/source.h"

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
    [CAP_NO_TRIGGER] = {"no_trigger", "times",
                        "the camera answered, but no pulse came on its line"},
    [CAP_CLOCK_STUCK] = {"clock_stuck", "times", "device time stood still for several frames"},
    [CAP_CLOCK_JUMP] = {"clock_jump", "times", "the camera's clock jumped"},
    [CAP_SLIP] = {"slip", "times", "frame numbers and times disagreed: pictures may be off by one"},
    [CAP_MISSED_TRIGGER] = {"missed_trigger", "frames", "not taken while the other cameras did"},
    [CAP_TRIGGER_MODE] = {"trigger_mode", "times",
                          "it was in another trigger mode than it had been set to"},
    [CAP_OUT_OF_STEP] = {"out_of_step", "windows",
                         "exposed outside the tolerance around the others"},
    [CAP_PHASE_WALK] = {"phase_walk", "windows", "its exposures moved against the others'"},
    [CAP_RATE] = {"rate", "windows", "its frame rate was not what it should be"},
    [CAP_BANDWIDTH] = {"bandwidth", "s", "several cameras at once sent incomplete frames"},
    [CAP_PTP_MASTERS] = {"ptp_masters", "s", "it was PTP master beside another camera"},
};

const struct cap_health cap_health_unknown = {
    .temperature_c = NAN, .ptp_offset_ns = NAN, .link_mbps = NAN, .clock = {.bound_ns = -1}};

void cap_frame_release(struct cap_frame *f)
{
    if (f != NULL)
        f->release(f);
}

static const struct cap_source_ops *const backends[] = {
    &cap_source_aravis,
    &cap_source_v4l2,
    &cap_source_libcamera,
    &cap_source_sim,
    &cap_source_files,
    &cap_source_take,
    NULL,
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
