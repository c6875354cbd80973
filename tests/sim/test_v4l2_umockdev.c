/* test_v4l2_umockdev.c - the v4l2: backend on cameras that misbehave as a good driver will not on request:
 * the ioctls are answered by umockdev.  What real drivers do is in tests/vm/vm_v4l2.c. */
#include "tests/lib/rig.h"
#include "tests/lib/v4l2_bed.h"

#include <limits.h>
#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include "base/log.h"
#include "capture/rig/backends.h"
#include "capture/rig/capture.h"
#include "tests/lib/mock_v4l2.h"

static struct mock_camera cam;

static struct cap_source_config config(void)
{
    struct cap_source_config c = source_of("usb-0042", 320, 240, CAP_YUYV, 60);
    c.buffers = 6;
    return c;
}

static void plug(void)
{
    mock_init(&cam, 0, "0042");
    mock_plug(&cam);
}

/* Frames until n more have come, then stop. */
static void run(const struct cap_source_config *c, uint64_t n)
{
    cap_source *s = running(c, false);
    if (s != NULL)
        T_OK(wait_count(&box, &box.n, n));
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

T_CASE(frames_are_the_drivers_memory)
{
    plug();
    struct cap_source_config c = config();
    reset_box(&box, true);
    cam.interrupts = 3; /* EINTR is asked again */
    cap_source *s = opened(&c);
    if (started(s)) {
        T_OK(wait_count(&box, &box.count[CAP_UNDERRUN], 3)); /* all 6 are out, the driver goes on */
        T_EQ_I(box.n_held, 6);
        for (unsigned i = 0; i < box.n_held; i++) {
            const struct cap_image *img = &box.held[i]->img;
            T_EQ_I(((const unsigned char *)img->data)[0], 1 + box.held[i]->id % 250);
            T_EQ_I(img->size, 320 * 240 * 2);
            T_EQ_I(img->stride, 640);
        }
        keep_box(&box, false);
        empty_box(&box);
        T_OK(wait_more(&box, &box.n, 12));
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

T_CASE(without_buffers_enough)
{
    plug();
    struct cap_source_config c = config();
    cam.max_buffers = 4; /* fewer than 6 + 2: copies */
    cap_source *s = running(&c, true);
    if (s != NULL) {
        T_OK(wait_count(&box, &box.count[CAP_UNDERRUN], 3));
        T_EQ_I(box.n_held, 6);
        for (unsigned i = 0; i < box.n_held; i++)
            T_EQ_I(((const unsigned char *)box.held[i]->img.data)[9], 1 + box.held[i]->id % 250);
        T_EQ_I(cam.buffers, 4);
        T_EQ_I(cam.queued, 4);
    }
    ended(s);
    empty_box(&box);
    cam.max_buffers = 2;
    REFUSED(&c, PVX_ENOMEM, "gives only 2 buffers");
    mock_unplug(&cam);
}

T_CASE(multi_planar)
{
    mock_init(&cam, 0, "0042");
    cam.caps = V4L2_CAP_VIDEO_CAPTURE_MPLANE | V4L2_CAP_STREAMING;
    cam.data_offset = 64;
    mock_plug(&cam);
    struct cap_source_config c = config();
    c.fmt = CAP_GREY8;
    cap_source *s = running(&c, true);
    if (s != NULL && wait_count(&box, &box.n, 3)) {
        const struct cap_frame *f = box.held[2];
        T_EQ_I(f->img.size, 320 * 240);
        T_EQ_I((uintptr_t)f->img.data % 4096, 64);
        T_EQ_I(((const unsigned char *)f->img.data)[0], 1 + f->id % 250);
    }
    ended(s);
    empty_box(&box);
    mock_unplug(&cam);
}

T_CASE(rows_may_be_padded)
{
    plug();
    cam.bytesperline = 704;
    struct cap_source_config c = config();
    cap_source *s = running(&c, true);
    if (s != NULL && wait_count(&box, &box.n, 1)) {
        T_EQ_I(box.held[0]->img.stride, 704);
        T_EQ_I(box.held[0]->img.size, 704 * 240);
    }
    ended(s);
    empty_box(&box);
    cam.bytesperline = 600; /* a driver that is wrong about itself */
    REFUSED(&c, PVX_EIO, "driver mock", "600 bytes per row");
    mock_unplug(&cam);
}

/* ---- what a camera may not do ----------------------------------------------------------------- */

T_CASE(substitutes_are_refused)
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

T_CASE(ranges_are_told_as_such)
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

T_CASE(refusals_of_the_driver_name_the_remedy)
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
        T_EQ_I(v4l2->start(s, &box_sink, &d), k[i].want);
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

T_CASE(bad_frames_are_counted_not_used)
{
    plug();
    struct cap_source_config c = config();
    cam.error_every = 3;
    run(&c, 12);
    T_OK(box.count[CAP_INCOMPLETE] >= 5);
    T_EQ_I(box.count[CAP_ID_GAP], 0); /* they were numbered and seen */
    T_LE(box.holes, box.count[CAP_INCOMPLETE]);
    T_LE(box.count[CAP_INCOMPLETE], box.holes + 1); /* behind the last good one */
    cam.error_every = 0;
    cam.skip_every = 4;
    run(&c, 12);
    T_OK(box.holes >= 4);
    T_EQ_I(box.holes, box.count[CAP_ID_GAP]);
    cam.skip_every = 0;
    cam.short_by = 320 * 240 * 2; /* nothing in it */
    cap_source *s = running(&c, false);
    if (s != NULL)
        T_OK(wait_count(&box, &box.count[CAP_INCOMPLETE], 3));
    ended(s);
    T_EQ_I(box.n, 0);
    cam.short_by = -5000u; /* more than the buffer has */
    s = running(&c, false);
    if (s != NULL)
        T_OK(wait_count(&box, &box.count[CAP_INCOMPLETE], 3));
    ended(s);
    T_EQ_I(box.n, 0);
    mock_unplug(&cam);
}

T_CASE(stamps)
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

T_CASE(exposure_and_gain)
{
    plug();
    struct cap_source_config c = config();
    c.exposure_us = 10049; /* units of 100 us */
    c.gain = 21;           /* steps of 4 */
    reset_box(&box, true);
    cap_source *s = opened(&c);
    T_EQ_I(cam.exposure_auto, V4L2_EXPOSURE_MANUAL);
    T_EQ_I(cam.exposure, 100);
    T_EQ_I(cam.priority, 0);
    T_EQ_I(cam.autogain, 0);
    T_EQ_I(cam.gain, 20);
    if (started(s) && wait_count(&box, &box.n, 1)) {
        T_NEAR(box.held[0]->exposure_us, 10000, 1e-9);
        T_NEAR(box.held[0]->gain, 20, 0);
    }
    ended(s);
    empty_box(&box);
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
    FEATURES(&c, {"exposure_dynamic_framerate", "0"}, {"auto_exposure", "aperture priority mode"},
             {"exposure_time_absolute", "77"});
    cam.control_keeps = 156;
    REFUSED(&c, PVX_EINVAL, "has 156, because an automatic mode rules it");
    T_EQ_I(cam.exposure_auto, V4L2_EXPOSURE_APERTURE_PRIORITY);
    FEATURES(&c, {"power_line_frequency", "1"});
    REFUSED(&c, PVX_EINVAL, "disabled");
    cam.control_keeps = -1;
    c.exposure_us = 10000;
    c.gain = 20;
    FEATURES(&c, {"exposure_time_absolute", "77"});
    REFUSED(&c, PVX_EINVAL,
            "exposure_us: 10000 and `features: exposure_time_absolute: 77` disagree");
    FEATURES(&c, {"auto_exposure", "aperture priority mode"});
    REFUSED(&c, PVX_EINVAL, "exposure_us: 10000 and `features: auto_exposure: aperture prio");
    FEATURES(&c, {"gain", "40"});
    REFUSED(&c, PVX_EINVAL, "gain: 20 and `features: gain: 40` disagree; leave one of them out");
    FEATURES(&c, {"exposure_time_absolute", "100"}, {"gain", "20"}); /* as the keys say */
    s = opened(&c);
    T_OK(s != NULL);
    ended(s);
    mock_unplug(&cam);
}

/* ---- names ------------------------------------------------------------------------------------ */

static void serial_is(cap_source *s, const char *want)
{
    struct cap_health h;
    v4l2->health(s, &h);
    T_EQ_S(h.serial, want);
    T_OK(isnan(h.temperature_c));
}

T_CASE(equal_webcams_are_told_apart)
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
    cap_source *its = opened(&c);
    serial_is(its, "usb-0043");
    ended(its);
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
    its = opened(&c);
    serial_is(its, "");
    ended(its);
    mock_unplug(&two[0]);
    mock_unplug(&meta);
    mock_unplug(&two[1]);
    c.uri = "usb-0042";
    REFUSED(&c, PVX_ENOENT, "no V4L2 camera at all");
}

/* ---- lost and found --------------------------------------------------------------------------- */

T_CASE(a_device_that_fails_is_lost_once)
{
    static const int errors[] = {ENODEV, EIO, EINVAL};
    plug();
    struct cap_source_config c = config();
    for (size_t i = 0; i < sizeof errors / sizeof errors[0]; i++) {
        cap_source *s = running(&c, true);
        if (s != NULL && wait_count(&box, &box.n, 3)) {
            mock_lock();
            cam.dqbuf_errno = errors[i];
            mock_unlock();
            T_OK(wait_count(&box, &box.lost, 1));
        }
        cam.dqbuf_errno = 0;
        ended(s); /* with frames out */
        T_EQ_I(box.lost, 1);
        empty_box(&box);
    }
    mock_unplug(&cam);
}

static struct rig r;

static void start(void)
{
    struct cap_source_config c = config();
    c.uri = "v4l2:usb-0042";
    c.buffers = 8;
    rig_init(&r, 1, 60, c);
    rig_start(&r);
}

static int open_files(void)
{
    int n = 0;
    for (int fd = 0; fd < 1024; fd++)
        n += fcntl(fd, F_GETFD) != -1;
    return n;
}

/* The least that open files grew by from one of the counts to the next. */
static int least_growth(const int *files, int n)
{
    int least = INT_MAX;
    for (int i = 1; i < n; i++)
        least = files[i] - files[i - 1] < least ? files[i] - files[i - 1] : least;
    return least;
}

T_CASE(it_is_found_again_under_another_number)
{
    static struct mock_camera again[4];
    int files[4];
    start(); /* not there yet */
    for (unsigned i = 0; i < 4; i++) {
        uint64_t before = r.st.camera[0].count[CAP_RECEIVED];
        mock_init(&again[i], i % 2 == 0 ? 5 : 7, "0042");
        mock_plug(&again[i]);
        T_OK(rig_counts(&r, 0, CAP_RECEIVED, before + 5));
        T_OK(again[i].streaming);
        mock_unplug(&again[i]);
        T_OK(rig_counts(&r, 0, CAP_LOST_CAMERA, i + 1));
        /* or, on a busy machine, what the first look for it has said since */
        T_OK(strstr(r.st.camera[0].error, "connection lost") != NULL ||
             strstr(r.st.camera[0].error, "not plugged in") != NULL);
        files[i] = open_files();
    }
    /* Our mock keeps a file and what umockdev needs for it; were more to stay, it would each time.  (The
     * camera given up last is still closing.) */
    UNTIL ((files[3] = open_files(), least_growth(files, 4) <= 4))
        pvx_sleep_until_mono(pvx_now_mono() + 20 * PVX_NS_PER_MS);
    T_LE(least_growth(files, 4), 4);
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA], 4);
    T_EQ_I(r.st.camera[0].count[CAP_BAD_SIZE] + r.st.camera[0].count[CAP_INCOMPLETE], 0);
    rig_end(&r);
}

T_CASE(short_frames_are_counted)
{
    plug();
    start();
    T_OK(rig_counts(&r, 0, CAP_RECEIVED, 3));
    mock_lock();
    cam.short_by = 2;
    mock_unlock();
    T_OK(rig_counts(&r, 0, CAP_BAD_SIZE, 5));
    mock_lock();
    cam.short_by = 0;
    mock_unlock();
    T_OK(rig_counts(&r, 0, CAP_RECEIVED, r.st.camera[0].count[CAP_RECEIVED] + 5));
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA], 0);
    rig_end(&r);
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
    t_run();
    mock_stop();
    return t_done();
}
