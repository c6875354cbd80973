/* Corners that another program found in pictures of four webcams, and its calibration of them. */
#include "tests/lib/caliscope.h"
#include "tests/lib/plugins.h"

static struct cs s;

/* The lenses are the other program's, as its poses were found: these pictures hardly tell them.  The webcams are
 * not synchronized, and the right answer is a warning. */
T_CASE(caliscope_extrinsic)
{
    struct rec_rig rig;
    struct rec_calib_report r;
    struct pvx_diag d = {""};
    if (!cs_read(&s, "caliscope_post_optimization", "calibration/extrinsic/xy.csv", 6))
        T_SKIP("shared/data is not here");
    s.in.options.old = &s.rig;
    s.in.options.world = REC_WORLD_OLD;
    for (int c = 0; c < CS_CAMERAS; c++)
        s.camera[c].hold = REC_HOLD_LENS;
    pvx_err e = rec_calib_solve(&s.in, &rig, &r, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    for (int a = 0; a < CS_CAMERAS && e == PVX_OK; a++)
        for (int b = a + 1; b < CS_CAMERAS; b++)
            T_NEAR(cs_baseline(&rig, a, b) / cs_baseline(&s.rig, a, b), 1, 0.02);
    T_OK(rec_calib_says(&r, REC_CALIB_WARNING, REC_CALIB_SYNC));
    rec_rig_fini(&rig);
    rec_calib_report_fini(&r);
}

T_MAIN(plugins_of_this_build(), (void)0)
