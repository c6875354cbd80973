/* test_frameset.c - sets hold one instant, whatever arrives in whatever order; no frame is
 * unaccounted for. */
#include "../t.h"

#include "base/clock.h"
#include "capture/sync/frameset.h"

#define P  (10 * PVX_NS_PER_MS) /* period */
#define T0 1700000000000000000LL

/* Frames of a test: allocated, and counted as they go. */
struct test_frame {
    struct cap_frame f; /* first */
    int64_t scene;      /* number of the instant that it truly shows */
};
static long n_alive;

static void freed(struct cap_frame *f)
{
    n_alive--;
    free(f);
}

static struct cap_frame *frame(uint32_t camera, int64_t scene, int64_t t, int64_t mono)
{
    struct test_frame *x = calloc(1, sizeof *x);
    x->f = (struct cap_frame){
        .camera = camera, .t_exposure_ns = t, .t_arrival_mono_ns = mono, .release = freed};
    x->scene = scene;
    n_alive++;
    return &x->f;
}

static uint64_t counts[CAP_MAX_CAMERAS][CAP_N_COUNT];
static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    counts[camera][what] += n;
}

static uint64_t counted(enum cap_count what)
{
    uint64_t n = 0;
    for (int i = 0; i < CAP_MAX_CAMERAS; i++)
        n += counts[i][what];
    return n;
}

static cap_assembler *make(uint32_t cameras, enum cap_policy policy, uint32_t least)
{
    memset(counts, 0, sizeof counts);
    struct cap_assembler_params p = {
        .cameras = cameras, .period_ns = P, .policy = policy, .min_cameras = least};
    struct cap_sink sink = {.count = count};
    cap_assembler *a;
    T_EQ_I(cap_assembler_new(&p, &sink, &a), PVX_OK);
    return a;
}

static void end(cap_assembler **a)
{
    cap_assembler_free(a);
    T_EQ_I(n_alive, 0);
}

/* "0123" = members of the next set; "-" = none is ready. */
static void expect(cap_assembler *a, const char *members)
{
    struct cap_set *s = cap_assembler_pop(a);
    char got[80] = "-";
    if (s != NULL) {
        int n = 0;
        for (int i = 0; i < CAP_MAX_CAMERAS; i++)
            if (s->frame[i] != NULL)
                got[n++] = (char)('0' + i);
        got[n] = '\0';
        T_EQ_I(s->n, n);
    }
    T_EQ_S(got, members);
    cap_set_release(s);
}

static void put(cap_assembler *a, uint32_t camera, int64_t scene)
{
    cap_assembler_put(a, frame(camera, scene, T0 + scene * P, scene * P));
}

/* Of these cameras, in this order. */
static void put_all(cap_assembler *a, const char *cameras, int64_t scene)
{
    for (; *cameras != '\0'; cameras++)
        put(a, (uint32_t)(*cameras - '0'), scene);
}

T_CASE(complete_set_comes_at_once)
{
    cap_assembler *a = make(3, CAP_POLICY_DROP, 0);
    put_all(a, "10", 0);
    expect(a, "-");
    T_EQ_I(cap_assembler_open(a), 2);
    cap_assembler_put(a, frame(2, 0, T0 + 900000, 12345678));
    struct cap_set *s = cap_assembler_pop(a);
    T_OK(s != NULL);
    T_EQ_I(s->n, 3);
    T_EQ_I(s->number, 0);
    T_EQ_I(s->spread_ns, 900000);
    T_EQ_I(s->t_exposure_ns, T0 + 300000);
    T_EQ_I(s->t_last_mono_ns, 12345678);
    T_EQ_I(cap_assembler_deadline(a), INT64_MAX);
    cap_set_release(s);
    end(&a);
}

