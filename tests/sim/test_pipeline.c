/* test_pipeline.c - sim: cameras through the whole pipeline: volumes are right and in order, and every
 * set is accounted for, with time enough and without. */
#include "tests/lib/pipebed.h"

T_CASE(volumes_are_right_and_in_order)
{
    /* Small and slow, so that all cameras see the same instants, also under a sanitizer. */
    make_rig(5, 40, 30, 16);
    dmn_live *p = make("cameras: \"sim:\"\nfps: 5\nsolver: {deadline_ms: 0}\n"
                       "sim: {seed: 3, period_s: 1.5}\n");
    struct audience a;
    audience_open(&a, 3, 1.5);
    T_EQ_I(dmn_live_start(p, NULL), PVX_OK);
    uint64_t last = 0;
    int volumes = 0;
    UNTIL (volumes >= 10) {
        struct pvp_view v;
        double error;
        if (!audience_next(&a, &v, &error))
            continue;
        T_OK(volumes == 0 || v.v.set > last);
        last = v.v.set;
        T_EQ_I(v.v.cameras_present, 5);
        T_EQ_I(v.v.camera_mask, 0x1F);
        T_OK(v.v.latency_ns > 0 && v.v.t_publish_ns > v.v.t_exposure_ns);
        T_LE(error, 0.25);
        volumes++;
    }
    T_EQ_I(volumes, 10);
    T_OK(a.others >= 1); /* status */
    finish(&p);
    audience_close(&a);
}

T_CASE(too_fast_drops_the_oldest_and_counts)
{
    /* Far more than can be solved: 200 iterations on every set at 300 Hz.  On a slow machine each camera keeps up with
     * some instants only, rarely all with one, so a set may have any of them. */
    make_rig(4, 80, 60, 24);
    dmn_live *p =
        started("cameras: \"sim:\"\nfps: 300\nthreads: 1\nsync: {policy: partial, min_cameras: 1}\n"
                "solver: {name: mlem, stop: iterations, iterations: 200, deadline_ms: 0}\n");
    LOOK_UNTIL(p, state.published >= 3 && state.dropped[DMN_DROP_SOLVE] > 0);
    finish(&p);
}

T_CASE(a_deadline_ends_the_solver)
{
    make_rig(4, 80, 60, 24);
    /* Enough for what comes before the solver under a sanitizer on a busy machine: without an iteration
     * nothing is ended. At one set a second none waits behind another while its time runs. */
    dmn_live *p = started("cameras: \"sim:\"\nfps: 1\nthreads: 1\n"
                          "solver: {name: mlem, stop: iterations, iterations: 100000, "
                          "deadline_ms: 800}\n");
    LOOK_UNTIL(p, state.published >= 2 && state.report.solve.iterations >= 1);
    T_EQ_I(state.report.solve.status, REC_DEADLINE);
    finish(&p);
}

T_CASE(cameras_that_are_not_there_do_not_stop_the_others)
{
    make_rig(4, 40, 30, 16);
    dmn_live *p = started("cameras: {cam0: \"sim:\", cam1: \"sim:absent\", cam2: \"sim:\", "
                          "cam3: \"sim:\"}\nfps: 5\nsync: {policy: partial, min_cameras: 3}\n");
    LOOK_UNTIL(p, state.published >= 5);
    T_EQ_I(state.report.cameras, 3);
    T_OK(state.capture.camera[1].state != CAP_RUNNING);
    T_OK(state.capture.camera[1].error[0] != '\0');
    T_OK(state.capture.sets_partial > 0);
    finish(&p);
}

T_CASE(an_end_is_an_end)
{
    make_rig(3, 40, 30, 16);
    dmn_live *p = started("cameras: \"sim:end_after=12\"\nfps: 10\nsolver: {deadline_ms: 0}\n");
    LOOK_UNTIL(p, dmn_live_finished(p));
    finish(&p);
    T_OK(state.published >= 1 && state.published <= 12);
}

T_CASE(a_second_publisher_is_refused)
{
    make_rig(3, 80, 60, 16);
    dmn_live *p = make("cameras: \"sim:\"\n"), *q = NULL;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_live_new(&cfg, NULL, NULL, NULL, &q, &d), PVX_EBUSY);
    T_OK(q == NULL);
    T_OK(d.text[0] != '\0');
    dmn_live_free(&p);
}

int main(void)
{
    bed_open();
    t_run();
    return bed_close();
}
