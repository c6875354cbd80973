/* test_v4l2_umockdev.c - the v4l2: backend on cameras that misbehave as a good driver will not on request:
 * the ioctls are answered by umockdev.  What real drivers do is in tests/vm/vm_v4l2.c. */
#include "../t.h"
#include "../v4l2_bed.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include "base/log.h"
#include "capture/rig/capture.h"
#include "mock_v4l2.h"

static struct mock_camera cam;

static struct cap_source_config config(void)
{
    return (struct cap_source_config){.uri = "usb-0042",
                                      .name = "cam0",
                                      .width = 320,
                                      .height = 240,
                                      .fmt = CAP_YUYV,
                                      .fps = 60,
                                      .buffers = 6,
                                      .exposure_us = -1,
                                      .gain = -1};
}

static void plug(void)
{
    mock_init(&cam, 0, "0042");
    mock_plug(&cam);
}

/* Frames until n more have come, then stop. */
static void run(const struct cap_source_config *c, uint64_t n)
{
    reset_box(false);
    cap_source *s = opened(c);
    if (started(s))
        T_OK(wait_count(&box.n, n));
    ended(s);
}

static char listed[4][64], listed_formats[512];
static unsigned n_listed;
static void on_found(void *ctx, const struct cap_found *f)
{
    (void)ctx;
    if (n_listed < 4)
        snprintf(listed[n_listed], sizeof listed[0], "%s", f->uri);
    n_listed++;
    snprintf(listed_formats, sizeof listed_formats, "%s", f->formats);
}

/* ---- what goes well --------------------------------------------------------------------------- */

static void frames_are_the_drivers_memory(void)
{
    plug();
    struct cap_source_config c = config();
    reset_box(true);
    cam.interrupts = 3; /* EINTR is asked again */
    cap_source *s = opened(&c);
    if (started(s)) {
        T_OK(wait_count(&box.count[CAP_UNDERRUN], 3)); /* all 6 are out, the driver goes on */
        T_EQ_I(box.n_held, 6);
        for (unsigned i = 0; i < box.n_held; i++) {
            const struct cap_image *img = &box.held[i]->img;
            T_EQ_I(((const unsigned char *)img->data)[0], 1 + box.held[i]->id % 250);
            T_EQ_I(img->size, 320 * 240 * 2);
            T_EQ_I(img->stride, 640);
            T_OK(box.held[i]->dmabuf > 0);
        }
        keep_box(false);
        empty_box();
        T_OK(wait_more(&box.n, 12));
        T_EQ_I(cam.buffers, 8); /* two more than asked for */
    }
    ended(s);
    T_EQ_I(box.count[CAP_ID_GAP], 0);
    T_EQ_I(box.holes, box.count[CAP_UNDERRUN]);
    T_OK(cam.refused_reads > 0); /* EAGAIN, though poll said ready, is no fault */
    T_EQ_I(box.lost, 0);
    T_OK(!cam.streaming);
    T_EQ_I(cam.buffers, 0);
    mock_unplug(&cam);
}

static void without_export_or_buffers_enough(void)
{
    plug();
    struct cap_source_config c = config();
    cam.no_expbuf = true;
    reset_box(true);
    cap_source *s = opened(&c);
    if (started(s) && wait_count(&box.n, 2))
        T_EQ_I(box.held[0]->dmabuf, 0);
    ended(s);
    empty_box();
    cam.max_buffers = 4; /* fewer than 6 + 2: copies */
    reset_box(true);
    s = opened(&c);
    if (started(s)) {
        T_OK(wait_count(&box.count[CAP_UNDERRUN], 3));
        T_EQ_I(box.n_held, 6);
        for (unsigned i = 0; i < box.n_held; i++)
            T_EQ_I(((const unsigned char *)box.held[i]->img.data)[9], 1 + box.held[i]->id % 250);
        T_EQ_I(cam.buffers, 4);
        T_EQ_I(cam.queued, 4);
    }
    ended(s);
    empty_box();
    cam.max_buffers = 2;
    REFUSED(&c, PVX_ENOMEM, "gives only 2 buffers");
    mock_unplug(&cam);
}

