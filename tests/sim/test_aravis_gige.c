/* What is asked for with gige.* is so in the kernel and at the camera: the receiving thread's priority, the
 * room of its socket, whether lost packets are asked for again.  And what the host refuses is said, once,
 * with a remedy, and capture goes on. */
#include <ctype.h>
#include <dirent.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "arvbed.h"

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

/* What is logged from here on, until log_end. */
static int log_fd = -1, log_err = -1;
static char log_text[65536];

static void log_begin(void)
{
    char path[] = "/tmp/pyrovox-test-XXXXXX";
    log_fd = mkstemp(path);
    log_err = dup(STDERR_FILENO);
    T_OK(log_fd >= 0 && log_err >= 0);
    unlink(path);
    dup2(log_fd, STDERR_FILENO);
    pvx_log_set_level(PVX_LOG_WARN);
}

static void log_end(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    dup2(log_err, STDERR_FILENO);
    close(log_err);
    ssize_t n = pread(log_fd, log_text, sizeof log_text - 1, 0);
    close(log_fd);
    log_text[n > 0 ? n : 0] = '\0';
}

static int said(const char *what)
{
    int n = 0;
    for (const char *p = log_text; (p = strstr(p, what)) != NULL; p++)
        n++;
    return n;
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

static void receiving_threads_have_the_priority_asked_for(void)
{
    NEED_BED();
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
                take_good(&s[c]);
        }
        /* one thread of each camera, and no other */
        T_EQ_I(each_of("/proc/self/task", in_real_time, 0), want[k] > 0 ? 2 : 0);
        T_EQ_I(each_of("/proc/self/task", has_priority, want[k]), want[k] > 0 ? 2 : 0);
        for (int c = 0; c < 2; c++)
            end(&s[c]);
    }
}

/* As an ordinary user, on a machine without RtKit. */
static void without_the_right_it_is_said_and_capture_goes_on(void)
{
    NEED_BED();
    bed_all(25);
    struct rlimit was, none;
    T_EQ_I(getrlimit(RLIMIT_RTPRIO, &was), 0);
    none = was;
    none.rlim_cur = 0;
    setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/nowhere", 1);
    T_EQ_I(setrlimit(RLIMIT_RTPRIO, &none), 0);
    T_OK(set_nice_capability(false)); /* threads started from now on are without it, too */
    T_OK(!may_run_in_real_time());
    log_begin();
    struct session s[2];
    for (int c = 0; c < 2; c++) {
        struct cap_source_config config = bed_source(c);
        config.gige.rt_priority = PRIORITY;
        config.gige.socket_buffer = ROOM; /* that is there */
        if (begin(&s[c], &config))
            for (int k = 0; k < 5 && take_good(&s[c]); k++)
                ;
        T_EQ_I(s[c].good, 5);
    }
    T_EQ_I(each_of("/proc/self/task", in_real_time, 0), 0);
    for (int c = 0; c < 2; c++)
        end(&s[c]);
    log_end();
    set_nice_capability(true);
    setrlimit(RLIMIT_RTPRIO, &was);
    T_EQ_I(said("no real-time priority (gige.rt_priority 37)"), 1); /* of two cameras */
    T_EQ_I(said(" warn "), 1);
    T_CONTAINS(log_text, "camera a: ");
    T_CONTAINS(log_text, "Remedy: run as the service or raise the limit rtprio");
}

/* ---- room ------------------------------------------------------------------------------------- */

static void the_socket_has_the_room_asked_for(void)
{
    NEED_BED();
    bed_all(25);
    struct session s;
    struct cap_source_config config = bed_source(1);
    config.gige.socket_buffer = ROOM;
    log_begin();
    if (begin(&s, &config))
        take_good(&s);
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

static void less_room_than_asked_for_is_said(void)
{
    NEED_BED();
    int most = most_room(), asked = most + 4096;
    char text[64];
    if (most >= 1 << 29)
        T_SKIP("net.core.rmem_max is so large that nothing is beyond it");
    bed_all(25);
    struct session s[2];
    log_begin();
    for (int c = 0; c < 2; c++) {
        struct cap_source_config config = bed_source(c);
        config.gige.socket_buffer = asked;
        config.gige.no_packet_socket = true;
        if (begin(&s[c], &config))
            for (int k = 0; k < 5 && take_good(&s[c]); k++)
                ;
        T_EQ_I(s[c].good, 5);
    }
    T_EQ_I(each_of("/proc/self/fd", has_room, most), 2);
    for (int c = 0; c < 2; c++)
        end(&s[c]);
    log_end();
    T_EQ_I(said(" warn "), 1);
    snprintf(text, sizeof text, "camera a: a socket buffer of %d bytes", asked);
    T_CONTAINS(log_text, text);
    snprintf(text, sizeof text, "the kernel gives %d:", most);
    T_CONTAINS(log_text, text);
    snprintf(text, sizeof text, "Remedy: sysctl -w net.core.rmem_max=%d", asked);
    T_CONTAINS(log_text, text);
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
    take_good(&s);
    bed_fault(2, (struct cap_gvcam_fault){.packet_loss = 0.01});
    while ((s.good < 60 || bed_stats(2).lost < 10) && take_good(&s))
        ;
    bed_fault(2, (struct cap_gvcam_fault){0});
    for (int n = 0; n < 5; n++)
        take_good(&s);
    ops->health(s.src, &h);
    ops->stop(s.src);
    while (s.box.n > 0)
        take_good(&s);
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

static void resend_always(void)
{
    NEED_BED();
    bed_ring_fps = 50;
    struct resend r = resend(CAP_RESEND_ALWAYS, true);
    all_is_repaired(&r);
    r = resend(CAP_RESEND_ALWAYS, false); /* asked for all the same, in vain */
    T_LE(1, r.cam.asked);
    T_LE(r.cam.asked, r.cam.refused);
    T_EQ_I(r.cam.resent, 0);
    T_LE(1, r.incomplete);
}

static void resend_never(void)
{
    NEED_BED();
    bed_ring_fps = 50;
    struct resend r = resend(CAP_RESEND_NEVER, true);
    nothing_is_asked_for(&r);
}

static void resend_auto_asks_those_that_can(void)
{
    NEED_BED();
    bed_ring_fps = 50;
    struct resend r = resend(CAP_RESEND_AUTO, true);
    all_is_repaired(&r);
    r = resend(CAP_RESEND_AUTO, false);
    nothing_is_asked_for(&r);
}

int main(void)
{
    bed_open();
    T_RUN(without_the_right_it_is_said_and_capture_goes_on); /* said once in a process: first */
    T_RUN(receiving_threads_have_the_priority_asked_for);
    T_RUN(the_socket_has_the_room_asked_for);
    T_RUN(less_room_than_asked_for_is_said);
    T_RUN(resend_always);
    T_RUN(resend_never);
    T_RUN(resend_auto_asks_those_that_can);
    bed_close();
    return t_done();
}
