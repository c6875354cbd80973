/* bench_drift.c - the drift alarm: how soon a camera that was moved is named, and how often one that was not; and
 * whether the daemon's own checks (watch.h) name any camera of a rig that nothing happened to.
 *
 * Rings of cameras whose calibration is off by a little, flames that move, noise; after the first sets one camera
 * is turned by so many pixels.  bench_drift [CSV_FOLDER [HEALTHY_SETS]]. */
#include "bench.h"
#include "daemon/pipeline/watch.h"
#include "recon/check/drift.h"
#include "recon/check/gauge.h"

#define INSTANTS 12
#define BEFORE   70  /* sets before it is moved */
#define AFTER    100 /* and then */

struct run {
    enum flame_kind flame;
    int cameras, seed;
    double off, noise, moved; /* rms of calibration, px; share of the peak; px */
};

/* Turned about its own axes, so that its picture goes by (x,y) px, and the flame carried away by `by` m. */
static void disturb(struct rec_camera *c, double x, double y, const double by[3])
{
    const double w[3] = {-y / c->fy, x / c->fx, 0}, none[3] = {0};
    double at[3];
    for (int a = 0; a < 3; a++)
        c->t[a] += c->R[a * 3] * by[0] + c->R[a * 3 + 1] * by[1] + c->R[a * 3 + 2] * by[2];
    rec_camera_centre(c, at);
    rec_camera_nudge(c, at, w, none);
}

struct film {
    struct rec_rig rig;
    int victim;
    double peak;
    float *picture[INSTANTS][REC_MAX_CAMERAS], *moved[INSTANTS]; /* [h][w] */
};

static float *shoot(const struct scene *s, struct rec_camera c, double x, double y,
                    const double by[3], pvx_pool *pool)
{
    size_t n = (size_t)c.width * (size_t)c.height, nch = (size_t)s->nch;
    disturb(&c, x, y, by);
    float *img = scene_image(s, &c, pool);
    for (size_t i = 0; i < n; i++) {
        float sum = 0;
        for (size_t l = 0; l < nch; l++)
            sum += img[i * nch + l];
        img[i] = sum / (float)nch;
    }
    return img;
}

static bool film_new(struct film *f, const struct run *r, pvx_pool *pool)
{
    static const int32_t size[3] = {160, 120, 48};
    struct view_set v = {"ring", (size_t)r->cameras + 1, (size_t)r->cameras, 0, {0}};
    double off[REC_MAX_CAMERAS][2], angle, phase;
    bench_seed((uint32_t)r->seed);
    for (int c = 0; c < r->cameras; c++) {
        v.use[c] = (uint8_t)(c + 1);
        off[c][0] = r->off * bench_normal();
        off[c][1] = r->off * bench_normal();
    }
    f->victim = r->seed % r->cameras;
    f->peak = 0;
    angle = 6.283 * bench_even();
    phase = 6.283 * bench_even();
    for (int i = 0; i < INSTANTS; i++) {
        struct scene s;
        double t = r->flame == FLAME_RING ? 0.05 * i + bench_even() : i % 6;
        const double by[3] = {0.03 * sin(0.7 * i + phase), 0.02 * cos(0.45 * i),
                              0.03 * sin(0.3 * i)};
        if (!scene_new(&s, r->flame, &v, size, t, pool))
            return false;
        if (i == 0)
            CHECK(rec_rig_copy(&s.rig, &f->rig));
        for (int c = 0; c < r->cameras; c++)
            f->picture[i][c] = shoot(&s, s.rig.cameras[c], off[c][0], off[c][1], by, pool);
        int k = f->victim;
        f->moved[i] = shoot(&s, s.rig.cameras[k], off[k][0] + r->moved * cos(angle),
                            off[k][1] + r->moved * sin(angle), by, pool);
        f->peak = fmax(f->peak, s.peak);
        scene_fini(&s);
    }
    return true;
}

static void film_free(struct film *f, int cameras)
{
    for (int i = 0; i < INSTANTS; i++) {
        for (int c = 0; c < cameras; c++)
            free(f->picture[i][c]);
        free(f->moved[i]);
    }
    rec_rig_fini(&f->rig);
}

