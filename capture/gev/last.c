#include "capture/gev/last.h"

#include "base/clock.h"

bool aravis_is_last(gpointer object)
{
    return g_atomic_int_get(&G_OBJECT(object)->ref_count) == 1;
}

void aravis_unref_last(gpointer object)
{
    while (!aravis_is_last(object))
        pvx_sleep_until_mono(pvx_now_mono() + PVX_NS_PER_MS);
    g_object_unref(object);
}

void aravis_close_camera(ArvCamera **camera)
{
    if (*camera == NULL)
        return;
    ArvDevice *device = g_object_ref(arv_camera_get_device(*camera));
    aravis_unref_last(*camera);
    aravis_unref_last(device);
    *camera = NULL;
}
