/* test_blind.c - cameras that do not see the volume: the wrong reading of their poses is found, and no right rig is
 * accused. */
#include "recon/geom/blind.h"

#include "../t.h"

/* A right rig: the volume does not lie at the world's origin, so that every wrong reading loses it. */
static void ring(size_t n, double radius, struct rec_rig *r)
{
    static const double by[3] = {0.7, -0.4, 0.6};
    T_EQ_I(rec_rig_ring(n, radius, 640, 480, 16, r), PVX_OK);
    for (size_t c = 0; c < n; c++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                r->cameras[c].t[i] -= r->cameras[c].R[3 * i + j] * by[j];
    for (int a = 0; a < 3; a++) {
        r->grid.min[a] += by[a];
        r->grid.max[a] += by[a];
    }
}

/* The pose as another program would write it. */
static void write_as(struct rec_camera *c, bool to_world, bool place, bool opengl, double unit)
{
    const struct rec_camera was = *c;
    rec_camera_centre(&was, place || to_world ? c->t : (double[3]){0});
    for (int i = 0; i < 9 && to_world; i++) /* a column of R per axis of the camera */
        c->R[i] = was.R[3 * (i % 3) + i / 3] * (opengl && i % 3 > 0 ? -1 : 1);
    for (int i = 3; i < 9 && !to_world && opengl; i++)
        c->R[i] = -was.R[i];
    for (int i = 1; i < 3 && !to_world && !place && opengl; i++)
        c->t[i] = -was.t[i];
    for (int i = 0; i < 3; i++)
        c->t[i] *= unit;
}

static enum rec_blind seen(const struct rec_rig *r, char text[1000])
{
    enum rec_blind b = rec_rig_blind(r, text, 1000);
    T_EQ_I(strlen(text) == 0, b == REC_BLIND_NONE);
    return b;
}

static const struct {
    bool to_world, place, opengl;
    double unit;
    const char *say[3];
} cases[] = {
    {true, false, false, 1, {"from the camera to the world"}},
    {false, true, false, 1, {"t is the camera's place"}},
    {false, false, true, 1, {"OpenGL"}},
    {true, false, true, 1, {"from the camera to the world", "OpenGL"}},
    {false, true, true, 1, {"t is the camera's place", "OpenGL"}},
    {false, false, false, 1000, {"t is in millimetres"}},
    {false, false, false, 100, {"t is in centimetres"}},
    {false, false, false, 1e-3, {"the volume is in millimetres"}},
    {true, false, false, 1000, {"from the camera to the world", "t is in millimetres"}},
    {false, true, false, 1000, {"t is the camera's place", "t is in millimetres"}},
    {true, false, true, 1000, {"from the camera to the world", "OpenGL", "t is in millimetres"}},
};

T_CASE(finds_the_reading)
{
    char text[1000];
    struct rec_rig r;
    for (size_t n = 3; n <= 9; n += 3)
        for (double radius = 2.5; radius < 9; radius *= 1.7)
            for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
                ring(n, radius, &r);
                T_EQ_I(seen(&r, text), REC_BLIND_NONE);
                for (size_t c = 0; c < n; c++)
                    write_as(&r.cameras[c], cases[k].to_world, cases[k].place, cases[k].opengl,
                             cases[k].unit);
                T_OK(seen(&r, text) != REC_BLIND_NONE);
                T_CONTAINS(text, "would see it if ");
                int said = 0;
                for (int i = 0; i < 3 && cases[k].say[i] != NULL; i++, said++)
                    T_CONTAINS(text, cases[k].say[i]);
                int parts = 0; /* no other reading beside them */
                for (const char *p = text; (p = strstr(p, " (give ")) != NULL; p++)
                    parts++;
                for (const char *p = text; (p = strstr(p, " (change ")) != NULL; p++)
                    parts++;
                T_EQ_I(parts, said);
                rec_rig_fini(&r);
            }
}

