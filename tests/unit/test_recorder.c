/* test_recorder.c - recording beside a capture: what it cannot record it lists, a disk that is full or
 * fails ends the take and nothing else, every frame goes back to its pool. */
#include "../t.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "capture/source/bufpool.h"
#include "capture/take/recorder.h"
#include "tests/lib/scratch.h"
#include "tests/lib/take.h"
#include "tests/lib/free_frames.h"

#define CAMERAS 3
#define P       (10 * PVX_NS_PER_MS)
#define T0      1700000000000000000LL
#define BUFFERS 200
#define WIDTH   256
#define HEIGHT  128

static char path[96];
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

/* A new one, whose sets have so many members at least. */
static void assemble(uint32_t least)
{
    struct cap_assembler_params p = {.cameras = CAMERAS,
                                     .period_ns = P,
                                     .policy =
                                         least < CAMERAS ? CAP_POLICY_PARTIAL : CAP_POLICY_DROP,
                                     .min_cameras = least};
    struct cap_sink sink = {.count = count, .push = push};
    cap_assembler_free(&assembler);
    T_EQ_I(cap_assembler_new(&p, &sink, &assembler), PVX_OK);
}

static cap_recorder *set_up(const struct cap_recorder_config *c)
{
    cap_recorder *r = NULL;
    T_EQ_I(cap_recorder_new(c, &r), PVX_OK);
    tap = cap_recorder_tap(r);
    assemble(CAMERAS);
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
        T_EQ_I(free_frames(pool[i]), BUFFERS); /* nothing is kept */
        cap_bufpool_unref(&pool[i]);
    }
    unlink(path);
}

static const struct cap_take_camera cameras[CAMERAS] = {
    {.name = "a"}, {.name = "b"}, {.name = "c"}};

static void put(uint32_t camera, uint64_t id)
{
    struct cap_frame *f = NULL;
    for (int i = 0; f == NULL && i < 20000; i++) {
        f = cap_bufpool_get(pool[camera]);
        if (f == NULL)
            usleep(1000);
    }
    T_OK(f != NULL);
    if (f == NULL)
        return;
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

static pvx_err start(cap_recorder *r, struct pvx_diag *d)
{
    struct cap_take_head h = take_head(cameras, CAMERAS);
    return cap_recorder_start(r, path, &h, d);
}

/* Set up and recording; lossless: nothing is left out, and `limit` bytes end it (0: nothing does). */
static cap_recorder *recording(bool lossless, uint32_t queue, uint64_t limit)
{
    struct cap_recorder_config c = plain;
    c.lossless = lossless;
    c.queue = queue;
    c.limit_bytes = limit;
    cap_recorder *r = set_up(&c);
    T_EQ_I(start(r, NULL), PVX_OK);
    return r;
}

/* Every frame put, of n sets, is in the take of `sets` or in one of its gaps, and nowhere twice; how many
 * gaps. */
static uint64_t check_account(uint64_t sets, uint64_t n)
{
    cap_take *t = open_take();
    unsigned char *seen = calloc(n * CAMERAS, 1);
    const struct cap_take_info *i = cap_take_info(t);
    uint64_t gaps = i->gaps;
    T_EQ_I(i->sets, sets);
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
    cap_take_free(&t);
    return gaps;
}

T_CASE(what_is_too_much_is_listed)
{
    cap_recorder *r = set_up(&plain);
    struct pvx_diag d = {""};
    struct cap_recorder_stats s;
    T_EQ_I(send_sets(0, 3), 3); /* not recording: nobody is disturbed */
    assemble(CAMERAS);
    T_EQ_I(start(r, &d), PVX_OK);
    T_EQ_I(start(r, &d), PVX_EBUSY);
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
    T_LE(CAMERAS, check_account(s.sets, n));
    tear_down(&r);
}

T_CASE(lossless_waits_for_the_disk)
{
    cap_recorder *r = recording(true, 1, 0);
    T_EQ_I(send_sets(0, 200), 200);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    T_EQ_I(check_account(200, 200), 0);
    tear_down(&r);
}

/* The takes of a recording that rolled, read as one: each closed, every set of 0..n in order; how many takes. */
static unsigned check_takes(uint64_t n)
{
    cap_take *t = open_take();
    const struct cap_take_info *i = cap_take_info(t);
    unsigned takes = (unsigned)i->pieces;
    T_OK(i->closed);
    T_EQ_I(i->notes, 0);
    T_EQ_I(i->sets, n);
    for (uint64_t k = 0; k < i->sets; k++)
        T_EQ_I(cap_take_set(t, k, NULL)->number, k);
    for (unsigned k = 0; k < takes; k++) {
        struct cap_take_piece p = cap_take_piece(t, k);
        T_OK(p.closed);
        T_LE(1, p.sets);
        unlink(p.path);
    }
    cap_take_free(&t);
    return takes;
}

static cap_recorder *rolling(int64_t every_ns, int64_t sync_ns, struct cap_take_head *h)
{
    struct cap_recorder_config c = plain;
    c.lossless = true;
    c.roll_ns = every_ns;
    c.sync_ns = sync_ns;
    cap_recorder *r = set_up(&c);
    *h = take_head(cameras, CAMERAS);
    T_EQ_I(cap_recorder_start(r, path, h, NULL), PVX_OK);
    return r;
}

T_CASE(goes_on_in_another_take)
{
    struct cap_take_head h;
    struct cap_recorder_stats s;
    cap_recorder *r = rolling(1, 0, &h); /* one set each */
    T_EQ_I(send_sets(0, 12), 12);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.sets, 12);
    T_EQ_I(s.takes, 12);
    T_EQ_I(s.bytes, 12 * CAMERAS * WIDTH * HEIGHT);
    T_OK(strstr(s.path, "-0012.h5") != NULL);
    T_EQ_I(check_takes(12), 12);
    tear_down(&r);

    r = rolling(1, PVX_NS_PER_MS, &h); /* as fast as they are synced */
    uint64_t n = 0;
    do {
        T_EQ_I(send_sets(n, 20), 20);
        n += 20;
        cap_recorder_stats(r, &s);
    } while (s.takes < 4);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.sets, n);
    T_EQ_I(check_takes(n), s.takes);
    tear_down(&r);
}

