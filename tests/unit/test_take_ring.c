/* test_take_ring.c - the ring of raw frames: what it holds, the takes that triggers make of it, and the account of every
 * frame that such a take should have. */
#include "../t.h"

#include <pthread.h>
#include <sched.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/source/bufpool.h"
#include "capture/take/ring.h"
#include "tests/lib/free_frames.h"
#include "tests/lib/scratch.h"
#include "tests/lib/take.h"

#define CAMERAS 3
#define FPS     100
#define P       (PVX_NS_PER_S / FPS)
#define T0      1700000000000000000LL
#define FRAMES  50                            /* of the ring */
#define BUFFERS (FRAMES + CAP_RING_MORE + 40) /* open sets have 32 */
#define WIDTH   64
#define HEIGHT  32
#define BYTES   (WIDTH * HEIGHT)
#define IDS     4096

static cap_bufpool *pool[CAMERAS];
static cap_assembler *assembler;
static struct cap_tap tap;
static enum cap_count last_why;
/* Not NULL: cameras wait for the disk, whose thread does not know that they are faster. */
static cap_ring *paced;
static uint64_t counts[CAMERAS][CAP_N_COUNT];
static unsigned takes, next_sets, next_strays;
static char paths[16][128];
static bool fails;
static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER; /* held: no take begins */

static void ring_count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    (void)camera;
    (void)n;
    last_why = what;
}
static void ring_stray(void *ctx, struct cap_frame *f)
{
    (void)ctx;
    tap.stray(tap.ctx, f, last_why);
}
static void counts_of(void *ctx, uint32_t camera, uint64_t out[CAP_N_COUNT])
{
    (void)ctx;
    memcpy(out, counts[camera], sizeof counts[camera]);
}
static const struct cap_take_camera cameras[CAMERAS] = {
    {.name = "a"}, {.name = "b"}, {.name = "c"}};
static pvx_err place(void *ctx, const struct cap_take_trigger *t, char *path, size_t size,
                     struct cap_take_head *head, struct pvx_diag *d)
{
    (void)ctx;
    (void)t;
    pthread_mutex_lock(&gate);
    pthread_mutex_unlock(&gate);
    if (fails)
        return pvx_fail(d, PVX_EPERM, "no place");
    snprintf(paths[takes], sizeof paths[takes], "%s/%u.h5", dir, takes);
    snprintf(path, size, "%s", paths[takes++]);
    *head = take_head(cameras, CAMERAS);
    return PVX_OK;
}
static void next_set(void *ctx, struct cap_set *s)
{
    (void)ctx;
    (void)s;
    next_sets++;
}
static void next_stray(void *ctx, struct cap_frame *f, enum cap_count why)
{
    (void)ctx;
    (void)why;
    next_strays++;
    cap_frame_release(f);
}

static cap_ring *set_up(uint64_t bytes)
{
    const struct cap_ring_config c = {.n_cameras = CAMERAS,
                                      .frames = FRAMES,
                                      .bytes = bytes,
                                      .fps = FPS,
                                      .next = {.set = next_set, .stray = next_stray},
                                      .counts = counts_of,
                                      .place = place};
    const struct cap_assembler_params p = {.cameras = CAMERAS,
                                           .period_ns = P,
                                           .policy = CAP_POLICY_PARTIAL,
                                           .min_cameras = 2,
                                           .held = FRAMES + CAP_RING_MORE};
    const struct cap_sink sink = {.count = ring_count, .push = ring_stray};
    cap_ring *r = NULL;
    takes = next_sets = next_strays = 0;
    fails = false;
    memset(counts, 0, sizeof counts);
    T_EQ_I(cap_ring_new(&c, &r), PVX_OK);
    T_EQ_I(cap_assembler_new(&p, &sink, &assembler), PVX_OK);
    for (uint32_t i = 0; i < CAMERAS; i++)
        T_EQ_I(cap_bufpool_new(BUFFERS, BYTES, i, &pool[i]), PVX_OK);
    tap = cap_ring_tap(r);
    T_EQ_I(cap_ring_start(r, NULL), PVX_OK);
    paced = r;
    return r;
}

