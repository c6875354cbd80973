#include "capture/gev/setup.h"

#include <ifaddrs.h>
#include <math.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/log.h"
#include "capture/gev/err.h"
#include "capture/gev/feature.h"
#include "capture/gev/ptp.h"
#include "capture/gev/ticks.h"
#include "capture/gev/trigger.h"

#define REG_GVCP_CAPABILITY 0x934 /* GigE Vision bootstrap register */
#define GVCP_CAN_RESEND     0x4u
#define JUMBO               9000 /* no larger packets unless asked for */

/* Features of triggers and lines are set after the trigger, because setting the trigger chooses selectors and an edge
 * for them.  The size is set when the offset is 0, and then the offset. */
enum feature_kind { FEATURE_FIRST, FEATURE_SIZE, FEATURE_OFFSET, FEATURE_TRIGGER };

static enum feature_kind kind_of(const char *name)
{
    if (strcmp(name, "Width") == 0 || strcmp(name, "Height") == 0)
        return FEATURE_SIZE;
    if (strcmp(name, "OffsetX") == 0 || strcmp(name, "OffsetY") == 0)
        return FEATURE_OFFSET;
    bool trigger = strncmp(name, "Trigger", 7) == 0 || strncmp(name, "Line", 4) == 0;
    return trigger ? FEATURE_TRIGGER : FEATURE_FIRST;
}

static pvx_err set_features(const struct cap_source_config *c, ArvCamera *cam,
                            enum feature_kind kind, struct pvx_diag *d)
{
    for (size_t i = 0; i < c->n_features; i++)
        if (kind_of(c->features[i].name) == kind)
            PVX_TRY(aravis_feature_set(c, cam, &c->features[i], d));
    return PVX_OK;
}

static pvx_err set_format(const struct cap_source_config *c, ArvCamera *cam,
                          struct aravis_layout *l, struct pvx_diag *d)
{
    GError *err = NULL;
    uint32_t pfnc = cap_pixfmt_pfnc(c->fmt);
    if (c->fmt != CAP_FMT_NONE && pfnc == 0)
        return CAP_FAIL(c, "aravis", d, PVX_EUNSUP, "format %s does not exist there",
                        cap_pixfmt_name(c->fmt));
    if (!aravis_has(cam, "PixelFormat")) {
        if (c->fmt == CAP_FMT_NONE)
            return aravis_lacks(c, cam, "pixel_format: auto", "PixelFormat", d);
        CAP_LOG(PVX_LOG_WARN, c, "aravis", "PixelFormat",
                "the camera has no PixelFormat%s: every frame is checked for %s",
                aravis_near(cam, "PixelFormat").text, cap_pixfmt_name(c->fmt));
        l->fmt = c->fmt;
        return PVX_OK;
    }
    ArvPixelFormat got = arv_camera_get_pixel_format(cam, &err);
    if (err == NULL && pfnc != 0 && got != pfnc) {
        arv_camera_set_pixel_format(cam, pfnc, NULL);
        got = arv_camera_get_pixel_format(cam, &err);
    }
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, "pixel format", &err, d);
    l->fmt = cap_pixfmt_from_pfnc(got);
    if (l->fmt != CAP_FMT_NONE && (c->fmt == CAP_FMT_NONE || l->fmt == c->fmt))
        return PVX_OK;
    char has[400];
    aravis_entries(cam, "PixelFormat", has, sizeof has);
    return l->fmt == CAP_FMT_NONE
               ? CAP_FAIL(c, "aravis", d, PVX_EUNSUP,
                          "its pixel format 0x%08x is not known here: of those that it offers (%s) "
                          "set one that pyrovoxd --print-config lists under pixel_format",
                          (unsigned)got, has)
               : CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                          "format %s refused: the camera has %s and offers %s",
                          cap_pixfmt_name(c->fmt), cap_pixfmt_name(l->fmt), has);
}

/* The room for the size depends on the offset, so the offset is 0 until the size is set. */
static void clear_offset(const struct cap_source_config *c, ArvCamera *cam, const char *offset)
{
    GError *err = NULL;
    gint64 was = aravis_has(cam, offset) ? arv_camera_get_integer(cam, offset, NULL) : 0;
    if (was == 0)
        return;
    arv_camera_set_integer(cam, offset, 0, &err);
    if (!aravis_asks(c, offset))
        CAP_LOG(PVX_LOG_WARN, c, "aravis", offset,
                "its %s was %lld%s; `features: { %s: %lld }` keeps it", offset, (long long)was,
                err == NULL ? " and is now 0" : " and cannot be set to 0", offset, (long long)was);
    g_clear_error(&err);
}

