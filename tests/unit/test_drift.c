/* A camera that is moved while sets come in is named, and nobody else. */
#include "recon/check/drift.h"

#include "tests/lib/scene.h"

#define CAMERAS 6
#define SIDE    64 /* pixels across */
#define ROUND   (CAMERAS * REC_DRIFT_LOOKS)

struct bed {
    struct scene s;
    struct rec_camera shot[CAMERAS]; /* where the cameras really are */
    float *picture[CAMERAS];
    rec_unseen *u;
    rec_drift *d;
    int set;
    uint64_t named; /* so far */
};

static void bed_new(struct bed *b, double off_px)
{
    const struct rec_drift_params p = REC_DRIFT_DEFAULTS;
    const struct rec_unseen_params u = {.voxels = 20, .binning = 1, .rays = 2, .margin = 1};
    memset(b, 0, sizeof *b);
    scene_new(&b->s, CAMERAS, SIDE, 20, 1, 2);
    for (size_t c = 0; c < CAMERAS; c++) {
        b->shot[c] = b->s.rig.cameras[c];
        b->shot[c].cx += off_px * t_normal();
        b->shot[c].cy += off_px * t_normal();
        b->picture[c] = pvx_calloc(SIDE * SIDE * 3 / 4, sizeof(float));
    }
    T_EQ_I(rec_unseen_new(&b->s.rig, &u, b->s.pool, &b->u, NULL), PVX_OK);
    T_EQ_I(rec_drift_new(b->u, &p, &b->d, NULL), PVX_OK);
}

static void bed_free(struct bed *b)
{
    for (size_t c = 0; c < CAMERAS; c++)
        free(b->picture[c]);
    rec_drift_free(&b->d);
    rec_unseen_free(&b->u);
    scene_free(&b->s);
}

/* n sets of a flame that moves, with noise; cameras of `missing` have no picture. */
static void play(struct bed *b, int n, double noise, uint64_t missing)
{
    static float rgb[SIDE * SIDE * 3 / 4 * 3];
    for (int k = 0; k < n; k++, b->set++) {
        const float *in[REC_MAX_CAMERAS] = {0};
        uint64_t changed;
        struct rec_flame_pose pose = scene_pose(&b->s.rig.grid, 3, 0.04 * (b->set % 60));
        for (size_t c = 0; c < CAMERAS; c++) {
            rec_flame_render(&pose, &b->shot[c], 2, 0, SIDE * 3 / 4, rgb);
            for (size_t i = 0; i < SIDE * SIDE * 3 / 4; i++)
                b->picture[c][i] = (rgb[i * 3] + rgb[i * 3 + 1] + rgb[i * 3 + 2]) / 3 +
                                   (float)(noise * t_normal());
            in[c] = (missing >> c & 1) != 0 ? NULL : b->picture[c];
        }
        T_EQ_I(rec_drift_add(b->d, in, true, &changed), PVX_OK);
        b->named |= changed;
    }
}

T_CASE(moved)
{
    struct bed b;
    bed_new(&b, 0.15);
    play(&b, 2 * ROUND, 0.005, 0);
    T_EQ_I(b.named, 0);
    b.shot[4].cx -= 1.2;
    b.shot[4].cy += 0.5;
    play(&b, 3 * ROUND, 0.005, 0);
    T_EQ_I(b.named, 1u << 4);
    const struct rec_drift_camera *k = rec_drift_of(b.d, 4);
    T_OK(k->moved);
    T_NEAR(k->since[0], -1.2, 0.3);
    T_NEAR(k->since[1], 0.5, 0.3);
    for (size_t c = 0; c < CAMERAS; c++)
        T_OK(rec_drift_of(b.d, c)->moved == (c == 4));
    /* put back, it is taken back */
    b.shot[4].cx += 1.2;
    b.shot[4].cy -= 0.5;
    play(&b, 2 * ROUND, 0.005, 0);
    T_OK(!rec_drift_of(b.d, 4)->moved);
    bed_free(&b);
}

/* One that was never where the rig says: nothing to compare it with, but far enough off. */
T_CASE(off_from_the_start)
{
    T_NOT_UNDER_SANITIZERS();
    struct bed b;
    bed_new(&b, 0);
    b.shot[1].cx += 6;
    play(&b, 3 * ROUND, 0.005, 0);
    T_EQ_I(b.named, 1u << 1);
    T_NEAR(rec_drift_of(b.d, 1)->px[0], 6, 0.8);
    bed_free(&b);
}

T_CASE(healthy)
{
    T_NOT_UNDER_SANITIZERS();
    struct bed b;
    bed_new(&b, 0.2);
    play(&b, 4 * ROUND, 0.02, 0);
    T_EQ_I(b.named, 0);
    for (size_t c = 0; c < CAMERAS; c++)
        T_OK(rec_drift_of(b.d, c)->looks >= 2 * REC_DRIFT_LOOKS);
    bed_free(&b);
}

/* A set now and then without a camera changes nothing; many make it a rig of the others. */
T_CASE(missing)
{
    struct bed b;
    bed_new(&b, 0);
    for (int k = 0; k < 2 * ROUND; k++)
        play(&b, 1, 0.005, k % 5 == 4 ? 1 : 0);
    uint64_t looks = rec_drift_of(b.d, 0)->looks;
    T_OK(looks >= REC_DRIFT_LOOKS);
    T_EQ_I(b.named, 0);
    play(&b, 2 * ROUND, 0.005, 1);
    T_EQ_I(rec_drift_of(b.d, 0)->looks, looks);
    T_OK(rec_drift_of(b.d, 1)->looks > 2 * REC_DRIFT_LOOKS);
    play(&b, 40, 0.005, 7); /* three are too few to contradict each other */
    looks = rec_drift_of(b.d, 5)->looks;
    play(&b, 20, 0.005, 7);
    T_EQ_I(rec_drift_of(b.d, 5)->looks, looks);
    bed_free(&b);
}

T_CASE(dark)
{
    struct bed b;
    const float *in[REC_MAX_CAMERAS] = {0};
    uint64_t changed;
    bed_new(&b, 0);
    for (size_t c = 0; c < CAMERAS; c++)
        in[c] = b.picture[c];
    for (int k = 0; k < 3 * ROUND; k++) {
        T_EQ_I(rec_drift_add(b.d, in, true, &changed), PVX_OK);
        T_EQ_I(changed, 0);
    }
    T_EQ_I(rec_drift_of(b.d, 0)->looks, 0);
    bed_free(&b);
}