static void tear_down(cap_ring **r)
{
    paced = NULL;
    cap_ring_free(r);
    cap_assembler_free(&assembler);
    for (uint32_t i = 0; i < CAMERAS; i++) {
        T_EQ_I(free_frames(pool[i]), BUFFERS); /* nothing is kept */
        cap_bufpool_unref(&pool[i]);
    }
    for (unsigned i = 0; i < takes; i++)
        unlink(paths[i]);
}

static void put(uint32_t camera, uint64_t id)
{
    struct cap_frame *f = cap_bufpool_get(pool[camera]);
    T_OK(f != NULL); /* the ring never holds more than it said */
    if (f == NULL)
        return;
    memset(cap_bufpool_memory(f), (int)(id * CAMERAS + camera), BYTES);
    f->img.size = BYTES;
    f->img.width = f->img.stride = WIDTH;
    f->img.height = HEIGHT;
    f->img.fmt = CAP_GREY8;
    f->id = id;
    f->t_exposure_ns = f->t_device_ns = T0 + (int64_t)id * P;
    f->t_arrival_mono_ns = (int64_t)id * P;
    cap_assembler_put(assembler, f);
}

static void wait_disk(void)
{
    struct cap_ring_stats s = {0};
    do {
        if (paced == NULL)
            return;
        sched_yield();
        cap_ring_stats(paced, &s);
    } while (s.behind > 3 || (s.waiting > 0 && !s.writing));
}

/* Cameras of `mask` send the frames first..end-1. */
static void send(uint64_t first, uint64_t end, unsigned mask)
{
    for (uint64_t k = first; k < end; k++) {
        wait_disk();
        for (uint32_t c = 0; c < CAMERAS; c++)
            if (mask >> c & 1)
                put(c, k);
        for (struct cap_set *s; (s = cap_assembler_pop(assembler)) != NULL;) {
            tap.set(tap.ctx, s);
            cap_set_release(s);
        }
    }
}

static pvx_err order(cap_ring *r, const char *name, int64_t id, int pre, int post)
{
    struct cap_take_trigger t = {.t_ns = T0 + id * P,
                                 .set = id,
                                 .t_from_ns = T0 + (id - pre) * P,
                                 .t_to_ns = T0 + (id + post) * P};
    snprintf(t.name, sizeof t.name, "%s", name);
    return cap_ring_trigger(r, &t);
}

static struct cap_ring_stats wait_takes(cap_ring *r, uint64_t n)
{
    struct cap_ring_stats s;
    do {
        sched_yield();
        cap_ring_stats(r, &s);
    } while (s.takes + s.failed < n || s.writing);
    return s;
}

static uint64_t all_lost(const struct cap_ring_stats *s)
{
    uint64_t n = 0;
    for (int i = 0; i < CAP_RING_N_WHY; i++)
        n += s->lost[i];
    return n;
}

/* Each frame first..last of each camera is once in take k, or once in a row of lost frames.  Returns those in rows of
 * `why`. */
