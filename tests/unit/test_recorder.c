/* test_recorder.c - recording beside a capture: what it cannot record it lists, a disk that is full or
 * fails ends the take and nothing else, every frame goes back to its pool. */
#include "../t.h"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/source/bufpool.h"
#include "capture/take/recorder.h"

#define CAMERAS 3
#define P       (10 * PVX_NS_PER_MS)
#define T0      1700000000000000000LL
#define BUFFERS 200
#define WIDTH   256
#define HEIGHT  128

static char dir[64], path[96];
static cap_bufpool *pool[CAMERAS];
static cap_assembler *assembler;
static struct cap_tap tap;
static enum cap_count last_why;
static uint64_t strays;

static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    (void)camera;
    (void)n;
    last_why = what;
}
static void push(void *ctx, struct cap_frame *f)
{
    (void)ctx;
    strays++;
    tap.stray(tap.ctx, f, last_why);
}

static cap_recorder *set_up(const struct cap_recorder_config *c)
{
    cap_recorder *r = NULL;
    T_EQ_I(cap_recorder_new(c, &r), PVX_OK);
    tap = cap_recorder_tap(r);
    struct cap_assembler_params p = {.cameras = CAMERAS, .period_ns = P};
    struct cap_sink sink = {.count = count, .push = push};
    T_EQ_I(cap_assembler_new(&p, &sink, &assembler), PVX_OK);
    for (uint32_t i = 0; i < CAMERAS; i++)
        T_EQ_I(cap_bufpool_new(BUFFERS, WIDTH * HEIGHT, i, &pool[i]), PVX_OK);
    strays = 0;
    return r;
}

static void tear_down(cap_recorder **r)
{
    cap_recorder_free(r);
    cap_assembler_free(&assembler);
    for (uint32_t i = 0; i < CAMERAS; i++) {
        T_EQ_I(cap_bufpool_free_count(pool[i]), BUFFERS); /* nothing is kept */
        cap_bufpool_unref(&pool[i]);
    }
    unlink(path);
}

static const struct cap_take_camera cameras[CAMERAS] = {
    {.name = "a"}, {.name = "b"}, {.name = "c"}};
static struct cap_take_head head(void)
{
    return (struct cap_take_head){.rig = "",
                                  .config = "",
                                  .software = "test",
                                  .host = "",
                                  .base = "/",
                                  .n_cameras = CAMERAS,
                                  .camera = cameras};
}

static void put(uint32_t camera, uint64_t id)
{
    struct cap_frame *f = NULL;
    for (int i = 0; f == NULL && i < 20000; i++) {
        f = cap_bufpool_take(pool[camera]);
        if (f == NULL)
            usleep(1000);
    }
    if (f == NULL) {
        T_OK(f != NULL);
        return;
    }
    memset(cap_bufpool_memory(f), (int)(id * CAMERAS + camera), WIDTH * HEIGHT);
    f->img.size = WIDTH * HEIGHT;
    f->img.width = f->img.stride = WIDTH;
    f->img.height = HEIGHT;
    f->img.fmt = CAP_GREY8;
    f->id = id;
    f->t_exposure_ns = f->t_device_ns = T0 + (int64_t)id * P;
    f->t_arrival_mono_ns = (int64_t)id * P;
    cap_assembler_put(assembler, f);
}

/* As the capture does: the tap sees it, then the consumer has it. */
static uint64_t hand_over(void)
{
    uint64_t n = 0;
    for (struct cap_set *s; (s = cap_assembler_pop(assembler)) != NULL; n++) {
        tap.set(tap.ctx, s);
        cap_set_release(s);
    }
    return n;
}

static uint64_t send_sets(uint64_t first, uint64_t n)
{
    uint64_t out = 0;
    for (uint64_t k = first; k < first + n; k++) {
        for (uint32_t c = 0; c < CAMERAS; c++)
            put(c, k);
        out += hand_over();
    }
    return out;
}