/* Sets as the daemon keeps them for a check: runs of some that follow each other, and a pause. */
struct keeper {
    rec_check *check;
    struct rec_rig *rig;
    struct dmn_checks said;
    int n, pause; /* kept; sets to let go */
    size_t bins;
    uint64_t number[DMN_WATCH_SETS];
    float *copy; /* [DMN_WATCH_SETS][cameras][bins] */
    const float *at[REC_MAX_CAMERAS];
    int found; /* cameras that a single check found wrong, summed over checks */
};

static pvx_err kept(void *ctx, size_t i, struct rec_check_set *out)
{
    struct keeper *k = ctx;
    for (size_t c = 0; c < k->rig->n_cameras; c++)
        k->at[c] = k->copy + (i * k->rig->n_cameras + c) * k->bins;
    *out = (struct rec_check_set){k->number[i], k->at, true};
    return PVX_OK;
}

static void nothing_said(void *ctx, bool bad, const struct pvx_about *about, const char *sentence)
{
    int *wrongly = ctx;
    (void)about;
    *wrongly += bad;
    printf("  %s\n", sentence);
}

/* One more set; a check of the last ones whenever there are enough. */
static void keep(struct keeper *k, uint64_t number, const float *picture, int *wrongly)
{
    static struct rec_check_verdict v;
    const uint8_t known[REC_MAX_CAMERAS] = {0};
    const struct dmn_checks_news news = {&v, UINT64_MAX, known};
    size_t set = k->rig->n_cameras * k->bins;
    if (k->pause > 0) {
        k->pause--;
        return;
    }
    k->number[k->n] = number;
    memcpy(k->copy + (size_t)k->n++ * set, picture, set * sizeof *picture);
    if (k->n % DMN_WATCH_RUN == 0)
        k->pause = (int)k->rig->n_cameras;
    if (k->n < DMN_WATCH_SETS)
        return;
    struct pvx_diag d = {""};
    const struct rec_check_source from = {.n = DMN_WATCH_SETS, .get = kept, .ctx = k};
    k->n = 0;
    if (rec_check_run(k->check, k->rig, &from, &v, &d) != PVX_OK) {
        k->said.failed++;
        return;
    }
    k->found += (int)v.n_wrong;
    for (size_t c = 0; c < k->rig->n_cameras; c++)
        if (v.figures.camera[c].wrong != REC_WRONG_NOTHING) {
            char words[DMN_CHECK_WORDS];
            dmn_check_sentence(&v.figures.camera[c], words);
            printf("  once: %s %s\n", k->rig->cameras[c].name, words);
        }
    dmn_checks_add(&k->said, &news, k->rig, &(struct dmn_votes_listener){nothing_said, wrongly});
}

struct told {
    int after;   /* sets from the move until the camera was named; -1 never */
    int wrongly; /* cameras that were named and had not moved */
    double ms;
    double worst;               /* furthest from the base, of those that were not moved */
    int checks, found, accused; /* of a healthy rig; cameras wrong in one check; named after two */
};