static uint64_t check_account(unsigned k, uint64_t first, uint64_t last, const char *why)
{
    static unsigned char seen[CAMERAS][IDS];
    struct pvx_diag d = {""};
    cap_take *t = NULL;
    uint64_t of_why = 0, wrong = 0;
    memset(seen, 0, sizeof seen);
    pvx_err e = cap_take_open(paths[k], &t, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    if (e != PVX_OK)
        return 0;
    const struct cap_take_info *i = cap_take_info(t);
    T_OK(i->closed && i->head.triggered);
    T_EQ_I(i->gaps, 0);
    for (uint32_t c = 0; c < CAMERAS; c++)
        for (uint64_t r = 0; r < i->head.camera[c].frames; r++) {
            unsigned char mem[BYTES];
            struct cap_image img;
            uint64_t id = cap_take_row(t, c, r)->id;
            T_OK(id >= first && id <= last);
            T_EQ_I(cap_take_read(t, c, r, mem, sizeof mem, &img, NULL), PVX_OK);
            T_EQ_I(mem[0], (unsigned char)(id * CAMERAS + c));
            seen[c][id % IDS]++;
        }
    for (uint64_t g = 0; g < i->lost; g++) {
        const struct cap_take_lost *l = cap_take_lost(t, g);
        T_EQ_I(l->frames, l->id_last - l->id_first + 1);
        of_why += strcmp(l->why, why) == 0 ? l->frames : 0;
        for (uint64_t id = l->id_first; id <= l->id_last; id++)
            seen[l->camera][id % IDS]++;
    }
    for (uint32_t c = 0; c < CAMERAS; c++)
        for (uint64_t id = first; id <= last; id++)
            wrong += seen[c][id % IDS] != 1;
    T_EQ_I(wrong, 0);
    cap_take_free(&t);
    return of_why;
}

static struct cap_take_trigger trigger_of(unsigned k, uint64_t n)
{
    struct cap_take_trigger out = {0};
    cap_take *t = NULL;
    T_EQ_I(cap_take_open(paths[k], &t, NULL), PVX_OK);
    T_LE(n + 1, cap_take_info(t)->triggers);
    if (cap_take_info(t)->triggers > n)
        out = *cap_take_trigger(t, n);
    cap_take_free(&t);
    return out;
}

#define ALL    7u
#define PLENTY (1u << 30)

T_CASE_OF_THREADS(it_holds_the_newest_within_its_bounds)
{
    struct cap_ring_stats s;
    cap_ring *r = set_up(PLENTY);
    send(0, 500, ALL);
    cap_ring_stats(r, &s);
    T_EQ_I(s.held, FRAMES);
    T_EQ_I(s.bytes, FRAMES * CAMERAS * BYTES);
    T_NEAR(s.seconds, (FRAMES - 1) * 1.0 / FPS, 1e-6);
    T_EQ_I(next_sets, 500); /* the next receiver has all */
    T_EQ_I(s.triggers, 0);
    T_EQ_I(all_lost(&s), 0); /* no take should have had what left it */
    send(500, 700, 1);       /* frames in no set count too */
    cap_ring_stats(r, &s);
    T_EQ_I(s.held, FRAMES);
    tear_down(&r);
    r = set_up(10 * CAMERAS * BYTES + 5);
    send(0, 100, ALL);
    cap_ring_stats(r, &s);
    T_EQ_I(s.held, 10);
    T_EQ_I(s.bytes_most, 10 * CAMERAS * BYTES);
    tear_down(&r);
    r = set_up(CAMERAS * BYTES - 1); /* not even one */
    send(0, 3, ALL);
    cap_ring_stats(r, &s);
    T_EQ_I(s.bytes, 0);
    tear_down(&r);
}

T_CASE_OF_THREADS(a_trigger_writes_from_before_to_after)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 80, ALL);
    T_EQ_I(order(r, "ignition", 70, 20, 30), PVX_OK);
    send(80, 200, ALL);
    struct cap_ring_stats s = wait_takes(r, 1);
    T_EQ_I(s.takes, 1);
    T_EQ_I(s.written, 51 * CAMERAS);
    T_EQ_I(all_lost(&s), 0);
    T_EQ_I(check_account(0, 50, 100, ""), 0);
    struct cap_take_trigger t = trigger_of(0, 0);
    T_EQ_S(t.name, "ignition");
    T_EQ_I(t.set, 70);
    T_EQ_I(t.t_ns, T0 + 70 * P);
    T_EQ_I(order(r, "again", 180, 10, 10), PVX_OK); /* it is ready again */
    send(200, 250, ALL);
    s = wait_takes(r, 2);
    T_EQ_I(s.takes, 2);
    T_EQ_I(check_account(1, 170, 190, ""), 0);
    tear_down(&r);
}

