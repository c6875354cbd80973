#include "capture/gev/ticks.h"

guint64 aravis_tick_hz(ArvCamera *cam)
{
    if (!arv_camera_is_gv_device(cam))
        return 0;
    return arv_gv_device_get_timestamp_tick_frequency(ARV_GV_DEVICE(arv_camera_get_device(cam)),
                                                      NULL);
}

int64_t aravis_ticks_to_ns(uint64_t ticks, guint64 hz)
{
    if (hz == 0 || hz == 1000000000u)
        return (int64_t)ticks;
    uint64_t s = ticks / hz, rest = ticks % hz;
    return (int64_t)(s * 1000000000u + (uint64_t)((double)rest * 1e9 / (double)hz));
}
