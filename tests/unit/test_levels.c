/* test_levels.c - the coarse-to-fine start: near the truth, the same for any number of threads, sound
 * on odd grids, with cameras away and without time; and the solver's loops the same on every
 * instruction set. */
#include "../scene.h"

#include "recon/levels.h"
#include "recon/solve/passes/pcg_pass.h"

/* Start of a carved frame into x [n][4]; false: there is nothing to solve. */
static bool start(const struct scene *s, rec_frame *f, int64_t deadline, float *x,
                  uint32_t *iterations)
{
    const struct rec_subsys *a = rec_frame_subsys(f);
    struct rec_kernels k;
    rec_levels *l;
    rec_solver *solver;
    double weight[4], noise2[4], misfit2[4] = {0};
    rec_kernels_init(&k, 0);
    T_EQ_I(rec_levels_new(s->S, &k, s->pool, 3, &l), PVX_OK);
    T_EQ_I(rec_solver_new(s->S, 3, &solver), PVX_OK);
    rec_levels_restrict(l, a, rec_frame_rhs(f), rec_frame_weight(f), false);
    bool any = rec_solve_weight(solver, a, rec_frame_rhs(f), rec_frame_weight(f), 0.01,
                                &rec_solve_defaults, weight, noise2);
    if (any)
        rec_levels_solve(l, a, weight, deadline, x, iterations, misfit2);
    rec_solver_free(&solver);
    rec_levels_free(&l);
    return any;
}

static void start_is_near_the_truth(void)
{
    static const int32_t grid[] = {32, 35, 61}; /* odd at one level or another */
    for (size_t g = 0; g < 3; g++)
        for (unsigned away = 0; away < 2; away++) {
            struct scene s;
            T_OK(scene_new(&s, 8, 80, grid[g], 2, 1));
            T_OK(s.S->coarse != NULL);
            struct rec_frame_params p = rec_frame_defaults;
            p.photo.saturation = 1e30f;
            rec_frame *f;
            T_EQ_I(rec_frame_new(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
            scene_shoot(&s, f, 0);
            rec_frame_present(f, 3, away == 0);
            rec_frame_carve(f);
            const struct rec_subsys *a = rec_frame_subsys(f);
            float *x = pvx_calloc((size_t)a->n * 4, sizeof *x);
            uint32_t iterations = 0;
            T_OK(start(&s, f, 0, x, &iterations));
            T_OK(iterations > 0);
            struct rec_sparse v = {&s.rig.grid, 3, 4, a->n, a->col, x};
            T_LE(scene_error(&s, &v), 0.45); /* a cell of the start is two fine ones wide */
            bool sound = true;
            for (size_t i = 0; i < (size_t)a->n * 4; i++)
                sound = sound && x[i] >= 0 && x[i] < 1e6f;
            T_OK(sound);
            T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
            struct rec_sparse end;
            rec_frame_volume(f, &end);
            T_OK(scene_error(&s, &end) < scene_error(&s, &v));
            free(x);
            rec_frame_free(&f);
            scene_free(&s);
        }
}

static void same_bits_for_any_number_of_threads(void)
{
    float *first = NULL;
    size_t n = 0;
    for (unsigned threads = 1; threads <= 4; threads++) {
        struct scene s;
        T_OK(scene_new(&s, 6, 80, 32, 1, threads));
        rec_frame *f;
        T_EQ_I(rec_frame_new(s.S, &s.rig, &rec_frame_defaults, s.pool, &f, NULL), PVX_OK);
        scene_shoot(&s, f, 0);
        rec_frame_carve(f);
        n = (size_t)rec_frame_subsys(f)->n * 4;
        float *x = pvx_calloc(n, sizeof *x);
        uint32_t iterations;
        T_OK(start(&s, f, 0, x, &iterations));
        if (first == NULL) {
            first = x;
        } else {
            T_OK(memcmp(first, x, n * sizeof *x) == 0);
            free(x);
        }
        rec_frame_free(&f);
        scene_free(&s);
    }
    free(first);
}

static void no_time_and_no_light(void)
{
    struct scene s;
    T_OK(scene_new(&s, 6, 80, 32, 1, 2));
    rec_frame *f;
    T_EQ_I(rec_frame_new(s.S, &s.rig, &rec_frame_defaults, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0);
    rec_frame_carve(f);
    size_t n = (size_t)rec_frame_subsys(f)->n * 4;
    float *x = pvx_calloc(n, sizeof *x);
    for (size_t i = 0; i < n; i++)
        x[i] = NAN; /* every value is written */
    uint32_t iterations = 9;
    T_OK(start(&s, f, 1, x, &iterations));
    T_EQ_I(iterations, 0);
    bool zero = true;
    for (size_t i = 0; i < n; i++)
        zero = zero && x[i] == 0;
    T_OK(zero);
    free(x);
    for (size_t c = 0; c < s.rig.n_cameras; c++)
        memset(s.image[c], 0, 80 * 60 * 4 * sizeof(float));
    scene_shoot(&s, f, 0);
    rec_frame_carve(f);
    float none[4];
    T_OK(!start(&s, f, 0, none, &iterations));
    rec_frame_free(&f);
    scene_free(&s);
}

/* The reference's gather with each set of loops: nothing but the compiler's flags differs. */
static void loops_do_not_depend_on_the_instruction_set(void)
{
#if defined(__x86_64__)
    if (!(rec_cpu_flags() & REC_CPU_AVX2))
        T_SKIP("no AVX2 here");
    struct scene s;
    T_OK(scene_new(&s, 8, 80, 32, 2, 2));
    rec_frame *f;
    T_EQ_I(rec_frame_new(s.S, &s.rig, &rec_frame_defaults, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0.01);
    rec_frame_carve(f);
    struct rec_subsys a = *rec_frame_subsys(f);
    rec_solver *solver;
    T_EQ_I(rec_solver_new(s.S, 3, &solver), PVX_OK);
    struct rec_kernels k[2];
    float *x[2];
    for (int i = 0; i < 2; i++) {
        struct rec_solve_report r;
        rec_kernels_init(&k[i], 0);
        if (i == 1)
            k[i].pcg = &rec_pcg_passes_avx2;
        a.k = &k[i];
        x[i] = pvx_calloc((size_t)a.n * 4, sizeof(float));
        T_EQ_I(rec_solve(solver, &a, rec_frame_rhs(f), rec_frame_weight(f), 0.01,
                         &rec_solve_defaults, x[i], NULL, NULL, &r),
               PVX_OK);
        T_OK(r.iterations > 5);
    }
    T_OK(memcmp(x[0], x[1], (size_t)a.n * 4 * sizeof(float)) == 0);
    free(x[0]);
    free(x[1]);
    rec_solver_free(&solver);
    rec_frame_free(&f);
    scene_free(&s);
#else
    T_SKIP("one set of loops on this CPU");
#endif
}

int main(void)
{
    T_RUN(start_is_near_the_truth);
    T_RUN(same_bits_for_any_number_of_threads);
    T_RUN(no_time_and_no_light);
    T_RUN(loops_do_not_depend_on_the_instruction_set);
    return t_done();
}
