/* bench_calib - what rec_calib makes of a known ring of eight cameras: volume error, time, and how often what it
 * states of itself holds; from corners with noise, and from pictures of which the corners have to be found. */
#include "base/clock.h"
#include "base/pool.h"
#include "recon/board/detect.h"
#include "recon/calib/pose.h"
#include "tests/lib/board_picture.h"
#include "tests/lib/board_views.h"

static struct bv s;

/* Largest error of a focal length and of a baseline between opposite cameras, in %, and of a centre, in mm. */
static void lengths(const struct bv_result *r)
{
    double f = 0, base = 0, centre = 0, sum = 0, a[3], b[3], to[3];
    for (size_t c = 0; c < 8; c++) {
        const double *p = s.cam[c].at, *q = s.cam[(c + 4) % 8].at;
        rec_camera_centre(&r->rig.cameras[c], a);
        rec_camera_centre(&r->rig.cameras[(c + 4) % 8], b);
        rec_pose_apply(r->to_rig, p, to);
        double off = sqrt(pow(a[0] - to[0], 2) + pow(a[1] - to[1], 2) + pow(a[2] - to[2], 2));
        centre = fmax(centre, 1e3 * off);
        sum += 1e6 * off * off / 8;
        double got = sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
        double true_one = sqrt(pow(p[0] - q[0], 2) + pow(p[1] - q[1], 2) + pow(p[2] - q[2], 2));
        base = fmax(base, 100 * fabs(got / true_one - 1));
        f = fmax(f, 100 * fabs(r->rig.cameras[c].fx / s.cam[c].f[0] - 1));
    }
    printf(
        "  worst focal length %.3f %%, worst opposite baseline %.3f %%, centres %.2f mm rms, %.2f "
        "worst\n",
        f, base, sqrt(sum), centre);
}

/* Views of eight cameras, into s. */
static void take(size_t frames, bool two_sided, double noise, double wrong)
{
    bv_init(&s, 8, two_sided);
    s.frames = frames;
    s.noise = noise;
    s.wrong = wrong;
    bv_everywhere(&s);
    bv_take(&s);
}

/* Solved from the views in s, and printed. */
static void solve(const char *what)
{
    struct bv_result r;
    int64_t t = pvx_now_mono();
    bv_solve(&s, &r);
    printf("%s: %zu views, %.2f s, error %d %s\n", what, s.n, 1e-9 * (double)(pvx_now_mono() - t),
           r.e, r.d.text);
    bv_print(&r);
    if (r.e == PVX_OK)
        lengths(&r);
    for (int i = 0; i < REC_CALIB_FOLDS && r.e == PVX_OK; i++)
        printf("  fold %d: %.4f px, held out %.4f, volume %.4f px\n", i, r.report.fold[i].trained,
               r.report.fold[i].held_out, r.report.fold[i].volume);
    bv_done(&r);
}

static void run(const char *what, size_t frames, bool two_sided, double noise, double wrong)
{
    take(frames, two_sided, noise, wrong);
    solve(what);
}

/* What the detector finds of view i of s in a picture of it, in its place. */
static void find_view(rec_board_detector *det, float *level, size_t i)
{
    struct rec_board b = s.board;
    struct rec_board_view *v = &s.view[i];
    const struct bv_camera *c = &s.cam[v->camera];
    const struct bv_pose *p = &s.pose[v->frame - 100];
    struct board_shot shot = {.width = s.w,
                              .height = s.h,
                              .f = c->f[0],
                              .cx = c->c[0],
                              .cy = c->c[1],
                              .blur = 1,
                              .noise = 0.01,
                              .dark = 0.1,
                              .light = 0.8,
                              .ground = 0.4,
                              .across = 2,
                              .seed = i + 1};
    const double *axis[3] = {c->right, c->down, c->forward};
    double from[3];
    memcpy(shot.k, c->k, sizeof shot.k);
    for (int j = 0; j < 3; j++)
        from[j] = p->o[j] - c->at[j];
    for (int j = 0; j < 3; j++) {
        shot.R[3 * j] = bv_dot(axis[j], p->x);
        shot.R[3 * j + 1] = bv_dot(axis[j], p->y);
        shot.R[3 * j + 2] = bv_dot(axis[j], p->z);
        shot.t[j] = bv_dot(axis[j], from);
    }
    if (b.two_sided)
        b.thickness =
            s.thickness; /* of the board in the picture; who calibrates does not know it */
    board_picture(&b, &shot, level);
    struct rec_board_sight sight;
    struct rec_board_picture picture = {level, s.w, s.h, s.w * (ptrdiff_t)sizeof(float), true};
    if (rec_board_detect(det, &picture, &sight) != PVX_OK)
        exit(1);
    v->n = sight.view.n <= BV_CORNERS ? sight.view.n : 0;
    v->face = sight.view.face;
    if (v->n > 0)
        memcpy(v->corner, sight.view.corner, v->n * sizeof *v->corner);
}
static void find_half(void *ctx, size_t half)
{
    struct pvx_diag d;
    rec_board_detector *det;
    float *level = malloc((size_t)s.w * (size_t)s.h * sizeof *level);
    (void)ctx;
    if (level == NULL || rec_board_detector_new(&s.board, &det, &d) != PVX_OK)
        exit(1);
    for (size_t i = half; i < s.n; i += 2)
        find_view(det, level, i);
    rec_board_detector_free(&det);
    free(level);
}