static cap_take *open_take(void)
{
    struct pvx_diag d = {""};
    cap_take *t;
    pvx_err e = cap_take_open(path, &t, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    return t;
}

static const struct cap_recorder_config plain = {
    .n_cameras = CAMERAS, .queue = 4, .sync_ns = 20 * PVX_NS_PER_MS};

/* Every frame put is in the take or in one of its gaps, and nowhere twice. */
static void check_account(const cap_take *t, uint64_t n)
{
    unsigned char *seen = calloc(n * CAMERAS, 1);
    const struct cap_take_info *i = cap_take_info(t);
    for (uint32_t c = 0; c < CAMERAS; c++)
        for (uint64_t r = 0; r < i->head.camera[c].frames; r++) {
            unsigned char mem[WIDTH * HEIGHT];
            struct cap_image img;
            uint64_t id = cap_take_row(t, c, r)->id;
            T_OK(id < n);
            T_EQ_I(cap_take_read(t, c, r, mem, sizeof mem, &img, NULL), PVX_OK);
            T_EQ_I(mem[0], (unsigned char)(id * CAMERAS + c));
            seen[id * CAMERAS + c]++;
        }
    for (uint64_t g = 0; g < i->gaps; g++) {
        const struct cap_take_gap *k = cap_take_gap(t, g);
        T_EQ_I(k->why, CAP_TAKE_QUEUE);
        T_EQ_I(k->frames, k->id_last - k->id_first + 1);
        T_EQ_I(k->set_first, k->id_first);
        for (uint64_t id = k->id_first; id <= k->id_last && id < n; id++)
            seen[id * CAMERAS + k->camera]++;
    }
    uint64_t wrong = 0;
    for (uint64_t x = 0; x < n * CAMERAS; x++)
        wrong += seen[x] != 1;
    T_EQ_I(wrong, 0);
    free(seen);
}

static void what_is_too_much_is_listed(void)
{
    cap_recorder *r = set_up(&plain);
    struct cap_take_head h = head();
    struct pvx_diag d = {""};
    struct cap_recorder_stats s;
    T_EQ_I(send_sets(0, 3), 3); /* not recording: nobody is disturbed */
    cap_assembler_free(&assembler);
    struct cap_assembler_params p = {.cameras = CAMERAS, .period_ns = P};
    struct cap_sink sink = {.count = count, .push = push};
    T_EQ_I(cap_assembler_new(&p, &sink, &assembler), PVX_OK);
    T_EQ_I(cap_recorder_start(r, path, &h, &d), PVX_OK);
    T_EQ_I(cap_recorder_start(r, path, &h, &d), PVX_EBUSY);
    const uint64_t n = 300; /* a burst that no disk follows */
    T_EQ_I(send_sets(0, n), n);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.state, CAP_REC_ENDED);
    T_EQ_I(s.sets + s.sets_missed, n);
    T_EQ_I(s.frames + s.frames_missed, n * CAMERAS);
    T_LE(1, s.sets_missed);
    T_LE(1, s.sets);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_ENOENT);
    cap_take *t = open_take();
    T_EQ_I(cap_take_info(t)->sets, s.sets);
    T_LE(CAMERAS, cap_take_info(t)->gaps);
    check_account(t, n);
    cap_take_free(&t);
    tear_down(&r);
}

static void lossless_waits_for_the_disk(void)
{
    struct cap_recorder_config c = plain;
    c.lossless = true;
    c.queue = 1;
    cap_recorder *r = set_up(&c);
    struct cap_take_head h = head();
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    T_EQ_I(send_sets(0, 200), 200);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_take *t = open_take();
    T_EQ_I(cap_take_info(t)->sets, 200);
    T_EQ_I(cap_take_info(t)->gaps, 0);
    check_account(t, 200);
    cap_take_free(&t);
    tear_down(&r);
}

static void frames_without_a_set_are_recorded(void)
{
    struct cap_recorder_config c = plain;
    c.lossless = true;
    cap_recorder *r = set_up(&c);
    struct cap_take_head h = head();
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    T_EQ_I(send_sets(0, 2), 2);
    put(0, 2); /* its partners never come */
    put(1, 2);
    cap_assembler_tick(assembler, INT64_MAX);
    T_EQ_I(send_sets(3, 2), 2);
    put(2, 2); /* late */
    T_EQ_I(strays, 3);
    struct cap_recorder_stats s;
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.strays, 3);
    T_EQ_I(s.frames, 4 * CAMERAS + 3);
    cap_take *t = open_take();
    T_EQ_I(cap_take_info(t)->sets, 4);
    T_EQ_I(cap_take_row(t, 0, 2)->set, -1);
    T_EQ_I(cap_take_row(t, 0, 2)->why, CAP_TAKE_UNMATCHED);
    T_EQ_I(cap_take_row(t, 2, 4)->id, 2);
    T_EQ_I(cap_take_row(t, 2, 4)->why, CAP_TAKE_LATE);
    check_account(t, 5);
    cap_take_free(&t);
    tear_down(&r);
}

static void wait_for_end(cap_recorder *r, struct cap_recorder_stats *s)
{
    uint64_t k = 0;
    do {
        send_sets(k++, 1);
        cap_recorder_stats(r, s);
    } while (s->state == CAP_REC_RUNNING && k < 100000);
}

