#include "capture/gev/setup.h"

#include <ifaddrs.h>
#include <math.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/log.h"
#include "capture/gev/err.h"
#include "capture/gev/ptp.h"
#include "capture/gev/ticks.h"
#include "capture/gev/trigger.h"

#define REG_GVCP_CAPABILITY 0x934 /* GigE Vision bootstrap register */
#define GVCP_CAN_RESEND     0x4u
#define JUMBO               9000 /* no larger packets unless asked for */

static pvx_err setup_set_format(const struct cap_source_config *c, ArvCamera *cam,
                                struct aravis_layout *l, struct pvx_diag *d)
{
    GError *err = NULL;
    if (c->fmt != CAP_FMT_NONE) {
        uint32_t pfnc = cap_pixfmt_pfnc(c->fmt);
        if (pfnc == 0)
            return CAP_FAIL(c, "aravis", d, PVX_EUNSUP, "format %s does not exist there",
                            cap_pixfmt_name(c->fmt));
        arv_camera_set_pixel_format(cam, pfnc, &err);
        if (err != NULL)
            return aravis_fail(c, PVX_EINVAL, cap_pixfmt_name(c->fmt), &err, d);
    }
    ArvPixelFormat got = arv_camera_get_pixel_format(cam, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, "pixel format", &err, d);
    l->fmt = cap_pixfmt_from_pfnc(got);
    if (l->fmt == CAP_FMT_NONE)
        return CAP_FAIL(c, "aravis", d, PVX_EUNSUP,
                        "its pixel format 0x%08x is not known here: set one "
                        "that pyrovoxd --print-config lists under pixel_format",
                        (unsigned)got);
    if (c->fmt != CAP_FMT_NONE && l->fmt != c->fmt)
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "format %s refused: the camera has %s",
                        cap_pixfmt_name(c->fmt), cap_pixfmt_name(l->fmt));
    return PVX_OK;
}

static pvx_err set_region(const struct cap_source_config *c, ArvCamera *cam,
                          struct aravis_layout *l, struct pvx_diag *d)
{
    GError *err = NULL;
    int x, y;
    if (c->width > 0 && c->height > 0) {
        int offset = arv_camera_is_region_offset_available(cam, NULL) ? 0 : -1; /* -1: leave */
        arv_camera_set_region(cam, offset, offset, c->width, c->height, &err);
    }
    /* A refusal shows below, by the size that the camera then has; the error gives the limits. */
    g_clear_error(&err);
    arv_camera_get_region(cam, &x, &y, &l->width, &l->height, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, "image size", &err, d);
    if (c->width > 0 && c->height > 0 && (l->width != c->width || l->height != c->height)) {
        int w = 0, h = 0;
        arv_camera_get_sensor_size(cam, &w, &h, NULL);
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "image size %dx%d refused: the camera has %dx%d, "
                        "its sensor %dx%d",
                        c->width, c->height, l->width, l->height, w, h);
    }
    return PVX_OK;
}

static pvx_err setup_set_exposure(const struct cap_source_config *c, ArvCamera *cam,
                                  struct pvx_diag *d)
{
    GError *err = NULL;
    double min = 0, max = 0;
    if (c->exposure_us >= 0) {
        if (arv_camera_is_exposure_auto_available(cam, NULL))
            arv_camera_set_exposure_time_auto(cam, ARV_AUTO_OFF, NULL);
        arv_camera_set_exposure_time(cam, c->exposure_us, &err);
        g_clear_error(&err);
        double got = arv_camera_get_exposure_time(cam, &err);
        if (err != NULL)
            return aravis_fail(c, PVX_EINVAL, "exposure time", &err, d);
        if (fabs(got - c->exposure_us) > 0.01 * c->exposure_us + 1) {
            arv_camera_get_exposure_time_bounds(cam, &min, &max, NULL);
            return aravis_refused(c, d, "exposure time [us]", c->exposure_us, got, min, max);
        }
    }
    if (c->gain >= 0) {
        if (arv_camera_is_gain_auto_available(cam, NULL))
            arv_camera_set_gain_auto(cam, ARV_AUTO_OFF, NULL);
        arv_camera_set_gain(cam, c->gain, &err);
        g_clear_error(&err);
        double got = arv_camera_get_gain(cam, &err);
        if (err != NULL)
            return aravis_fail(c, PVX_EINVAL, "gain", &err, d);
        if (fabs(got - c->gain) > 0.01 * c->gain + 0.05) {
            arv_camera_get_gain_bounds(cam, &min, &max, NULL);
            return aravis_refused(c, d, "gain", c->gain, got, min, max);
        }
    }
    return PVX_OK;
}