static bool play(const struct run *r, int sets, struct told *out, pvx_pool *pool)
{
    struct film f;
    struct pvx_diag d = {""};
    const struct rec_drift_params p = REC_DRIFT_DEFAULTS;
    const struct rec_unseen_params u = REC_UNSEEN_DEFAULTS;
    rec_drift *t;
    rec_check *check;
    *out = (struct told){.after = -1};
    if (!film_new(&f, r, pool))
        return false;
    size_t n = 160 * 120;
    float *noisy = must_floats(n * (size_t)r->cameras);
    for (int c = 0; c < r->cameras; c++) /* displacements are the alarm's, as in watch.c */
        f.rig.cameras[c].uncertainty.px_95 = rec_drift_off(&p, rec_unseen_binning(&f.rig, &u));
    CHECK(rec_check_new(&f.rig, &u, pool, &check, &d));
    CHECK(rec_drift_new(rec_check_unseen(check), &p, &t, &d));
    struct keeper own = {.check = check, .rig = &f.rig, .bins = n, .said.patience = 2};
    own.copy = must_floats(n * (size_t)r->cameras * DMN_WATCH_SETS);
    for (int k = 0; k < sets; k++) {
        const float *picture[REC_MAX_CAMERAS] = {0};
        uint64_t changed;
        int step = k % (2 * INSTANTS - 2), at = step < INSTANTS ? step : 2 * INSTANTS - 2 - step;
        for (int c = 0; c < r->cameras; c++) {
            bool now = r->moved > 0 && k >= BEFORE && c == f.victim;
            const float *from = now ? f.moved[at] : f.picture[at][c];
            float *to = noisy + n * (size_t)c;
            for (size_t i = 0; i < n; i++)
                to[i] = from[i] + (float)(r->noise * f.peak * bench_normal());
            picture[c] = to;
        }
        double t0 = ms(pvx_now_mono());
        CHECK(rec_drift_add(t, picture, true, &changed));
        out->ms += ms(pvx_now_mono()) - t0;
        if (r->moved == 0)
            keep(&own, (uint64_t)k, noisy, &out->accused);
        for (int c = 0; c < r->cameras; c++) {
            const struct rec_drift_camera *o = rec_drift_of(t, (size_t)c);
            bool victim = r->moved > 0 && c == f.victim;
            if (!victim)
                out->worst = fmax(out->worst, hypot(o->since[0], o->since[1]));
            if ((changed >> c & 1) == 0 || !o->moved)
                continue;
            if (!victim || k < BEFORE)
                out->wrongly++;
            else if (out->after < 0)
                out->after = k - BEFORE + 1;
        }
    }
    out->ms /= sets;
    out->checks = (int)own.said.n;
    out->found = own.found;
    rec_drift_free(&t);
    rec_check_free(&check);
    free(own.copy);
    free(noisy);
    film_free(&f, r->cameras);
    return true;
}

int main(int argc, char **argv)
{
    static const enum flame_kind kinds[] = {
        FLAME_RING, FLAME_CAMPFIRE, FLAME_JET,  FLAME_HOLLOW, FLAME_CANDLES,
        FLAME_WALL, FLAME_SHELL,    FLAME_POOL, FLAME_SHEETS, FLAME_RAGGED};
    static const double moves[] = {0.5, 1, 4}, noises[] = {0.01, 0.05};
    pvx_pool *pool;
    CHECK(pvx_pool_new(1, "bench", &pool));
    int healthy = argc > 2 ? atoi(argv[2]) : 200;
    FILE *csv = bench_csv(
        argc, argv, "drift",
        "flame,use,cameras,calibration,noise,moved,after,wrongly,ms,checks,found,accused");
    printf("\nthe drift alarm: sets until a camera that was moved is named (wanted 100), others "
           "named wrongly; checks of the healthy, cameras that one found wrong, that two did\n");
    printf("%-10s %-9s %7s %7s %6s %6s %6s %8s %6s %6s %6s %6s %7s\n", "flame", "", "cameras",
           "off px", "noise", "moved", "after", "wrongly", "worst", "ms", "checks", "found",
           "accused");
    int seed = 1;
    for (size_t i = argc > 3 ? (size_t)atoi(argv[3]) : 0; i < sizeof kinds / sizeof *kinds; i++)
        for (int m = -1; m < 3; m++) {
            struct run r = {kinds[i],          4 + (seed * 5) % 9, seed,
                            0.15 * (seed % 3), noises[seed % 2],   m < 0 ? 0 : moves[m]};
            struct told o;
            seed++;
            if (argc > 4 && seed != atoi(argv[4]))
                continue;
            if (!play(&r, m < 0 ? healthy : BEFORE + AFTER, &o, pool))
                continue;
            printf("%-10s %-9s %7d %7.2f %6.2f %6.1f %6d %8d %6.2f %6.1f %6d %6d %7d\n",
                   flames[r.flame].name, flames[r.flame].use, r.cameras, r.off, r.noise, r.moved,
                   o.after, o.wrongly, o.worst, o.ms, o.checks, o.found, o.accused);
            if (csv != NULL)
                fprintf(csv, "%s,%s,%d,%g,%g,%g,%d,%d,%g,%d,%d,%d\n", flames[r.flame].name,
                        flames[r.flame].use, r.cameras, r.off, r.noise, r.moved, o.after, o.wrongly,
                        o.ms, o.checks, o.found, o.accused);
            fflush(stdout);
        }
    if (csv != NULL)
        fclose(csv);
    pvx_pool_free(&pool);
    return 0;
}
