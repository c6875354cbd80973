/* What is asked for with gige.* is so in the kernel and at the camera: the receiving thread's priority, the
 * room of its socket, whether lost packets are asked for again.  And what the host refuses is said, once,
 * with a remedy, and capture goes on. */
#include <arv.h>
#include <ctype.h>
#include <dirent.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "capture/gev/ring.h"
#include "tests/lib/logged.h"
#include "tests/lib/arvbed.h"

#define PRIORITY 37     /* nobody else has it */
#define ROOM     123456 /* nor this */

/* Calls fn for every number that is a name in the folder; the sum of what it says. */
static int each_of(const char *folder, int (*fn)(int n, int arg), int arg)
{
    DIR *d = opendir(folder);
    struct dirent *e;
    int sum = 0;
    T_OK(d != NULL);
    while (d != NULL && (e = readdir(d)) != NULL)
        if (isdigit((unsigned char)e->d_name[0]))
            sum += fn(atoi(e->d_name), arg);
    if (d != NULL)
        closedir(d);
    return sum;
}

static int has_priority(int tid, int priority)
{
    struct sched_param p = {0};
    int policy = sched_getscheduler(tid) & ~SCHED_RESET_ON_FORK;
    return policy == SCHED_RR && sched_getparam(tid, &p) == 0 && p.sched_priority == priority;
}

static int in_real_time(int tid, int unused)
{
    int policy = sched_getscheduler(tid) & ~SCHED_RESET_ON_FORK;
    (void)unused;
    return policy == SCHED_RR || policy == SCHED_FIFO;
}

/* An UDP socket with so much room: the kernel doubles what it is told. */
static int has_room(int fd, int bytes)
{
    int type = 0, got = 0;
    socklen_t a = sizeof type, b = sizeof got;
    return getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &a) == 0 && type == SOCK_DGRAM &&
           getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &got, &b) == 0 && got == 2 * bytes;
}

/* ---- priority --------------------------------------------------------------------------------- */

static bool set_nice_capability(bool on)
{
    struct __user_cap_header_struct h = {_LINUX_CAPABILITY_VERSION_3, 0};
    struct __user_cap_data_struct c[2];
    uint32_t bit = 1u << CAP_SYS_NICE;
    if (syscall(SYS_capget, &h, c) != 0)
        return false;
    c[0].effective = on ? c[0].effective | bit : c[0].effective & ~bit;
    return syscall(SYS_capset, &h, c) == 0;
}

/* May a thread of this process run in real time?  Tried, and undone. */
static bool may_run_in_real_time(void)
{
    struct sched_param p = {.sched_priority = PRIORITY}, none = {0};
    return sched_setscheduler(0, SCHED_RR, &p) == 0 &&
           sched_setscheduler(0, SCHED_OTHER, &none) == 0;
}

/* As an ordinary user, on a machine without RtKit.  Said once in a process: the first case. */
T_CASE(without_the_right_it_is_said_and_capture_goes_on)
{
    bed_all(25);
    struct rlimit was, none;
    T_EQ_I(getrlimit(RLIMIT_RTPRIO, &was), 0);
    none = was;
    none.rlim_cur = 0;
    setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/nowhere", 1);
    T_EQ_I(setrlimit(RLIMIT_RTPRIO, &none), 0);
    T_OK(set_nice_capability(false)); /* threads started from now on are without it, too */
    T_OK(!may_run_in_real_time());
    log_begin(PVX_LOG_WARN);
    struct session s[2];
    for (int c = 0; c < 2; c++) {
        struct cap_source_config config = bed_source(c);
        config.gige.rt_priority = PRIORITY;
        config.gige.socket_buffer = ROOM; /* that is there */
        if (begin(&s[c], &config))
            for (int k = 0; k < 5 && next_good(&s[c]); k++)
                ;
        T_EQ_I(s[c].good, 5);
    }
    T_EQ_I(each_of("/proc/self/task", in_real_time, 0), 0);
    for (int c = 0; c < 2; c++)
        end(&s[c]);
    log_end();
    set_nice_capability(true);
    setrlimit(RLIMIT_RTPRIO, &was);
    T_EQ_I(log_count("no real-time priority (gige.rt_priority 37)"), 1); /* of two cameras */
    T_EQ_I(log_count(" warn "), 1);
    T_CONTAINS(log_text, "camera a: ");
    T_CONTAINS(log_text, "Remedy: run as the service or raise the limit rtprio");
}