T_CASE(the_next_take_is_there_already)
{
    struct cap_take_head h;
    struct cap_recorder_stats s;
    char next[sizeof path];
    T_EQ_I(pvx_path_more(path, "-0002", next, sizeof next), PVX_OK);
    fclose(fopen(next, "w"));
    cap_recorder *r = rolling(1, PVX_NS_PER_MS, &h);
    T_EQ_I(send_sets(0, 5), 5);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_EBUSY);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.state, CAP_REC_FAILED);
    T_OK(strstr(s.error, "-0002.h5") != NULL);
    T_EQ_I(s.sets, 1);
    T_LE(s.sets + s.sets_missed, 5); /* the others came when it had ended */
    unlink(next);
    T_EQ_I(check_takes(1), 1);
    tear_down(&r);
}

T_CASE(frames_without_a_set_are_recorded)
{
    cap_recorder *r = recording(true, 4, 0);
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
    T_EQ_I(cap_take_row(t, 0, 2)->set, -1);
    T_EQ_I(cap_take_row(t, 0, 2)->why, CAP_TAKE_UNMATCHED);
    T_EQ_I(cap_take_row(t, 2, 4)->id, 2);
    T_EQ_I(cap_take_row(t, 2, 4)->why, CAP_TAKE_LATE);
    cap_take_free(&t);
    check_account(4, 5);
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

T_CASE(limit_ends_it_in_order)
{
    cap_recorder *r = recording(true, 4, 10 * CAMERAS * WIDTH * HEIGHT + 1);
    struct cap_recorder_stats s;
    struct pvx_diag d = {""};
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
    T_EQ_I(start(r, NULL), PVX_OK);
    send_sets(200000, 3);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    tear_down(&r);
}

static bool small_disk(const char *size)
{
    return unshare(CLONE_NEWNS | (geteuid() == 0 ? 0 : CLONE_NEWUSER)) == 0 &&
           mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0 &&
           mount("take", dir, "tmpfs", 0, size) == 0;
}

/* A disk of 48 MB: the take ends, in order, before it is full. */
static int on_a_small_disk(void)
{
    if (!small_disk("size=48m"))
        return 77;
    cap_recorder *r = recording(true, 4, 0);
    struct cap_recorder_stats s;
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

/* Another program fills the disk, in an instant, before the first frame. */
static int on_a_full_disk(void)
{
    static const char zeros[1 << 16];
    if (!small_disk("size=60m"))
        return 77;
    cap_recorder *r = recording(false, 4, 0);
    struct cap_recorder_stats s;
    FILE *f = fopen(at("filler"), "w");
    while (fwrite(zeros, 1, sizeof zeros, f) == sizeof zeros)
        ;
    fclose(f);
    wait_for_end(r, &s);
    T_EQ_I(s.state, CAP_REC_FAILED);
    T_CONTAINS(s.error, "the disk is full");
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_ENOSPC);
    cap_take *t = open_take();
    T_OK(cap_take_info(t)->closed);
    T_LE(1, cap_take_info(t)->gaps); /* what was lost is in it: its place was kept */
    cap_take_free(&t);
    tear_down(&r);
    return t_case_fails > 0;
}

/* A disk that is full already: the recording does not begin, and nothing is left behind. */
static int on_a_disk_too_small(void)
{
    if (!small_disk("size=20m"))
        return 77;
    cap_recorder *r;
    struct cap_recorder_config c = {.n_cameras = CAMERAS, .queue = 4};
    struct cap_take_head head = {.n_cameras = CAMERAS, .camera = cameras};
    struct pvx_diag d = {""};
    char deep[600];
    snprintf(deep, sizeof deep, "%s/new/folder/take.h5", dir);
    T_EQ_I(cap_recorder_new(&c, &r), PVX_OK);
    T_EQ_I(cap_recorder_start(r, deep, &head, &d), PVX_ENOSPC);
    T_CONTAINS(d.text, deep);
    T_CONTAINS(d.text, "0.02 GB are free");
    T_CONTAINS(d.text, "record.keep_free_gb");
    T_EQ_I(access(at("new"), F_OK), -1);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_ENOENT);
    cap_recorder_free(&r);
    return t_case_fails > 0;
}