static void limit_ends_it_in_order(void)
{
    struct cap_recorder_config c = plain;
    c.lossless = true;
    c.limit_bytes = 10 * CAMERAS * WIDTH * HEIGHT + 1;
    cap_recorder *r = set_up(&c);
    struct cap_take_head h = head();
    struct cap_recorder_stats s;
    struct pvx_diag d = {""};
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    wait_for_end(r, &s);
    T_EQ_I(s.state, CAP_REC_ENDED);
    T_EQ_I(s.sets, 10);
    T_CONTAINS(s.error, "limit");
    T_EQ_I(send_sets(100000, 50), 50); /* goes on undisturbed */
    T_EQ_I(cap_recorder_stop(r, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "limit");
    cap_take *t = open_take();
    T_OK(cap_take_info(t)->closed);
    T_EQ_I(cap_take_info(t)->sets, 10);
    cap_take_free(&t);
    unlink(path); /* and another one can be begun */
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    send_sets(200000, 3);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    tear_down(&r);
}

/* A disk of 40 MB: the take ends, in order, before it is full. */
static int on_a_small_disk(void)
{
    if (unshare(CLONE_NEWNS | (geteuid() == 0 ? 0 : CLONE_NEWUSER)) != 0 ||
        mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0 ||
        mount("take", dir, "tmpfs", 0, "size=40m") != 0)
        return 77;
    struct cap_recorder_config c = plain;
    c.lossless = true;
    cap_recorder *r = set_up(&c);
    struct cap_take_head h = head();
    struct cap_recorder_stats s;
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    wait_for_end(r, &s);
    T_EQ_I(s.state, CAP_REC_FAILED);
    T_CONTAINS(s.error, "the disk is full");
    T_LE(20, s.sets);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_ENOSPC);
    T_EQ_I(send_sets(100000, 50), 50);
    cap_take *t = open_take();
    T_OK(cap_take_info(t)->closed);
    T_EQ_I(cap_take_info(t)->sets, s.sets);
    cap_take_free(&t);
    tear_down(&r);
    return t_case_fails > 0;
}

/* Writing fails in the middle of a frame, and closing fails too: the take is as if it had been cut. */
static int with_a_failing_disk(void)
{
    signal(SIGXFSZ, SIG_IGN);
    struct rlimit lim = {3 << 20, 3 << 20};
    struct cap_recorder_config c = plain;
    c.lossless = true;
    cap_recorder *r = set_up(&c);
    struct cap_take_head h = head();
    struct cap_recorder_stats s;
    setrlimit(RLIMIT_FSIZE, &lim);
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    wait_for_end(r, &s);
    T_EQ_I(s.state, CAP_REC_FAILED);
    T_OK(s.error[0] != '\0');
    T_LE(20, s.sets);
    T_OK(cap_recorder_stop(r, NULL) != PVX_OK);
    T_EQ_I(send_sets(100000, 50), 50);
    cap_take *t = open_take();
    T_LE(s.sets, cap_take_info(t)->sets + 1);
    T_LE(20, cap_take_info(t)->sets);
    cap_take_free(&t);
    tear_down(&r);
    return t_case_fails > 0;
}

static int in_child(int (*fn)(void))
{
    int status;
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0) {
        t_case_fails = 0;
        int rc = fn();
        fflush(stdout);
        _exit(rc);
    }
    waitpid(pid, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 99;
}

static void full_disk_ends_it_in_order(void)
{
    int rc = in_child(on_a_small_disk);
    if (rc == 77)
        T_SKIP("a mount namespace of our own is not allowed here");
    T_EQ_I(rc, 0);
}

static void failing_disk_ends_it(void)
{
    T_EQ_I(in_child(with_a_failing_disk), 0);
}

/* Sets of one camera each: frames of every camera would have room, set structs are for all. */
static void waiting_sets_leave_some_to_the_live_ones(void)
{
    struct cap_recorder_config c = plain;
    c.queue = CAP_RECORDER_QUEUE_MAX;
    cap_recorder *r = set_up(&c);
    struct cap_take_head h = head();
    struct cap_recorder_stats s;
    cap_assembler_free(&assembler);
    struct cap_assembler_params p = {
        .cameras = CAMERAS, .period_ns = P, .policy = CAP_POLICY_PARTIAL, .min_cameras = 1};
    struct cap_sink sink = {.count = count, .push = push};
    T_EQ_I(cap_assembler_new(&p, &sink, &assembler), PVX_OK);
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK);
    const uint64_t n = 400;
    uint64_t out = 0;
    unsigned most = 0;
    for (uint64_t k = 0; k < n; k++) {
        put((uint32_t)(k % CAMERAS), k);
        cap_assembler_tick(assembler, INT64_MAX);
        out += hand_over();
        cap_recorder_stats(r, &s);
        most = s.queued > most ? s.queued : most;
    }
    T_EQ_I(out, n);
    T_EQ_I(strays, 0);
    T_LE(most, CAP_RECORDER_QUEUE_MAX);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.sets + s.sets_missed, n);
    tear_down(&r);
}