static void multi_planar(void)
{
    mock_init(&cam, 0, "0042");
    cam.caps = V4L2_CAP_VIDEO_CAPTURE_MPLANE | V4L2_CAP_STREAMING;
    cam.data_offset = 64;
    mock_plug(&cam);
    struct cap_source_config c = config();
    c.fmt = CAP_GREY8;
    reset_box(true);
    cap_source *s = opened(&c);
    if (started(s) && wait_count(&box.n, 3)) {
        const struct cap_frame *f = box.held[2];
        T_EQ_I(f->img.size, 320 * 240);
        T_EQ_I((uintptr_t)f->img.data % 4096, 64);
        T_EQ_I(((const unsigned char *)f->img.data)[0], 1 + f->id % 250);
    }
    ended(s);
    empty_box();
    mock_unplug(&cam);
}

static void rows_may_be_padded(void)
{
    plug();
    cam.bytesperline = 704;
    struct cap_source_config c = config();
    reset_box(true);
    cap_source *s = opened(&c);
    if (started(s) && wait_count(&box.n, 1)) {
        T_EQ_I(box.held[0]->img.stride, 704);
        T_EQ_I(box.held[0]->img.size, 704 * 240);
    }
    ended(s);
    empty_box();
    cam.bytesperline = 600; /* a driver that is wrong about itself */
    REFUSED(&c, PVX_EIO, "driver mock", "600 bytes per row");
    mock_unplug(&cam);
}

/* ---- what a camera may not do ----------------------------------------------------------------- */

static void substitutes_are_refused(void)
{
    plug();
    struct cap_source_config c = config();
    c.fmt = CAP_JPEG;
    cam.substitute = V4L2_PIX_FMT_YUYV; /* says it can, and then does not */
    REFUSED(&c, PVX_EINVAL, "camera cam0 (v4l2:usb-0042)", "JPEG refused", "YUV422_8 Mono8 JPEG");
    cam.substitute = 0;
    c.width = 200;
    c.height = 100;
    REFUSED(&c, PVX_EINVAL, "200x100 refused", "gives 160x120", "320x240 160x120");
    c = config();
    cam.rate_fixed = true;
    REFUSED(&c, PVX_EINVAL, "frame rate 60 refused", "has 30", "30 60 Hz");
    cam.no_parm = true; /* it cannot be asked: said, and taken as it comes */
    run(&c, 2);
    cam.field = V4L2_FIELD_INTERLACED;
    REFUSED(&c, PVX_EUNSUP, "interlaced");
    mock_unplug(&cam);
    mock_init(&cam, 0, "0042");
    cam.fourcc[0] = V4L2_PIX_FMT_NV12;
    cam.fourcc[1] = 0;
    mock_plug(&cam);
    c.fmt = CAP_FMT_NONE;
    REFUSED(&c, PVX_EUNSUP, "nothing", "of no use here: NV12");
    mock_unplug(&cam);
}

static void ranges_are_told_as_such(void)
{
    struct pvx_diag d = {""};
    mock_init(&cam, 0, NULL); /* no USB device: the bus is its name */
    cam.bus = "platform:soc-csi";
    cam.ranges = true;
    cam.fourcc[1] = 0;
    mock_plug(&cam);
    n_listed = 0;
    T_EQ_I(v4l2->list(on_found, NULL, &d), PVX_OK);
    T_EQ_I(n_listed, 1);
    T_EQ_S(listed[0], "v4l2:platform:soc-csi");
    T_EQ_S(listed_formats, "YUV422_8 160x120..320x240 in steps of 16x8 5..120 Hz");
    struct cap_source_config c = config();
    c.uri = "platform:soc-csi";
    c.width = 1000;
    REFUSED(&c, PVX_EINVAL, "it offers 160x120..320x240 in steps of 16x8");
    mock_unplug(&cam);
}

static void refusals_of_the_driver_name_the_remedy(void)
{
    static const struct {
        int err;
        pvx_err want;
        const char *says;
    } k[] = {{ENOSPC, PVX_ENOSPC, "USB bus"},
             {EPIPE, PVX_EIO, "media-ctl"},
             {ENODEV, PVX_ENODEV, "unplugged"},
             {EBUSY, PVX_EBUSY, "in use"}};
    plug();
    struct cap_source_config c = config();
    for (size_t i = 0; i < sizeof k / sizeof k[0]; i++) {
        struct pvx_diag d = {""};
        cam.streamon_errno = k[i].err;
        cap_source *s = opened(&c);
        T_EQ_I(v4l2->start(s, &sink, &d), k[i].want);
        T_CONTAINS(d.text, k[i].says);
        T_CONTAINS(d.text, "VIDIOC_STREAMON");
        cam.streamon_errno = 0;
        if (started(s)) /* it may be tried again */
            v4l2->stop(s);
        ended(s);
    }
    cam.open_errno = EACCES;
    c.uri = "/dev/video0";
    REFUSED(&c, PVX_EPERM, "/dev/video0", "group", "usermod");
    c.uri = "usb-0042";
    REFUSED(&c, PVX_EPERM, "group");
    cam.open_errno = 0;
    cam.s_fmt_errno = EBUSY;
    REFUSED(&c, PVX_EBUSY, "VIDIOC_S_FMT", "/dev/video0 is in use");
    cam.s_fmt_errno = 0;
    cam.reqbufs_errno = ENOMEM;
    REFUSED(&c, PVX_ENOMEM, "VIDIOC_REQBUFS");
    mock_unplug(&cam);
}

