/* bench_motion.c - flames in motion: start from nothing against start from the last volume.
 *
 * The same frames with the same iteration budgets, both ways; errors and times are means over all
 * frames but the first, which both start from nothing.  And a flame that jumps: what a start from the
 * wrong volume costs, and how much of it is still there. */
#include "curve.h"

static const uint16_t steps[] = {1, 2, 4, 8, 16};
#define N_STEPS   ((int)(sizeof steps / sizeof *steps))
#define MAX_FRAME 12 /* as the campfire has */

static FILE *csv;

/* Emission where only the old flame was, as a share of all: what bled into the new frame. */
struct bleed {
    const struct scene *old, *now;
    int frame;
    double share;
};

static void bleed_after(void *ctx, int frame, const float *dense)
{
    struct bleed *b = ctx;
    if (frame != b->frame)
        return;
    size_t n = rec_grid_count(&b->now->rig.grid) * (size_t)b->now->nch;
    double top = 0, all = 0, ghost = 0;
    for (size_t i = 0; i < n; i++)
        top = fmax(top, b->now->truth[i]);
    for (size_t i = 0; i < n; i++) {
        all += dense[i];
        if (b->now->truth[i] < 1e-3 * top && b->old->truth[i] > 1e-2 * top)
            ghost += dense[i];
    }
    b->share = all > 0 ? ghost / all : 0;
}

static void both_ways(const char *name, const char *use, const struct course *c,
                      struct bleed *bleed)
{
    const char *solver = rec_solver_names()[0], *basis = rec_basis_name(c->S->grid.basis);
    for (int i = 0; i <= N_STEPS; i++)
        for (int warm = 0; warm < 2; warm++) {
            struct setting set = {.solver = solver,
                                  .stop = i < N_STEPS ? REC_STOP_ITERATIONS : REC_STOP_AUTO,
                                  .iterations = i < N_STEPS ? steps[i] : 0,
                                  .warm = warm};
            if (bleed != NULL) {
                set.after = bleed_after;
                set.ctx = bleed;
            }
            struct point p = measure(c, &set);
            bench_row(csv, "%s,%s,%s,%s,%s,%.1f,%.4f,%.6f,%.6f", name, use, basis,
                      warm ? "warm" : "cold", i < N_STEPS ? "budget" : "auto", p.iterations, p.ms,
                      p.q.volume, bleed != NULL ? bleed->share : 0);
        }
}

static void sequence(const char *name, const char *use, struct scene *s, int n, bool jump,
                     pvx_pool *pool)
{
    struct shot shot[MAX_FRAME];
    for (int i = 0; i < n; i++)
        shot_new(&shot[i], &s[i], &noise_1, 1 + (uint64_t)i);
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        for (int i = 0; i < n; i++)
            scene_truth(&s[i], (enum rec_basis)basis, pool);
        rec_sysmat *S = scene_matrix(&s[0], 2, pool, NULL);
        struct course c = {.scene = s, .shot = shot, .n = n, .from = 1, .S = S, .pool = pool};
        course_base(&c);
        struct bleed b = {.old = &s[n - 2], .now = &s[n - 1], .frame = n - 1};
        both_ways(name, use, &c, jump ? &b : NULL);
        rec_sysmat_free(&S);
    }
    for (int i = 0; i < n; i++) {
        shot_free(&shot[i]);
        scene_fini(&s[i]);
    }
}

/* The first n volumes of a flame, with one exposure for all, as a camera has. */
static void volumes(const char *name, enum flame_kind kind, int n, pvx_pool *pool)
{
    static struct scene s[MAX_FRAME];
    double peak = 0;
    for (int i = 0; i < n; i++)
        if (!scene_new(&s[i], kind, &views_8, size_64, i, pool))
            return;
    for (int i = 0; i < n; i++)
        peak = fmax(peak, s[i].peak / s[i].scale);
    for (int i = 0; i < n; i++)
        scene_rescale(&s[i], PEAK / (peak * s[i].scale));
    sequence(name, flames[kind].use, s, n, false, pool);
}

int main(int argc, char **argv)
{
    struct scene s[MAX_FRAME];
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nin motion: %s from nothing (cold) and from the last volume (warm), 8 x 160x120, 1 %% "
           "noise, %u threads; ghost: share of light where only the old flame was\n",
           rec_solver_names()[0], pvx_pool_threads(pool));
    csv = bench_csv(argc, argv, "motion", "scene,use,basis,start,stop,iterations,ms,volume,ghost");
    for (int i = 0; i < MAX_FRAME; i++)
        (void)scene_new(&s[i], FLAME_RING, &views_8, size_64, 0.3 + 0.05 * i, pool);
    sequence("ring at 20 Hz", "fitted", s, MAX_FRAME, false, pool);
    volumes("campfire at 24 Hz", FLAME_CAMPFIRE, MAX_FRAME, pool);
    volumes("jet at 24 Hz", FLAME_JET, 4, pool); /* the first four follow each other */
    volumes("hollow at 24 Hz", FLAME_HOLLOW, 4, pool);
    for (int i = 0; i < 2; i++) { /* another flame, 16 cm to the side */
        scene_views(&s[i], &views_8, 160, 120, 64);
        pose_ring(&s[i], (uint32_t)(1 + i), 0.3, i == 0 ? -0.08 : 0.08);
        scene_shoot(&s[i], pool);
    }
    sequence("ring that jumps", "fitted", s, 2, true, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