static pvx_err set_one_size(const struct cap_source_config *c, ArvCamera *cam, const char *name,
                            int want, int *got, struct pvx_diag *d)
{
    GError *err = NULL;
    if (!aravis_has(cam, name)) {
        if (want <= 0)
            return aravis_lacks(c, cam, "image size", name, d);
        CAP_LOG(PVX_LOG_WARN, c, "aravis", name,
                "the camera has no %s%s: every frame is checked for %d", name,
                aravis_near(cam, name).text, want);
        *got = want;
        return PVX_OK;
    }
    /* A refusal shows by the size that the camera then has; the error gives the limits. */
    if (want > 0)
        arv_camera_set_integer(cam, name, want, NULL);
    *got = (int)arv_camera_get_integer(cam, name, &err);
    return err == NULL ? PVX_OK : aravis_fail(c, PVX_EIO, "image size", &err, d);
}

static pvx_err set_region(const struct cap_source_config *c, ArvCamera *cam,
                          struct aravis_layout *l, struct pvx_diag *d)
{
    bool sized = c->width > 0 && c->height > 0;
    if (sized || aravis_asks(c, "OffsetX"))
        clear_offset(c, cam, "OffsetX");
    if (sized || aravis_asks(c, "OffsetY"))
        clear_offset(c, cam, "OffsetY");
    if (!sized)
        PVX_TRY(set_features(c, cam, FEATURE_SIZE, d));
    PVX_TRY(set_one_size(c, cam, "Width", sized ? c->width : 0, &l->width, d));
    PVX_TRY(set_one_size(c, cam, "Height", sized ? c->height : 0, &l->height, d));
    if (sized && (l->width != c->width || l->height != c->height)) {
        char sensor[64] = "";
        int w = 0, h = 0;
        arv_camera_get_sensor_size(cam, &w, &h, NULL);
        if (w > 0 && h > 0)
            snprintf(sensor, sizeof sensor, ", its sensor %dx%d", w, h);
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "image size %dx%d refused: the camera has %dx%d%s", c->width, c->height,
                        l->width, l->height, sensor);
    }
    return set_features(c, cam, FEATURE_OFFSET, d);
}

/* An automatic mode would change what is set.  Without the feature there is none. */
static pvx_err set_manual(const struct cap_source_config *c, ArvCamera *cam, const char *mode,
                          const char *value, struct pvx_diag *d)
{
    return arv_camera_is_enumeration_entry_available(cam, mode, value, NULL)
               ? aravis_choose(c, cam, mode, value, d)
               : PVX_OK;
}

/* Why a value that was asked for could not be set: the camera has no such feature, or `err`. */
static pvx_err setup_not_set(const struct cap_source_config *c, ArvCamera *cam, const char *asked,
                             const char *name, GError **err, struct pvx_diag *d)
{
    if (!g_error_matches(*err, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_FEATURE_NOT_FOUND))
        return aravis_fail(c, PVX_EINVAL, asked, err, d);
    g_clear_error(err);
    return aravis_lacks(c, cam, asked, name, d);
}

/* Exposure and gain.  For both, Aravis also knows names that are older than `feature`. */
struct setup_number {
    const char *asked, *feature, *said;
    double slack; /* beside 1 %, between what is asked and what the camera makes of it */
    void (*set)(ArvCamera *cam, double value, GError **err);
    double (*get)(ArvCamera *cam, GError **err);
    void (*bounds)(ArvCamera *cam, double *min, double *max, GError **err);
};

static pvx_err set_number(const struct cap_source_config *c, ArvCamera *cam,
                          const struct setup_number *n, double want, struct pvx_diag *d)
{
    GError *err = NULL;
    double min = 0, max = 0;
    n->set(cam, want, NULL); /* a refusal shows by the value that the camera then has */
    double got = n->get(cam, &err);
    if (err != NULL)
        return setup_not_set(c, cam, n->asked, n->feature, &err, d);
    if (fabs(got - want) <= 0.01 * want + n->slack)
        return PVX_OK;
    n->bounds(cam, &min, &max, NULL);
    return aravis_refused(c, d, n->said, want, got, min, max);
}