static void bad_frames_are_counted_not_used(void)
{
    plug();
    struct cap_source_config c = config();
    cam.error_every = 3;
    run(&c, 12);
    T_OK(box.count[CAP_INCOMPLETE] >= 5);
    T_EQ_I(box.count[CAP_ID_GAP], 0); /* they were numbered and seen */
    T_EQ_I(box.holes, box.count[CAP_INCOMPLETE]);
    cam.error_every = 0;
    cam.skip_every = 4;
    run(&c, 12);
    T_OK(box.holes >= 4);
    T_EQ_I(box.holes, box.count[CAP_ID_GAP]);
    cam.skip_every = 0;
    cam.short_by = 320 * 240 * 2; /* nothing in it */
    reset_box(false);
    cap_source *s = opened(&c);
    if (started(s))
        T_OK(wait_count(&box.count[CAP_INCOMPLETE], 3));
    ended(s);
    T_EQ_I(box.n, 0);
    cam.short_by = -5000u; /* more than the buffer has */
    reset_box(false);
    s = opened(&c);
    if (started(s))
        T_OK(wait_count(&box.count[CAP_INCOMPLETE], 3));
    ended(s);
    T_EQ_I(box.n, 0);
    mock_unplug(&cam);
}

static void stamps(void)
{
    plug();
    struct cap_source_config c = config();
    c.exposure_us = 2000;
    run(&c, 3);
    T_OK(box.stamped);
    T_LE(box.off_ns, 0);
    T_LE(-box.off_ns, 10 * PVX_NS_PER_S);
    int64_t soe = box.off_ns;
    /* the end of the frame: the exposure is taken off, so it is at least 2 ms back */
    cam.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
    run(&c, 3);
    T_LE(box.off_ns, -2000000);
    T_LE(soe - box.off_ns, 10 * PVX_NS_PER_S);
    cam.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN;
    run(&c, 3);
    T_OK(!box.stamped);
    cam.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_COPY;
    cam.sequence_stays = true; /* v4l2loopback: numbered here */
    run(&c, 5);
    T_OK(!box.stamped);
    T_OK(!box.ids_fall);
    T_EQ_I(box.holes, 0);
    mock_unplug(&cam);
}

/* ---- controls --------------------------------------------------------------------------------- */

static void exposure_and_gain(void)
{
    plug();
    struct cap_source_config c = config();
    c.exposure_us = 10049; /* units of 100 us */
    c.gain = 21;           /* steps of 4 */
    reset_box(true);
    cap_source *s = opened(&c);
    T_EQ_I(cam.exposure_auto, V4L2_EXPOSURE_MANUAL);
    T_EQ_I(cam.exposure, 100);
    T_EQ_I(cam.priority, 0);
    T_EQ_I(cam.autogain, 0);
    T_EQ_I(cam.gain, 20);
    if (started(s) && wait_count(&box.n, 1)) {
        T_NEAR(box.held[0]->exposure_us, 10000, 1e-9);
        T_NEAR(box.held[0]->gain, 20, 0);
    }
    ended(s);
    empty_box();
    c.exposure_us = 100;
    REFUSED(&c, PVX_EINVAL, "exposure_us = 100 refused", "300 to 204700 us");
    c.exposure_us = 10000;
    cam.control_keeps = 55;
    REFUSED(&c, PVX_EINVAL, "exposure_time_absolute = 100 refused", "has 55", "3 to 2047");
    cam.control_keeps = -1;
    cam.control_errno = EBUSY;
    REFUSED(&c, PVX_EINVAL, "auto_exposure = 1 refused", "rules it", "1 = Manual Mode");
    cam.control_errno = 0;
    c = config();
    c.features = (const struct cap_feature[]){{"exposure_dynamic_framerate", "0"},
                                              {"auto_exposure", "aperture priority mode"},
                                              {"exposure_time_absolute", "77"}};
    c.n_features = 3;
    cam.control_keeps = 156;
    REFUSED(&c, PVX_EINVAL, "has 156, because an automatic mode rules it");
    T_EQ_I(cam.exposure_auto, V4L2_EXPOSURE_APERTURE_PRIORITY);
    c.features = (const struct cap_feature[]){{"power_line_frequency", "1"}};
    c.n_features = 1;
    REFUSED(&c, PVX_EINVAL, "disabled");
    mock_unplug(&cam);
}

