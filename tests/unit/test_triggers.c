/* test_triggers.c - conditions on volumes: their values, and when they fire. */
#include "../t.h"

#include <math.h>
#include <sched.h>

#include "base/clock.h"
#include "daemon/pipeline/triggers.h"

#define N  8
#define P  (10 * PVX_NS_PER_MS)
#define T0 1700000000000000000LL

/* 8^3 voxels of 0.1 m, z from 1 to 1.8 m. */
static const struct rec_grid grid = {.n = {N, N, N}, .min = {0, 0, 1}, .max = {0.8, 0.8, 1.8}};
static int32_t voxel[N * N * N];
static float value[N * N * N];
static struct rec_sparse v;

/* Columns of the four voxels at (x..x+1, y..y+1), layers 0..top-1, all of this value. */
static void column(int x, int y, int top, float light)
{
    v = (struct rec_sparse){.grid = &grid, .nch = 1, .cs = 1, .index = voxel, .value = value};
    for (int z = 0; z < top; z++)
        for (int k = 0; k < 4; k++) {
            voxel[v.n] = (z * N + y + k / 2) * N + x + k % 2;
            value[v.n++] = light;
        }
}

static double value_of(struct dmn_trigger k)
{
    double light = -1;
    return dmn_trigger_value(&k, &v, &light);
}

T_CASE(values)
{
    column(2, 2, 5, 3);
    T_NEAR(value_of((struct dmn_trigger){.when = DMN_WHEN_LIGHT}), 20 * 3 * 1e-3, 1e-9);
    T_NEAR(value_of((struct dmn_trigger){.when = DMN_WHEN_HEIGHT}), 1.5, 1e-9);
    T_NEAR(value_of((struct dmn_trigger){.when = DMN_WHEN_APPEARS}), 20, 0);
    /* the lower two layers, and of these the left half */
    struct dmn_trigger k = {.when = DMN_WHEN_LIGHT, .boxed = true, .box = {0, 0, 1, 0.3, 0.8, 1.2}};
    T_NEAR(value_of(k), 4 * 3 * 1e-3, 1e-9);
    k.when = DMN_WHEN_VANISHES;
    T_NEAR(value_of(k), 4, 0);
    k.when = DMN_WHEN_HEIGHT;
    T_NEAR(value_of(k), 1.2, 1e-9);
    k = (struct dmn_trigger){.when = DMN_WHEN_LIGHT, .boxed = true, .box = {5, 5, 5, 6, 6, 6}};
    T_NEAR(value_of(k), 0, 0); /* outside the volume */
    double light = -1;
    k = (struct dmn_trigger){.when = DMN_WHEN_CHANGE};
    T_NEAR(dmn_trigger_value(&k, &v, &light), 0, 0); /* there was no set before */
    column(2, 2, 5, 2.4f);
    T_NEAR(dmn_trigger_value(&k, &v, &light), 20, 1e-4);
    column(2, 2, 0, 0);
    T_NEAR(dmn_trigger_value(&k, &v, &light), 100, 1e-9);
    T_NEAR(dmn_trigger_value(&k, &v, &light), 0, 0);
    column(2, 2, 5, 1);
    T_LE(1000, dmn_trigger_value(&k, &v, &light)); /* from nothing */
    column(0, 0, N, 1);                            /* colour: the mean of three */
    v.nch = 3;
    v.cs = 4;
    static float colour[N * N * N * 4];
    for (int32_t i = 0; i < v.n; i++)
        for (int c = 0; c < 3; c++)
            colour[i * 4 + c] = (float)c;
    v.value = colour;
    T_NEAR(value_of((struct dmn_trigger){.when = DMN_WHEN_LIGHT}), 32e-3, 1e-9);
    T_NEAR(value_of((struct dmn_trigger){.when = DMN_WHEN_HEIGHT}), 1.8, 1e-9);
}

/* ---- firing ---- */

static struct dmn_config cfg;
static cap_ring *ring;
static dmn_triggers_run *run;
static char said[4096];

static pvx_err nowhere(void *ctx, const struct cap_take_trigger *t, char *path, size_t size,
                       struct cap_take_head *head, struct pvx_diag *d)
{
    (void)ctx, (void)t, (void)path, (void)size, (void)head;
    return pvx_fail(d, PVX_EPERM, "not in this test");
}
static void say(void *ctx, const char *json)
{
    (void)ctx;
    size_t n = strlen(said);
    snprintf(said + n, sizeof said - n, "%s\n", json);
}
static const struct dmn_events_listener to = {.say = say};

