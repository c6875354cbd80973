/* test_intake.c - a thread that pushes frames: it waits for nobody, and each of its frames ends in a set
 * or in one count, also with all of them at full speed.  The capture's own threads do not run. */
#include "../t.h"

#include <sys/syscall.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/rig/capture_int.h"
#include "tests/lib/source.h"
#include "capture/source/bufpool.h"
#include "tests/lib/free_frames.h"

#define CAMERAS 3
#define BUFFERS 12
#define BYTES   64
#define MEMBERS 200 /* of sets, of each camera, and as many displaced */

static cap_bufpool *pool[CAMERAS];

static cap_capture *begin(bool shared_clock, uint32_t discard)
{
    static const char *const name[CAMERAS] = {"a", "b", "c"};
    struct cap_source_config cam[CAMERAS];
    for (uint32_t i = 0; i < CAMERAS; i++) {
        cam[i] = source_of("sim:", 8, 8, CAP_GREY8, 0);
        cam[i].name = name[i];
        cam[i].buffers = BUFFERS;
        T_EQ_I(cap_bufpool_new(2 * BUFFERS, BYTES, i, &pool[i]), PVX_OK);
    }
    struct cap_capture_config cfg = {.n_cameras = CAMERAS,
                                     .camera = cam,
                                     .fps = 1000,
                                     .shared_clock = shared_clock,
                                     .discard_first = discard,
                                     .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    cap_capture *cap;
    struct pvx_diag d = {""};
    T_CHECK_(cap_capture_new(&cfg, &cap, &d) == PVX_OK, "%s", d.text);
    for (uint32_t i = 0; i < CAMERAS; i++)
        cap_intake_restart(&cap->camera[i]);
    return cap;
}

static void end(cap_capture *cap)
{
    cap_capture_free(&cap);
    for (uint32_t i = 0; i < CAMERAS; i++) {
        T_EQ_I(free_frames(pool[i]), 2 * BUFFERS);
        cap_bufpool_unref(&pool[i]);
    }
}

/* False: no buffer is free. */
static bool push(cap_capture *cap, uint32_t c, int32_t width, int64_t device_ns)
{
    struct cap_sink sink = cap_intake_sink(&cap->camera[c]);
    struct cap_frame *f = cap_bufpool_get(pool[c]);
    if (f == NULL)
        return false;
    f->img.size = BYTES;
    f->img.width = width;
    f->img.height = f->img.stride = 8;
    f->img.fmt = CAP_GREY8;
    f->t_device_ns = device_ns;
    pvx_now_both(&f->t_arrival_ns, &f->t_arrival_mono_ns);
    sink.push(sink.ctx, f);
    return true;
}

/* Were a lock on the way of a frame, this would not return. */
T_CASE(a_push_returns_with_every_lock_held)
{
    cap_capture *cap = begin(false, 1);
    struct cap_camera *cam = &cap->camera[0];
    pthread_mutex_lock(&cap->stopping);
    pthread_mutex_lock(&cap->figures);
    pthread_mutex_lock(&cam->readings.lock);
    struct cap_sink sink = cap_intake_sink(cam);
    for (int i = 1; i <= 100; i++)
        T_OK(push(cap, 0, 8, i * PVX_NS_PER_MS));
    for (int i = 0; i < 100; i++) /* its stamps stand still; its size is another one */
        T_OK(push(cap, 0, i % 2 != 0 ? 8 : 4, 100 * PVX_NS_PER_MS));
    sink.detail(sink.ctx, 0, CAP_TRIGGER_MODE, "On instead of Off");
    sink.count(sink.ctx, 0, CAP_INCOMPLETE, 3);
    sink.event(sink.ctx, 0, CAP_EV_LOST);
    pthread_mutex_unlock(&cam->readings.lock);
    pthread_mutex_unlock(&cap->figures);
    pthread_mutex_unlock(&cap->stopping);
    T_EQ_I(cam->count[CAP_RECEIVED], 92); /* after eight that only tell the clock */
    T_EQ_I(cam->count[CAP_OVERFLOW], 92 - BUFFERS / 2);
    T_EQ_I(cam->count[CAP_BAD_SIZE], 50);
    T_EQ_I(cam->count[CAP_BAD_STAMP], 50);
    T_EQ_I(cam->count[CAP_INCOMPLETE], 3);
    T_OK(cam->intake.lost);
    T_EQ_I(free_frames(pool[0]), 2 * BUFFERS - BUFFERS / 2);
    end(cap);
}

/* The time of this program: where `still_ns` is set it stands there, until the reading in which the thread
 * is held up for a second, after a frame has come. */
static int64_t still_ns;
static int held_up_at; /* so many readings from now; 0 = not */
static cap_capture *meanwhile;

int clock_gettime(clockid_t id, struct timespec *ts)
{
    if (still_ns == 0)
        return (int)syscall(SYS_clock_gettime, id, ts);
    if (held_up_at > 0 && --held_up_at == 0) {
        push(meanwhile, 1, 8, still_ns);
        still_ns += PVX_NS_PER_S;
    }
    *ts = (struct timespec){.tv_sec = still_ns / PVX_NS_PER_S, .tv_nsec = still_ns % PVX_NS_PER_S};
    return 0;
}

static void push_to_set(cap_capture *cap, uint32_t c)
{
    T_OK(push(cap, c, 8, still_ns));
    T_OK(cap_assemble_some(cap, false));
}

T_CASE(a_frame_is_not_late_because_the_assembler_was_held_up)
{
    int reading = 0;
    do {
        still_ns = 1000 * PVX_NS_PER_S;
        meanwhile = begin(true, 0);
        T_OK(push(meanwhile, 1, 8, still_ns)); /* so that sets wait for it */
        push_to_set(meanwhile, 0);
        T_OK(cap_assemble_some(meanwhile, false));
        still_ns += 10 * PVX_NS_PER_MS;
        push_to_set(meanwhile, 0);
        held_up_at = ++reading;
        T_OK(cap_assemble_some(meanwhile, false));
        bool was = held_up_at == 0;
        held_up_at = 0;
        while (was && pvx_ring_length(meanwhile->camera[1].intake.ring) > 0)
            T_OK(cap_assemble_some(meanwhile, false));
        T_EQ_I(meanwhile->camera[1].count[CAP_RECEIVED], was ? 2 : 1);
        T_EQ_I(meanwhile->camera[1].count[CAP_LATE], 0);
        end(meanwhile);
        if (!was)
            break;
    } while (reading < 100);
    still_ns = 0;
    T_OK(reading > 2); /* as often was it held up */
}

static atomic_bool enough;

struct driver {
    cap_capture *cap;
    uint32_t camera;
    uint64_t pushed;
};
static void *drive(void *arg)
{
    struct driver *d = arg;
    for (int64_t last = 0; !enough;) {
        int64_t now = pvx_now_real();
        d->pushed += now > last && push(d->cap, d->camera, 8, now);
        last = now;
        if (d->pushed % BUFFERS == 0) /* the ring is full: let the assembler at it */
            sched_yield();
    }
    return NULL;
}

static void *read_figures(void *cap)
{
    static struct cap_stats st;
    for (; !enough; sched_yield())
        cap_capture_stats(cap, &st);
    return NULL;
}

static void pop_sets(cap_capture *cap, uint64_t in_sets[CAMERAS])
{
    struct cap_set *s;
    while (cap_capture_next(cap, 0, &s) == PVX_OK) {
        for (uint32_t i = 0; i < CAMERAS; i++)
            in_sets[i] += s->frame[i] != NULL;
        cap_set_release(s);
    }
}

T_CASE(every_frame_is_accounted_for_at_full_speed)
{
    cap_capture *cap = begin(true, 0);
    struct driver d[CAMERAS];
    pthread_t thread[CAMERAS], reader;
    uint64_t in_sets[CAMERAS] = {0};
    enough = false;
    pthread_create(&reader, NULL, read_figures, cap);
    for (uint32_t i = 0; i < CAMERAS; i++) {
        d[i] = (struct driver){.cap = cap, .camera = i};
        pthread_create(&thread[i], NULL, drive, &d[i]);
    }
    while (!enough) {
        T_OK(cap_assemble_some(cap, false));
        pop_sets(cap, in_sets);
        bool more = false;
        for (uint32_t i = 0; i < CAMERAS; i++)
            more |= in_sets[i] < MEMBERS || cap->camera[i].count[CAP_OVERFLOW] < MEMBERS;
        enough = !more;
    }
    pthread_join(reader, NULL);
    for (uint32_t i = 0; i < CAMERAS; i++)
        pthread_join(thread[i], NULL);
    cap->stop = true; /* what is open is closed */
    T_OK(!cap_assemble_some(cap, false));
    pop_sets(cap, in_sets);
    cap_assemble_nothing(cap);
    for (uint32_t i = 0; i < CAMERAS; i++) {
        const _Atomic uint64_t *k = cap->camera[i].count;
        T_EQ_I(k[CAP_RECEIVED], d[i].pushed);
        T_EQ_I(in_sets[i] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW], d[i].pushed);
        printf("  camera %u: %llu pushed, %llu in sets, %llu displaced\n", i,
               (unsigned long long)d[i].pushed, (unsigned long long)in_sets[i],
               (unsigned long long)k[CAP_OVERFLOW]);
    }
    end(cap);
}
