/* soak.c - eight GigE Vision cameras for a long time: is every frame there, is every set right, what does
 * it cost?  Cameras and their images are those of `pyrovox simcams`; soak.sh starts them. */
#include <argp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#include "base/clock.h"
#include "capture/rig/capture.h"
#include "tests/lib/source.h"
#include "tests/soak/truth.h"

struct args {
    const char *frames, *csv;
    unsigned cameras;
    double seconds, fps;
    bool drops;
};

struct tally {
    uint64_t sets, complete, right, wrong, unknown;
};

static volatile sig_atomic_t interrupted;

static void on_signal(int sig)
{
    (void)sig;
    interrupted = 1;
}

static double seconds_of(struct timeval t)
{
    return (double)t.tv_sec + (double)t.tv_usec * 1e-6;
}

/* CPU of this process but its main thread, which looks at the images. */
static void capture_cpu(double *user, double *sys)
{
    struct rusage all, main_thread;
    getrusage(RUSAGE_SELF, &all);
    getrusage(RUSAGE_THREAD, &main_thread);
    *user = seconds_of(all.ru_utime) - seconds_of(main_thread.ru_utime);
    *sys = seconds_of(all.ru_stime) - seconds_of(main_thread.ru_stime);
}

static void judge(const struct truth *t, const struct cap_set *s, unsigned cameras, struct tally *n)
{
    int first = -1;
    bool right = true, known = true;
    for (unsigned c = 0; c < cameras; c++) {
        if (s->frame[c] == NULL)
            continue;
        int i = truth_find(t, c, &s->frame[c]->img);
        known &= i >= 0;
        right &= first < 0 || i == first;
        first = i;
    }
    n->sets++;
    n->complete += s->n == cameras;
    n->right += right && known;
    n->wrong += !right && known;
    n->unknown += !known;
}

static cap_capture *begin(const struct args *a, const struct truth *t)
{
    static struct cap_source_config cam[CAP_MAX_CAMERAS];
    static char uri[CAP_MAX_CAMERAS][32], name[CAP_MAX_CAMERAS][16];
    for (unsigned c = 0; c < a->cameras; c++) {
        snprintf(uri[c], sizeof uri[c], "aravis:127.0.0.%u", 2 + c);
        snprintf(name[c], sizeof name[c], "cam%u", c);
        cam[c] = source_of(uri[c], t->width, t->height, CAP_RGB8, a->fps);
        cam[c].name = name[c];
        cam[c].buffers = 16;
    }
    struct cap_capture_config config = {.n_cameras = a->cameras,
                                        .camera = cam,
                                        .fps = a->fps,
                                        .discard_first = 1,
                                        .sets = {.policy = CAP_POLICY_DROP}};
    struct pvx_diag d = {""};
    cap_capture *cap = NULL;
    pvx_err e = cap_capture_new(&config, &cap, &d);
    if (e == PVX_OK)
        e = cap_capture_start(cap, &d);
    if (e != PVX_OK) {
        fprintf(stderr, "soak: %s\n", pvx_diag_text(&d, e));
        exit(1);
    }
    return cap;
}

static void until_all_run(cap_capture *cap, unsigned cameras)
{
    int64_t until = pvx_now_mono() + 30 * PVX_NS_PER_S;
    for (int n = 0; n < 10 && pvx_now_mono() < until && !interrupted;) {
        struct cap_set *s;
        if (cap_capture_next(cap, PVX_NS_PER_S, &s) != PVX_OK)
            continue;
        n += s->n == cameras;
        cap_set_release(s);
    }
}