T_CASE(newer_complete_set_closes_older_ones)
{
    for (int partial = 0; partial < 2; partial++) {
        cap_assembler *a = make(3, partial ? CAP_POLICY_PARTIAL : CAP_POLICY_DROP, 2);
        put_all(a, "01", 0); /* 2 of 3 */
        put(a, 0, 1);        /* 1 of 3: too few in any case */
        put_all(a, "012", 2);
        if (partial)
            expect(a, "01");
        expect(a, "012");
        expect(a, "-");
        T_EQ_I(counted(CAP_UNMATCHED), partial ? 1 : 3);
        T_EQ_I(cap_assembler_sets_failed(a), partial ? 1 : 2);
        put(a, 2, 0); /* its set has been closed */
        put(a, 2, 1);
        T_EQ_I(counts[2][CAP_LATE], 2);
        expect(a, "-");
        end(&a);
    }
}

T_CASE(deadline_closes_what_waits)
{
    cap_assembler *a = make(3, CAP_POLICY_PARTIAL, 2);
    put_all(a, "01", 5);
    put(a, 0, 6);
    int64_t due = 5 * P + 150 * PVX_NS_PER_MS;
    T_EQ_I(cap_assembler_deadline(a), due);
    cap_assembler_tick(a, due - 1);
    expect(a, "-");
    cap_assembler_tick(a, due);
    expect(a, "01");
    put(a, 1, 6);
    cap_assembler_tick(a, due + P);
    expect(a, "01");
    expect(a, "-");
    end(&a);
}

T_CASE(dead_camera_is_not_waited_for)
{
    cap_assembler *a = make(3, CAP_POLICY_PARTIAL, 1);
    put_all(a, "02", 0);
    cap_assembler_alive(a, 1, false);
    expect(a, "02");
    put_all(a, "20", 1);
    expect(a, "02");
    put(a, 1, 2); /* it was not dead after all: a frame of it is taken along */
    put_all(a, "20", 2);
    expect(a, "012");
    cap_assembler_alive(a, 1, true);
    put_all(a, "20", 3);
    expect(a, "-");
    put(a, 1, 3);
    expect(a, "012");
    for (uint32_t c = 0; c < 3; c++)
        cap_assembler_alive(a, c, false);
    put(a, 1, 4);
    expect(a, "-"); /* nobody to wait for is no reason to close: the deadline is */
    cap_assembler_tick(a, INT64_MAX);
    expect(a, "1");
    end(&a);
    /* without partial sets nothing comes out, and it is counted */
    a = make(2, CAP_POLICY_DROP, 0);
    cap_assembler_alive(a, 1, false);
    put(a, 0, 0);
    expect(a, "-");
    T_EQ_I(counts[0][CAP_UNMATCHED], 1);
    end(&a);
}

T_CASE(second_frame_of_a_camera_is_unmatched)
{
    cap_assembler *a = make(2, CAP_POLICY_DROP, 0);
    put(a, 0, 0);
    cap_assembler_put(a, frame(0, 0, T0 + 1000, 0));
    T_EQ_I(counts[0][CAP_UNMATCHED], 1);
    put(a, 1, 0);
    expect(a, "01");
    end(&a);
}

/* Tolerance 2.5 ms: 2.4 ms is together, 2.6 ms is not; neighbours are never matched. */
T_CASE(window_is_the_tolerance)
{
    cap_assembler *a = make(2, CAP_POLICY_DROP, 0);
    put(a, 0, 0);
    cap_assembler_put(a, frame(1, 0, T0 - 2400000, 0));
    expect(a, "01");
    put(a, 0, 3);
    cap_assembler_put(a, frame(1, 3, T0 + 3 * P + 2600000, 0));
    expect(a, "-");
    T_EQ_I(cap_assembler_open(a), 1); /* the other's partner has passed by: it is not waited for */
    T_EQ_I(counts[0][CAP_UNMATCHED], 1);
    end(&a);
}

/* A camera's frames come in order: a later one means that the one before will not come. */
T_CASE(lost_frame_is_not_waited_for)
{
    cap_assembler *a = make(3, CAP_POLICY_PARTIAL, 2);
    put_all(a, "01", 0);
    put_all(a, "01", 1);
    expect(a, "-");
    put(a, 2, 1); /* 2 has lost instant 0, and 1 is whole */
    expect(a, "01");
    expect(a, "012");
    put(a, 2, 2);
    put_all(a, "20", 3); /* 0 has lost instant 2, 1 may still send it */
    expect(a, "-");
    put(a, 1, 2);
    expect(a, "12");
    end(&a);
}