/* The rig and the places of the board half as large, the board as it was: its squares have 16 px, not 8, which a
 * marker can not be read from. */
static void closer(void)
{
    for (size_t c = 0; c < 8; c++)
        for (int j = 0; j < 3; j++)
            s.cam[c].at[j] *= 0.5;
    for (size_t f = 0; f < s.frames; f++)
        for (int j = 0; j < 3; j++) {
            struct bv_pose *p = &s.pose[f];
            double middle = 0.09 * p->x[j] + 0.135 * p->y[j];
            p->o[j] = 0.5 * (p->o[j] + middle) - middle;
        }
    for (int j = 0; j < 3; j++) {
        s.in.grid.min[j] *= 0.5;
        s.in.grid.max[j] *= 0.5;
    }
}

/* From pictures of a renderer that shares no code with what finds and solves: blur 1 px, noise 1 %. */
static void run_pictures(const char *what, size_t frames, bool two_sided)
{
    pvx_pool *pool;
    size_t n = 0;
    bv_init(&s, 8, two_sided);
    s.frames = frames;
    for (size_t c = 0; c < 8; c++)
        s.cam[c].f[1] = s.cam[c].f[0]; /* the renderer's pixels are square */
    bv_everywhere(&s);
    closer();
    bv_take(&s);
    if (pvx_pool_new(2, "board", &pool) != PVX_OK)
        exit(1);
    pvx_pool_run(pool, 2, find_half, NULL);
    pvx_pool_free(&pool);
    for (size_t i = 0; i < s.n; i++)
        if (s.view[i].n > 0)
            s.view[n++] = s.view[i];
    printf("the board is found in %zu of %zu pictures\n", n, s.n);
    s.in.n_views = s.n = n;
    solve(what);
}

/* In how many of `seeds` does each camera's volume error stay below its px_95, and f within 1.96 sigma? */
static void states(const char *what, int seeds, size_t frames, bool two_sided, double noise,
                   double wrong)
{
    double below = 0, within = 0, n = 0, ratio = 0;
    for (int i = 0; i < seeds; i++) {
        struct bv_result r;
        take(frames, two_sided, noise, wrong);
        bv_solve(&s, &r);
        for (size_t c = 0; c < 8 && r.e == PVX_OK; c++) {
            below += r.px[c] <= r.rig.cameras[c].uncertainty.px_95;
            within += fabs(r.rig.cameras[c].fx - s.cam[c].f[0]) <=
                      1.96 * r.report.camera[c].sigma[REC_FX];
            ratio += pow(r.rms / r.report.px, 2);
        }
        n += 8;
        bv_done(&r);
    }
    printf(
        "%s, %d seeds: below px_95 %.1f %%, f in its interval %.1f %%, error over expected %.3f\n",
        what, seeds, 100 * below / n, 100 * within / n, sqrt(ratio / n));
}

int main(void)
{
    board_module_here();
    run_pictures("pictures of 100 poses, two-sided", 100, true);
    run_pictures("pictures of 100 poses, one-sided", 100, false);
    run("100 poses, one-sided", 100, false, 0.1, 0);
    run("100 poses, two-sided", 100, true, 0.1, 0);
    run("30 poses, one-sided", 30, false, 0.1, 0);
    run("30 poses, one-sided, 0.3 px, 3 % wrong", 30, false, 0.3, 0.03);
    states("30 poses, two-sided", 100, 30, true, 0.1, 0);
    states("30 poses, one-sided", 100, 30, false, 0.1, 0);
    states("30 poses, one-sided, 0.3 px, 3 % wrong", 100, 30, false, 0.3, 0.03);
    return 0;
}
