/* test_missing_camera.c - solve with what is there: a camera that comes and goes leaves the system and
 * joins it again; the volume stays right, from set to set and with warm starts, and says how many
 * cameras it was made from. */
#include "tests/lib/pipebed.h"

#define CAMERAS 8
#define FPS     10

struct errors {
    int n;
    double sum, max;
};

struct seen {
    struct errors with[CAMERAS + 1]; /* by cameras present */
    struct errors changed;           /* first volume after a change of them */
    int changes, wrong_mask;
};

static void add(struct errors *e, double error)
{
    e->n++;
    e->sum += error;
    e->max = fmax(e->max, error);
}

static double mean(const struct errors *e)
{
    return e->n > 0 ? e->sum / e->n : 0;
}

static const char common[] = "fps: 10\nsim: {seed: 3, period_s: 1.5}\n"
                             "solver: {deadline_ms: 0, warm_start: on}\n";
#define ALL_BUT_3                                                                                \
    "cameras: {cam0: \"sim:\", cam1: \"sim:\", cam2: \"sim:\", cam4: \"sim:\", cam5: \"sim:\", " \
    "cam6: \"sim:\", cam7: \"sim:\", cam3: "

static void note(struct seen *y, const struct pvp_view *v, double error, int *before)
{
    int present = (int)v->v.cameras_present;
    uint64_t mask = v->v.camera_mask;
    y->wrong_mask += __builtin_popcountll(mask) != present || mask >> CAMERAS != 0;
    add(&y->with[present], error);
    if (*before != 0 && *before != present) {
        y->changes++;
        add(&y->changed, error);
    }
    *before = present;
}

/* Volumes of cameras 0 to 7, of which 3 is `third`, against the flame, until there are `full` from all
 * cameras and `less` from one fewer.  (min_cameras: on a busy machine any of them may be late.) */
static void watch(const char *third, const char *more, struct seen *y, int full, int less)
{
    char text[600];
    snprintf(text, sizeof text, "%s" ALL_BUT_3 "\"sim:%s\"}\n%s", common, third, more);
    dmn_live *p = make(text);
    struct audience a;
    int before = 0;
    memset(y, 0, sizeof *y);
    audience_open(&a, 3, 1.5);
    T_EQ_I(dmn_live_start(p, NULL), PVX_OK);
    UNTIL (y->with[CAMERAS].n >= full && y->with[CAMERAS - 1].n >= less) {
        struct pvp_view v;
        double error;
        if (audience_next(&a, &v, &error))
            note(y, &v, error, &before);
    }
    finish(&p);
    audience_close(&a);
}

/* The camera dies after each 8 pictures and is back a quarter of a second later. */
T_CASE(a_flapping_camera_does_no_harm)
{
    enum { WHOLE = T_TSAN ? 8 : 20, LESS = T_TSAN ? 4 : 12 };
    static struct seen y;
    watch("die_after=8", "sync: {policy: solve-with-what-is-there, min_cameras: 7}\n", &y, WHOLE,
          LESS);
    printf("  relative L2 error: 8 views %.3f mean %.3f worst (%d), 7 views %.3f mean %.3f worst "
           "(%d), "
           "first after a change %.3f worst (%d)\n",
           mean(&y.with[8]), y.with[8].max, y.with[8].n, mean(&y.with[7]), y.with[7].max,
           y.with[7].n, y.changed.max, y.changed.n);
    T_OK(y.with[8].n >= WHOLE);
    T_OK(y.with[7].n >= LESS);
    T_OK(y.changes >= (T_TSAN ? 1 : 4));
    T_EQ_I(y.wrong_mask, 0);
    T_LE(y.with[8].max, 0.2);
    T_LE(y.with[7].max, 0.2);
    T_LE(mean(&y.with[7]), 1.25 * mean(&y.with[8]));
    T_LE(y.changed.max, 0.2);
    T_OK(state.capture.sets_partial > 0);
    T_OK(state.capture.camera[3].count[CAP_LOST_CAMERA] >= (T_TSAN ? 1 : 2));
}

/* drop: only whole sets.  wait: whole ones as long as the camera lives, then those of the others. */
T_CASE(the_other_policies_do_what_they_say)
{
    T_NOT_UNDER_TSAN();
    static struct seen y;
    watch("drop=0.3", "sync: {policy: wait}\n", &y, 15, 0);
    T_OK(y.with[8].n >= 15);
    T_EQ_I(y.with[7].n, 0); /* it lives: no set lacks it */
    T_OK(state.capture.sets_failed > 0);
    watch("die_after=8", "sync: {policy: wait}\n", &y, 8, 2);
    T_OK(y.with[8].n >= 8);
    T_OK(y.with[7].n >= 2); /* gone: the others go on */
    watch("die_after=8", "sync: {policy: drop}\n", &y, 15, 0);
    T_OK(y.with[8].n >= 15);
    T_EQ_I(y.with[7].n, 0);
    T_EQ_I(state.capture.sets_partial, 0);
}

/* hull.min_views holds for the cameras that are there. */
T_CASE(min_views_is_respected)
{
    T_NOT_UNDER_TSAN();
    static struct seen y;
    watch("absent",
          "sync: {policy: solve-with-what-is-there, min_cameras: 7}\nhull: {min_views: 8}\n", &y, 0,
          3);
    T_OK(y.with[7].n >= 3);
    T_EQ_I(state.report.cameras, 7);
    T_EQ_I(state.report.active_voxels, 0); /* no voxel is seen by eight */
    watch("absent",
          "sync: {policy: solve-with-what-is-there, min_cameras: 7}\nhull: {min_views: 7}\n", &y, 0,
          3);
    T_EQ_I(state.report.cameras, 7);
    T_OK(state.report.active_voxels > 100);
}

int main(void)
{
    bed_open();
    make_rig(CAMERAS, 80, 60, 24);
    t_run();
    return bed_close();
}