T_CASE(patient_policy_waits_for_the_living)
{
    cap_assembler *a = make(3, CAP_POLICY_WAIT, 2);
    put_all(a, "01", 0);
    cap_assembler_tick(a, 400 * PVX_NS_PER_MS); /* longer than the others wait */
    expect(a, "-");
    put(a, 2, 0);
    expect(a, "012");
    put_all(a, "01", 1);
    cap_assembler_tick(a, INT64_MAX); /* alive, and did not come: never given out without it */
    expect(a, "-");
    T_EQ_I(counts[0][CAP_UNMATCHED], 1);
    T_EQ_I(counts[1][CAP_UNMATCHED], 1);
    put_all(a, "01", 2);
    cap_assembler_alive(a, 2, false); /* gone: the others go on */
    expect(a, "01");
    put_all(a, "01", 3);
    expect(a, "01");
    cap_assembler_alive(a, 2, true);
    put_all(a, "01", 4);
    expect(a, "-");
    put(a, 2, 4);
    expect(a, "012");
    cap_assembler_alive(a, 2, false);
    cap_assembler_alive(a, 1, false);
    put(a, 0, 5); /* fewer than min_cameras */
    expect(a, "-");
    T_EQ_I(counts[0][CAP_UNMATCHED], 2);
    end(&a);
}

/* The host's clock is set while sets are open: they go on as if nothing had been. */
T_CASE(stepped_host_clock_is_moved_along)
{
    static const int64_t steps[] = {3600 * PVX_NS_PER_S, -3600 * PVX_NS_PER_S, 7 * PVX_NS_PER_MS};
    for (size_t k = 0; k < sizeof steps / sizeof steps[0]; k++) {
        cap_assembler *a = make(2, CAP_POLICY_DROP, 0);
        put_all(a, "01", 0);
        expect(a, "01");
        put(a, 0, 1);
        cap_assembler_shift(a, steps[k]);
        cap_assembler_put(a, frame(1, 1, T0 + P + steps[k], P));
        struct cap_set *s = cap_assembler_pop(a);
        T_OK(s != NULL && s->n == 2);
        if (s != NULL) {
            T_EQ_I(s->t_exposure_ns, T0 + P + steps[k]);
            T_EQ_I(s->frame[0]->t_exposure_ns, T0 + P + steps[k]);
            T_EQ_I(s->spread_ns, 0);
        }
        cap_set_release(s);
        cap_assembler_put(a, frame(0, 1, T0 + P + steps[k], P)); /* still late */
        T_EQ_I(counts[0][CAP_LATE], 1);
        end(&a);
    }
    /* cameras that show the host's own clock: nothing is late afterwards */
    cap_assembler *a = make(2, CAP_POLICY_DROP, 0);
    put_all(a, "01", 1000);
    expect(a, "01");
    cap_assembler_forget_order(a);
    put_all(a, "01", 1);
    expect(a, "01");
    T_EQ_I(counted(CAP_LATE), 0);
    end(&a);
}

T_CASE(stamp_from_the_future_harms_itself_only)
{
    cap_assembler *a = make(2, CAP_POLICY_PARTIAL, 2);
    put_all(a, "01", 0);
    expect(a, "01");
    cap_assembler_put(a, frame(1, 0, T0 + 3600 * PVX_NS_PER_S, 0));
    cap_assembler_tick(a, INT64_MAX);
    for (int64_t k = 1; k < 20; k++) {
        put_all(a, "01", k);
        expect(a, "01");
    }
    T_EQ_I(counted(CAP_LATE), 0);
    T_EQ_I(counts[1][CAP_UNMATCHED], 1);
    end(&a);
}