/* No page is free, so libhdf5 fails without a reason: no file that nothing can read is left behind. */
static int on_a_disk_without_a_page(void)
{
    static const char zeros[1 << 16];
    if (!small_disk("size=1m"))
        return 77;
    struct cap_take_head head = take_head(cameras, CAMERAS);
    struct pvx_diag d = {""};
    cap_take_writer *w;
    int fd = open(at("filler"), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
    while (write(fd, zeros, sizeof zeros) > 0)
        ;
    close(fd);
    T_EQ_I(cap_take_create(at("take.h5"), &head, &w, &d), PVX_ENOSPC);
    T_CONTAINS(d.text, "take.h5: cannot be written: the disk is full");
    T_EQ_I(access(at("take.h5"), F_OK), -1);
    return t_case_fails > 0;
}

/* Writing fails in the middle of a frame, and closing fails too: the take is as if it had been cut. */
static int with_a_failing_disk(void)
{
    signal(SIGXFSZ, SIG_IGN);
    struct rlimit lim = {3 << 20, 3 << 20};
    struct cap_recorder_stats s;
    setrlimit(RLIMIT_FSIZE, &lim);
    cap_recorder *r = recording(true, 4, 0);
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

/* One that needs what is not allowed here gives 77. */
static void in_child(int (*fn)(void))
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
    T_OK(WIFEXITED(status));
    if (WEXITSTATUS(status) == 77)
        T_SKIP("a mount namespace of our own is not allowed here");
    T_EQ_I(WEXITSTATUS(status), 0);
}

T_CASE(full_disk_ends_it_in_order)
{
    in_child(on_a_small_disk);
}

T_CASE(a_disk_that_others_fill_ends_it_in_order)
{
    in_child(on_a_full_disk);
}

T_CASE(too_full_a_disk_is_refused)
{
    in_child(on_a_disk_too_small);
}

T_CASE(a_disk_without_a_page_is_named)
{
    in_child(on_a_disk_without_a_page);
}

T_CASE(failing_disk_ends_it)
{
    in_child(with_a_failing_disk);
}

/* Sets of one camera each: frames of every camera would have room, set structs are for all. */
T_CASE(waiting_sets_leave_some_to_the_live_ones)
{
    cap_recorder *r = recording(false, CAP_RECORDER_QUEUE_MAX, 0);
    struct cap_recorder_stats s;
    assemble(1);
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

T_CASE(disk_that_does_not_answer_holds_nobody)
{
    cap_recorder *r = set_up(&plain);
    struct pvx_diag d = {""};
    __atomic_store_n(&disk_hangs, true, __ATOMIC_SEQ_CST);
    T_EQ_I(start(r, &d), PVX_OK);
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

/* The same for the thread that writes: it asks how much room there is before each set. */
static bool writer_hangs;
int fstatvfs(int fd, struct statvfs *v)
{
    int (*real)(int, struct statvfs *);
    *(void **)&real = dlsym(RTLD_NEXT, "fstatvfs");
    while (__atomic_load_n(&writer_hangs, __ATOMIC_SEQ_CST))
        usleep(1000);
    return real(fd, v);
}

static void *send_three(void *n)
{
    *(uint64_t *)n = send_sets(0, 3);
    return NULL;
}

T_CASE(disk_that_does_not_answer_holds_no_lossless_capture_that_stops)
{
    struct cap_recorder_stats s = {0};
    struct timespec patience;
    pthread_t thread;
    uint64_t sent = 0;
    __atomic_store_n(&writer_hangs, true, __ATOMIC_SEQ_CST);
    cap_recorder *r = recording(true, 1, 0);
    T_EQ_I(pthread_create(&thread, NULL, send_three, &sent), 0);
    for (int i = 0; i < 20000 && s.queued == 0; i++) {
        usleep(1000);
        cap_recorder_stats(r, &s);
    }
    usleep(50000); /* the next one waits by now, or comes later */
    cap_recorder_hurry(r);
    clock_gettime(CLOCK_REALTIME, &patience);
    patience.tv_sec += 60;
    int late = pthread_timedjoin_np(thread, NULL, &patience);
    T_EQ_I(late, 0);
    __atomic_store_n(&writer_hangs, false, __ATOMIC_SEQ_CST);
    if (late != 0)
        pthread_join(thread, NULL);
    T_EQ_I(sent, 3);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.sets, 1);
    T_EQ_I(s.sets_missed, 2);
    check_account(1, 3); /* what was left out is listed */
    tear_down(&r);
}

T_CASE(start_that_fails_leaves_nothing)
{
    cap_recorder *r = set_up(&plain);
    struct pvx_diag d = {""};
    struct cap_recorder_stats s;
    pthread_attr_t old, huge;
    T_EQ_I(pthread_getattr_default_np(&old), 0);
    pthread_attr_init(&huge);
    T_EQ_I(pthread_attr_setstacksize(&huge, (size_t)1 << 60), 0); /* no memory has room for it */
    T_EQ_I(pthread_setattr_default_np(&huge), 0);
    pvx_err e = start(r, &d);
    T_EQ_I(pthread_setattr_default_np(&old), 0);
    pthread_attr_destroy(&huge);
    pthread_attr_destroy(&old);
    T_EQ_I(e, PVX_EIO);
    T_CONTAINS(d.text, "no thread");
    T_OK(access(path, F_OK) != 0);
    cap_recorder_stats(r, &s);
    T_EQ_I(s.state, CAP_REC_FAILED);
    T_EQ_I(start(r, NULL), PVX_OK); /* the name is free */
    T_EQ_I(send_sets(0, 2), 2);
    T_EQ_I(cap_recorder_stop(r, NULL), PVX_OK);
    T_EQ_I(access(path, F_OK), 0);
    tear_down(&r);
}

T_CASE(nonsense_is_refused)
{
    cap_recorder *r;
    struct cap_recorder_config c = plain;
    c.queue = 0;
    T_EQ_I(cap_recorder_new(&c, &r), PVX_EINVAL);
    c = plain;
    c.n_cameras = 65;
    T_EQ_I(cap_recorder_new(&c, &r), PVX_EINVAL);
    r = set_up(&plain);
    struct cap_take_head h = take_head(cameras, CAMERAS);
    struct pvx_diag d = {""};
    T_OK(cap_recorder_start(r, "/proc/nowhere/take.h5", &h, &d) != PVX_OK);
    T_OK(d.text[0] != '\0');
    h.n_cameras = 2;
    T_EQ_I(cap_recorder_start(r, path, &h, NULL), PVX_EINVAL);
    tear_down(&r);
}

static void in_a_folder(void)
{
    scratch_new();
    snprintf(path, sizeof path, "%s/take.h5", dir);
}
T_MAIN(in_a_folder(), scratch_remove())