/* Turned about y instead of x: the same rig but for pictures that are turned by 180 degrees. */
T_CASE(cameras_that_look_away)
{
    char text[1000];
    struct rec_rig r;
    ring(6, 3, &r);
    for (size_t c = 0; c < 6; c++) {
        struct rec_camera *k = &r.cameras[c];
        for (int i = 0; i < 3; i++) {
            k->R[i] = -k->R[i];
            k->R[6 + i] = -k->R[6 + i];
        }
        k->t[0] = -k->t[0];
        k->t[2] = -k->t[2];
    }
    T_EQ_I(seen(&r, text), REC_BLIND_ALL);
    T_CONTAINS(text,
               "OpenGL's (change the signs of rows 2 and 3 of R and t), or it looks away from the "
               "flame (those of rows 1 and 3)");
    rec_rig_fini(&r);
}

T_CASE(names_width_and_height_that_are_swapped)
{
    char text[1000];
    struct rec_rig r;
    ring(4, 3, &r);
    const int32_t w = r.cameras[0].width, h = r.cameras[0].height;
    T_OK(w != h);
    for (size_t c = 0; c < 4; c++) {
        r.cameras[c].width = h;
        r.cameras[c].height = w;
    }
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "only if width and height are swapped (give size: [");
    r.cameras[2].width = w;
    r.cameras[2].height = h;
    T_OK(strstr((seen(&r, text), text), "swapped") == NULL);
    rec_rig_fini(&r);
}

T_CASE(names_one_camera)
{
    char text[1000];
    struct rec_rig r;
    ring(8, 3, &r);
    write_as(&r.cameras[5], true, false, false, 1);
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "cam5: ");
    T_CONTAINS(text, "1 of 1 would see it if R and t lead from the camera to the world");
    T_OK(strstr(text, "cam4") == NULL);
    rec_rig_fini(&r);
    ring(8, 2, &r);
    for (int i = 0; i < 3; i++) /* into the middle of the volume */
        r.cameras[2].t[i] = -(r.cameras[2].R[3 * i] * 0.7 - r.cameras[2].R[3 * i + 1] * 0.4 +
                              r.cameras[2].R[3 * i + 2] * 1.1);
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "cam2: it stands inside the volume");
    rec_rig_fini(&r);
    ring(8, 2, &r);
    r.cameras[7].cx = -3000;
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "cam7: the volume is not in its picture; check R, t, K");
    rec_rig_fini(&r);
}

/* From above, either way of writing a pose shows some of a volume near the origin. */
T_CASE(names_a_camera_that_looks_beside)
{
    char text[1000];
    const double above[3] = {1.8, 0.8, 2};
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(4, 2, 640, 480, 16, &r), PVX_OK);
    rec_camera_look(above, (double[3]){0, 0, 0.5}, &r.cameras[2]);
    T_EQ_I(seen(&r, text), REC_BLIND_NONE);
    write_as(&r.cameras[2], true, false, false, 1);
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text,
               "cam2 sees only 29 % of the volume, beside the middle of its picture; it would "
               "see 100 % if R and t lead from the camera to the world");
    write_as(&r.cameras[2], true, false, false, 1);
    for (double up = 0.5; up < 2; up += 0.1) { /* aimed higher and higher */
        rec_camera_look(above, (double[3]){0, 0, up}, &r.cameras[2]);
        T_EQ_I(seen(&r, text), REC_BLIND_NONE);
    }
    for (size_t c = 0; c < 4; c++) /* in a line, side by side */
        rec_camera_look((double[3]){3, (double)c - 1.5, 0.5}, (double[3]){0, (double)c - 1.5, 0.5},
                        &r.cameras[c]);
    T_EQ_I(seen(&r, text), REC_BLIND_NONE);
    rec_rig_fini(&r);
}

