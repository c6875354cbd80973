/* test_detection.c - how long a fault takes to be found, in time that the test makes: frames go through
 * the real intake, clock maps, assembler and watch of a capture whose threads do not run, so what comes
 * out is the same on any machine.  And random healthy rigs, in which nothing may be found. */
#include "../t.h"

#include "base/clock.h"
#include "capture/rig/capture_int.h"
#include "tests/lib/source.h"

#define S          PVX_NS_PER_S
#define MS         PVX_NS_PER_MS
#define MAX        8
#define FRAMES     4096
#define AT_MOST    1.0                   /* s */
#define BEGINNINGS (T_SANITIZED ? 1 : 5) /* of a fault, over a second */

static uint8_t pixels[64];
static struct cap_frame pool[FRAMES], *pool_free[FRAMES];
static size_t n_free;

static void give_back(struct cap_frame *f)
{
    pool_free[n_free++] = f;
}

/* What goes wrong with the last camera from `at` on; times in s. */
struct fault {
    const char *name;
    enum cap_count cause; /* CAP_N_COUNT: the host's clock */
    double hz;            /* runs by itself */
    double phase;         /* exposes that much later */
    int64_t slip;         /* numbers are so many ahead */
    bool missed;          /* takes one picture less, which its numbers do not tell */
    bool stuck;           /* its stamps stand still */
    double jump;          /* of its clock */
    double host_step;
    bool own_only, common_only; /* makes sense with such clocks */
};

struct rig {
    uint32_t cameras;
    double hz;
    double drift_ppm; /* clocks of their own, each way; < 0: one clock for all */
    double stamp;     /* s: exposures are up to that much late, as triggers are */
    double delay;     /* s: frames arrive up to that much late */
    double drop;      /* share of frames lost, with a gap in the numbers */
    bool readings;    /* clocks are read once a second, +-0.1 ms */
    struct fault fault;
    double at, until;
};

struct stream {
    double ppm, next, grid; /* next exposure; where it is on its own grid */
    int64_t k, dev0, last_arrival, read_at;
    uint64_t id;
    int64_t stuck_ns;
    bool ill;
};

struct bed {
    struct rig r;
    struct cap_capture *cap;
    struct stream cam[MAX];
    int64_t mono0, real_off;
    double found; /* after the fault; < 0 not yet */
};