static void begin(const char *triggers)
{
    struct pvx_diag d = {""};
    char text[1000];
    snprintf(text, sizeof text,
             "record: { ring: { seconds: 5, memory: 8GB } }\ncameras: 'sim:'\ntriggers: %s\n",
             triggers);
    const struct cap_ring_config c = {
        .n_cameras = 1, .frames = 4, .bytes = 1, .fps = 100, .place = nowhere};
    T_EQ_I(dmn_config_parse(text, strlen(text), "t", &cfg, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(cap_ring_new(&c, &ring), PVX_OK);
    T_EQ_I(cap_ring_start(ring, NULL), PVX_OK);
    T_EQ_I(dmn_triggers_new(&cfg, ring, &run), PVX_OK);
    said[0] = '\0';
}

static void end(void)
{
    dmn_triggers_free(&run);
    cap_ring_free(&ring);
}

/* Sets from..to-1 with so much light in each voxel.  Returns how often triggers fired. */
static uint64_t burn(uint64_t from, uint64_t upto, int top, float light)
{
    struct dmn_triggers_state a, b;
    uint64_t n = 0;
    column(2, 2, top, light);
    dmn_triggers_state(run, &a);
    for (uint64_t k = from; k < upto; k++)
        dmn_triggers_look(run, &v, k, T0 + (int64_t)k * P);
    dmn_triggers_state(run, &b);
    dmn_triggers_events(run, &to);
    for (size_t i = 0; i < b.n; i++)
        n += b.item[i].fired - a.item[i].fired;
    return n;
}

T_CASE_OF_THREADS(light_fires_once_and_is_ready_below_release)
{
    begin("[{ name: a, when: light, above: 0.05, release: 0.02, agree: 3, hold_off: 0 }]");
    T_EQ_I(burn(0, 10, 5, 3), 0); /* it holds from the start: 0.06 */
    T_EQ_I(burn(10, 12, 0, 0), 0);
    T_EQ_I(burn(12, 14, 5, 3), 0); /* not yet three sets */
    T_EQ_I(burn(14, 15, 5, 2), 0);
    T_EQ_I(burn(15, 17, 5, 3), 0); /* and not three in a row */
    T_EQ_I(burn(17, 18, 5, 3), 1);
    T_CONTAINS(said, "\"kind\":\"trigger\",\"name\":\"a\",\"when\":\"light\"");
    T_CONTAINS(said, "\"set\":15"); /* the first of the three */
    T_CONTAINS(said, "\"t_ns\":1700000000150000000");
    T_EQ_I(burn(18, 30, 5, 2), 0); /* 0.04: below above, not below release */
    T_EQ_I(burn(30, 40, 5, 3), 0);
    T_EQ_I(burn(40, 41, 5, 0.9f), 0); /* below release */
    T_EQ_I(burn(41, 50, 5, 3), 1);
    end();
}

T_CASE_OF_THREADS(ignition_and_blow_off)
{
    begin("[{ name: on, when: appears, hold_off: 0 }, { name: off, when: vanishes, hold_off: 0 }]");
    T_EQ_I(burn(0, 10, 0, 0), 0); /* dark from the start is no blow-off */
    T_EQ_I(burn(10, 20, 5, 1), 1);
    T_CONTAINS(said, "\"name\":\"on\"");
    said[0] = '\0';
    T_EQ_I(burn(20, 30, 0, 0), 1);
    T_CONTAINS(said, "\"name\":\"off\"");
    T_CONTAINS(said, "\"set\":20");
    T_EQ_I(burn(30, 31, 5, 1), 0); /* one set alone: agree is 2 */
    T_EQ_I(burn(31, 40, 0, 0), 0 + 1);
    end();
}

T_CASE_OF_THREADS(hold_off_and_change)
{
    begin("[{ name: c, when: change, above: 50, hold_off: 0.1 }]");
    T_EQ_I(burn(0, 5, 5, 1), 0);
    T_EQ_I(burn(5, 8, 5, 2), 1);
    T_EQ_I(burn(8, 11, 5, 1), 0);  /* 50 % is not above, and it is held off */
    T_EQ_I(burn(11, 14, 5, 2), 0); /* within 0.1 s */
    T_EQ_I(burn(14, 20, 5, 4), 0);
    T_EQ_I(burn(20, 21, 5, 8), 1);
    end();
}

/* Frames from..to-1 of the camera with these levels; returns how often triggers fired. */
static uint64_t wire(const char *camera, uint64_t from, uint64_t upto, uint64_t lines)
{
    struct dmn_triggers_state a, b;
    uint64_t n = 0;
    dmn_triggers_state(run, &a);
    for (uint64_t k = from; k < upto; k++)
        dmn_triggers_frame(run, camera,
                           &(struct cap_frame){.id = k,
                                               .t_exposure_ns = T0 + (int64_t)k * P,
                                               .lines = lines,
                                               .lines_known = true});
    dmn_triggers_state(run, &b);
    dmn_triggers_events(run, &to);
    for (size_t i = 0; i < b.n; i++)
        n += b.item[i].fired - a.item[i].fired;
    return n;
}

T_CASE_OF_THREADS(a_line_fires_when_it_rises)
{
    struct dmn_triggers_state s;
    begin("[{ name: spark, when: line, camera: cam2, line: 33, hold_off: 0.05 }]");
    const uint64_t on = 1ull << 33;
    dmn_triggers_state(run, &s);
    T_OK(isnan(s.item[0].value));
    T_EQ_I(wire("cam2", 0, 3, on), 0); /* high from the start */
    T_EQ_I(wire("cam2", 3, 5, ~on), 0);
    T_EQ_I(wire("cam1", 5, 8, on), 0);                                 /* of another camera */
    dmn_triggers_frame(run, "cam2", &(struct cap_frame){.lines = on}); /* not reported */
    dmn_triggers_state(run, &s);
    T_OK(s.item[0].value == 0 && s.item[0].ready);
    T_EQ_I(wire("cam2", 8, 12, on), 1); /* once, also after lost frames */
    T_CONTAINS(said, "\"name\":\"spark\",\"when\":\"line\"");
    T_CONTAINS(said, "\"t_ns\":1700000000080000000");
    T_OK(strstr(said, "\"set\"") == NULL);
    dmn_triggers_state(run, &s);
    T_OK(s.item[0].value == 1 && !s.item[0].ready);
    T_EQ_I(s.latency_n, 1);
    T_EQ_I(wire("cam2", 12, 13, 0), 0); /* 0.05 s from number 8 on it is held off */
    for (int i = 0; i < 5; i++)
        T_EQ_I(burn(12, 13, 5, 3), 0); /* volumes are no matter of lines */
    T_EQ_I(wire("cam2", 12, 13, on), 0);
    T_EQ_I(wire("cam2", 13, 14, 0), 0);
    T_EQ_I(wire("cam2", 14, 20, ~0ull), 1);
    T_CONTAINS(said, "\"t_ns\":1700000000140000000");
    end();
    dmn_triggers_frame(NULL, "cam2", &(struct cap_frame){.lines_known = true});
}

T_CASE_OF_THREADS(orders_and_times)
{
    struct pvx_diag d = {""};
    int64_t t = 0;
    begin("[{ name: a, pre: 1, post: 4 }, { name: n, at: '2100-01-01T00:00:00Z' }]");
    T_EQ_I(dmn_triggers_order(run, "b", &t, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "`triggers` has a, n");
    T_EQ_I(dmn_triggers_order(run, "a", &t, &d), PVX_OK);
    T_EQ_I(dmn_triggers_order(run, NULL, &t, &d), PVX_OK);
    dmn_triggers_tick(run, cfg.triggers.item[1].at_ns - 1);
    dmn_triggers_events(run, &to);
    T_CONTAINS(said, "\"name\":\"a\"");
    T_CONTAINS(said, "\"name\":\"order\"");
    T_OK(strstr(said, "\"name\":\"n\"") == NULL);
    for (int i = 0; i < 2; i++)
        dmn_triggers_tick(run, cfg.triggers.item[1].at_ns + i);
    dmn_triggers_events(run, &to);
    T_CONTAINS(said, "\"name\":\"n\"");
    struct dmn_triggers_state s;
    dmn_triggers_state(run, &s);
    T_EQ_I(s.item[0].fired, 1);
    T_EQ_I(s.item[1].fired, 1);
    end();
    T_EQ_I(dmn_triggers_order(NULL, NULL, &t, &d), PVX_EUNSUP);
}