T_CASE(knows_a_lens_of_another_picture)
{
    char text[1000];
    struct rec_rig r;
    ring(8, 2, &r);
    for (size_t c = 0; c < 8; c++) {
        struct rec_camera *k = &r.cameras[c];
        k->fx *= 2;
        k->fy *= 2;
        k->cx = 2 * k->cx + 0.5;
        k->cy = 2 * k->cy + 0.5;
    }
    T_OK(seen(&r, text) != REC_BLIND_NONE);
    T_CONTAINS(text, "K is that of pictures of twice the size");
    for (size_t c = 0; c < 8; c++) {
        struct rec_camera *k = &r.cameras[c];
        k->fx *= 0.25;
        k->fy *= 0.25;
        k->cx = 0.25 * k->cx - 0.375;
        k->cy = 0.25 * k->cy - 0.375;
    }
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "K is that of pictures of half the size");
    r.cameras[3].cx = 320; /* pictures cut alike are no fault of the lens */
    T_EQ_I(seen(&r, text), REC_BLIND_NONE);
    rec_rig_fini(&r);
}

/* Cameras that look at a part of the volume, far away or from the side, are no fault. */
T_CASE(accuses_no_right_rig)
{
    char text[1000];
    struct rec_rig r;
    for (double zoom = 0.15; zoom < 9; zoom *= 1.5)
        for (size_t n = 1; n <= 10; n += 3) {
            ring(n, 3, &r);
            for (size_t c = 0; c < n; c++) {
                r.cameras[c].fx *= zoom;
                r.cameras[c].fy *= zoom;
                r.cameras[c].cx += 0.2 * 640;
            }
            T_EQ_I(seen(&r, text), REC_BLIND_NONE);
            rec_rig_fini(&r);
        }
    T_EQ_I(rec_rig_ring(6, 2, 640, 480, 16, &r), PVX_OK);
    for (int a = 0; a < 3; a++) { /* a room with the cameras in it */
        r.grid.min[a] -= 4;
        r.grid.max[a] += 5;
    }
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "cam5: it stands inside the volume; check R, t, K");
    rec_rig_fini(&r);
    T_EQ_I(rec_rig_ring(4, 2, 640, 480, 16, &r), PVX_OK);
    for (size_t c = 0; c < 4;
         c++) /* all near the middle of a room: they see it, whatever its unit */
        for (int i = 0; i < 3; i++)
            r.cameras[c].t[i] *= 0.25;
    for (int a = 0; a < 3; a++) {
        r.grid.min[a] = -5;
        r.grid.max[a] = 5;
    }
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "it stands inside the volume");
    rec_rig_fini(&r);
    ring(8, 3, &r);
    for (size_t c = 0; c < 8; c++) { /* some 20 pixels of 1080: little, but seen */
        r.cameras[c].width = 1920;
        r.cameras[c].height = 1080;
        r.cameras[c].cx = 959.5;
        r.cameras[c].cy = 539.5;
        r.cameras[c].fx = r.cameras[c].fy = 15 * 3 / (r.grid.max[0] - r.grid.min[0]);
    }
    T_EQ_I(seen(&r, text), REC_BLIND_SOME);
    T_CONTAINS(text, "less than 3 % of its picture; check R, t, K");
    rec_rig_fini(&r);
    ring(8, 3, &r);
    for (size_t c = 0; c < 8; c++) { /* a thirtieth of the volume fills the picture */
        r.cameras[c].fx = r.cameras[c].fy = 480 * 3 * 30 / (r.grid.max[0] - r.grid.min[0]);
        r.cameras[c].cx = 319.5;
        r.cameras[c].cy = 239.5;
    }
    T_EQ_I(seen(&r, text), REC_BLIND_NONE);
    for (size_t c = 0; c < 8;
         c++) { /* cut from the left of larger pictures, the volume in the middle */
        r.cameras[c].fx = r.cameras[c].fy = 100;
        r.cameras[c].cx = 640;
        r.cameras[c].cy = 480;
        for (int i = 0; i < 2; i++)
            r.cameras[c].t[i] -= (i == 0 ? 3.2 : 2.4) * 3;
    }
    T_EQ_I(seen(&r, text), REC_BLIND_NONE);
    rec_rig_fini(&r);
    ring(8, 3, &r);
    char little[20];
    r.cameras[0].t[2] = -3;
    T_OK(rec_rig_blind(&r, little, sizeof little) != REC_BLIND_NONE); /* cut, never past the end */
    T_OK(strlen(little) < sizeof little);
    rec_rig_fini(&r);
}