static pvx_err set_exposure(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    static const struct setup_number n = {"exposure_us",
                                          "ExposureTime",
                                          "exposure time [us]",
                                          1,
                                          arv_camera_set_exposure_time,
                                          arv_camera_get_exposure_time,
                                          arv_camera_get_exposure_time_bounds};
    if (c->exposure_us < 0)
        return PVX_OK;
    PVX_TRY(set_manual(c, cam, "ExposureAuto", "Off", d));
    PVX_TRY(set_manual(c, cam, "ExposureMode", "Timed", d));
    return set_number(c, cam, &n, c->exposure_us, d);
}

static pvx_err set_gain(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    static const struct setup_number n = {"gain",
                                          "Gain",
                                          "gain",
                                          0.05,
                                          arv_camera_set_gain,
                                          arv_camera_get_gain,
                                          arv_camera_get_gain_bounds};
    if (c->gain < 0)
        return PVX_OK;
    PVX_TRY(set_manual(c, cam, "GainAuto", "Off", d));
    PVX_TRY(set_number(c, cam, &n, c->gain, d));
    if (!aravis_has(cam, "Gain"))
        CAP_LOG(PVX_LOG_WARN, c, "aravis", "Gain",
                "the camera has no Gain%s: gain %g is in steps of its own, not in dB",
                aravis_near(cam, "Gain").text, c->gain);
    return PVX_OK;
}

/* MTU of this host's interface towards the camera, 0 = unknown. */
static int path_mtu(ArvGvDevice *dev, bool *loopback)
{
    int mtu = 0;
    struct ifaddrs *list;
    struct sockaddr_in want;
    *loopback = false;
    GSocketAddress *local = arv_gv_device_get_interface_address(dev);
    if (!G_IS_INET_SOCKET_ADDRESS(local) ||
        !g_socket_address_to_native(local, &want, sizeof want, NULL) || getifaddrs(&list) != 0)
        return 0;
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    for (const struct ifaddrs *p = list; p != NULL && fd >= 0; p = p->ifa_next) {
        struct sockaddr_in sa;
        if (p->ifa_addr == NULL || p->ifa_addr->sa_family != AF_INET)
            continue;
        memcpy(&sa, p->ifa_addr, sizeof sa);
        if (sa.sin_addr.s_addr != want.sin_addr.s_addr)
            continue;
        struct ifreq r = {0};
        memcpy(r.ifr_name, p->ifa_name, strnlen(p->ifa_name, sizeof r.ifr_name - 1));
        if (ioctl(fd, SIOCGIFMTU, &r) == 0)
            mtu = r.ifr_mtu;
        *loopback = (p->ifa_flags & IFF_LOOPBACK) != 0;
        break;
    }
    if (fd >= 0)
        close(fd);
    freeifaddrs(list);
    return mtu;
}

/* A packet larger than the path's MTU is sent in fragments, and packet sockets do not join them.  So the size is
 * never above the MTU of our own interface, and test packets show what the rest of the path allows. */
static pvx_err set_packet_size(const struct cap_source_config *c, ArvCamera *cam,
                               struct pvx_diag *d)
{
    GError *err = NULL;
    bool loopback;
    if (!arv_camera_is_gv_device(cam))
        return PVX_OK;
    bool theirs = aravis_asks(c, "GevSCPSPacketSize") && c->gige.packet_size <= 0;
    arv_camera_gv_set_packet_size_adjustment(cam, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    int mtu = path_mtu(ARV_GV_DEVICE(arv_camera_get_device(cam)), &loopback);
    int size = c->gige.packet_size;
    if (theirs)
        size = (int)arv_camera_gv_get_packet_size(cam, NULL);
    if (size > 0 && mtu > 0 && size > mtu)
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "packet_size %d is more than the interface's MTU "
                        "%d: raise the MTU (ip link set dev ... mtu 9000) or leave it out",
                        size, mtu);
    if (size <= 0 && !loopback) {
        size = (int)arv_camera_gv_auto_packet_size(cam, &err);
        if (err != NULL) /* no test packets: a size that every network carries */
            size = 1500;
        g_clear_error(&err);
        if (mtu > 0 && size > mtu)
            size = mtu;
    } else if (size <= 0) {
        size = mtu > 0 && mtu < JUMBO ? mtu : JUMBO;
    }
    arv_camera_gv_set_packet_size(cam, size, &err);
    g_clear_error(&err);
    int got = (int)arv_camera_gv_get_packet_size(cam, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, "packet size", &err, d);
    if (c->gige.packet_size > 0 && got != size)
        return CAP_FAIL(
            c, "aravis", d, PVX_EINVAL, "packet_size %d refused: the camera has %d%s", size, got,
            aravis_has(cam, "GevSCPSPacketSize") ? "" : aravis_near(cam, "GevSCPSPacketSize").text);
    CAP_DEBUG(c, "aravis", "packets of %d bytes, MTU %d", got, mtu);
    return PVX_OK;
}