T_CASE_OF_THREADS(a_second_trigger_extends_or_waits)
{
    struct cap_ring_stats s;
    cap_ring *r = set_up(PLENTY);
    send(0, 60, ALL);
    T_EQ_I(order(r, "one", 50, 10, 20), PVX_OK);
    T_EQ_I(order(r, "two", 60, 10, 30), PVX_OK); /* its time begins within that of one */
    send(60, 80, ALL);
    T_EQ_I(order(r, "three", 120, 10, 10), PVX_OK);
    cap_ring_stats(r, &s);
    T_EQ_I(s.waiting, 1);
    paced = NULL; /* one waits: the ring has room for all that comes until then */
    send(80, 120, ALL);
    paced = r;
    do {
        cap_ring_stats(r, &s);
    } while (s.takes == 0 && s.behind > 3);
    send(120, 200, ALL);
    s = wait_takes(r, 2);
    T_EQ_I(s.triggers, 3);
    T_EQ_I(s.extended, 1);
    T_EQ_I(s.takes, 2);
    check_account(0, 40, 90, "");
    check_account(1, 110, 130, "");
    T_EQ_S(trigger_of(0, 1).name, "two");
    T_EQ_S(trigger_of(1, 0).name, "three");
    tear_down(&r);
}

/* The ring's thread has already seen later frames, and left them out, when they are asked for. */
T_CASE_OF_THREADS(a_late_trigger_extends_too)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 55, ALL);
    T_EQ_I(order(r, "one", 50, 10, 10), PVX_OK); /* 40..60 */
    send(55, 80, ALL);
    T_EQ_I(order(r, "two", 75, 20, 10), PVX_OK); /* 55..85 */
    send(80, 140, ALL);
    struct cap_ring_stats s = wait_takes(r, 1);
    T_EQ_I(s.extended, 1);
    T_EQ_I(s.written, 46 * CAMERAS);
    check_account(0, 40, 85, "");
    tear_down(&r);
}

/* A disk that takes nothing for long: what leaves the ring meanwhile is named. */
T_CASE_OF_THREADS(what_leaves_before_the_disk_takes_it_is_named)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 60, ALL);
    paced = NULL;
    pthread_mutex_lock(&gate);
    T_EQ_I(order(r, "slow", 55, 30, 30), PVX_OK); /* 25..85 */
    send(60, 100, ALL);                           /* 50..99 are left */
    pthread_mutex_unlock(&gate);
    paced = r;
    send(100, 140, ALL);
    struct cap_ring_stats s = wait_takes(r, 1);
    uint64_t n = check_account(0, 25, 85, "ring");
    T_LE(25 * CAMERAS, n);
    T_EQ_I(s.lost[CAP_RING_OUTRUN], n);
    T_EQ_I(s.written + n, 61 * CAMERAS);
    tear_down(&r);
}

T_CASE_OF_THREADS(what_had_left_before_the_trigger_is_named)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 200, ALL);                            /* 150..199 are left */
    T_EQ_I(order(r, "late", 190, 60, 5), PVX_OK); /* 130..195 */
    send(200, 260, ALL);
    struct cap_ring_stats s = wait_takes(r, 1);
    T_EQ_I(s.lost[CAP_RING_BEFORE], 20 * CAMERAS);
    T_EQ_I(s.written, 46 * CAMERAS);
    tear_down(&r);
}