static void open_bed(struct bed *b, const struct rig *r)
{
    static char name[MAX][16];
    static struct cap_source_config cam[MAX];
    *b = (struct bed){.r = *r, .mono0 = pvx_now_mono() + 3600 * S, .found = -1};
    b->real_off = pvx_now_real() - pvx_now_mono();
    n_free = 0;
    for (size_t i = 0; i < FRAMES; i++)
        give_back(&pool[i]);
    for (uint32_t c = 0; c < r->cameras; c++) {
        snprintf(name[c], sizeof name[c], "cam%u", c);
        cam[c] = source_of("sim:", 8, 8, CAP_GREY8, 0);
        cam[c].name = name[c];
        b->cam[c] = (struct stream){.ppm = t_uniform(-r->drift_ppm, r->drift_ppm),
                                    .dev0 = (int64_t)t_uniform(1e9, 1e15),
                                    .id = 1 + t_rand() % 60000,
                                    .k = (int64_t)(t_rand() % 5)};
        b->cam[c].next = (double)b->cam[c].k / r->hz;
    }
    struct cap_capture_config cfg = {.n_cameras = r->cameras,
                                     .camera = cam,
                                     .fps = r->hz,
                                     .shared_clock = r->drift_ppm < 0,
                                     .discard_first = 1,
                                     .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    struct pvx_diag d = {""};
    T_CHECK_(cap_capture_new(&cfg, &b->cap, &d) == PVX_OK, "%s", d.text);
    for (uint32_t c = 0; c < r->cameras; c++)
        cap_intake_restart(&b->cap->camera[c]);
}

static uint64_t found(const struct bed *b, uint32_t c)
{
    return b->r.fault.cause == CAP_N_COUNT ? b->cap->host.steps
                                           : b->cap->camera[c].count[b->r.fault.cause];
}

/* The exposure at t of camera c, on its way through everything. */
static void expose(struct bed *b, uint32_t c, double t)
{
    const struct rig *r = &b->r;
    const struct fault *f = &r->fault;
    struct stream *x = &b->cam[c];
    bool ill = x->ill;
    int64_t t_ns = llrint((t + (ill ? f->phase : 0) + t_uniform(0, r->stamp)) * 1e9);
    int64_t arrival = t_ns + 2 * MS + (int64_t)t_uniform(0, r->delay * 1e9);
    if (arrival <= x->last_arrival)
        arrival = x->last_arrival + 1000;
    x->last_arrival = arrival;
    int64_t step = t >= r->at ? llrint(f->host_step * 1e9) : 0;
    int64_t device = r->drift_ppm < 0 ? b->mono0 + b->real_off + t_ns + step
                                      : x->dev0 + t_ns + llrint((double)t_ns * x->ppm * 1e-6);
    device += ill ? llrint(f->jump * 1e9) : 0;
    if (ill && f->stuck)
        device = x->stuck_ns;
    x->stuck_ns = device;
    struct cap_sink sink = cap_intake_sink(&b->cap->camera[c]);
    if (r->readings && r->drift_ppm >= 0 && t_ns - x->read_at > S) {
        x->read_at = t_ns;
        sink.clock(sink.ctx, c, device, b->mono0 + t_ns + (int64_t)t_uniform(-1e5, 1e5), 100000);
    }
    T_OK(n_free > 0);
    struct cap_frame *frame = pool_free[--n_free];
    *frame = (struct cap_frame){.img = {.data = pixels,
                                        .size = sizeof pixels,
                                        .width = 8,
                                        .height = 8,
                                        .stride = 8,
                                        .fmt = CAP_GREY8},
                                .id = x->id + (uint64_t)(ill ? f->slip : 0),
                                .t_device_ns = device,
                                .t_arrival_ns = b->mono0 + b->real_off + arrival + step,
                                .t_arrival_mono_ns = b->mono0 + arrival,
                                .release = give_back};
    cap_assembler_tick(b->cap->assembler, b->mono0 + arrival);
    sink.push(sink.ctx, frame);
    while (pvx_ring_length(b->cap->camera[c].intake.ring) > 0)
        T_OK(cap_assemble_some(b->cap, false));
    struct cap_set *s;
    while (cap_capture_next(b->cap, 0, &s) == PVX_OK)
        cap_set_release(s);
    if (t >= r->at && b->found < 0 && found(b, r->cameras - 1) > 0)
        b->found = (double)arrival * 1e-9 - r->at;
}

/* Move camera c to its next exposure. */
static void go_on(struct bed *b, uint32_t c)
{
    struct stream *x = &b->cam[c];
    const struct fault *f = &b->r.fault;
    if (x->ill && f->hz > 0) {
        x->grid += 1 / f->hz;
        x->next = x->grid;
    } else {
        x->next = (double)++x->k / b->r.hz;
    }
    x->id++;
    if (x->ill || c != b->r.cameras - 1 || x->next < b->r.at || f->name == NULL)
        return;
    x->ill = true;
    if (f->missed)
        x->next = (double)++x->k / b->r.hz;
    x->grid = x->next;
}

static void play(struct bed *b, const struct rig *r)
{
    open_bed(b, r);
    for (;;) {
        uint32_t c = 0;
        for (uint32_t i = 1; i < r->cameras; i++)
            if (b->cam[i].next < b->cam[c].next)
                c = i;
        double t = b->cam[c].next;
        if (t > r->until || b->found >= 0)
            break;
        if (t_uniform(0, 1) >= r->drop)
            expose(b, c, t);
        go_on(b, c);
    }
}

static const char *detail(const struct bed *b, uint32_t c, int what)
{
    static char text[CAP_DETAIL_MAX];
    pvx_board_read(&b->cap->camera[c].detail[what], text, sizeof text);
    return text;
}

static void nothing_in(const struct bed *b, uint32_t cameras)
{
    for (uint32_t c = 0; c < cameras; c++)
        for (int k = 0; k < CAP_N_COUNT; k++)
            T_CHECK_(
                k < CAP_CLOCK_STUCK || b->cap->camera[c].count[k] == 0,
                "%s, %u cameras, %.1f Hz, %g ppm, stamps %g ms, delays %g ms, drops %g: camera "
                "%u: %s %llu: %s",
                b->r.fault.name != NULL ? b->r.fault.name : "healthy", b->r.cameras, b->r.hz,
                b->r.drift_ppm, b->r.stamp * 1e3, b->r.delay * 1e3, b->r.drop, c,
                cap_count_defs[k].name, (unsigned long long)b->cap->camera[c].count[k],
                detail(b, c, k));
}

static const struct fault faults[] = {
    {"numbers off by one", CAP_SLIP, .slip = 1},
    {"a trigger missed", CAP_MISSED_TRIGGER, .missed = true},
    {"wrong mode: runs freely at 25 Hz", CAP_RATE, .hz = 25},
    {"wrong mode: freely at 30 Hz, other phase", CAP_OUT_OF_STEP, .phase = 0.012},
    {"wrong mode: freely at 30.03 Hz", CAP_RATE, .hz = 30.03},
    {"29.97 Hz beside 30", CAP_RATE, .hz = 29.97},
    {"half the rate", CAP_RATE, .hz = 15},
    {"twice the rate", CAP_RATE, .hz = 60},
    {"its clock stands still", CAP_CLOCK_STUCK, .stuck = true},
    {"its clock jumps by 100 s", CAP_CLOCK_JUMP, .jump = 100, .own_only = true},
    {"its clock jumps by -100 s", CAP_CLOCK_JUMP, .jump = -100},
    {"its clock jumps by 100 s", CAP_OUT_OF_STEP, .jump = 100, .common_only = true},
    {"the host's clock is set by 3600 s", CAP_N_COUNT, .host_step = 3600},
    {"the host's clock is set by -0.01 s", CAP_N_COUNT, .host_step = -0.01},
};

/* The worst of many beginnings. */
static double worst(const struct fault *f, double ppm, double warm)
{
    double most = 0;
    struct bed b;
    for (int k = 0; k < BEGINNINGS; k++) {
        struct rig r = {.cameras = 4,
                        .hz = 30,
                        .drift_ppm = ppm,
                        .stamp = 5e-6,
                        .delay = 1e-3,
                        .readings = k % 2 == 0,
                        .fault = *f,
                        .at = warm + (double)k / BEGINNINGS,
                        .until = warm + 20};
        play(&b, &r);
        T_CHECK_(b.found >= 0, "%s: not found", f->name);
        most = fmax(most, b.found < 0 ? INFINITY : b.found);
        nothing_in(&b, r.cameras - 1);
        cap_capture_free(&b.cap);
        T_EQ_I(n_free, FRAMES);
    }
    return most;
}

T_CASE(every_fault_is_found_within_a_second)
{
    printf("  %-42s %-14s %s\n", "4 cameras, 30 Hz, stamps good to 5 us", "cause",
           "found after at most, s: one clock, own clocks at 5 s, at 30 s");
    for (size_t k = 0; k < sizeof faults / sizeof faults[0]; k++) {
        const struct fault *f = &faults[k];
        double t[3] = {NAN, NAN, NAN};
        for (int i = 0; i < 3; i++) {
            if (i == 0 ? f->own_only : f->common_only)
                continue;
            t[i] = worst(f, i == 0 ? -1 : 100, i == 2 ? 30 : 5);
            T_LE(t[i], AT_MOST);
        }
        printf("  %-42s %-14s %5.2f %5.2f %5.2f\n", f->name,
               f->cause == CAP_N_COUNT ? "host clock" : cap_count_defs[f->cause].name, t[0], t[1],
               t[2]);
    }
}

/* Any number of cameras, any rate, clocks, jitter, losses: no finding at all. */
T_CASE(nothing_is_found_in_healthy_rigs)
{
    struct bed b;
    const char *s = getenv("RIGS");
    int rigs = s != NULL ? atoi(s) : 20;
    double seconds = 0;
    for (int k = 0; k < rigs; k++) {
        struct rig r = {.cameras = 2 + (uint32_t)(t_rand() % 7),
                        .hz = exp(t_uniform(log(5), log(120))),
                        .drift_ppm = k % 4 == 0 ? -1 : t_uniform(0, 100),
                        .stamp = k % 3 == 0 ? 2e-6 : t_uniform(0, 1e-3),
                        .delay = t_uniform(0, 1e-3),
                        .drop = t_uniform(0, 0.05),
                        .readings = k % 2 == 0,
                        .at = INFINITY,
                        .until = t_uniform(10, 60)};
        play(&b, &r);
        nothing_in(&b, r.cameras);
        T_EQ_I(b.cap->host.steps, 0);
        seconds += r.until;
        cap_capture_free(&b.cap);
        if (t_case_fails > 8)
            break;
    }
    printf("  %d rigs of 2 to 8 cameras, 5 to 120 Hz, %.0f s of their time: nothing found\n", rigs,
           seconds);
}