static pvx_err set_packet_delay(const struct cap_source_config *c, ArvCamera *cam,
                                struct pvx_diag *d)
{
    GError *err = NULL;
    if (!arv_camera_is_gv_device(cam) || c->gige.packet_delay <= 0)
        return PVX_OK;
    arv_camera_gv_set_packet_delay(cam, c->gige.packet_delay, &err);
    g_clear_error(&err);
    gint64 got = arv_camera_gv_get_packet_delay(cam, &err);
    if (err != NULL)
        return setup_not_set(c, cam, "gige.packet_delay_ns", "GevSCPD", &err, d);
    /* the camera counts in ticks of its own clock, of up to 1 us */
    if (llabs(got - c->gige.packet_delay) <= 1000)
        return PVX_OK;
    gint64 min = 0, max = 0;
    guint64 hz = aravis_tick_hz(cam);
    double tick = hz > 0 ? 1e9 / (double)hz : 1;
    arv_camera_get_integer_bounds(cam, "GevSCPD", &min, &max, NULL);
    return aravis_refused(c, d, "packet delay [ns]", c->gige.packet_delay, (double)got,
                          (double)min * tick, (double)max * tick);
}

bool aravis_wants_resend(const struct cap_source_config *c, ArvCamera *camera)
{
    uint32_t can = 0;
    if (c->gige.resend != CAP_RESEND_AUTO)
        return c->gige.resend == CAP_RESEND_ALWAYS;
    return arv_device_read_register(arv_camera_get_device(camera), REG_GVCP_CAPABILITY, &can,
                                    NULL) &&
           (can & GVCP_CAN_RESEND) != 0;
}

/* What a person sets of triggers comes last.  It must leave the trigger that the capture was told. */
static pvx_err set_trigger(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    struct aravis_mode mode;
    char text[CAP_DETAIL_MAX];
    PVX_TRY(aravis_set_trigger(c, cam, d));
    aravis_mode_first(cam, &mode);
    PVX_TRY(set_features(c, cam, FEATURE_TRIGGER, d));
    if (aravis_mode_is(cam, &mode, text, sizeof text))
        return PVX_OK;
    if (c->trigger != CAP_TRIGGER_FREE_RUN)
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "`features` and the configured trigger disagree: %s; leave one of them out",
                        text);
    CAP_LOG(PVX_LOG_WARN, c, "aravis", "trigger",
            "the capture runs free, but by `features` its %s: it exposes only when it is triggered",
            text);
    return PVX_OK;
}

/* A camera that does not give its payload has frames of the pixels alone. */
static pvx_err setup_payload(const struct cap_source_config *c, ArvCamera *cam,
                             struct aravis_layout *l, struct pvx_diag *d)
{
    GError *err = NULL;
    l->payload = cap_pixfmt_image(l->fmt, l->width, l->height);
    if (!aravis_has(cam, "PayloadSize"))
        return PVX_OK;
    size_t payload = arv_camera_get_payload(cam, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, "payload size", &err, d);
    if (l->payload < payload)
        l->payload = payload;
    return PVX_OK;
}

pvx_err aravis_configure(const struct cap_source_config *c, ArvCamera *cam, struct aravis_layout *l,
                         struct aravis_chunks *chunks, struct pvx_diag *d)
{
    /* PTP first: it settles while the rest is set.  Then features, because the rest may need them (a user set, a
     * binning mode). */
    PVX_TRY(aravis_ptp_enable(c, cam, d));
    PVX_TRY(set_features(c, cam, FEATURE_FIRST, d));
    PVX_TRY(set_format(c, cam, l, d));
    PVX_TRY(set_region(c, cam, l, d));
    PVX_TRY(set_trigger(c, cam, d));
    PVX_TRY(set_exposure(c, cam, d));
    PVX_TRY(set_gain(c, cam, d));
    PVX_TRY(aravis_chunks_init(chunks, c, cam, d));
    PVX_TRY(set_packet_size(c, cam, d));
    PVX_TRY(set_packet_delay(c, cam, d));
    PVX_TRY(aravis_features_stay(c, cam, d));
    PVX_TRY(setup_payload(c, cam, l, d));
    return aravis_ptp_wait(c, cam, d);
}