/* In place of libc's: a disk that does not answer. */
static bool disk_hangs, disk_hung;
int fdatasync(int fd)
{
    while (__atomic_load_n(&disk_hangs, __ATOMIC_SEQ_CST)) {
        __atomic_store_n(&disk_hung, true, __ATOMIC_SEQ_CST);
        usleep(1000);
    }
    return (int)syscall(SYS_fdatasync, fd);
}

static void disk_that_does_not_answer_holds_nobody(void)
{
    cap_recorder *r = set_up(&plain);
    struct cap_take_head h = head();
    struct pvx_diag d = {""};
    __atomic_store_n(&disk_hangs, true, __ATOMIC_SEQ_CST);
    T_EQ_I(cap_recorder_start(r, path, &h, &d), PVX_OK);
    T_EQ_I(send_sets(0, 2), 2);
    for (int i = 0; i < 20000 && !__atomic_load_n(&disk_hung, __ATOMIC_SEQ_CST); i++)
        usleep(1000);
    T_EQ_I(cap_recorder_stop(r, &d), PVX_ETIMEDOUT);
    T_OK(strstr(d.text, "does not answer") != NULL);
    __atomic_store_n(&disk_hangs, false, __ATOMIC_SEQ_CST);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK); /* it answers again */
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_ENOENT);
    tear_down(&r);
}

static void start_that_fails_leaves_nothing(void)
{
    cap_recorder *r = set_up(&plain);
    struct cap_take_head h = head();
    struct pvx_diag d = {""};
    struct cap_recorder_stats s;
    pthread_attr_t old, huge;
    T_EQ_I(pthread_getattr_default_np(&old), 0);
    pthread_attr_init(&huge);
    T_EQ_I(pthread_attr_setstacksize(&huge, (size_t)1 << 60), 0); /* no memory has room for it */
    T_EQ_I(pthread_setattr_default_np(&huge), 0);
    pvx_err e = cap_recorder_start(r, path, &h, &d);
    T_EQ_I(pthread_setattr_default_np(&old), 0);
    pthread_attr_destroy(&huge);
    pthread_attr_destroy(&old);
    T_EQ_I(e, PVX_EIO);
    T_CONTAINS(d.text, "no thread");
    T_OK(access(path, F_OK) != 0);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.state, CAP_REC_FAILED);
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_OK); /* the name is free */
    T_EQ_I(send_sets(0, 2), 2);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    T_EQ_I(access(path, F_OK), 0);
    tear_down(&r);
}

static void nonsense_is_refused(void)
{
    cap_recorder *r;
    struct cap_recorder_config c = plain;
    c.queue = 0;
    T_EQ_I(cap_recorder_new(&c, &r), PVX_EINVAL);
    c = plain;
    c.n_cameras = 65;
    T_EQ_I(cap_recorder_new(&c, &r), PVX_EINVAL);
    r = set_up(&plain);
    struct cap_take_head h = head();
    struct pvx_diag d = {""};
    T_OK(cap_recorder_start(r, "/proc/nowhere/take.h5", &h, &d) != PVX_OK);
    T_OK(d.text[0] != '\0');
    h.n_cameras = 2;
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_EINVAL);
    tear_down(&r);
}

int main(void)
{
    snprintf(dir, sizeof dir, "/tmp/test_recorder-XXXXXX");
    if (mkdtemp(dir) == NULL)
        return 1;
    snprintf(path, sizeof path, "%s/take.h5", dir);
    T_RUN(what_is_too_much_is_listed);
    T_RUN(lossless_waits_for_the_disk);
    T_RUN(frames_without_a_set_are_recorded);
    T_RUN(limit_ends_it_in_order);
    T_RUN(full_disk_ends_it_in_order);
    T_RUN(failing_disk_ends_it);
    T_RUN(waiting_sets_leave_some_to_the_live_ones);
    T_RUN(disk_that_does_not_answer_holds_nobody);
    T_RUN(start_that_fails_leaves_nothing);
    T_RUN(nonsense_is_refused);
    rmdir(dir);
    return t_done();
}