/* ---- names ------------------------------------------------------------------------------------ */

static void equal_webcams_are_told_apart(void)
{
    static struct mock_camera two[2], meta;
    struct pvx_diag d = {""};
    mock_init(&two[0], 0, "0042");
    mock_init(&meta, 1, "0042");
    meta.index = 1;
    meta.caps = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
    mock_init(&two[1], 2, "0043");
    two[1].bus = "usb-0000:00:14.0-2";
    mock_plug(&two[0]);
    mock_plug(&meta);
    mock_plug(&two[1]);
    n_listed = 0;
    T_EQ_I(v4l2->list(on_found, NULL, &d), PVX_OK);
    T_EQ_I(n_listed, 2); /* the metadata node is no camera */
    T_EQ_S(listed[0], "v4l2:usb-0042");
    T_EQ_S(listed[1], "v4l2:usb-0043");
    T_EQ_S(listed_formats, "YUV422_8 320x240 30 60 Hz\nYUV422_8 160x120 30 60 Hz\n"
                           "Mono8 320x240 30 60 Hz\nMono8 160x120 30 60 Hz\n"
                           "JPEG 320x240 30 60 Hz\nJPEG 160x120 30 60 Hz");
    struct cap_source_config c = config();
    c.uri = "Mock Webcam";
    REFUSED(&c, PVX_EINVAL, "2 cameras", "v4l2:usb-0042 (Mock Webcam, /dev/video0)",
            "v4l2:usb-0043 (Mock Webcam, /dev/video2)");
    c.uri = "0043";
    ended(opened(&c));
    c.uri = "/dev/video1";
    REFUSED(&c, PVX_EUNSUP, "/dev/video1", "metadata");
    mock_unplug(&two[1]);
    c.uri = "usb-0043";
    REFUSED(&c, PVX_ENOENT, "not plugged in", "v4l2:usb-0042");
    /* cheap ones all have the same serial number: the port tells them apart */
    mock_init(&two[1], 2, "0042");
    two[1].bus = "usb-0000:00:14.0-2";
    mock_plug(&two[1]);
    n_listed = 0;
    T_EQ_I(v4l2->list(on_found, NULL, &d), PVX_OK);
    T_EQ_S(listed[0], "v4l2:usb-0000:00:14.0-1");
    T_EQ_S(listed[1], "v4l2:usb-0000:00:14.0-2");
    c.uri = "usb-0042";
    REFUSED(&c, PVX_EINVAL, "2 cameras", "v4l2:usb-0000:00:14.0-2");
    c.uri = "usb-0000:00:14.0-2";
    ended(opened(&c));
    mock_unplug(&two[0]);
    mock_unplug(&meta);
    mock_unplug(&two[1]);
    c.uri = "usb-0042";
    REFUSED(&c, PVX_ENOENT, "no V4L2 camera at all");
}

/* ---- lost and found --------------------------------------------------------------------------- */

static void a_device_that_fails_is_lost_once(void)
{
    static const int errors[] = {ENODEV, EIO, EINVAL};
    plug();
    struct cap_source_config c = config();
    for (size_t i = 0; i < sizeof errors / sizeof errors[0]; i++) {
        reset_box(true);
        cap_source *s = opened(&c);
        if (started(s) && wait_count(&box.n, 3)) {
            mock_lock();
            cam.dqbuf_errno = errors[i];
            mock_unlock();
            T_OK(wait_lost());
        }
        cam.dqbuf_errno = 0;
        ended(s); /* with frames out */
        T_EQ_I(box.lost, 1);
        empty_box();
    }
    mock_unplug(&cam);
}

static struct cap_stats st;
static bool until_received(cap_capture *cap, uint64_t n, enum cap_count what)
{
    int64_t until = pvx_now_mono() + BOX_PATIENCE_NS;
    do {
        struct cap_set *set;
        if (cap_capture_next(cap, 50 * PVX_NS_PER_MS, &set) == PVX_OK)
            cap_set_release(set);
        cap_capture_stats(cap, &st);
    } while (st.camera[0].count[what] < n && pvx_now_mono() < until);
    return st.camera[0].count[what] >= n;
}

