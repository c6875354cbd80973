/* bench_calib - what rec_calib makes of a known ring of eight cameras: volume error and time. */
#include "base/clock.h"
#include "tests/lib/board_views.h"

static struct bv s;

static void run(const char *what, size_t frames, bool two_sided, double noise, double wrong)
{
    struct bv_result r;
    bv_init(&s, 8, two_sided);
    s.frames = frames;
    s.noise = noise;
    s.wrong = wrong;
    bv_everywhere(&s);
    bv_take(&s);
    int64_t t = pvx_now_mono();
    bv_solve(&s, &r);
    printf("%s: %zu views, %.2f s, error %d %s\n", what, s.n, 1e-9 * (double)(pvx_now_mono() - t),
           r.e, r.d.text);
    bv_print(&r);
    for (int i = 0; i < REC_CALIB_FOLDS && r.e == PVX_OK; i++)
        printf("  fold %d: %.4f px, held out %.4f, volume %.4f px\n", i, r.report.fold[i].trained,
               r.report.fold[i].held_out, r.report.fold[i].volume);
    bv_done(&r);
}

int main(void)
{
    run("100 poses, one-sided", 100, false, 0.1, 0);
    run("100 poses, two-sided", 100, true, 0.1, 0);
    run("30 poses, one-sided", 30, false, 0.1, 0);
    run("30 poses, one-sided, 0.3 px, 3 % wrong", 30, false, 0.3, 0.03);
    return 0;
}