/* Equal as text, or both are numbers and equal within the rounding of a camera's steps. */
static bool same_value(const char *want, const char *got)
{
    char *end_want, *end_got;
    double a = strtod(want, &end_want), b = strtod(got, &end_got);
    if (end_want != want && *end_want == '\0' && end_got != got && *end_got == '\0')
        return fabs(a - b) <= 1e-3 * fabs(a);
    bool truth = strcmp(got, "true") == 0;
    if ((truth || strcmp(got, "false") == 0) && (strcmp(want, "1") == 0 || strcmp(want, "0") == 0))
        return truth == (want[0] == '1');
    return strcmp(want, got) == 0;
}

static pvx_err setup_set_feature(const struct cap_source_config *c, ArvCamera *cam,
                                 const struct cap_feature *f, struct pvx_diag *d)
{
    GError *err = NULL;
    ArvDevice *dev = arv_camera_get_device(cam);
    ArvGcNode *node = arv_device_get_feature(dev, f->name);
    if (!ARV_IS_GC_FEATURE_NODE(node))
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "the camera has no feature %s", f->name);
    if (ARV_IS_GC_COMMAND(node)) {
        arv_gc_command_execute(ARV_GC_COMMAND(node), &err);
        return err == NULL ? PVX_OK : aravis_fail(c, PVX_EINVAL, f->name, &err, d);
    }
    arv_gc_feature_node_set_value_from_string(ARV_GC_FEATURE_NODE(node), f->value, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EINVAL, f->name, &err, d);
    const char *got = arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(node), &err);
    if (err != NULL || got == NULL)
        return aravis_fail(c, PVX_EINVAL, f->name, &err, d);
    if (!same_value(f->value, got))
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "feature %s = %s refused: the camera has %s",
                        f->name, f->value, got);
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
    arv_camera_gv_set_packet_size_adjustment(cam, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    int mtu = path_mtu(ARV_GV_DEVICE(arv_camera_get_device(cam)), &loopback);
    int size = c->gige.packet_size;
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
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "packet_size %d refused: the camera has %d",
                        size, got);
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
        return aravis_fail(c, PVX_EINVAL, "packet delay", &err, d);
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

/* Features of triggers and lines are set after the trigger, because setting the trigger chooses selectors and an edge
 * for them. */
static pvx_err set_features(const struct cap_source_config *c, ArvCamera *cam, bool of_trigger,
                            struct pvx_diag *d)
{
    for (size_t i = 0; i < c->n_features; i++) {
        const char *name = c->features[i].name;
        bool is = strncmp(name, "Trigger", 7) == 0 || strncmp(name, "Line", 4) == 0;
        if (is == of_trigger)
            PVX_TRY(setup_set_feature(c, cam, &c->features[i], d));
    }
    return PVX_OK;
}

pvx_err aravis_configure(const struct cap_source_config *c, ArvCamera *cam, struct aravis_layout *l,
                         struct aravis_chunks *chunks, struct pvx_diag *d)
{
    /* PTP first: it settles while the rest is set.  Then features, because the rest may need them (a user set, a
     * binning mode). */
    PVX_TRY(aravis_ptp_enable(c, cam, d));
    PVX_TRY(set_features(c, cam, false, d));
    PVX_TRY(setup_set_format(c, cam, l, d));
    PVX_TRY(set_region(c, cam, l, d));
    PVX_TRY(aravis_set_trigger(c, cam, d));
    PVX_TRY(set_features(c, cam, true, d));
    PVX_TRY(setup_set_exposure(c, cam, d));
    PVX_TRY(aravis_chunks_init(chunks, c, cam, d));
    PVX_TRY(set_packet_size(c, cam, d));
    PVX_TRY(set_packet_delay(c, cam, d));
    GError *err = NULL;
    l->payload = arv_camera_get_payload(cam, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, "payload size", &err, d);
    size_t pixels = cap_pixfmt_image(l->fmt, l->width, l->height);
    if (l->payload < pixels)
        l->payload = pixels;
    return aravis_ptp_wait(c, cam, d);
}
