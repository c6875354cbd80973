/* test_faults.c - every fault of a camera, of the way to it and of the host: found, counted by its cause,
 * said once with a remedy, and over by itself; what is given out meanwhile is right, and every frame is
 * accounted for.
 * Each case is a capture of its own with four simulated cameras; all run at the same time, and the log
 * is told apart by the cameras' names.  Times are printed; what is asserted of them is generous. */
#include "tests/lib/logged.h"

#include "tests/lib/rig.h"

#define N       4
#define FPS     50
#define BUFFERS 64  /* a busy machine shall not come near */
#define HELD    128 /* sets, with frames of each camera in half of them at least */
#define START_S 3.0 /* from the capture's start, the fault */

enum { ONE, ALL };
struct fault {
    const char *name, *option;
    int who;
    enum cap_count cause;
    const char *begins, *ends; /* parts of the lines that are logged, once each */
    bool foreign_clocks;       /* cameras' clocks are their own */
    double last_s;
    bool holds_sets; /* the consumer keeps what it gets, meanwhile */
    bool no_count;   /* not a camera's count */
    bool noisy;      /* a busy machine does that too */
    bool mixes;      /* stamps are wrong on purpose: pictures cannot be compared */
};
static const struct fault faults[] = {
    {"incomplete", "incomplete=0.3", ONE, CAP_INCOMPLETE, "frames arrive incomplete",
     "no more: frames arrive incomplete", .last_s = 2},
    {"lost", "drop=0.3", ONE, CAP_ID_GAP, "never arrived", "no more: frames that it numbered",
     .noisy = true},
    {"freeze", "freeze", ONE, CAP_CLOCK_STUCK, "its time stamps do not change",
     "no more: its time stamps do not change", .last_s = 2},
    {"short", "short_every=2", ONE, CAP_BAD_SIZE, "frames of another size",
     "no more: frames of another size", .last_s = 2},
    {"wide", "wide_every=3", ONE, CAP_BAD_SIZE, "8x4 and 64 bytes instead of 16x4",
     "no more: frames of another size", .last_s = 2},
    {"format", "other_format", ONE, CAP_BAD_FORMAT, "BayerRG8 instead of Mono8",
     "no more: frames of another pixel format", .last_s = 2},
    {"silent", "silent", ONE, CAP_LOST_CAMERA, "no frame for 0.7 s", "frames come again",
     .last_s = 2},
    {"cable", "gone", ONE, CAP_LOST_CAMERA, "connection lost", "frames come again", .last_s = 2},
    {"switch", "gone", ALL, CAP_LOST_CAMERA, "all 4 cameras are gone", "all 4 cameras are back",
     .last_s = 2},
    {"link", "incomplete=0.4", ALL, CAP_BANDWIDTH, " of 4 cameras send incomplete frames at once",
     "no more: several cameras", .last_s = 2},
    {"jump", "clock_jump_s=-100", ONE, CAP_CLOCK_JUMP, "its clock jumped",
     "no more: its clock jumped", .foreign_clocks = true},
    {"slip", "slip=1", ONE, CAP_SLIP, "numbers and times disagree", "no more: its frame numbers",
     .last_s = 2},
    {"missed", "miss_every=9", ONE, CAP_MISSED_TRIGGER, "misses exposures",
     "no more: it misses exposures", .last_s = 2},
    {"phase", "phase_us=8000", ONE, CAP_OUT_OF_STEP, "out of step", "no more: it is out of step",
     .last_s = 2},
    {"half", "rate=0.5", ONE, CAP_RATE, "its frame rate is wrong",
     "no more: its frame rate is wrong", .last_s = 2},
    {"alone", "rate=1.0015", ONE, CAP_PHASE_WALK, "it runs freely", "no more: it runs freely",
     .last_s = 5, .mixes = true, .noisy = true},
    {"hostclock", "host_step_s=3600", ALL, CAP_N_COUNT, "the host's clock was set by +3600.0",
     "the host's clock was set by -3600.0", .foreign_clocks = true, .no_count = true},
    {"starved", "hold=64", ONE, CAP_UNDERRUN, "no buffer was free", "no more: no buffer was free",
     .last_s = 2},
    {"holding", "skew_us=0", ONE, CAP_UNDERRUN, "no buffer was free", "no more: no buffer was free",
     .holds_sets = true},
};
#define GONE_CASE 8 /* "switch" */
#define CASES     (sizeof faults / sizeof faults[0])

