/* test_sheets.c - thin sheets on an exact rig, without noise: to correct the cameras must cost nothing.  Where the grid
 * cannot follow the flame, what is left of the pictures looks like wrong cameras. */
#include "tests/bench/shot.h"
#include "tests/t.h"

static pvx_pool *pool;
static const struct view_set views_5 = {"5 on a ring", 6, 5, 2, {0, 1, 3, 4, 5}};

static double sheets_error(const struct scene *s, const struct shot *shot, const rec_sysmat *S,
                           enum rec_selfcal_mode mode)
{
    struct rec_frame_params p = rec_frame_defaults;
    size_t n = rec_grid_count(&S->grid) * (size_t)s->nch;
    float *dense = must_floats(n);
    struct rec_sparse v;
    rec_frame *f;
    p.photo.saturation = 1e30F;
    p.selfcal = mode;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    shot_put(shot, f);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    T_OK(mode == REC_SELFCAL_OFF || rec_frame_get_report(f)->selfcal.cameras > 0);
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    double error = rec_rel_l2(dense, s->truth, n);
    free(dense);
    rec_frame_free(&f);
    return error;
}

static void cost_nothing(const struct view_set *views, enum flame_kind kind)
{
    static const int32_t size[3] = {100, 75, 40};
    struct scene s;
    struct shot shot;
    T_OK(scene_new(&s, kind, views, size, 0, pool));
    scene_truth(&s, REC_TRILINEAR, pool);
    shot_new(&shot, &s, &noise_0, 1);
    rec_sysmat *S = scene_matrix(&s, 0, pool);
    double off = sheets_error(&s, &shot, S, REC_SELFCAL_OFF);
    double on = sheets_error(&s, &shot, S, REC_SELFCAL_ON);
    printf("  %s, %s: error %.4f, with corrected cameras %.4f\n", flames[kind].name, views->name,
           off, on);
    T_LE(on, 1.005 * off);
    rec_sysmat_free(&S);
    shot_free(&shot);
    scene_fini(&s);
}

T_CASE(sheets_of_eight_cameras)
{
    cost_nothing(&views_8, FLAME_SHEETS);
}
T_CASE(sheets_of_five_cameras)
{
    cost_nothing(&views_5, FLAME_SHEETS);
}
T_CASE(shell)
{
    cost_nothing(&views_8, FLAME_SHELL);
}

T_MAIN(if (pvx_pool_new(2, "test", &pool) != PVX_OK) return 2, pvx_pool_free(&pool))