/* All clocks stepped back together: some frames are lost as late, then it goes on. */
T_CASE(time_stepped_back_is_followed)
{
    cap_assembler *a = make(2, CAP_POLICY_DROP, 0);
    put_all(a, "01", 1000000);
    expect(a, "01");
    uint64_t sets = 0;
    for (int64_t k = 0; k < 20; k++) {
        put_all(a, "01", k);
        struct cap_set *s = cap_assembler_pop(a);
        sets += s != NULL;
        cap_set_release(s);
    }
    T_OK(sets >= 14);
    T_OK(counted(CAP_LATE) >= 2);
    end(&a);
}

T_CASE(consumer_that_keeps_everything)
{
    cap_assembler *a = make(1, CAP_POLICY_DROP, 0);
    static struct cap_set *kept[1000];
    int n = 0;
    for (int64_t k = 0; k < 1000; k++) {
        put(a, 0, k);
        kept[n] = cap_assembler_pop(a);
        n += kept[n] != NULL;
    }
    T_OK(n >= 64 && n < 1000);
    T_EQ_I(n + (int)counts[0][CAP_OVERFLOW], 1000);
    for (int i = 0; i < n / 2; i++)
        cap_set_release(kept[i]);
    put(a, 0, 1000);
    expect(a, "0");
    cap_assembler_free(&a); /* the other half outlives it */
    for (int i = n / 2; i < n; i++) {
        T_OK(kept[i]->frame[0]->t_exposure_ns > 0);
        cap_set_release(kept[i]);
    }
    T_EQ_I(n_alive, 0);
}

T_CASE(close_before_closes_what_is_final)
{
    cap_assembler *a = make(3, CAP_POLICY_PARTIAL, 1);
    struct cap_frame next = {.t_exposure_ns = T0 + P / 4};
    put_all(a, "01", 0);
    cap_assembler_close_before(a, &next);
    expect(a, "-"); /* could still be joined */
    next.t_exposure_ns++;
    cap_assembler_close_before(a, &next);
    expect(a, "01");
    end(&a);
}

T_CASE(set_lives_until_its_last_holder_lets_go)
{
    cap_assembler *a = make(2, CAP_POLICY_DROP, 0);
    put_all(a, "01", 0);
    struct cap_set *s = cap_assembler_pop(a);
    T_OK(s != NULL);
    cap_set_ref(s);
    cap_set_release(s);
    T_EQ_I(n_alive, 2);
    T_EQ_I(s->n, 2);
    cap_set_release(s);
    T_EQ_I(n_alive, 0);
    end(&a);
}

static struct cap_frame *strays[8];
static enum cap_count stray_why[8];
static unsigned n_strays;
static enum cap_count last_why;
static void count_why(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    count(ctx, camera, what, n);
    last_why = what;
}
static void keep_stray(void *ctx, struct cap_frame *f)
{
    (void)ctx;
    stray_why[n_strays] = last_why;
    strays[n_strays++] = f;
}

T_CASE(frames_without_a_set_are_handed_on)
{
    struct cap_assembler_params p = {.cameras = 2, .period_ns = P, .policy = CAP_POLICY_DROP};
    struct cap_sink sink = {.count = count_why, .push = keep_stray};
    cap_assembler *a;
    T_EQ_I(cap_assembler_new(&p, &sink, &a), PVX_OK);
    n_strays = 0;
    put(a, 0, 1); /* its partner never comes */
    cap_assembler_tick(a, INT64_MAX);
    put_all(a, "01", 2);
    put(a, 1, 1); /* late */
    T_EQ_I(n_strays, 2);
    T_EQ_I(stray_why[0], CAP_UNMATCHED);
    T_EQ_I(strays[0]->camera, 0);
    T_EQ_I(stray_why[1], CAP_LATE);
    T_EQ_I(strays[1]->camera, 1);
    T_EQ_I(n_alive, 4);
    for (unsigned i = 0; i < n_strays; i++)
        cap_frame_release(strays[i]);
    cap_set_release(cap_assembler_pop(a));
    end(&a);
}

static void put_recorded(cap_assembler *a, uint32_t camera, uint64_t set, uint32_t size, int64_t t)
{
    struct cap_frame *f = frame(camera, (int64_t)set, t, t);
    f->set = set + 1;
    f->set_size = size;
    cap_assembler_put(a, f);
}