T_CASE(receiving_threads_have_the_priority_asked_for)
{
    if (!may_run_in_real_time())
        T_SKIP("no thread may run in real time here (CAP_SYS_NICE, limit rtprio, cgroup)");
    bed_all(25);
    static const int asked[] = {PRIORITY, 0, -1}, want[] = {PRIORITY, 10, 0};
    for (int k = 0; k < 3; k++) {
        struct session s[2];
        for (int c = 0; c < 2; c++) {
            struct cap_source_config config = bed_source(c);
            config.gige.rt_priority = asked[k];
            config.gige.socket_buffer = ROOM;
            if (begin(&s[c], &config))
                next_good(&s[c]);
        }
        /* one thread of each camera, and no other */
        T_EQ_I(each_of("/proc/self/task", in_real_time, 0), want[k] > 0 ? 2 : 0);
        T_EQ_I(each_of("/proc/self/task", has_priority, want[k]), want[k] > 0 ? 2 : 0);
        for (int c = 0; c < 2; c++)
            end(&s[c]);
    }
}

/* ---- room ------------------------------------------------------------------------------------- */

T_CASE(the_socket_has_the_room_asked_for)
{
    bed_all(25);
    struct session s;
    struct cap_source_config config = bed_source(1);
    config.gige.socket_buffer = ROOM;
    log_begin(PVX_LOG_WARN);
    if (begin(&s, &config))
        next_good(&s);
    T_EQ_I(each_of("/proc/self/fd", has_room, ROOM), 1);
    end(&s);
    T_EQ_I(each_of("/proc/self/fd", has_room, ROOM), 0);
    log_end();
    T_EQ_S(log_text, "");
}

static int most_room(void)
{
    int asked = 1 << 30, got = 0, fd = socket(AF_INET, SOCK_DGRAM, 0);
    socklen_t len = sizeof got;
    T_OK(fd >= 0 && setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &asked, sizeof asked) == 0 &&
         getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &got, &len) == 0);
    close(fd);
    return got / 2;
}

T_CASE(less_room_than_asked_for_is_said)
{
    int most = most_room(), asked = most + 4096;
    char text[64];
    if (most >= 1 << 29)
        T_SKIP("net.core.rmem_max is so large that nothing is beyond it");
    bed_all(25);
    struct session s[2];
    log_begin(PVX_LOG_WARN);
    for (int c = 0; c < 2; c++) {
        struct cap_source_config config = bed_source(c);
        config.gige.socket_buffer = asked;
        config.gige.no_packet_socket = true;
        if (begin(&s[c], &config))
            for (int k = 0; k < 5 && next_good(&s[c]); k++)
                ;
        T_EQ_I(s[c].good, 5);
    }
    T_EQ_I(each_of("/proc/self/fd", has_room, most), 2);
    for (int c = 0; c < 2; c++)
        end(&s[c]);
    log_end();
    T_EQ_I(log_count(" warn "), 1);
    snprintf(text, sizeof text, "camera a: a socket buffer of %d bytes", asked);
    T_CONTAINS(log_text, text);
    snprintf(text, sizeof text, "the kernel gives %d:", most);
    T_CONTAINS(log_text, text);
    snprintf(text, sizeof text, "Remedy: sysctl -w net.core.rmem_max=%d", asked);
    T_CONTAINS(log_text, text);
}

/* ---- packets of others ------------------------------------------------------------------------ */

static uint64_t received(ArvStream *stream)
{
    return arv_stream_get_info_uint64_by_name(stream, "n_received_packets");
}

/* Openings beside busy cameras, until ENOUGH of them had caught packets of those: not one comes later,
 * when there are buffers that it could begin. */
T_CASE(no_packet_of_another_camera_is_left_when_there_are_buffers)
{
    enum { ENOUGH = 15, MOST = 400 };
    int fd = socket(AF_PACKET, SOCK_RAW, 0);
    if (fd < 0)
        T_SKIP("no packet sockets here (CAP_NET_RAW)");
    close(fd);
    bed_all(200);
    struct session s[3];
    for (int c = 0; c < 3; c++) {
        struct cap_source_config config = bed_source(c);
        if (begin(&s[c], &config))
            next_good(&s[c]);
        keep_box(&s[c].box, false);
    }
    ArvCamera *camera = arv_camera_new(bed_address[3], NULL);
    T_OK(camera != NULL);
    int caught = 0;
    for (int k = 0; camera != NULL && k < MOST && caught < ENOUGH; k++) {
        ArvStream *stream = arv_camera_create_stream(camera, NULL, NULL, NULL);
        T_OK(aravis_ring_settle(stream));
        uint64_t n = received(stream);
        usleep(60000);
        T_EQ_I(received(stream), n);
        caught += n > 0;
        g_object_unref(stream);
    }
    T_EQ_I(caught, ENOUGH);
    g_clear_object(&camera);
    for (int c = 0; c < 3; c++)
        end(&s[c]);
}

