/* test_compute.c - where frame sets are solved: what is allowed, the flame of a measurement, the measurement, what is
 * counted. */
#include "tests/lib/scene.h"

#include <math.h>

#include "base/log.h"
#include "daemon/config/compute.h"
#include "daemon/pipeline/compute.h"
#include "daemon/pipeline/compute_flame.h"
#include "tests/lib/cl_bed.h"

static struct scene sc;

T_CASE(words)
{
    enum dmn_compute_where where;
    const char *name;
    T_OK(dmn_compute_parse("cpu", &where, &name) && where == DMN_COMPUTE_CPU);
    T_OK(dmn_compute_parse("auto", &where, &name) && where == DMN_COMPUTE_AUTO);
    T_OK(dmn_compute_parse("opencl", &where, &name) && where == DMN_COMPUTE_OPENCL);
    T_EQ_S(name, "");
    T_OK(dmn_compute_parse("opencl:A 9: x", &where, &name) && where == DMN_COMPUTE_OPENCL);
    T_EQ_S(name, "A 9: x");
    T_OK(!dmn_compute_parse("opencl:", &where, &name));
    T_OK(!dmn_compute_parse("openclx", &where, &name));
    T_OK(!dmn_compute_parse("CPU", &where, &name));
    T_OK(!dmn_compute_parse("", &where, &name));
}

T_CASE(what_is_refused)
{
    struct pvx_diag d = {""};
    struct dmn_compute c;
    struct dmn_compute_want w = {.word = "opencl:portable", .what = "it", .refused = "error bars"};
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "it: opencl:portable: only the processors can do this: error bars");
    T_OK(c.card == NULL);
    w.word = "auto";
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_OK);
    T_OK(c.card == NULL && !c.warn);
    T_CONTAINS(c.said, "error bars");
    w.word = "cpu";
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_OK);
    T_OK(c.card == NULL);
    T_EQ_S(c.said, "");
    w = (struct dmn_compute_want){.word = "opencl:no such card", .what = "it"};
    d.text[0] = '\0';
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "there are: ");
}

/* Solved by the processors it looks like a flame in the rig: all cameras agree, and little is left. */
static void flame_is_seen(int nch, float black)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct pvx_diag d = {""};
    dmn_compute_flame *flame;
    rec_frame *f;
    p.nch = nch;
    p.photo.black = black;
    T_EQ_I(dmn_compute_flame_new(sc.S, &p, sc.pool, &flame), PVX_OK);
    T_EQ_I(rec_frame_alone(sc.S, &sc.rig, &p, sc.pool, &f, &d), PVX_OK);
    for (int again = 0; again < 2; again++) {
        rec_frame_reset(f);
        dmn_compute_flame_load(flame, f);
        rec_frame_carve(f);
        T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
        const struct rec_frame_report *r = rec_frame_get_report(f);
        T_EQ_I(r->cameras, sc.rig.n_cameras);
        T_LE(100, r->active_voxels);
        T_LE(r->active_voxels, 0.7 * (double)sc.voxels);
        T_OK(r->solve.rel_residual > 0 && r->solve.rel_residual < 0.2);
        T_OK(!r->on_card);
    }
    rec_frame_free(&f);
    dmn_compute_flame_free(&flame);
}

T_CASE(flame_of_a_measurement)
{
    flame_is_seen(3, 0);
    flame_is_seen(1, 0.02f);
}

/* On pocl either may be faster: what is said and what is taken belong together. */
static void measured(struct dmn_compute *c, const struct dmn_compute_job *job)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct pvx_diag d = {""};
    c->measure = true;
    T_EQ_I(dmn_compute_choose(c, job, &p, &d), PVX_OK);
    T_EQ_S(d.text, "");
    double first = 0, second = 0;
    const char *at = strstr(c->said, " ms a set against ");
    T_OK(at != NULL && p.card == c->card);
    if (at == NULL) {
        printf("said: %s\n", c->said);
        return;
    }
    while (at > c->said && at[-1] != ' ')
        at--;
    T_EQ_I(sscanf(at, "%lf ms a set against %lf ms", &first, &second), 2);
    T_OK(first > 0 && first <= second);
    T_OK((c->card == NULL) == (strncmp(c->said, "compute: the processors, ", 25) == 0));
    dmn_compute_close(c);
}

static size_t loaded;
static void load(void *ctx, size_t k, rec_frame *f)
{
    loaded += k < DMN_COMPUTE_SETS;
    scene_shoot(ctx, f, 0.01);
}

T_CASE(measurement)
{
    const struct dmn_compute_want w = {.word = "opencl:portable", .what = "it"};
    struct dmn_compute_job job = {.S = sc.S, .rig = &sc.rig, .pool = sc.pool};
    struct rec_frame_params p = rec_frame_defaults;
    struct pvx_diag d = {""};
    struct dmn_compute c;
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(c.card != NULL && !c.measure);
    if (c.card == NULL)
        return;
    T_EQ_I(dmn_compute_choose(&c, &job, &p, &d), PVX_OK);
    T_OK(p.card == c.card);
    T_CONTAINS(c.said, rec_cl_about(c.card)->name);
    measured(&c, &job);
    job.load = load;
    job.ctx = &sc;
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_OK);
    measured(&c, &job);
    T_LE(2 * 2, loaded);
}

static int lines;
static bool hear(enum pvx_log_level level, const struct pvx_about *about, const char *text)
{
    lines += level == PVX_LOG_WARN && about != NULL && strcmp(about->cause, "compute") == 0 &&
             strstr(text, "on the processors") != NULL;
    return true;
}

T_CASE(what_is_counted)
{
    static struct dmn_compute_count count = {.lock = PTHREAD_MUTEX_INITIALIZER};
    struct rec_frame_report there = {.on_card = true}, here = {.why_here = "it is tired"};
    struct dmn_compute_state s;
    struct pvx_diag d = {""};
    rec_cl *cl;
    dmn_compute_note(&count, NULL, &there);
    dmn_compute_state(&count, NULL, &s);
    T_OK(s.device[0] == '\0' && s.there == 0);
    T_EQ_I(rec_cl_open(cl_bed_name(), &cl, &d), PVX_OK);
    if (d.text[0] != '\0')
        return;
    pvx_log_set_sink(hear);
    for (int i = 0; i < 3; i++)
        dmn_compute_note(&count, cl, &there);
    for (int i = 0; i < 5; i++)
        dmn_compute_note(&count, cl, &here);
    T_EQ_I(lines, 1);
    snprintf(here.why_here, sizeof here.why_here, "it is gone");
    dmn_compute_note(&count, cl, &here);
    T_EQ_I(lines, 2);
    pvx_log_set_sink(NULL);
    dmn_compute_state(&count, cl, &s);
    T_EQ_S(s.device, rec_cl_about(cl)->name);
    T_EQ_I(s.there, 3);
    T_EQ_I(s.here, 6);
    T_EQ_S(s.why, "it is gone");
    rec_cl_close(&cl);
}

T_MAIN((cl_bed_begin(), scene_new(&sc, 6, 48, 14, 2, 2)), scene_free(&sc))