/* Whatever the stamps say, and whatever the policy, the sets are those of the recording. */
T_CASE(recorded_sets_come_out_as_recorded)
{
    cap_assembler *a = make(3, CAP_POLICY_DROP, 3);
    put_recorded(a, 0, 7, 3, T0);
    put_recorded(a, 1, 7, 3, T0 + 3 * P); /* far out of tolerance */
    put_recorded(a, 2, 7, 3, T0 - 3 * P);
    put_recorded(a, 0, 9, 2, T0 - 20 * P); /* time goes back, camera 1 is not in it */
    put_recorded(a, 2, 9, 2, T0 - 20 * P);
    put_recorded(a, 1, 7, 3, T0); /* once more: late */
    struct cap_set *s = cap_assembler_pop(a);
    T_EQ_I(s->number, 7);
    T_EQ_I(s->n, 3);
    T_EQ_I(s->spread_ns, 6 * P);
    cap_set_release(s);
    s = cap_assembler_pop(a);
    T_EQ_I(s->number, 9);
    T_EQ_I(s->n, 2);
    T_OK(s->frame[1] == NULL);
    cap_set_release(s);
    T_OK(cap_assembler_pop(a) == NULL);
    T_EQ_I(counted(CAP_LATE), 1);
    put_recorded(a, 0, 11, 3, T0); /* one that the replay lost a frame of: policy, once passed by */
    put_recorded(a, 1, 11, 3, T0);
    T_EQ_I(cap_assembler_open(a), 2);
    put_recorded(a, 2, 12, 3, T0 + P);
    T_EQ_I(counted(CAP_UNMATCHED), 2);
    T_EQ_I(cap_assembler_open(a), 1);
    cap_assembler_close_before(a, &(struct cap_frame){.set = 12 + 1, .t_exposure_ns = T0 + 9 * P});
    T_EQ_I(cap_assembler_open(a), 1); /* it is of that set */
    cap_assembler_close_before(a, &(struct cap_frame){.set = 13 + 1});
    T_EQ_I(cap_assembler_open(a), 0);
    end(&a);
}

T_CASE(nonsense_is_refused)
{
    struct cap_sink sink = {.count = count};
    cap_assembler *a;
    static const struct cap_assembler_params bad[] = {
        {.cameras = 0, .period_ns = P},
        {.cameras = 65, .period_ns = P},
        {.cameras = 2, .period_ns = P, .tolerance_ns = P / 2}, /* frames would fit two sets */
        {.cameras = 2, .period_ns = P, .tolerance_ns = -1},
        {.cameras = 2, .period_ns = P, .min_cameras = 3},
        {.cameras = 2}, /* neither period nor tolerance */
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        T_EQ_I(cap_assembler_new(&bad[i], &sink, &a), PVX_EINVAL);
        T_OK(a == NULL);
    }
    struct cap_assembler_params p = {.cameras = 64, .tolerance_ns = 1};
    T_EQ_I(cap_assembler_new(&p, &sink, &a), PVX_OK);
    for (uint32_t c = 0; c < 64; c++)
        put(a, c, 7);
    struct cap_set *s = cap_assembler_pop(a);
    T_OK(s != NULL && s->n == 64);
    cap_set_release(s);
    end(&a);
}

/* ---- property: any traffic -------------------------------------------------------------------- */

struct arrival {
    int64_t mono, scene, t;
    uint32_t camera;
};

static int by_mono(const void *a, const void *b)
{
    int64_t x = ((const struct arrival *)a)->mono, y = ((const struct arrival *)b)->mono;
    return x < y ? -1 : x > y;
}

/* Random traffic of up to 8 cameras over K instants: stamps off by up to 1 ms, 5 % dropped, 1 %
 * sent twice, delivered up to 30 ms late, some later than any deadline, one camera perhaps dead (and
 * perhaps not known to be).  Each camera's own frames in order, as drivers and intake.c have them, or
 * now and then not: then more is lost, but nothing is mixed. */
