/* test_levels.c - the coarse-to-fine start: near the truth, the same for any number of threads, sound
 * on odd grids, with cameras away and without time. */
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"
#include "recon/frame/inside.h"

/* Start of a carved frame into x [n][4]; false: there is nothing to solve. */
static bool start(rec_frame *f, int64_t deadline, float *x, uint32_t *iterations)
{
    struct rec_pictures in = slot_pictures(f, 0.01);
    struct rec_descent *d = &f->solver->descent;
    bool any = rec_problem_load(f->solver->problem, f->sub, &in);
    d->levels = f->levels;
    d->deadline_ns = deadline;
    rec_problem_weigh(f->solver->problem, -1);
    if (any)
        rec_levels_solve(f->solver->problem, d, x);
    *iterations = d->iterations;
    return any;
}

T_CASE(start_is_near_the_truth)
{
    static const int32_t grid[] = {32, 35, 45}; /* odd at one level or another */
    for (size_t g = 0; g < 3; g++) {
        struct scene s;
        scene_new(&s, 8, 80, grid[g], 2, 2);
        T_OK(s.S->coarse != NULL);
        for (unsigned away = 0; away < 2; away++) {
            struct rec_frame_params p = rec_frame_defaults;
            p.photo.saturation = 1e30f;
            rec_frame *f;
            T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
            scene_shoot(&s, f, 0);
            rec_frame_camera(f, 3)->present = away == 0;
            rec_frame_carve(f);
            const struct rec_subsys *a = rec_frame_subsys(f);
            float *x = pvx_calloc((size_t)a->n * 4, sizeof *x);
            uint32_t iterations = 0;
            T_OK(start(f, 0, x, &iterations));
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
        }
        scene_free(&s);
    }
}

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    float *first = NULL;
    size_t n = 0;
    for (unsigned threads = 1; threads <= 3; threads++) {
        struct scene s;
        scene_new(&s, 6, 80, 32, 1, threads);
        rec_frame *f;
        T_EQ_I(rec_frame_alone(s.S, &s.rig, &rec_frame_defaults, s.pool, &f, NULL), PVX_OK);
        scene_shoot(&s, f, 0);
        rec_frame_carve(f);
        n = (size_t)rec_frame_subsys(f)->n * 4;
        float *x = pvx_calloc(n, sizeof *x);
        uint32_t iterations;
        T_OK(start(f, 0, x, &iterations));
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

T_CASE(no_time_and_no_light)
{
    struct scene s;
    scene_new(&s, 6, 80, 32, 1, 2);
    rec_frame *f;
    T_EQ_I(rec_frame_alone(s.S, &s.rig, &rec_frame_defaults, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0);
    rec_frame_carve(f);
    size_t n = (size_t)rec_frame_subsys(f)->n * 4;
    float *x = pvx_calloc(n, sizeof *x);
    for (size_t i = 0; i < n; i++)
        x[i] = NAN; /* every value is written */
    uint32_t iterations = 9;
    T_OK(start(f, 1, x, &iterations));
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
    T_OK(!start(f, 0, none, &iterations));
    rec_frame_free(&f);
    scene_free(&s);
}
