/* test_meant.c - the mistake in a rig that explains silhouettes: named if it is one, and never without one. */
#include "recon/check/meant.h"

#include "../t.h"

enum { N = 8, W = 160, H = 120, BIN = 2, BW = W / BIN, BH = H / BIN };

static uint8_t lit[N][BW * BH];

/* Silhouettes of three balls, no two cameras alike. */
static void shine(const struct rec_rig *r)
{
    static const double ball[][4] = {
        {0.3, -0.1, 0.2, 0.12}, {-0.3, 0.3, 0.75, 0.1}, {0.1, 0.3, 0.4, 0.08}};
    for (size_t c = 0; c < N; c++)
        for (int i = 0; i < BW * BH; i++) {
            double from[3], dir[3];
            lit[c][i] = 0;
            if (!rec_camera_ray(&r->cameras[c], BIN * (i % BW) + 0.5, BIN * (i / BW) + 0.5, from,
                                dir))
                continue;
            for (int k = 0; k < 3; k++) {
                double along = 0, square = 0;
                for (int a = 0; a < 3; a++) {
                    along += (ball[k][a] - from[a]) * dir[a];
                    square += (ball[k][a] - from[a]) * (ball[k][a] - from[a]);
                }
                lit[c][i] |= square - along * along < ball[k][3] * ball[k][3];
            }
        }
}

static void turn(size_t c, bool across, bool upside)
{
    uint8_t was[BW * BH];
    memcpy(was, lit[c], sizeof was);
    for (int i = 0; i < BW * BH; i++)
        lit[c][i] =
            was[(upside ? BH - 1 - i / BW : i / BW) * BW + (across ? BW - 1 - i % BW : i % BW)];
}

static void transpose(struct rec_camera *c, bool to_world)
{
    const struct rec_camera was = *c;
    for (int i = 0; i < 9; i++)
        c->R[i] = was.R[3 * (i % 3) + i / 3];
    if (to_world)
        rec_camera_centre(&was, c->t);
}

static const char *meant(const struct rec_rig *r)
{
    static char text[REC_MEANT_TEXT];
    const uint8_t *of[N];
    for (size_t c = 0; c < N; c++)
        of[c] = lit[c];
    T_EQ_I(rec_rig_meant(r, BIN, of, text), PVX_OK);
    return text;
}

T_CASE(names_the_mistake)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(N, 2, W, H, 24, &r), PVX_OK);
    shine(&r);
    T_EQ_S(meant(&r), "");
    turn(3, true, false);
    T_CONTAINS(meant(&r), "% if the picture of cam3 is mirrored left to right");
    turn(3, true, true);
    T_CONTAINS(meant(&r), "if the picture of cam3 is mirrored top to bottom");
    turn(3, true, false);
    T_CONTAINS(meant(&r), "if the picture of cam3 is turned by 180 degrees");
    shine(&r);
    for (size_t c = 0; c < N; c++)
        turn(c, true, false);
    T_CONTAINS(meant(&r), "if all pictures are mirrored left to right");
    shine(&r);
    uint8_t was[BW * BH];
    memcpy(was, lit[2], sizeof was);
    memcpy(lit[2], lit[5], sizeof was);
    memcpy(lit[5], was, sizeof was);
    T_CONTAINS(meant(&r), "if the pictures of cam2 and cam5 are swapped");
    shine(&r);
    for (size_t c = 0; c < N; c++)
        transpose(&r.cameras[c], false);
    T_CONTAINS(meant(&r), "if R is transposed");
    for (size_t c = 0; c < N; c++) {
        transpose(&r.cameras[c], false);
        transpose(&r.cameras[c], true);
    }
    T_CONTAINS(meant(&r), "if R and t lead from the camera to the world");
    for (size_t c = 0; c < N; c++) {
        struct rec_camera *k = &r.cameras[c];
        transpose(k, true);
        k->fx *= 2;
        k->fy *= 2;
        k->cx = 2 * k->cx + 0.5;
        k->cy = 2 * k->cy + 0.5;
    }
    T_CONTAINS(meant(&r), "K is that of pictures of twice the size");
    rec_rig_fini(&r);
}

/* One camera whose pose is written in another way, with a world in which it sees the volume nevertheless. */
T_CASE(names_the_camera_that_is_read_wrongly)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(N, 2, W, H, 24, &r), PVX_OK);
    rec_camera_look((double[3]){1.8, 0.8, 2}, (double[3]){0, 0, 0.5}, &r.cameras[2]);
    shine(&r);
    T_EQ_S(meant(&r), "");
    const struct rec_camera right = r.cameras[2];
    transpose(&r.cameras[2], true);
    T_CONTAINS(
        meant(&r),
        "% if R and t lead from the camera to the world (give R transposed and -R^T t) in cam2");
    r.cameras[2] = right;
    for (int i = 0; i < 3; i++)
        r.cameras[2].t[i] *= 100;
    T_CONTAINS(meant(&r), "% if t is in centimetres (give t / 100) in cam2");
    r.cameras[2] = right;
    r.cameras[2].fx *= 2;
    r.cameras[2].fy *= 2;
    r.cameras[2].cx = 2 * right.cx + 0.5;
    r.cameras[2].cy = 2 * right.cy + 0.5;
    T_CONTAINS(meant(&r), "% if K is that of pictures of twice the size (give K / 2) in cam2");
    rec_rig_fini(&r);
}

/* A camera that is dark, flooded, missing or moved has no such mistake. */
T_CASE(names_none_where_there_is_none)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(N, 2, W, H, 24, &r), PVX_OK);
    shine(&r);
    memset(lit[1], 0, sizeof lit[1]);
    T_EQ_S(meant(&r), "");
    memset(lit[1], 1, sizeof lit[1]);
    T_EQ_S(meant(&r), "");
    shine(&r);
    r.cameras[4].cx += 12;
    T_EQ_S(meant(&r), "");
    for (size_t c = 0; c < N; c++)
        for (int i = 0; i < BW * BH; i++) /* noise */
            lit[c][i] = (uint8_t)((unsigned)(i * 7919 + (int)c * 104729) / 64 % 5 == 0);
    T_EQ_S(meant(&r), "");
    const uint8_t *none[N] = {NULL};
    char text[REC_MEANT_TEXT];
    T_EQ_I(rec_rig_meant(&r, BIN, none, text), PVX_OK);
    T_EQ_S(text, "");
    rec_rig_fini(&r);
}