static void traffic(int round)
{
    enum { K = 300 };
    static struct arrival all[8 * K * 2];
    uint32_t cameras = 1 + (uint32_t)(t_rand() % 8), dead = (uint32_t)(t_rand() % 16);
    bool known_dead = t_rand() % 2, in_order = t_rand() % 4 != 0;
    enum cap_policy policy = (enum cap_policy)(t_rand() % 3);
    bool partial = policy == CAP_POLICY_PARTIAL, wait = policy == CAP_POLICY_WAIT;
    int64_t last_mono[8] = {0};
    uint32_t least = 1 + (uint32_t)(t_rand() % cameras);
    size_t n = 0;
    for (int64_t k = 0; k < K; k++)
        for (uint32_t c = 0; c < cameras; c++) {
            if (c == dead || t_uniform(0, 1) < 0.05)
                continue;
            int64_t delay = (int64_t)t_uniform(0, t_rand() % 4 == 0 ? 30e6 : 3e6);
            if (t_uniform(0, 1) < (in_order ? 0.0005 : 0.01)) /* in order, 30 wait behind it */
                delay = 300000000;
            if (in_order && k * P + delay <= last_mono[c])
                delay = last_mono[c] + 1 - k * P;
            last_mono[c] = k * P + delay;
            struct arrival x = {k * P + delay, k, T0 + k * P + (int64_t)t_uniform(-1e6, 1e6), c};
            all[n++] = x;
            if (t_uniform(0, 1) < 0.01) {
                x.mono += (int64_t)t_uniform(0, 5e6);
                last_mono[c] = x.mono;
                all[n++] = x;
            }
        }
    qsort(all, n, sizeof all[0], by_mono);
    cap_assembler *a = make(cameras, policy, least);
    if (dead < cameras && known_dead)
        cap_assembler_alive(a, dead, false);
    uint64_t in_sets = 0, number = 0, mixed = 0, disorder = 0, small = 0, wide = 0, unbalanced = 0;
    int64_t last_scene = -1;
    for (size_t i = 0; i <= n; i++) {
        if (i < n) {
            cap_assembler_tick(a, all[i].mono);
            cap_assembler_put(a, frame(all[i].camera, all[i].scene, all[i].t, all[i].mono));
        } else {
            cap_assembler_flush(a);
            T_EQ_I(cap_assembler_open(a), 0);
        }
        struct cap_set *s;
        while ((s = cap_assembler_pop(a)) != NULL) {
            int64_t scene = -1;
            uint32_t members = 0;
            for (uint32_t c = 0; c < cameras; c++) {
                if (s->frame[c] == NULL)
                    continue;
                int64_t shows = ((struct test_frame *)s->frame[c])->scene;
                mixed += scene >= 0 && shows != scene;
                mixed += s->frame[c]->camera != c;
                scene = shows;
                members++;
            }
            disorder += scene <= last_scene || s->number != number;
            bool whole = members == cameras || (wait && dead < cameras && known_dead &&
                                                members == cameras - 1 && s->frame[dead] == NULL);
            small += members != s->n || (partial ? members < least : !whole);
            wide += s->spread_ns > P / 4;
            last_scene = scene;
            number++;
            in_sets += members;
            cap_set_release(s);
        }
        uint64_t put_so_far = i < n ? i + 1 : n;
        unbalanced += put_so_far != in_sets + counted(CAP_LATE) + counted(CAP_UNMATCHED) +
                                        counted(CAP_OVERFLOW) + cap_assembler_open(a);
    }
    T_EQ_I(mixed, 0);
    T_EQ_I(disorder, 0);
    T_EQ_I(small, 0);
    T_EQ_I(wide, 0);
    T_EQ_I(unbalanced, 0);
    T_EQ_I(counted(CAP_OVERFLOW), 0);
    /* It must also work: 0.95^8 = 0.66 of the sets are whole, fewer with what comes late. */
    if (in_order && (dead >= cameras || (partial && least < cameras)))
        T_CHECK_(number > K / 3, "round %d: %llu sets of %d", round, (unsigned long long)number, K);
    end(&a);
}

T_CASE(any_traffic_gives_pure_sets)
{
    for (int round = 0; round < 300; round++)
        traffic(round);
}