static int open_files(void)
{
    int n = 0;
    for (int fd = 0; fd < 1024; fd++)
        n += fcntl(fd, F_GETFD) != -1;
    return n;
}

static void it_is_found_again_under_another_number(void)
{
    struct cap_source_config c = config();
    c.uri = "v4l2:usb-0042";
    c.buffers = 8;
    struct cap_capture_config cfg = {.n_cameras = 1,
                                     .camera = &c,
                                     .fps = 60,
                                     .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    cap_capture *cap;
    struct pvx_diag d = {""};
    static struct mock_camera again[4];
    int files = 0, now;
    T_EQ_I(cap_capture_new(&cfg, &cap, &d), PVX_OK);
    T_EQ_I(cap_capture_start(cap, &d), PVX_OK); /* not there yet */
    for (unsigned i = 0; i < 4; i++) {
        uint64_t before = st.camera[0].count[CAP_RECEIVED];
        mock_init(&again[i], i % 2 == 0 ? 5 : 7, "0042");
        mock_plug(&again[i]);
        T_OK(until_received(cap, before + 5, CAP_RECEIVED));
        T_OK(again[i].streaming);
        mock_unplug(&again[i]);
        T_OK(until_received(cap, i + 1, CAP_LOST_CAMERA));
        /* or, on a busy machine, what the first look for it has said since */
        T_OK(strstr(st.camera[0].error, "connection lost") != NULL ||
             strstr(st.camera[0].error, "not plugged in") != NULL);
        /* our mock keeps a file and what umockdev needs for it; no more than that may stay */
        if (i == 1)
            files = open_files();
    }
    int64_t until =
        pvx_now_mono() + BOX_PATIENCE_NS; /* the camera given up last is still closing */
    while ((now = open_files()) - files > 2 * 4 && pvx_now_mono() < until)
        pvx_sleep_until_mono(pvx_now_mono() + 20 * PVX_NS_PER_MS);
    T_LE(now - files, 2 * 4);
    T_EQ_I(st.camera[0].count[CAP_LOST_CAMERA], 4);
    T_EQ_I(st.camera[0].count[CAP_BAD_SIZE] + st.camera[0].count[CAP_INCOMPLETE], 0);
    cap_capture_free(&cap);
}

static void short_frames_are_counted(void)
{
    plug();
    struct cap_source_config c = config();
    c.uri = "v4l2:usb-0042";
    c.buffers = 8;
    struct cap_capture_config cfg = {.n_cameras = 1,
                                     .camera = &c,
                                     .fps = 60,
                                     .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    cap_capture *cap;
    struct pvx_diag d = {""};
    st = (struct cap_stats){0};
    T_EQ_I(cap_capture_new(&cfg, &cap, &d), PVX_OK);
    T_EQ_I(cap_capture_start(cap, &d), PVX_OK);
    T_OK(until_received(cap, 3, CAP_RECEIVED));
    mock_lock();
    cam.short_by = 2;
    mock_unlock();
    T_OK(until_received(cap, 5, CAP_BAD_SIZE));
    mock_lock();
    cam.short_by = 0;
    mock_unlock();
    T_OK(until_received(cap, st.camera[0].count[CAP_RECEIVED] + 5, CAP_RECEIVED));
    T_EQ_I(st.camera[0].count[CAP_LOST_CAMERA], 0);
    cap_capture_free(&cap);
    mock_unplug(&cam);
}

int main(int argc, char **argv)
{
    (void)argc;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    (void)argv;
    printf("umockdev and the sanitizer both want to be loaded first\n");
    return 77;
#endif
    mock_preload(argv);
    const char *rest;
    pvx_log_set_level(PVX_LOG_ERROR);
    v4l2 = cap_backend_find("v4l2:", &rest);
    mock_start();
    T_RUN(frames_are_the_drivers_memory);
    T_RUN(without_export_or_buffers_enough);
    T_RUN(multi_planar);
    T_RUN(rows_may_be_padded);
    T_RUN(substitutes_are_refused);
    T_RUN(ranges_are_told_as_such);
    T_RUN(refusals_of_the_driver_name_the_remedy);
    T_RUN(bad_frames_are_counted_not_used);
    T_RUN(stamps);
    T_RUN(exposure_and_gain);
    T_RUN(equal_webcams_are_told_apart);
    T_RUN(a_device_that_fails_is_lost_once);
    T_RUN(it_is_found_again_under_another_number);
    T_RUN(short_frames_are_counted);
    mock_stop();
    return t_done();
}