/* ---- packets again ---------------------------------------------------------------------------- */

/* Frames of a camera that can or cannot send packets again, while one packet in a hundred is lost. */
struct resend {
    uint64_t good, incomplete, gaps; /* frames here */
    uint64_t again;                  /* packets that came when asked for again */
    struct cap_gvcam_stats cam;      /* what the camera knows */
};

static struct resend resend(enum cap_resend policy, bool camera_can)
{
    struct session s;
    struct cap_gvcam_config k = bed_config(2);
    struct cap_source_config config = bed_source(2);
    struct cap_health h;
    k.no_resend = !camera_can;
    bed_restart(2, &k);
    config.gige.packet_size = 1500; /* 14 packets a frame */
    config.gige.frame_retention_ms = 2000;
    config.gige.resend = policy;
    if (!begin(&s, &config))
        return (struct resend){0};
    next_good(&s);
    bed_fault(2, (struct cap_gvcam_fault){.packet_loss = 0.01});
    while ((s.good < 60 || bed_stats(2).lost < 10) && next_good(&s))
        ;
    bed_fault(2, (struct cap_gvcam_fault){0});
    for (int n = 0; n < 5; n++)
        next_good(&s);
    ops->health(s.src, &h);
    ops->stop(s.src);
    while (s.box.n_held > 0)
        next_good(&s);
    struct resend r = {.good = s.good,
                       .incomplete = s.box.count[CAP_INCOMPLETE],
                       .gaps = s.box.count[CAP_ID_GAP],
                       .again = h.packets_resent,
                       .cam = bed_stats(2)};
    T_LE(60, r.good);
    T_LE(10, r.cam.lost);
    /* every number from the first good frame to the last is accounted for */
    T_LE(s.last_id - s.first_id + 1, r.good + r.gaps + r.incomplete + s.box.count[CAP_UNDERRUN]);
    printf("  %llu packets lost, asked for %llu times, %llu sent again; %llu good frames, %llu "
           "incomplete, %llu missing\n",
           (unsigned long long)r.cam.lost, (unsigned long long)r.cam.asked,
           (unsigned long long)r.cam.resent, (unsigned long long)r.good,
           (unsigned long long)r.incomplete, (unsigned long long)r.gaps);
    end(&s);
    return r;
}

/* What is still missing was no longer to be had (asked for too late, on a busy machine) or never sent. */
static void all_is_repaired(const struct resend *r)
{
    T_LE(1, r->cam.asked);
    T_LE(1, r->again);
    T_LE(r->again, r->cam.resent);
    T_LE(r->incomplete + r->gaps, r->cam.gone + r->cam.overrun);
}

static void nothing_is_asked_for(const struct resend *r)
{
    T_EQ_I(r->cam.asked, 0);
    T_EQ_I(r->cam.resent, 0);
    T_EQ_I(r->again, 0);
    T_LE(1, r->incomplete);
}

T_CASE(resend_always)
{
    bed_ring_fps = 50;
    struct resend r = resend(CAP_RESEND_ALWAYS, true);
    all_is_repaired(&r);
    r = resend(CAP_RESEND_ALWAYS, false); /* asked for all the same, in vain */
    T_LE(1, r.cam.asked);
    T_LE(r.cam.asked, r.cam.refused);
    T_EQ_I(r.cam.resent, 0);
    T_LE(1, r.incomplete);
}

T_CASE(resend_never)
{
    bed_ring_fps = 50;
    struct resend r = resend(CAP_RESEND_NEVER, true);
    nothing_is_asked_for(&r);
}

T_CASE(resend_auto_asks_those_that_can)
{
    bed_ring_fps = 50;
    struct resend r = resend(CAP_RESEND_AUTO, true);
    all_is_repaired(&r);
    r = resend(CAP_RESEND_AUTO, false);
    nothing_is_asked_for(&r);
}

T_MAIN(bed_open(), bed_close())
