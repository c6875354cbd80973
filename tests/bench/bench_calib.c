/* bench_calib - what rec_calib makes of a known ring of eight cameras: volume error, time, and how often what it
 * states of itself holds. */
#include "base/clock.h"
#include "recon/calib/pose.h"
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

static void run(const char *what, size_t frames, bool two_sided, double noise, double wrong)
{
    struct bv_result r;
    take(frames, two_sided, noise, wrong);
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
    run("100 poses, one-sided", 100, false, 0.1, 0);
    run("100 poses, two-sided", 100, true, 0.1, 0);
    run("30 poses, one-sided", 30, false, 0.1, 0);
    run("30 poses, one-sided, 0.3 px, 3 % wrong", 30, false, 0.3, 0.03);
    states("30 poses, two-sided", 100, 30, true, 0.1, 0);
    states("30 poses, one-sided", 100, 30, false, 0.1, 0);
    states("30 poses, one-sided, 0.3 px, 3 % wrong", 100, 30, false, 0.3, 0.03);
    return 0;
}