struct run {
    const struct fault *fault;
    struct rig rig;
    uint64_t frames[N], sets, complete, mixed, disorder;
    int64_t last_t;
    struct cap_set *held[HELD];
    int n_held;
    double found_s, back_s; /* after the fault began, after it ended; < 0: not yet */
    uint64_t complete_then; /* complete sets when it ended */
    double t_from;          /* of the fault */
    bool over;
};
static struct run runs[CASES];

static double now_s(void)
{
    return (double)pvx_now_real() * 1e-9;
}

static double last_s(const struct run *r)
{
    return r->fault->last_s > 0 ? r->fault->last_s : 2;
}

static void begin(struct run *r, const struct fault *f)
{
    struct rig *g = &r->rig;
    struct cap_source_config one = sim_camera();
    one.buffers = BUFFERS;
    *r = (struct run){.fault = f, .found_s = -1, .back_s = -1, .t_from = now_s() + START_S};
    rig_init(g, N, FPS, one);
    for (uint32_t i = 0; i < N; i++) {
        int n = f->foreign_clocks
                    ? snprintf(g->uri[i], sizeof g->uri[i], "sim:skew_us=%d,drift_ppm=%d",
                               1000000 * ((int)i + 1), 30 * (int)i - 45)
                    : snprintf(g->uri[i], sizeof g->uri[i], "sim:");
        if (f->who == ALL || i == 2)
            snprintf(g->uri[i] + n, sizeof g->uri[i] - (size_t)n, "%s%s,from=%.3f,to=%.3f",
                     f->foreign_clocks ? "," : "", f->option, r->t_from, r->t_from + last_s(r));
        snprintf(g->name[i], sizeof g->name[i], "%s%u", f->name, i);
    }
    g->cfg.shared_clock = !f->foreign_clocks;
    rig_start(g);
}

static void look(struct run *r, const struct cap_set *s)
{
    int64_t t = 0;
    for (uint32_t i = 0; i < N; i++) {
        if (s->frame[i] == NULL)
            continue;
        struct truth x;
        memcpy(&x, s->frame[i]->img.data, sizeof x);
        r->frames[i]++;
        r->mixed += x.camera != i || (t != 0 && x.t != t && !r->fault->mixes);
        t = x.t;
    }
    r->sets++;
    r->complete += s->n == N;
    r->disorder +=
        s->t_exposure_ns <= r->last_t && llabs(s->t_exposure_ns - r->last_t) < PVX_NS_PER_S;
    r->last_t = s->t_exposure_ns;
}

static void consume(struct run *r)
{
    struct cap_set *s;
    bool hold = r->fault->holds_sets && now_s() > r->t_from &&
                (r->found_s < 0 || now_s() < r->t_from + last_s(r));
    while (cap_capture_next(r->rig.cap, 0, &s) == PVX_OK) {
        look(r, s);
        if (hold && r->n_held < HELD)
            r->held[r->n_held++] = s;
        else
            cap_set_release(s);
    }
    while (!hold && r->n_held > 0)
        cap_set_release(r->held[--r->n_held]);
}

static bool has_trouble(const struct run *r, enum cap_count cause)
{
    for (uint32_t c = 0; c < N; c++)
        for (uint32_t i = 0; i < r->rig.st.camera[c].n_troubles; i++)
            if (r->rig.st.camera[c].trouble[i].cause == cause)
                return true;
    return false;
}

static uint64_t caused(const struct run *r)
{
    return r->fault->no_count ? r->rig.st.host_steps : r->rig.st.camera[2].count[r->fault->cause];
}

/* Found?  Back?  Over, with nothing left to complain of? */
static void follow(struct run *r)
{
    const struct fault *f = r->fault;
    consume(r);
    rig_stats(&r->rig);
    double t = now_s(), end = r->t_from + last_s(r);
    if (r->found_s < 0 && caused(r) > 0)
        r->found_s = t - r->t_from;
    if (t < end)
        r->complete_then = r->complete;
    else if (r->back_s < 0 && r->complete > r->complete_then)
        r->back_s = t - end;
    r->over = r->found_s >= 0 && r->back_s >= 0 && t > end + 0.5;
    for (uint32_t c = 0; c < N; c++)
        r->over &= r->rig.st.camera[c].state == CAP_RUNNING && r->rig.st.camera[c].error[0] == '\0';
    if (f->no_count)
        r->over &= r->rig.st.host_steps == 2;
    else if (!f->noisy)
        r->over &= !has_trouble(r, f->cause);
}