static void print(const struct args *a, const struct cap_stats *s0, const struct cap_stats *s,
                  const struct tally *n, double took, bool dear)
{
    uint64_t received = 0, lost = 0;
    printf("| camera | received |");
    for (int k = CAP_INCOMPLETE; k < CAP_N_COUNT; k++)
        printf(" %s |", cap_count_defs[k].name);
    printf(" drift ppm |\n|---|");
    for (int k = 0; k <= CAP_N_COUNT; k++)
        printf("---|");
    printf("\n");
    for (unsigned c = 0; c < a->cameras; c++) {
        printf("| cam%u |", c);
        for (int k = 0; k < CAP_N_COUNT; k++) {
            uint64_t v = s->camera[c].count[k] - s0->camera[c].count[k];
            printf(" %llu |", (unsigned long long)v);
            if (k == CAP_RECEIVED)
                received += v;
            else if (k == CAP_INCOMPLETE || k == CAP_UNDERRUN || k == CAP_OVERFLOW ||
                     k == CAP_BAD_SIZE || k == CAP_LATE || (k == CAP_ID_GAP && !a->drops))
                lost += v;
        }
        printf(" %.1f |\n", s->camera[c].drift_ppm);
    }
    printf("\n%.0f s: %llu frames received, %llu lost on the receiving side; %llu sets, %llu "
           "complete; "
           "%llu of one instant, %llu mixed, %llu with an image that no camera sent\n",
           took, (unsigned long long)received, (unsigned long long)lost,
           (unsigned long long)n->sets, (unsigned long long)n->complete,
           (unsigned long long)n->right, (unsigned long long)n->wrong,
           (unsigned long long)n->unknown);
    printf("spread of a set: p50 %.3f ms, p99 %.3f ms\n",
           (double)pvx_hist_quantile(&s->spread, 0.50) * 1e-6,
           (double)pvx_hist_quantile(&s->spread, 0.99) * 1e-6);
    bool few = !a->drops && (double)n->complete < took * a->fps - 2;
    if (lost > 0 || n->wrong > 0 || n->unknown > 0 || n->right == 0 || few || dear) {
        printf("soak: FAIL\n");
        exit(1);
    }
}

static int soak(const struct args *a)
{
    static struct truth t;
    static struct cap_stats before, after;
    struct pvx_diag d = {""};
    pvx_err e = truth_load(&t, a->frames, a->cameras, &d);
    if (e != PVX_OK) {
        fprintf(stderr, "soak: %s\n", pvx_diag_text(&d, e));
        return 1;
    }
    cap_capture *cap = begin(a, &t);
    until_all_run(cap, a->cameras);
    cap_capture_stats(cap, &before);
    struct tally n = {0};
    double user0, sys0, user, sys;
    capture_cpu(&user0, &sys0);
    int64_t start = pvx_now_mono(), end = start + (int64_t)(a->seconds * 1e9), now = start,
            said = start;
    while (now < end && !interrupted) {
        struct cap_set *s;
        if (cap_capture_next(cap, PVX_NS_PER_S, &s) == PVX_OK) {
            judge(&t, s, a->cameras, &n);
            cap_set_release(s);
        }
        now = pvx_now_mono();
        if (now - said > 10 * PVX_NS_PER_S) {
            fprintf(stderr, "\r%.0f of %.0f s, %llu sets, %llu wrong ",
                    (double)(now - start) * 1e-9, a->seconds, (unsigned long long)n.sets,
                    (unsigned long long)(n.wrong + n.unknown));
            said = now;
        }
    }
    double took = (double)(now - start) * 1e-9;
    capture_cpu(&user, &sys);
    cap_capture_stats(cap, &after);
    cap_capture_stop(cap);
    cap_capture_free(&cap);
    double cost = (user - user0 + sys - sys0) / took;
    printf("capture: %.1f %% of a core (user %.1f, system %.1f; wanted: under 25)\n", 100 * cost,
           100 * (user - user0) / took, 100 * (sys - sys0) / took);
    print(a, &before, &after, &n, took, cost > 0.25);
    printf("soak: PASS\n");
    return 0;
}

static error_t parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case 's': a->seconds = atof(arg); return 0;
    case 'f': a->fps = atof(arg); return 0;
    case 'n': a->cameras = (unsigned)atoi(arg); return 0;
    case 'd': a->drops = true; return 0;
    case ARGP_KEY_ARG: a->frames = arg; return 0;
    case ARGP_KEY_END:
        if (a->frames == NULL || a->cameras < 1 || a->cameras > 64 || !(a->fps > 0) ||
            !(a->seconds > 0))
            argp_usage(st);
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

int main(int argc, char **argv)
{
    static const struct argp_option options[] = {
        {"seconds", 's', "S", 0, "how long (600)", 0},
        {"fps", 'f', "HZ", 0, "frame rate (30)", 0},
        {"cameras", 'n', "N", 0, "how many (8)", 0},
        {"drops", 'd', NULL, 0, "the cameras drop frames: gaps in their numbers are no loss here",
         0},
        {0}};
    const struct argp argp = {options, parse, "FRAMES", "Frames of simulated cameras, for long.",
                              NULL,    NULL,  NULL};
    struct args a = {.cameras = 8, .seconds = 600, .fps = 30};
    argp_parse(&argp, argc, argv, 0, NULL, &a);
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);
    return soak(&a);
}