T_CASE_OF_THREADS(frames_that_capture_lost_are_named_with_its_cause)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 40, ALL);
    counts[0][CAP_INCOMPLETE] += 2; /* numbers 40, 41 of camera a */
    send(40, 42, 6);
    send(42, 50, ALL);
    counts[1][CAP_UNDERRUN] += 1; /* 50 of b */
    send(50, 51, 5);
    send(51, 53, ALL);
    counts[0][CAP_UNDERRUN] += 1; /* 53 of a, which had lost others before */
    send(53, 54, 6);
    send(54, 60, ALL);
    send(60, 61, 3); /* 60 of c: counted as nothing */
    T_EQ_I(order(r, "x", 55, 30, 20), PVX_OK);
    send(61, 130, ALL);
    struct cap_ring_stats s = wait_takes(r, 1);
    T_EQ_I(check_account(0, 25, 75, "incomplete"), 2);
    T_EQ_I(check_account(0, 25, 75, "underrun"), 2);
    T_EQ_I(check_account(0, 25, 75, "unknown"), 1);
    T_EQ_I(all_lost(&s), 5);
    tear_down(&r);
}

/* The disk is behind, and a camera that was silent at the take's end has sent again: what it did not send comes after the
 * set that ends the take. */
T_CASE_OF_THREADS(a_camera_that_came_back_is_named)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 92, ALL);
    paced = NULL;
    pthread_mutex_lock(&gate);
    T_EQ_I(order(r, "x", 90, 0, 5), PVX_OK); /* 90..95 */
    send(92, 139, 3);
    send(139, 142, ALL);
    pthread_mutex_unlock(&gate);
    wait_takes(r, 1);
    T_LE(4, check_account(0, 90, 95, "unknown"));
    tear_down(&r);
}

/* One camera sends alone: frames in no set are in the take too, and with the next receiver. */
T_CASE_OF_THREADS(frames_without_a_set_are_in_the_take)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 30, ALL);
    send(30, 35, 1);
    send(35, 60, ALL);
    T_EQ_I(order(r, "x", 50, 25, 20), PVX_OK);
    send(60, 130, ALL);
    wait_takes(r, 1);
    T_EQ_I(next_strays, 5);
    cap_take *t = NULL;
    T_EQ_I(cap_take_open(paths[0], &t, NULL), PVX_OK);
    T_EQ_I(cap_take_info(t)->head.camera[0].frames, 46);
    T_EQ_I(cap_take_info(t)->head.camera[1].frames, 41);
    cap_take_free(&t);
    T_EQ_I(check_account(0, 25, 70, "unknown"), 10); /* the five of b and of c */
    tear_down(&r);
}

T_CASE_OF_THREADS(a_take_that_cannot_be_written_is_counted)
{
    cap_ring *r = set_up(PLENTY);
    fails = true;
    send(0, 60, ALL);
    T_EQ_I(order(r, "x", 50, 10, 10), PVX_OK);
    send(60, 130, ALL);
    struct cap_ring_stats s = wait_takes(r, 1);
    T_EQ_I(s.failed, 1);
    T_EQ_I(s.lost[CAP_RING_DISK], 21 * CAMERAS);
    T_CONTAINS(s.error, "no place");
    fails = false; /* and the next one works */
    T_EQ_I(order(r, "y", 120, 10, 10), PVX_OK);
    send(130, 190, ALL);
    s = wait_takes(r, 2);
    T_EQ_I(s.takes, 1);
    check_account(0, 110, 130, "");
    tear_down(&r);
}

T_CASE_OF_THREADS(a_stop_writes_what_is_there)
{
    cap_ring *r = set_up(PLENTY);
    send(0, 60, ALL);
    T_EQ_I(order(r, "x", 55, 10, 30), PVX_OK);
    cap_ring_stop(r);
    struct cap_ring_stats s;
    cap_ring_stats(r, &s);
    T_EQ_I(s.takes, 1);
    T_EQ_I(s.written, 15 * CAMERAS);
    T_EQ_I(s.lost[CAP_RING_STOPPED], 26 * CAMERAS);
    T_EQ_I(order(r, "y", 59, 1, 1), PVX_ECLOSED);
    tear_down(&r);
}
T_MAIN(scratch_new(), scratch_remove())
