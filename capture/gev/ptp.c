#include "capture/gev/ptp.h"

#include <math.h>
#include <stdio.h>
#include <strings.h>

#include "base/clock.h"
#include "capture/gev/err.h"
#include "capture/gev/feature.h"

#define WAIT_NS PVX_NS_PER_S
#define LOOK_NS (50 * PVX_NS_PER_MS)

static const struct names {
    const char *enable, *state, *latch, *offset;
} names[] = {
    {"PtpEnable", "PtpStatus", "PtpDataSetLatch", "PtpOffsetFromMaster"},
    {"GevIEEE1588", "GevIEEE1588Status", "GevIEEE1588DataSetLatch", "GevIEEE1588OffsetFromMaster"},
};

static const struct names *names_of(ArvCamera *cam)
{
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (arv_camera_is_feature_available(cam, names[i].enable, NULL))
            return &names[i];
    return NULL;
}

void aravis_ptp_read(ArvCamera *cam, struct aravis_ptp *out)
{
    const struct names *n = names_of(cam);
    GError *err = NULL;
    *out = (struct aravis_ptp){.offset_ns = NAN};
    if (n == NULL || !arv_camera_get_boolean(cam, n->enable, NULL))
        return;
    if (arv_camera_is_feature_available(cam, n->latch, NULL))
        arv_camera_execute_command(cam, n->latch, NULL);
    const char *state = arv_camera_get_string(cam, n->state, &err);
    snprintf(out->state, sizeof out->state, "%.15s", err == NULL && state != NULL ? state : "");
    g_clear_error(&err);
    if (!arv_camera_is_feature_available(cam, n->offset, NULL))
        return;
    gint64 offset = arv_camera_get_integer(cam, n->offset, &err);
    if (err == NULL)
        out->offset_ns = (double)offset;
    g_clear_error(&err);
}

bool aravis_ptp_good(const struct aravis_ptp *p, double offset_us)
{
    double limit = 1000 * (offset_us > 0 ? offset_us : ARAVIS_PTP_OFFSET_US);
    if (strcasecmp(p->state, "Master") == 0)
        return true; /* a master has no offset */
    return strcasecmp(p->state, "Slave") == 0 &&
           (isnan(p->offset_ns) || fabs(p->offset_ns) <= limit);
}

pvx_err aravis_ptp_enable(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    GError *err = NULL;
    const struct names *n = names_of(cam);
    if (!c->ptp)
        return PVX_OK;
    if (n == NULL)
        return CAP_FAIL(c, "aravis", d, PVX_EUNSUP,
                        "ptp refused: the camera has neither PtpEnable nor GevIEEE1588%s",
                        aravis_near(cam, "Ptp").text);
    if (!aravis_has(cam, n->state))
        return aravis_lacks(c, cam, "ptp", n->state, d);
    bool on = arv_camera_get_boolean(cam, n->enable, NULL);
    if (on)
        return PVX_OK; /* it keeps the time that it has */
    arv_camera_set_boolean(cam, n->enable, TRUE, &err);
    if (err == NULL)
        on = arv_camera_get_boolean(cam, n->enable, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EINVAL, n->enable, &err, d);
    return on ? PVX_OK
              : CAP_FAIL(c, "aravis", d, PVX_EINVAL, "ptp refused: %s stays off", n->enable);
}

pvx_err aravis_ptp_wait(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    struct aravis_ptp p;
    int64_t until = pvx_now_mono() + WAIT_NS;
    if (!c->ptp)
        return PVX_OK;
    const struct names *n = names_of(cam);
    if (n != NULL && aravis_asks(c, n->enable) && !arv_camera_get_boolean(cam, n->enable, NULL))
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "ptp: true and `features: %s` disagree; leave one of them out", n->enable);
    for (;;) {
        aravis_ptp_read(cam, &p);
        if (aravis_ptp_good(&p, c->ptp_offset_us))
            return PVX_OK;
        if (pvx_now_mono() >= until)
            break;
        pvx_sleep_until_mono(pvx_now_mono() + LOOK_NS);
    }
    char offset[64] = "";
    if (!isnan(p.offset_ns) && strcasecmp(p.state, "Slave") == 0)
        snprintf(offset, sizeof offset, ", more than ptp_offset_us = %g off its master",
                 c->ptp_offset_us > 0 ? c->ptp_offset_us : ARAVIS_PTP_OFFSET_US);
    return CAP_FAIL(c, "aravis", d, PVX_ETIMEDOUT,
                    "its clock is not synchronized: PTP says %s%s (is there a "
                    "PTP master, and does the switch let its messages pass?)",
                    p.state[0] != '\0' ? p.state : "nothing", offset);
}
