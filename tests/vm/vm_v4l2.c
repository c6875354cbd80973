/* vm_v4l2.c - the v4l2: backend against the kernel's vivid driver: what it shows is known (colour
 * bars), and its controls drop, tear off and break things on request.
 * Needs: vivid n_devs=8 with one webcam input each, the last one multi-planar. */
#include "../t.h"
#include "tests/lib/v4l2_bed.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <pthread.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/backends.h"
#include "tests/lib/rig.h"
#include "capture/pixel/pixfmt.h"

#define N 8

/* ---- sources ---------------------------------------------------------------------------------- */

#define NO_TEXT              \
    {                        \
        "osd_text_mode", "2" \
    }

static struct cap_source_config config(const char *uri)
{
    struct cap_source_config c = source_of(uri, 320, 180, CAP_YUYV, 30);
    c.buffers = 6;
    return c;
}

/* Straight to the driver, past the code under test. */
static int device(unsigned i)
{
    char path[32];
    snprintf(path, sizeof path, "/dev/video%u", i);
    return open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
}

static uint32_t control_id(int fd, const char *name)
{
    struct v4l2_query_ext_ctrl q = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
    while (ioctl(fd, VIDIOC_QUERY_EXT_CTRL, &q) == 0) {
        if (strcmp(q.name, name) == 0)
            return q.id;
        q.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    return 0;
}

static int64_t control_get(unsigned dev, const char *name)
{
    int fd = device(dev);
    struct v4l2_ext_control x = {.id = control_id(fd, name)};
    struct v4l2_ext_controls all = {.count = 1, .controls = &x};
    T_EQ_I(ioctl(fd, VIDIOC_G_EXT_CTRLS, &all), 0);
    close(fd);
    return strstr(name, "64") != NULL ? x.value64 : x.value;
}

static void control_set(unsigned dev, const char *name, int32_t value)
{
    int fd = device(dev);
    struct v4l2_control x = {.id = control_id(fd, name), .value = value};
    T_CHECK_(ioctl(fd, VIDIOC_S_CTRL, &x) == 0, "%s: %s", name, strerror(errno));
    close(fd);
}

static unsigned entries(const char *dir)
{
    unsigned n = 0;
    DIR *d = opendir(dir);
    while (d != NULL && readdir(d) != NULL)
        n++;
    if (d != NULL)
        closedir(d);
    return n;
}

static unsigned mappings(void)
{
    unsigned n = 0;
    char line[512];
    FILE *f = fopen("/proc/self/maps", "re");
    while (f != NULL && fgets(line, sizeof line, f) != NULL)
        n += strstr(line, "/dev/video") != NULL;
    if (f != NULL)
        fclose(f);
    return n;
}

/* ---- names and lists -------------------------------------------------------------------------- */

static unsigned n_found;
static char found_uri[N][64];
static void on_found(void *ctx, const struct cap_found *f)
{
    (void)ctx;
    T_CONTAINS(f->text, "vivid");
    T_CONTAINS(f->text, "/dev/video");
    T_CONTAINS(f->formats, "YUV422_8 320x180 1 2 4 5 10 12.5 15 25 30 40 50 60 Hz\n");
    T_CONTAINS(f->formats, "BayerRG12 640x480 1 2 4 5 10 12.5 15 25 Hz");
    T_OK(strstr(f->formats, "none") == NULL);
    if (n_found < N)
        snprintf(found_uri[n_found], sizeof found_uri[0], "%s", f->uri);
    n_found++;
}

T_CASE(lists_every_camera_by_a_name_that_opens_it)
{
    struct pvx_diag d = {""};
    n_found = 0;
    T_EQ_I(v4l2->list(on_found, NULL, &d), PVX_OK);
    T_EQ_I(n_found, N);
    for (unsigned i = 0; i < N && i < n_found; i++) {
        char want[64];
        const char *rest;
        snprintf(want, sizeof want, "v4l2:platform:vivid-%03u", i);
        T_EQ_S(found_uri[i], want);
        T_OK(cap_backend_find(found_uri[i], &rest) == v4l2);
        struct cap_source_config c = config(rest);
        ended(opened(&c));
    }
}

T_CASE(a_name_of_several_cameras_is_refused_with_the_choice)
{
    struct cap_source_config c = config("vivid");
    REFUSED(&c, PVX_EINVAL, "8 cameras", "v4l2:platform:vivid-000 (vivid, /dev/video0)",
            "v4l2:platform:vivid-001");
    c.uri = "platform:vivid-003#0";
    ended(opened(&c));
    c.uri = "platform:vivid-003#1";
    REFUSED(&c, PVX_ENOENT, "not plugged in");
    c.uri = "usb-0123";
    REFUSED(&c, PVX_ENOENT, "not plugged in", "v4l2:platform:vivid-000");
    c.uri = "/dev/video99";
    REFUSED(&c, PVX_ENOENT, "/dev/video99");
    c.uri = "/dev/null";
    REFUSED(&c, PVX_EUNSUP, "no V4L2 device");
    c.uri = "";
    REFUSED(&c, PVX_EINVAL, "needs a name");
    /* a link as udev makes it */
    mkdir("/dev/v4l", 0755);
    mkdir("/dev/v4l/by-id", 0755);
    T_EQ_I(symlink("../../video5", "/dev/v4l/by-id/usb-Maker_Flame_77-video-index0"), 0);
    c.uri = "usb-Maker_Flame_77-video-index0";
    FEATURES(&c, {"brightness", "99"});
    ended(opened(&c));
    T_EQ_I(control_get(5, "Brightness"), 99);
}

T_CASE(a_camera_in_use_is_busy_and_says_by_whom)
{
    struct cap_source_config c = config("/dev/video0");
    cap_source *s = opened(&c);
    char pid[32];
    snprintf(pid, sizeof pid, "vm_v4l2 (pid %d", (int)getpid());
    REFUSED(&c, PVX_EBUSY, "/dev/video0", pid, "is the camera there twice?");
    ended(s);
    ended(opened(&c));
}

/* ---- pixels ----------------------------------------------------------------------------------- */

#define BIN 4
#define BW  (320 / BIN)
#define BH  (180 / BIN)

/* 75 % colour bars, in the middle of each. */
static const double bars[8][3] = {{1, 1, 1}, {1, 1, 0}, {0, 1, 1}, {0, 1, 0},
                                  {1, 0, 1}, {1, 0, 0}, {0, 0, 1}, {0, 0, 0}};

/* Full scale 1; grey: BT.709 luma. */
static double bar(int b, int ch, bool grey)
{
    double v = grey ? 0.2126 * bars[b][0] + 0.7152 * bars[b][1] + 0.0722 * bars[b][2] : bars[b][ch];
    return 191.0 / 255 * v;
}

static void shows_bars(const char *uri, enum cap_pixfmt fmt)
{
    static float out[BH][BW][4], grey[BH][BW];
    struct cap_source_config c = config(uri);
    c.fmt = fmt;
    FEATURES(&c, {"test_pattern", "75% Colorbar"}, NO_TEXT);
    cap_source *s = running(&c, true);
    if (s == NULL || !wait_count(&box, &box.n, 2)) {
        T_CHECK_(false, "no frames of %s", cap_pixfmt_name(fmt));
        ended(s);
        return;
    }
    v4l2->stop(s);
    const struct cap_image *img = &box.held[1]->img;
    T_EQ_I(img->fmt, fmt);
    T_EQ_I(img->width, 320);
    T_OK(img->stride >= (ptrdiff_t)cap_pixfmt_row(fmt, 320));
    bool one = cap_pixfmt_channels(fmt) == 1;
    struct cap_convert_params linear = {
        .binning = BIN, .nch = one ? 1 : 3, .transfer = CAP_TRANSFER_LINEAR};
    pvx_err e = cap_convert(img, &linear, 0, BH, one ? &grey[0][0] : &out[0][0][0]);
    T_CHECK_(e == PVX_OK, "%s: %s", cap_pixfmt_name(fmt), pvx_strerror(e));
    /* RGB and Bayer come as they are; of Y, Cb and Cr vivid cuts off up to a step each (BT.709: 1.86
     * steps of Cb are one of blue), of luma likewise, and what has more bits than 8 ends in zeros. */
    bool exact = cap_pixfmt_layout(fmt) == CAP_LAYOUT_8 && !one;
    double tol = exact ? 1.1 / 255 : 4.0 / 255;
    for (int b = 0; b < 8 && e == PVX_OK; b++) {
        int x = (2 * b + 1) * BW / 16, y = BH / 2;
        for (int ch = 0; ch < (one ? 1 : 3); ch++) {
            double got = one ? grey[y][x] : out[y][x][ch];
            T_CHECK_(fabs(got - bar(b, ch, one)) <= tol, "%s bar %d channel %d: %.4f, want %.4f",
                     cap_pixfmt_name(fmt), b, ch, got, bar(b, ch, one));
        }
    }
    empty_box(&box);
    ended(s);
}

T_CASE(every_format_shows_the_same_bars)
{
    static const enum cap_pixfmt fmt[] = {
        CAP_RGB8,       CAP_BGR8,       CAP_YUYV,       CAP_UYVY,       CAP_GREY8,
        CAP_GREY10,     CAP_GREY12,     CAP_GREY16,     CAP_BAYER_RG8,  CAP_BAYER_GR8,
        CAP_BAYER_GB8,  CAP_BAYER_BG8,  CAP_BAYER_RG10, CAP_BAYER_GR10, CAP_BAYER_GB10,
        CAP_BAYER_BG10, CAP_BAYER_RG12, CAP_BAYER_GR12, CAP_BAYER_GB12, CAP_BAYER_BG12,
        CAP_BAYER_RG16, CAP_BAYER_GR16, CAP_BAYER_GB16, CAP_BAYER_BG16};
    for (size_t i = 0; i < sizeof fmt / sizeof fmt[0]; i++)
        shows_bars("platform:vivid-000", fmt[i]);
}

T_CASE(multi_planar_devices_too)
{
    int fd = device(N - 1);
    struct v4l2_capability cap = {0};
    T_EQ_I(ioctl(fd, VIDIOC_QUERYCAP, &cap), 0);
    T_OK((cap.device_caps & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0); /* else this tests nothing */
    close(fd);
    shows_bars("platform:vivid-007", CAP_RGB8);
    shows_bars("platform:vivid-007", CAP_YUYV);
    shows_bars("platform:vivid-007", CAP_GREY16);
}

static uint8_t yuv_of(enum cap_pixfmt fmt)
{
    struct cap_source_config c = config("platform:vivid-000");
    uint8_t yuv = 0xff;
    c.fmt = fmt;
    cap_source *s = running(&c, true);
    if (s != NULL && wait_count(&box, &box.n, 1))
        yuv = box.held[0]->img.yuv;
    ended(s);
    empty_box(&box);
    return yuv;
}

T_CASE(yuv_is_read_as_the_driver_says_it_is)
{
    static const struct {
        int matrix, range;
        uint8_t want;
    } k[] = {{1, 2, CAP_YUV_601},
             {2, 2, CAP_YUV_709},
             {1, 1, CAP_YUV_601 | CAP_YUV_FULL},
             {2, 1, CAP_YUV_709 | CAP_YUV_FULL}};
    for (size_t i = 0; i < sizeof k / sizeof k[0]; i++) {
        control_set(0, "Y'CbCr Encoding", k[i].matrix);
        control_set(0, "Quantization", k[i].range);
        T_EQ_I(yuv_of(CAP_YUYV), k[i].want);
        shows_bars("platform:vivid-000", CAP_YUYV);
    }
    T_EQ_I(yuv_of(CAP_RGB8), 0);
    control_set(0, "Y'CbCr Encoding", 0);
    control_set(0, "Quantization", 0);
    control_set(0, "Transfer Function", 1);
    T_EQ_I(yuv_of(CAP_UYVY), CAP_YUV_601 | CAP_YUV_TRANSFER_709);
    control_set(0, "Transfer Function", 0);
    control_set(0, "Colorspace", 1); /* Rec. 709: all its defaults */
    T_EQ_I(yuv_of(CAP_YUYV), CAP_YUV_709 | CAP_YUV_TRANSFER_709);
    control_set(0, "Colorspace", 2);
    T_EQ_I(yuv_of(CAP_YUYV), 0);
}

T_CASE(what_is_not_offered_is_refused_with_what_is)
{
    struct cap_source_config c = config("platform:vivid-001");
    c.fmt = CAP_JPEG;
    REFUSED(&c, PVX_EINVAL, "JPEG refused", "YUV422_8", "Mono10");
    c = config("platform:vivid-001");
    c.width = 333;
    REFUSED(&c, PVX_EINVAL, "333x180 refused", "320x180", "640x480");
    c = config("platform:vivid-001");
    c.width = 640;
    c.height = 480;
    REFUSED(&c, PVX_EINVAL, "frame rate 30 refused", "has 25", "640x480", "12.5 15 25 Hz");
    c.fps = 12.5;
    ended(opened(&c));
    c.fps = 0; /* all as it is */
    c.fmt = CAP_FMT_NONE;
    c.width = c.height = 0;
    cap_source *s = running(&c, true);
    if (s != NULL && wait_count(&box, &box.n, 1)) {
        T_EQ_I(box.held[0]->img.width, 640);
        T_EQ_I(box.held[0]->img.fmt, CAP_YUYV);
    }
    empty_box(&box);
    ended(s);
}

/* ---- controls --------------------------------------------------------------------------------- */

static void feature(const char *name, const char *value, int64_t want, const char *driver_name)
{
    struct cap_feature f;
    snprintf(f.name, sizeof f.name, "%s", name);
    snprintf(f.value, sizeof f.value, "%s", value);
    struct cap_source_config c = config("platform:vivid-002");
    c.features = &f;
    c.n_features = 1;
    ended(opened(&c));
    if (driver_name != NULL)
        T_EQ_I(control_get(2, driver_name), want);
}

static void no_feature(const char *name, const char *value, const char *part)
{
    struct cap_feature f;
    snprintf(f.name, sizeof f.name, "%s", name);
    snprintf(f.value, sizeof f.value, "%s", value);
    struct cap_source_config c = config("platform:vivid-002");
    c.features = &f;
    c.n_features = 1;
    REFUSED(&c, PVX_EINVAL, name, value, part);
}

T_CASE(controls_are_set_and_read_back)
{
    feature("brightness", "200", 200, "Brightness");
    feature("Brightness", "201", 201, "Brightness");
    feature("0x00980900", "0xca", 202, "Brightness");
    feature("hue", "-20", -20, "Hue");
    feature("horizontal_flip", "true", 1, "Horizontal Flip");
    feature("horizontal_flip", "off", 0, "Horizontal Flip");
    feature("test_pattern", "100% Red", 7, "Test Pattern");
    feature("test_pattern", "3", 3, "Test Pattern");
    feature("integer_menu", "5", 5, "Integer Menu");
    feature("integer_64_bits", "-5000000000", -5000000000LL, "Integer 64 Bits");
    feature("bitmask", "0x80000010", (int32_t)0x80000010u, "Bitmask");
    feature("string", "abc", 0, NULL);
    feature("button", "1", 0, NULL);
}

T_CASE(controls_that_are_refused_say_why)
{
    no_feature("brightness", "300", "it offers 0 to 255");
    no_feature("brightness", "-1", "it offers 0 to 255");
    no_feature("brightness", "bright", "no value of it");
    no_feature("horizontal_flip", "2", "0 to 1");
    no_feature("menu", "2", "3 = Menu Item 3");
    no_feature("menu", "Menu Item 9", "1 = Menu Item 1, 3 = Menu Item 3, 4 = Menu Item 4");
    no_feature("read_only_integer_32_bits", "3", "it can only be read");
    no_feature("u16_8x16_matrix", "3", "table");
    no_feature("string", "abcdefgh", "2 to 4 characters");
    no_feature("bitmask", "1", "bits of 0x80402010");
    struct cap_source_config c = config("platform:vivid-002");
    FEATURES(&c, {"warp_drive", "1"});
    REFUSED(&c, PVX_EINVAL, "no control warp_drive", "v4l2-ctl");
    c = config("platform:vivid-002");
    c.exposure_us = 500;
    REFUSED(&c, PVX_EINVAL, "exposure_us = 500");
}

T_CASE(gain_switches_the_automatic_off)
{
    control_set(2, "Gain, Automatic", 1);
    struct cap_source_config c = config("platform:vivid-002");
    c.gain = 77;
    reset_box(&box, true);
    cap_source *s = opened(&c);
    T_EQ_I(control_get(2, "Gain, Automatic"), 0);
    T_EQ_I(control_get(2, "Gain"), 77);
    if (started(s) && wait_count(&box, &box.n, 1)) {
        T_NEAR(box.held[0]->gain, 77, 0);
        T_OK(isnan(box.held[0]->exposure_us));
    }
    empty_box(&box);
    ended(s);
    c.gain = 256;
    REFUSED(&c, PVX_EINVAL, "gain = 256", "0 to 255");
    control_set(2, "Gain, Automatic", 1);
}

/* ---- the stream ------------------------------------------------------------------------------- */

T_CASE(a_slow_consumer_costs_frames_not_the_stream)
{
    struct cap_source_config c = config("platform:vivid-003");
    c.buffers = 5;
    cap_source *s = running(&c, true);
    if (s != NULL) {
        T_OK(wait_count(&box, &box.count[CAP_UNDERRUN], 6));
        T_EQ_I(box.n_held, 5);
        T_OK(box.held[0]->img.data != box.held[1]->img.data);
        keep_box(&box, false);
        empty_box(&box);
        T_OK(wait_more(&box, &box.n, 10));
    }
    ended(s);
    T_OK(!box.ids_fall);
    /* what is missing in our numbers is what we dropped or vivid says it skipped */
    T_EQ_I(box.holes, box.count[CAP_UNDERRUN] + box.count[CAP_ID_GAP]);
}

/* More buffers than a driver can have: copies, the driver keeps its own. */
T_CASE(many_buffers_are_copies)
{
    struct cap_source_config c = config("platform:vivid-003");
    c.buffers = 40;
    FEATURES(&c, {"test_pattern", "0"}, NO_TEXT);
    cap_source *s = running(&c, true);
    if (s != NULL) {
        T_OK(wait_count(&box, &box.count[CAP_UNDERRUN], 2));
        T_EQ_I(box.n_held, 40);
        T_EQ_I(memcmp(box.held[0]->img.data, box.held[39]->img.data, 320 * 180 * 2), 0);
    }
    ended(s);
    empty_box(&box);
}

T_CASE(dropped_buffers_are_gaps)
{
    struct cap_source_config c = config("platform:vivid-003");
    FEATURES(&c, {"percentage_of_dropped_buffers", "40"});
    cap_source *s = running(&c, false);
    if (s != NULL) {
        T_OK(wait_count(&box, &box.count[CAP_ID_GAP], 8));
        T_OK(wait_count(&box, &box.n, 5));
    }
    ended(s);
    T_OK(!box.ids_fall);
    T_EQ_I(box.holes, box.count[CAP_ID_GAP]);
    T_EQ_I(box.count[CAP_INCOMPLETE], 0);
    control_set(3, "Percentage of Dropped Buffers", 0);
}

T_CASE(numbers_go_on_past_32_bits)
{
    struct cap_source_config c = config("platform:vivid-003");
    c.fps = 60;
    FEATURES(&c, {"wrap_sequence_number", "1"});
    cap_source *s = running(&c, false);
    if (s != NULL) {
        T_OK(wait_count(&box, &box.n, 1));
        T_OK(wait_count(&box, &box.last_id, (uint64_t)UINT32_MAX + 3));
    }
    ended(s);
    T_LE(box.first_id, UINT32_MAX);
    T_OK(box.first_id > UINT32_MAX - 256);
    T_OK(box.last_id > UINT32_MAX);
    T_LE(box.last_id, (uint64_t)UINT32_MAX + 1000);
    T_OK(!box.ids_fall);
    control_set(3, "Wrap Sequence Number", 0);
}

T_CASE(stamps_are_the_hosts_clock_or_not_used)
{
    struct cap_source_config c = config("platform:vivid-003");
    for (int mode = 0; mode < 3; mode++) { /* end of frame, start of exposure, nonsense */
        char source[8], wrap[8];
        snprintf(source, sizeof source, "%d", mode == 1);
        snprintf(wrap, sizeof wrap, "%d", mode == 2);
        struct cap_feature f[2] = {{"timestamp_source", ""}, {"wrap_timestamp", ""}};
        snprintf(f[0].value, sizeof f[0].value, "%s", source);
        snprintf(f[1].value, sizeof f[1].value, "%s", wrap);
        c.features = f;
        c.n_features = 2;
        cap_source *s = running(&c, false);
        if (s != NULL)
            T_OK(wait_count(&box, &box.n, 3));
        ended(s);
        T_EQ_I(box.stamped, mode < 2);
        if (mode < 2)
            T_LE(llabs(box.off_ns), 10 * PVX_NS_PER_S);
    }
    control_set(3, "Wrap Timestamp", 0);
    control_set(3, "Timestamp Source", 0);
}

T_CASE(errors_of_single_frames_are_counted)
{
    struct cap_source_config c = config("platform:vivid-003");
    cap_source *s = running(&c, false);
    if (s != NULL) {
        T_OK(wait_count(&box, &box.n, 2));
        for (unsigned k = 1; k <= 3; k++) {
            control_set(3, "Inject V4L2_BUF_FLAG_ERROR", 1);
            T_OK(wait_count(&box, &box.count[CAP_INCOMPLETE], k));
        }
        T_OK(wait_more(&box, &box.n, 3));
        control_set(3, "Inject VIDIOC_QBUF Error",
                    1); /* the driver refuses a buffer: asked again */
        T_OK(wait_more(&box, &box.n, 20));
    }
    ended(s);
    T_EQ_I(box.lost, 0);
    T_EQ_I(box.holes, box.count[CAP_ID_GAP] + box.count[CAP_INCOMPLETE]);
}

T_CASE(stops_and_starts)
{
    struct cap_source_config c = config("platform:vivid-004");
    reset_box(&box, true);
    cap_source *s = opened(&c);
    unsigned fds = entries("/proc/self/fd");
    for (int round = 0; round < 10; round++) {
        struct cap_frame *old = NULL;
        if (!started(s) || !wait_count(&box, &box.n, 1 + (uint64_t)(round % 3)))
            break;
        v4l2->stop(s);
        pthread_mutex_lock(&box.lock);
        uint64_t n = box.n;
        old = box.n_held > 0 ? box.held[--box.n_held] : NULL; /* comes back while it runs again */
        pthread_mutex_unlock(&box.lock);
        usleep(20000);
        T_EQ_I(box.n, n); /* nothing after stop */
        reset_box(&box, true);
        cap_frame_release(old);
    }
    T_EQ_I(entries("/proc/self/fd"), fds);
    ended(s);
    for (int i = 0; i < 5; i++) /* never started, and closed without stop */
        ended(opened(&c));
}

/* ---- lost and found --------------------------------------------------------------------------- */

T_CASE(frames_outlive_their_source_and_do_not_block_the_next)
{
    struct cap_source_config c = config("platform:vivid-004");
    FEATURES(&c, {"osd_text_mode", "0"}); /* counters: frames differ */
    cap_source *s = running(&c, true);
    if (s == NULL || !wait_count(&box, &box.n, 3)) {
        ended(s);
        return;
    }
    ended(s);
    uint32_t sum[3];
    for (int i = 0; i < 3; i++)
        sum[i] = checksum(&box.held[i]->img);
    T_OK(sum[0] != sum[1] && sum[1] != sum[2]);
    struct cap_frame *old[3] = {box.held[0], box.held[1], box.held[2]};
    for (unsigned i = 3; i < box.n_held; i++)
        cap_frame_release(box.held[i]);
    box.n_held = 0;
    s = running(&c, false);
    if (s != NULL)
        T_OK(wait_count(&box, &box.n, 10));
    for (int i = 0; i < 3; i++) {
        T_EQ_I(checksum(&old[i]->img), sum[i]);
        cap_frame_release(old[i]);
    }
    ended(s);
}

T_CASE(a_broken_stream_is_lost_at_once)
{
    struct cap_source_config c = config("platform:vivid-005");
    static const char *const ways[] = {"Inject Fatal Streaming Error", "Disconnect"};
    for (int way = 0; way < 2; way++) {
        cap_source *s = running(&c, true);
        if (s != NULL && wait_count(&box, &box.n, 2)) {
            control_set(5, ways[way], 1);
            T_OK(wait_count(&box, &box.lost, 1));
            if (way == 1) { /* gone while a frame of it is out, and in use */
                cap_source *again;
                struct pvx_diag d = {""};
                T_OK(v4l2->open(&c, &again, &d) != PVX_OK);
            }
        }
        ended(s);
        T_EQ_I(box.lost, 1);
        empty_box(&box);
        reset_box(&box, false);
        s = opened(&c); /* the driver brings it back when nobody has it open */
        if (started(s))
            T_OK(wait_count(&box, &box.n, 3));
        ended(s);
    }
    control_set(5, "Inject VIDIOC_STREAMON Error", 1);
    cap_source *s = opened(&c);
    struct pvx_diag d = {""};
    T_OK(s != NULL && v4l2->start(s, &box_sink, &d) != PVX_OK);
    T_CONTAINS(d.text, "VIDIOC_STREAMON");
    if (started(s)) /* the next try goes well */
        T_OK(wait_count(&box, &box.n, 5));
    ended(s);
    control_set(5, "Inject VIDIOC_REQBUFS Error", 1);
    REFUSED(&c, PVX_EINVAL, "VIDIOC_REQBUFS");
}

/* ---- eight at once ---------------------------------------------------------------------------- */

static struct rig r;
static uint64_t in_sets[N];

static bool count_sets(int64_t wait_ns)
{
    struct cap_set *set;
    if (cap_capture_next(r.cap, wait_ns, &set) != PVX_OK)
        return false;
    T_LE(set->spread_ns, 90 * PVX_NS_PER_MS);
    for (unsigned k = 0; k < N; k++)
        in_sets[k] += set->frame[k] != NULL;
    cap_set_release(set);
    return true;
}

/* Sets are taken until camera i has counted n. */
static bool run_until(unsigned i, enum cap_count what, uint64_t n)
{
    UNTIL (rig_stats(&r)->camera[i].count[what] >= n)
        count_sets(100 * PVX_NS_PER_MS);
    return r.st.camera[i].count[what] >= n;
}

T_CASE(eight_at_once_and_one_is_unplugged)
{
    rig_init(&r, N, 5, config(found_uri[0]));
    for (unsigned i = 0; i < N; i++) {
        r.cam[i].uri = found_uri[i];
        r.cam[i].fps = 5;
        r.cam[i].buffers = 8;
    }
    r.cfg.discard_first = 1;
    r.cfg.sets.tolerance_ns = 90 * PVX_NS_PER_MS;
    rig_start(&r);
    for (unsigned i = 0; i < N; i++)
        T_OK(run_until(i, CAP_RECEIVED, 5));
    control_set(3, "Disconnect", 1);
    T_OK(run_until(3, CAP_LOST_CAMERA, 1));
    T_OK(run_until(3, CAP_RECEIVED, r.st.camera[3].count[CAP_RECEIVED] + 5));
    cap_capture_stop(r.cap);
    while (count_sets(0))
        ;
    rig_stats(&r);
    for (unsigned i = 0; i < N; i++) {
        const uint64_t *n = r.st.camera[i].count;
        T_OK(in_sets[i] > 0);
        T_EQ_I(n[CAP_RECEIVED], in_sets[i] + n[CAP_LATE] + n[CAP_UNMATCHED] + n[CAP_OVERFLOW]);
        T_OK(n[CAP_LOST_CAMERA] >= (i == 3));
        if (!machine_is_busy())
            T_EQ_I(n[CAP_LOST_CAMERA], i == 3);
        T_EQ_I(n[CAP_BAD_FORMAT] + n[CAP_BAD_SIZE] + n[CAP_INCOMPLETE], 0);
    }
    cap_capture_free(&r.cap);
}

static unsigned fds_at_first;
T_CASE(nothing_is_left_open)
{
    empty_box(&box);
    T_EQ_I(entries("/proc/self/fd"), fds_at_first);
    T_EQ_I(mappings(), 0);
}

int main(void)
{
    const char *rest;
    pvx_log_set_level(PVX_LOG_ERROR);
    v4l2 = cap_backend_find("v4l2:", &rest);
    fds_at_first = entries("/proc/self/fd");
    return t_run();
}
