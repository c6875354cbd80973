#include "capture/gev/err.h"

#include <pthread.h>
#include <string.h>

#include "base/log.h"

pvx_err aravis_fail(const struct cap_source_config *c, pvx_err e, const char *what, GError **err,
                    struct pvx_diag *d)
{
    CAP_FAIL(c, "aravis", d, e, "%s: %s", what, *err != NULL ? (*err)->message : pvx_strerror(e));
    g_clear_error(err);
    return e;
}

bool aravis_means_gone(const GError *err)
{
    return err->domain != ARV_DEVICE_ERROR || err->code == ARV_DEVICE_ERROR_TIMEOUT ||
           err->code == ARV_DEVICE_ERROR_TRANSFER_ERROR ||
           err->code == ARV_DEVICE_ERROR_NOT_CONNECTED ||
           err->code == ARV_DEVICE_ERROR_NOT_CONTROLLER;
}

pvx_err aravis_refused(const struct cap_source_config *c, struct pvx_diag *d, const char *what,
                       double want, double got, double min, double max)
{
    return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                    "%s %g refused: the camera has %g and offers %g to %g", what, want, got, min,
                    max);
}

/* ---- GLib's own messages ------------------------------------------------------------------------ */

static const char *field(const GLogField *f, gsize n, const char *key)
{
    for (gsize i = 0; i < n; i++)
        if (strcmp(f[i].key, key) == 0 && f[i].length < 0)
            return f[i].value;
    return "?";
}

static GLogWriterOutput on_message(GLogLevelFlags level, const GLogField *f, gsize n, gpointer user)
{
    const char *who = field(f, n, "GLIB_DOMAIN"), *what = field(f, n, "MESSAGE");
    (void)user;
    if (level & G_LOG_LEVEL_ERROR)
        LOG_E(CAPTURE, "%s ends the process: %s", who, what);
    else if (level & (G_LOG_LEVEL_CRITICAL | G_LOG_LEVEL_WARNING))
        LOG_EVERY(PVX_LOG_WARN, CAPTURE, "%s: %s", who, what);
    return G_LOG_WRITER_HANDLED;
}

static void log_messages(void)
{
    g_log_set_always_fatal((GLogLevelFlags)(G_LOG_LEVEL_ERROR | G_LOG_FLAG_RECURSION));
    g_log_set_writer_func(on_message, NULL, NULL);
}

void aravis_log_messages(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, log_messages);
}