/* Lines of the log at `level` with `part` in them, and with the name of the case's camera if any. */
static int lines(const char *log, const char *level, const char *name, const char *part)
{
    int n = 0;
    for (const char *p = log; *p != '\0';) {
        const char *e = strchr(p, '\n');
        size_t len = e == NULL ? strlen(p) : (size_t)(e - p);
        char line[1024];
        snprintf(line, sizeof line, "%.*s", (int)len, p);
        n += strstr(line, part) != NULL && (name == NULL || strstr(line, name) != NULL) &&
             strstr(line, level) != NULL;
        p += len + (e != NULL);
    }
    return n;
}

static void check(struct run *r, const char *log)
{
    const struct fault *f = r->fault;
    char camera[32];
    snprintf(camera, sizeof camera, "camera %s2 ", f->name);
    printf("  %-10s found after %.2f s, sets whole %.2f s after its end; %s %llu\n", f->name,
           r->found_s, r->back_s, f->no_count ? "steps" : cap_count_defs[f->cause].name,
           (unsigned long long)caused(r));
    T_CHECK_(r->found_s >= 0, "%s: not found", f->name);
    T_CHECK_(r->back_s >= 0, "%s: not back", f->name);
    T_CHECK_(r->over, "%s: is not over", f->name);
    const char *name = f->who == ONE ? camera : NULL;
    int begins = lines(log, r == &runs[GONE_CASE] ? " error " : " warn ", name, f->begins);
    int ends = lines(log, f->no_count ? " warn " : " info ", name, f->ends);
    if (f->noisy && begins > 1)
        begins = 1;
    T_CHECK_(begins == 1, "%s: said %d times: %s", f->name, begins, f->begins);
    T_CHECK_(ends == 1 || f->noisy, "%s: said %d times: %s", f->name, ends, f->ends);
    T_CHECK_(r->mixed == 0, "%s: %llu frames of another instant", f->name,
             (unsigned long long)r->mixed);
    T_CHECK_(r->disorder == 0, "%s: sets out of order", f->name);
    for (uint32_t c = 0; c < N; c++) {
        const uint64_t *k = r->rig.st.camera[c].count;
        T_CHECK_(
            k[CAP_RECEIVED] == r->frames[c] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW],
            "%s%u: received %llu, accounted for %llu", f->name, c,
            (unsigned long long)k[CAP_RECEIVED],
            (unsigned long long)(r->frames[c] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW]));
    }
}

T_CASE(every_fault_is_found_told_once_and_over)
{
    log_begin(PVX_LOG_INFO);
    for (size_t i = 0; i < CASES; i++) {
        begin(&runs[i], &faults[i]);
        for (size_t k = 0; k < i; k++)
            follow(&runs[k]);
    }
    size_t over = 0;
    UNTIL (over >= CASES) {
        over = 0;
        for (size_t i = 0; i < CASES; i++) {
            follow(&runs[i]);
            over += runs[i].over;
        }
        pvx_sleep_until_mono(pvx_now_mono() + 5 * PVX_NS_PER_MS);
    }
    pvx_sleep_until_mono(pvx_now_mono() + 1500 * PVX_NS_PER_MS); /* the last lines */
    for (size_t i = 0; i < CASES; i++) {
        cap_capture_stop(runs[i].rig.cap);
        consume(&runs[i]);
        rig_stats(&runs[i].rig);
    }
    log_end();
    for (size_t i = 0; i < CASES; i++) {
        check(&runs[i], log_text);
        cap_capture_free(&runs[i].rig.cap);
    }
    T_EQ_I(runs[GONE_CASE].rig.st.all_gone, 1);
    const char *show = getenv("FAULTS_LOG");
    if (t_case_fails > 0 || show != NULL)
        printf("%s", log_text);
}
