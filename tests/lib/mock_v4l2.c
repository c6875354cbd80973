#include "tests/lib/mock_v4l2.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <umockdev.h>
#include <unistd.h>

#include "base/clock.h"

#define PRELOAD "libumockdev-preload.so.0"
#define NUMBERS 16
#define PAGE    4096

struct mock_state {
    UMockdevIoctlBase *handler;
    char *root, *sys[3]; /* in sysfs: USB device, its interface, the node */
    char node[64], file[512];
    int fd; /* the file behind the node */
    bool gone;
    struct v4l2_format fmt;
    struct v4l2_fract period;
    size_t size;                  /* of an image */
    unsigned queue[MOCK_BUFFERS]; /* order in which buffers were queued */
    bool is_queued[MOCK_BUFFERS];
    uint32_t sequence;
    int64_t due;
};

static UMockdevTestbed *testbed;
static GMainLoop *loop;
static GThread *thread;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

void mock_lock(void)
{
    pthread_mutex_lock(&lock);
}

void mock_unlock(void)
{
    pthread_mutex_unlock(&lock);
}

/* ---- the camera ------------------------------------------------------------------------------- */

static bool mplane(const struct mock_camera *c)
{
    return (c->caps & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0;
}

static uint32_t type_of(const struct mock_camera *c)
{
    return mplane(c) ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
}

static uint32_t buffer_size(const struct mock_state *s)
{
    return (uint32_t)((s->size + PAGE - 1) / PAGE * PAGE);
}

static void set_format(struct mock_camera *c, struct v4l2_format *f)
{
    struct mock_state *s = c->state;
    uint32_t w, code, bytes = 1;
    if (mplane(c)) {
        w = f->fmt.pix_mp.width;
        code = f->fmt.pix_mp.pixelformat;
    } else {
        w = f->fmt.pix.width;
        code = f->fmt.pix.pixelformat;
    }
    bool known = false;
    for (int i = 0; i < 4 && c->fourcc[i] != 0; i++)
        known |= c->fourcc[i] == code;
    if (!known)
        code = c->fourcc[0];
    if (c->substitute != 0)
        code = c->substitute;
    bool small = w < 240;
    w = small ? 160 : 320;
    uint32_t h = small ? 120 : 240;
    if (code == V4L2_PIX_FMT_YUYV)
        bytes = 2;
    uint32_t line = c->bytesperline != 0 ? c->bytesperline : w * bytes;
    if (code == V4L2_PIX_FMT_MJPEG)
        line = 0;
    uint32_t size = line > 0 ? line * h : w * h;
    uint32_t field = c->field != 0 ? c->field : V4L2_FIELD_NONE;
    if (mplane(c)) {
        struct v4l2_pix_format_mplane *m = &f->fmt.pix_mp;
        *m = (struct v4l2_pix_format_mplane){
            .width = w, .height = h, .pixelformat = code, .field = field, .num_planes = 1};
        m->plane_fmt[0].bytesperline = line;
        m->plane_fmt[0].sizeimage = size + c->data_offset;
    } else {
        f->fmt.pix = (struct v4l2_pix_format){.width = w,
                                              .height = h,
                                              .pixelformat = code,
                                              .field = field,
                                              .bytesperline = line,
                                              .sizeimage = size,
                                              .priv = V4L2_PIX_FMT_PRIV_MAGIC};
    }
    s->fmt = *f;
    s->size = size + c->data_offset;
}

static int query_control(const struct mock_camera *c, struct v4l2_query_ext_ctrl *q)
{
    static const struct {
        uint32_t id, type;
        const char *name;
        int32_t lo, hi, by;
        uint32_t flags;
    } all[] = {
        {V4L2_CID_GAIN, V4L2_CTRL_TYPE_INTEGER, "Gain", 0, 100, 4, 0},
        {V4L2_CID_AUTOGAIN, V4L2_CTRL_TYPE_BOOLEAN, "Gain, Automatic", 0, 1, 1, 0},
        {V4L2_CID_POWER_LINE_FREQUENCY, V4L2_CTRL_TYPE_MENU, "Power Line Frequency", 0, 2, 1,
         V4L2_CTRL_FLAG_DISABLED},
        {V4L2_CID_EXPOSURE_AUTO, V4L2_CTRL_TYPE_MENU, "Auto Exposure", 0, 3, 1, 0},
        {V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CTRL_TYPE_INTEGER, "Exposure Time, Absolute", 3, 2047, 1,
         0},
        {V4L2_CID_EXPOSURE_AUTO_PRIORITY, V4L2_CTRL_TYPE_BOOLEAN, "Exposure, Dynamic Framerate", 0,
         1, 1, 0},
    };
    /* in order of their numbers, as a driver gives them */
    bool next = (q->id & (V4L2_CTRL_FLAG_NEXT_CTRL | V4L2_CTRL_FLAG_NEXT_COMPOUND)) != 0;
    uint32_t id = q->id & V4L2_CTRL_ID_MASK;
    size_t n = sizeof all / sizeof all[0], k = n;
    for (size_t i = 0; i < n; i++)
        if (next ? all[i].id > id && (k == n || all[i].id < all[k].id) : all[i].id == id)
            k = i;
    if (k == n)
        return EINVAL;
    *q = (struct v4l2_query_ext_ctrl){.id = all[k].id,
                                      .type = all[k].type,
                                      .minimum = all[k].lo,
                                      .maximum = all[k].hi,
                                      .step = (uint64_t)all[k].by,
                                      .flags = all[k].flags};
    snprintf(q->name, sizeof q->name, "%s", all[k].name);
    if (q->id == V4L2_CID_EXPOSURE_ABSOLUTE && c->exposure_auto != V4L2_EXPOSURE_MANUAL)
        q->flags |= V4L2_CTRL_FLAG_INACTIVE;
    return 0;
}

static int32_t *control(struct mock_camera *c, uint32_t id)
{
    switch (id) {
    case V4L2_CID_GAIN: return &c->gain;
    case V4L2_CID_AUTOGAIN: return &c->autogain;
    case V4L2_CID_EXPOSURE_AUTO: return &c->exposure_auto;
    case V4L2_CID_EXPOSURE_ABSOLUTE: return &c->exposure;
    case V4L2_CID_EXPOSURE_AUTO_PRIORITY: return &c->priority;
    }
    return NULL;
}

static int access_control(struct mock_camera *c, struct v4l2_ext_control *x, bool write)
{
    int32_t *v = control(c, x->id);
    if (v == NULL)
        return EINVAL;
    if (write && c->control_errno != 0)
        return c->control_errno;
    if (!write) {
        x->value = *v;
        return 0;
    }
    *v = x->id == V4L2_CID_GAIN ? (x->value + 2) / 4 * 4 : x->value; /* in its steps */
    if (x->id == V4L2_CID_EXPOSURE_ABSOLUTE && c->control_keeps >= 0)
        *v = c->control_keeps;
    return 0;
}

static int get_frame(struct mock_camera *c, struct v4l2_buffer *b, struct v4l2_plane *plane)
{
    struct mock_state *s = c->state;
    int64_t now = pvx_now_mono();
    if (s->gone)
        return ENODEV;
    if (c->dqbuf_errno != 0)
        return c->dqbuf_errno;
    if (!c->streaming)
        return EINVAL;
    if (now < s->due || c->queued == 0) {
        c->refused_reads++;
        return EAGAIN;
    }
    s->due += 1000000000LL * s->period.numerator / s->period.denominator;
    if (s->due < now)
        s->due = now;
    unsigned i = s->queue[0];
    memmove(s->queue, s->queue + 1, --c->queued * sizeof s->queue[0]);
    s->is_queued[i] = false;
    c->frames++;
    if (c->frames > 1 && !c->sequence_stays)
        s->sequence += c->skip_every > 0 && c->frames % c->skip_every == 0 ? 3 : 1;
    unsigned char row[PAGE];
    memset(row, (int)(1 + s->sequence % 250), sizeof row);
    uint32_t room = buffer_size(s);
    for (uint32_t at = 0; at < room; at += PAGE)
        if (pwrite(s->fd, row, PAGE, (off_t)i * room + at) != PAGE)
            return EIO;
    uint32_t used = (uint32_t)s->size - c->short_by;
    if (plane != NULL) {
        plane->bytesused = used;
        plane->length = room;
        plane->data_offset = c->data_offset;
    } else {
        b->bytesused = used;
        b->length = room;
    }
    b->index = i;
    b->sequence = s->sequence;
    b->flags = V4L2_BUF_FLAG_DONE | c->stamp_flags;
    if (c->error_every > 0 && c->frames % c->error_every == 0)
        b->flags |= V4L2_BUF_FLAG_ERROR;
    b->timestamp.tv_sec = now / 1000000000;
    b->timestamp.tv_usec = now % 1000000000 / 1000;
    return 0;
}

static int queue_frame(struct mock_camera *c, unsigned i)
{
    struct mock_state *s = c->state;
    if (i >= c->buffers || s->is_queued[i]) /* twice: the client's fault, and a test's */
        return EINVAL;
    s->queue[c->queued++] = i;
    s->is_queued[i] = true;
    return 0;
}

static void all_back(struct mock_camera *c)
{
    c->queued = 0;
    c->streaming = false;
    memset(c->state->is_queued, 0, sizeof c->state->is_queued);
}

static int request_buffers(struct mock_camera *c, struct v4l2_requestbuffers *r)
{
    struct mock_state *s = c->state;
    if (c->reqbufs_errno != 0)
        return c->reqbufs_errno;
    unsigned most = c->max_buffers > 0 ? c->max_buffers : MOCK_BUFFERS;
    all_back(c);
    if (r->count > most)
        r->count = most;
    c->buffers = r->count;
    if (ftruncate(s->fd, (off_t)(r->count > 0 ? r->count : 1) * buffer_size(s)) != 0)
        return EIO;
    return 0;
}

static int frame_size(const struct mock_camera *c, struct v4l2_frmsizeenum *z)
{
    if (z->index > (c->ranges ? 0 : 1))
        return EINVAL;
    if (c->ranges) {
        z->type = V4L2_FRMSIZE_TYPE_STEPWISE;
        z->stepwise = (struct v4l2_frmsize_stepwise){160, 320, 16, 120, 240, 8};
        return 0;
    }
    z->type = V4L2_FRMSIZE_TYPE_DISCRETE;
    z->discrete.width = z->index == 0 ? 320 : 160;
    z->discrete.height = z->index == 0 ? 240 : 120;
    return 0;
}

static int frame_rate(const struct mock_camera *c, struct v4l2_frmivalenum *v)
{
    static const uint32_t hz[] = {30, 60};
    if (v->index > (c->ranges ? 0 : 1))
        return EINVAL;
    if (c->ranges) {
        v->type = V4L2_FRMIVAL_TYPE_CONTINUOUS;
        v->stepwise = (struct v4l2_frmival_stepwise){{1, 120}, {1, 5}, {1, 1}};
        return 0;
    }
    v->type = V4L2_FRMIVAL_TYPE_DISCRETE;
    v->discrete = (struct v4l2_fract){1, hz[v->index]};
    return 0;
}

static int set_rate(struct mock_camera *c, struct v4l2_streamparm *p, bool write)
{
    struct mock_state *s = c->state;
    if (c->no_parm)
        return ENOTTY;
    struct v4l2_fract *t = &p->parm.capture.timeperframe;
    if (write && !c->rate_fixed)
        s->period = *t;
    *t = s->period;
    p->parm.capture.capability = V4L2_CAP_TIMEPERFRAME;
    return 0;
}

/* ---- its ioctls ------------------------------------------------------------------------------- */

union argument {
    char bytes[1024];
    struct v4l2_capability cap;
    struct v4l2_fmtdesc desc;
    struct v4l2_format fmt;
    struct v4l2_streamparm parm;
    struct v4l2_requestbuffers req;
    struct v4l2_buffer buf;
    struct v4l2_frmsizeenum size;
    struct v4l2_frmivalenum rate;
    struct v4l2_query_ext_ctrl query;
    struct v4l2_querymenu menu;
    struct v4l2_ext_controls controls;
};

static void capability(const struct mock_camera *c, struct v4l2_capability *cap)
{
    snprintf((char *)cap->card, sizeof cap->card, "%s", c->card);
    snprintf((char *)cap->driver, sizeof cap->driver, "mock");
    snprintf((char *)cap->bus_info, sizeof cap->bus_info, "%s", c->bus);
    cap->device_caps = c->caps;
    cap->capabilities = c->caps | V4L2_CAP_DEVICE_CAPS;
}

/* What lies behind a pointer of the argument. */
static UMockdevIoctlData *behind(UMockdevIoctlData *data, size_t offset, size_t len, void *out)
{
    GError *err = NULL;
    guint8 *bytes = NULL;
    gint n = 0;
    UMockdevIoctlData *d = umockdev_ioctl_data_resolve(data, offset, len, &err);
    if (d == NULL) {
        g_clear_error(&err);
        return NULL;
    }
    umockdev_ioctl_data_retrieve(d, &bytes, &n);
    memcpy(out, bytes, len < (size_t)n ? len : (size_t)n);
    g_free(bytes);
    return d;
}

static void put(UMockdevIoctlData *d, void *bytes, size_t len)
{
    umockdev_ioctl_data_update(d, 0, bytes, (gint)len);
    g_object_unref(d);
}

static int buffers(struct mock_camera *c, unsigned long request, union argument *a,
                   UMockdevIoctlData *data)
{
    struct mock_state *s = c->state;
    struct v4l2_plane plane = {0}, *p = NULL;
    UMockdevIoctlData *d = NULL;
    if (a->buf.type != type_of(c))
        return EINVAL;
    if (mplane(c)) {
        d = behind(data, offsetof(struct v4l2_buffer, m), sizeof plane, &plane);
        if (d == NULL)
            return EFAULT;
        p = &plane;
    }
    int e = 0;
    if (request == VIDIOC_QUERYBUF) {
        if (p != NULL) {
            p->length = buffer_size(s);
            p->m.mem_offset = a->buf.index * buffer_size(s);
        } else {
            a->buf.length = buffer_size(s);
            a->buf.m.offset = a->buf.index * buffer_size(s);
        }
    } else if (request == VIDIOC_QBUF) {
        e = queue_frame(c, a->buf.index);
    } else {
        e = get_frame(c, &a->buf, p);
    }
    if (d != NULL)
        put(d, &plane, sizeof plane);
    return e;
}

static int controls(struct mock_camera *c, union argument *a, UMockdevIoctlData *data, bool write)
{
    struct v4l2_ext_control x;
    UMockdevIoctlData *d = behind(data, offsetof(struct v4l2_ext_controls, controls), sizeof x, &x);
    if (a->controls.count != 1 || d == NULL)
        return EINVAL;
    int e = access_control(c, &x, write);
    put(d, &x, sizeof x);
    return e;
}

static int answer(struct mock_camera *c, unsigned long request, union argument *a,
                  UMockdevIoctlData *data)
{
    struct mock_state *s = c->state;
    if (s->gone)
        return ENODEV;
    if (c->interrupts > 0) {
        c->interrupts--;
        return EINTR;
    }
    switch (request) {
    case VIDIOC_QUERYCAP: capability(c, &a->cap); return c->open_errno;
    case VIDIOC_ENUM_FMT:
        if (a->desc.index > 3 || c->fourcc[a->desc.index] == 0)
            return EINVAL;
        a->desc.pixelformat = c->fourcc[a->desc.index];
        return 0;
    case VIDIOC_ENUM_FRAMESIZES: return frame_size(c, &a->size);
    case VIDIOC_ENUM_FRAMEINTERVALS: return frame_rate(c, &a->rate);
    case VIDIOC_G_FMT: a->fmt = s->fmt; return 0;
    case VIDIOC_S_FMT:
        if (c->s_fmt_errno == 0)
            set_format(c, &a->fmt);
        return c->s_fmt_errno;
    case VIDIOC_G_PARM: return set_rate(c, &a->parm, false);
    case VIDIOC_S_PARM: return set_rate(c, &a->parm, true);
    case VIDIOC_REQBUFS: return request_buffers(c, &a->req);
    case VIDIOC_QUERYBUF:
    case VIDIOC_QBUF:
    case VIDIOC_DQBUF: return buffers(c, request, a, data);
    case VIDIOC_STREAMON:
        if (c->streamon_errno != 0)
            return c->streamon_errno;
        c->streaming = true;
        c->streamons++;
        s->sequence = 0;
        c->frames = 0;
        s->due = pvx_now_mono();
        return 0;
    case VIDIOC_STREAMOFF: all_back(c); return 0;
    case VIDIOC_QUERY_EXT_CTRL: return query_control(c, &a->query);
    case VIDIOC_QUERYMENU:
        if (a->menu.id != V4L2_CID_EXPOSURE_AUTO ||
            (a->menu.index != V4L2_EXPOSURE_MANUAL &&
             a->menu.index != V4L2_EXPOSURE_APERTURE_PRIORITY))
            return EINVAL;
        snprintf((char *)a->menu.name, sizeof a->menu.name, "%s",
                 a->menu.index == V4L2_EXPOSURE_MANUAL ? "Manual Mode" : "Aperture Priority Mode");
        return 0;
    case VIDIOC_G_EXT_CTRLS: return controls(c, a, data, false);
    case VIDIOC_S_EXT_CTRLS: return controls(c, a, data, true);
    }
    return ENOTTY;
}

static gboolean on_ioctl(UMockdevIoctlBase *base, UMockdevIoctlClient *client, gpointer user)
{
    struct mock_camera *c = user;
    gulong request = umockdev_ioctl_client_get_request(client);
    size_t size = _IOC_SIZE(request);
    union argument a;
    (void)base;
    memset(&a, 0, sizeof a);
    UMockdevIoctlData *d =
        size <= sizeof a ? behind(umockdev_ioctl_client_get_arg(client), 0, size, &a) : NULL;
    int e = EFAULT;
    if (d != NULL) {
        mock_lock();
        e = answer(c, request, &a, d);
        mock_unlock();
        put(d, &a, size);
    }
    umockdev_ioctl_client_complete(client, e == 0 ? 0 : -1, e);
    return TRUE;
}

/* ---- plugging --------------------------------------------------------------------------------- */

void mock_init(struct mock_camera *c, unsigned number, const char *serial)
{
    *c = (struct mock_camera){.card = "Mock Webcam",
                              .bus = "usb-0000:00:14.0-1",
                              .serial = serial,
                              .caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING,
                              .number = number,
                              .fourcc = {V4L2_PIX_FMT_YUYV, V4L2_PIX_FMT_GREY, V4L2_PIX_FMT_MJPEG},
                              .stamp_flags =
                                  V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
                              .exposure_auto = V4L2_EXPOSURE_APERTURE_PRIORITY,
                              .exposure = 156,
                              .priority = 1,
                              .autogain = 1,
                              .gain = 8,
                              .control_keeps = -1};
}

static void plug_usb(struct mock_camera *c)
{
    struct mock_state *s = c->state;
    char name[32], interface[64];
    snprintf(name, sizeof name, "usb%u", c->number);
    snprintf(interface, sizeof interface, "usb%u:1.0", c->number);
    s->sys[0] = umockdev_testbed_add_device(testbed, "usb", name, NULL, "idVendor", "1d6d",
                                            "idProduct", "0501", "serial", c->serial, NULL,
                                            "DEVTYPE", "usb_device", NULL);
    s->sys[1] = umockdev_testbed_add_device(testbed, "usb", interface, s->sys[0], NULL, "DEVTYPE",
                                            "usb_interface", NULL);
}

/* umockdev's wrapper of open() ends the program when it finds a node of which nobody answers the ioctls (yet,
 * or any more).  So a node has its name only while somebody does, and its listener is kept until the
 * number is used again: an open() that has just begun finds it. */
static char listening[NUMBERS][64];

static void stop_listening(unsigned number)
{
    if (listening[number][0] != '\0')
        umockdev_testbed_detach_ioctl(testbed, listening[number], NULL);
    listening[number][0] = '\0';
}

void mock_plug(struct mock_camera *c)
{
    if (c->number >= NUMBERS)
        abort();
    stop_listening(c->number);
    struct mock_state *s = c->state = calloc(1, sizeof *s);
    char name[32], index[8];
    snprintf(name, sizeof name, "video%u", c->number);
    snprintf(index, sizeof index, "%u", c->index);
    snprintf(s->node, sizeof s->node, "/dev/%s", name);
    s->root = umockdev_testbed_get_root_dir(testbed);
    if (c->serial != NULL)
        plug_usb(c);
    s->sys[2] = umockdev_testbed_add_device(testbed, "video4linux", name, s->sys[1], "index", index,
                                            NULL, "DEVNAME", s->node, NULL);
    snprintf(s->file, sizeof s->file, "%s%s", s->root, s->node);
    char unnamed[600];
    snprintf(unnamed, sizeof unnamed, "%s/node", s->root);
    s->fd = open(unnamed, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    struct v4l2_format f = {.type = type_of(c)};
    set_format(c, &f);
    s->period = (struct v4l2_fract){1, 30};
    if (s->fd < 0 || ftruncate(s->fd, PAGE) != 0)
        abort();
    s->handler = umockdev_ioctl_base_new();
    g_signal_connect(s->handler, "handle-ioctl", G_CALLBACK(on_ioctl), c);
    GError *err = NULL;
    if (!umockdev_testbed_attach_ioctl(testbed, s->node, s->handler, &err) ||
        rename(unnamed, s->file) != 0)
        abort();
}

void mock_unplug(struct mock_camera *c)
{
    struct mock_state *s = c->state;
    mock_lock();
    s->gone = true;
    mock_unlock();
    unlink(s->file);
    snprintf(listening[c->number], sizeof listening[0], "%s", s->node);
    for (int i = 2; i >= 0; i--)
        if (s->sys[i] != NULL)
            umockdev_testbed_remove_device(testbed, s->sys[i]);
}

static void *run_loop(void *arg)
{
    (void)arg;
    g_main_loop_run(loop);
    return NULL;
}

void mock_preload(char **argv)
{
    const char *now = getenv("LD_PRELOAD");
    if (now != NULL && strstr(now, PRELOAD) != NULL)
        return;
    setenv("LD_PRELOAD", PRELOAD, 1);
    execv("/proc/self/exe", argv);
    abort();
}

void mock_start(void)
{
    testbed = umockdev_testbed_new();
    char dev[600];
    char *root = umockdev_testbed_get_root_dir(testbed);
    snprintf(dev, sizeof dev, "%s/dev", root);
    g_mkdir_with_parents(dev, 0755);
    g_free(root);
    loop = g_main_loop_new(NULL, FALSE);
    thread = g_thread_new("mock", run_loop, NULL);
}

void mock_stop(void)
{
    for (unsigned i = 0; i < NUMBERS; i++)
        stop_listening(i);
    g_main_loop_quit(loop);
    g_thread_join(thread);
    g_main_loop_unref(loop);
    g_object_unref(testbed);
}
