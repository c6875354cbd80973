#include "recon/geom/camera.h"

#include "tests/lib/optics.h"
#include "tests/t.h"

/* Random rotation from a unit quaternion. */
static void rotation(double R[9])
{
    double q[4], n = 0;
    for (int i = 0; i < 4; i++) {
        q[i] = t_normal();
        n += q[i] * q[i];
    }
    n = sqrt(n);
    double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
    double m[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                   2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                   2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    memcpy(R, m, sizeof m);
}

static struct rec_camera camera(const double dist[8])
{
    struct rec_camera c = {
        .width = 640, .height = 480, .fx = 500, .fy = 503, .cx = 322.1, .cy = 236.7};
    memcpy(c.dist, dist, sizeof c.dist);
    rotation(c.R);
    for (int a = 0; a < 3; a++)
        c.t[a] = t_uniform(-3, 3);
    return c;
}

static const double lenses[][8] = {
    {0},
    {-0.05, 0.01, 5e-4, -3e-4},
    {-0.28, 0.09, 1e-3, 2e-3, -0.01},
    {0.4, -0.3, -2e-3, 1e-3, 0.2},
    {-0.35, 0.12, 0, 0, -0.02},
    {5.1, 3.2, 1e-4, -2e-4, 0.3, 5.4, 4.9, 0.9}, /* rational model with large terms, as fits give */
    {-0.2, 0.3, -1e-3, 3e-3, -0.05, 0.1, 0.05, 0.01},
};
enum { LENSES = sizeof lenses / sizeof lenses[0] };

T_CASE(project_inverts_ray)
{
    for (int l = 0; l < LENSES; l++) {
        double worst = 0;
        int lost = 0;
        for (int i = 0; i < 2000; i++) {
            struct rec_camera c = camera(lenses[l]);
            double u = t_uniform(-20, 660), v = t_uniform(-20, 500), o[3], d[3], X[3], uv[2];
            if (!rec_camera_ray(&c, u, v, o, d)) {
                lost++;
                continue;
            }
            T_NEAR(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1, 1e-14);
            double s = t_uniform(0.1, 20);
            for (int a = 0; a < 3; a++)
                X[a] = o[a] + s * d[a];
            if (!rec_camera_project(&c, X, uv)) {
                lost++;
                continue;
            }
            worst = fmax(worst, fmax(fabs(uv[0] - u), fabs(uv[1] - v)));
        }
        T_LE(worst, 1e-9);
        T_EQ_I(lost, 0);
    }
}

/* The model written out a second time, straight from the equations. */
T_CASE(project_follows_the_equations)
{
    static const double k[8] = {-0.2, 0.3, -1e-3, 3e-3, -0.05, 0.1, 0.05, 0.01};
    struct rec_camera c = camera(k);
    for (int i = 0; i < 100; i++) {
        double x = t_uniform(-0.7, 0.7), y = t_uniform(-0.6, 0.6), Z = t_uniform(0.5, 4);
        double P[3] = {x * Z - c.t[0], y * Z - c.t[1], Z - c.t[2]}, X[3], uv[2];
        for (int a = 0; a < 3; a++)
            X[a] = c.R[a] * P[0] + c.R[3 + a] * P[1] + c.R[6 + a] * P[2];
        double r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
        double s =
            (1 + k[0] * r2 + k[1] * r4 + k[4] * r6) / (1 + k[5] * r2 + k[6] * r4 + k[7] * r6);
        double xd = x * s + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x);
        double yd = y * s + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y;
        T_OK(rec_camera_project(&c, X, uv));
        T_NEAR(uv[0], c.fx * xd + c.cx, 1e-9);
        T_NEAR(uv[1], c.fy * yd + c.cy, 1e-9);
    }
}

/* What OpenCV 4.6's fisheye::projectPoints gives for K 500 503 322.1 236.7. */
T_CASE(fisheye_is_opencvs)
{
    static const double lens[3][4] = {
        {-0.02, 0.011, -0.006, 0.0012}, {0, 0, 0, 0}, {0.13, -0.04, 0.02, -0.005}};
    static const double X[5][3] = {
        {0, 0, 1}, {0.3, -0.2, 1}, {-1.1, 0.7, 0.9}, {2.5, 1.5, 0.8}, {0.001, 0.002, 3}};
    static const double want[3][5][2] = {{{322.1, 236.7},
                                          {465.740696119211, 140.364973136049},
                                          {-80.328050837386, 494.327121272443},
                                          {868.662605510324, 566.605188686032},
                                          {322.266666633951, 237.035333267509}},
                                         {{322.1, 236.7},
                                          {466.064225350546, 140.147992864901},
                                          {-85.654876220639, 497.737258031431},
                                          {880.752405898518, 573.902592200345},
                                          {322.266666635802, 237.035333271235}},
                                         {{322.1, 236.7},
                                          {468.227579979003, 138.697103027415},
                                          {-126.043290434586, 523.593186476396},
                                          {971.112261192986, 628.443800856086},
                                          {322.266666647840, 237.035333295453}}};
    for (int l = 0; l < 3; l++) {
        struct rec_camera c = {
            .fx = 500, .fy = 503, .cx = 322.1, .cy = 236.7, .model = REC_FISHEYE};
        c.R[0] = c.R[4] = c.R[8] = 1;
        memcpy(c.dist, lens[l], sizeof lens[l]);
        for (int i = 0; i < 5; i++) {
            struct rec_projection p, q;
            double o[3], d[3], e = 1e-6;
            T_OK(rec_camera_project_full(&c, X[i], &p));
            T_NEAR(p.u, want[l][i][0], 1e-9);
            T_NEAR(p.v, want[l][i][1], 1e-9);
            T_OK(rec_camera_ray(&c, want[l][i][0], want[l][i][1], o, d));
            for (int a = 0; a < 2; a++) {
                T_NEAR(d[a] / d[2], X[i][a] / X[i][2], 1e-9);
                double Y[3] = {p.x + (a == 0 ? e : 0), p.y + (a == 1 ? e : 0), 1};
                T_OK(rec_camera_project_full(&c, Y, &q));
                T_NEAR((q.u - p.u) / e, p.J[a], 1e-3);
                T_NEAR((q.v - p.v) / e, p.J[2 + a], 1e-3);
            }
        }
        /* up to 80 degrees off axis, and not beyond 90 */
        for (int i = 0; i < 1000; i++) {
            double at = t_uniform(-4, 4), T = t_uniform(0, 1.4), uv[2], o[3], d[3];
            double Y[3] = {sin(T) * cos(at), sin(T) * sin(at), cos(T)};
            T_OK(rec_camera_project(&c, Y, uv) && rec_camera_ray(&c, uv[0], uv[1], o, d));
            for (int a = 0; a < 3; a++)
                T_NEAR(d[a], Y[a], 1e-12);
        }
        double o[3], d[3], beside[3] = {1, 0, 0}, far = 500 * (1.58 + lens[l][0] * 4) + 322.1;
        T_OK(!rec_camera_project(&c, beside, o));
        T_OK(!rec_camera_ray(&c, far + 500, 236.7, o, d));
        T_OK(!rec_camera_ray(&c, 1e300, -1e300, o, d));
    }
    struct rec_camera w =
        camera(lenses[0]); /* any coefficients at all: an answer is right or absent */
    w.model = REC_FISHEYE;
    int answered = 0;
    for (int i = 0; i < 3000; i++) {
        double u = t_uniform(-400, 1000), v = t_uniform(-300, 800), o[3], d[3], Y[3], uv[2];
        for (int j = 0; j < 4; j++)
            w.dist[j] = 0.3 * t_normal();
        if (!rec_camera_ray(&w, u, v, o, d))
            continue;
        answered++;
        for (int a = 0; a < 3; a++)
            Y[a] = o[a] + d[a];
        if (!rec_camera_project(&w, Y, uv))
            continue; /* on the very edge of the domain */
        T_NEAR(uv[0], u, 1e-7);
        T_NEAR(uv[1], v, 1e-7);
    }
    T_OK(answered > 1500);
}

T_CASE(behind_is_refused)
{
    struct rec_camera c = camera(lenses[1]);
    double o[3], d[3], X[3], uv[2] = {-7, -7};
    T_OK(rec_camera_ray(&c, 320, 240, o, d));
    for (int a = 0; a < 3; a++)
        X[a] = o[a] - d[a];
    T_OK(!rec_camera_project(&c, X, uv));
    T_EQ_I(uv[0], -7); /* untouched */
    struct rec_camera id = {.fx = 1, .fy = 1, .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    double centre0[3] = {0, 0, 0}, beside[3] = {1, 1, 0};
    T_OK(!rec_camera_project(&id, centre0, uv));
    T_OK(!rec_camera_project(&id, beside, uv));
    double nan3[3] = {NAN, 0, 0}, inf3[3] = {INFINITY, 1, 1};
    T_OK(!rec_camera_project(&c, nan3, uv));
    T_OK(!rec_camera_project(&c, inf3, uv));
}

/* k1 = -0.5: r(1 - r2/2) turns at r2 = 2/3, where it reaches 0.544. */
T_CASE(fold_is_refused)
{
    struct rec_camera c = {.fx = 100, .fy = 100, .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .dist = {-0.5}};
    double turn = sqrt(2.0 / 3), uv[2], o[3], d[3];
    double in[3] = {turn * 0.999, 0, 1}, out[3] = {turn * 1.001, 0, 1}, far[3] = {0, 5, 1};
    T_OK(rec_camera_project(&c, in, uv));
    T_OK(!rec_camera_project(&c, out, uv));
    T_OK(!rec_camera_project(&c, far, uv));
    T_OK(rec_camera_ray(&c, 54.4, 0, o, d));
    T_NEAR(d[0] / d[2], turn, 0.02);
    T_LE(d[0] / d[2], turn);
    T_OK(!rec_camera_ray(&c, 54.5, 0, o, d));
    T_OK(!rec_camera_ray(&c, 40, 40, o, d));
    /* falls, then rises again: the second rising part must not be taken for the first */
    struct rec_camera w = c;
    w.dist[0] = -1;
    w.dist[1] = 0.3;
    double second[3] = {3, 0, 1};
    T_OK(!rec_camera_project(&w, second, uv));
    T_OK(!rec_camera_ray(&w, 100 * 3 * (1 - 9 + 0.3 * 81), 0, o, d));
    /* a pole of the rational model in between: 1 - r2 = 0 at r = 1 */
    struct rec_camera p = c;
    p.dist[0] = 0;
    p.dist[5] = -1;
    double before[3] = {0.9, 0, 1}, beyond[3] = {1.5, 0, 1};
    T_OK(rec_camera_project(&p, before, uv));
    T_OK(!rec_camera_project(&p, beyond, uv));
}

T_CASE(far_pixels_never_give_nan)
{
    static const double big[] = {1e3, 1e4, 1e6, 1e9, 1e15, 1e100, 1e300, INFINITY, NAN};
    int refused = 0;
    for (int l = 0; l < LENSES; l++)
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 4; j++) {
                struct rec_camera c = camera(lenses[l]);
                double o[3], d[3], u = j & 1 ? big[i] : -big[i], v = j & 2 ? big[i] : 240;
                if (!rec_camera_ray(&c, u, v, o, d)) {
                    refused++;
                    continue;
                }
                T_OK(isfinite(d[0]) && isfinite(d[1]) && isfinite(d[2]));
                T_OK(isfinite(o[0]) && isfinite(o[1]) && isfinite(o[2]));
                T_NEAR(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1, 1e-12);
            }
    T_OK(refused > 20);
}

/* Any coefficients at all: an answer is right or absent. */
T_CASE(wild_lenses)
{
    int answered = 0;
    for (int i = 0; i < 5000; i++) {
        double k[8];
        for (int j = 0; j < 8; j++)
            k[j] = t_normal() * (j == 2 || j == 3 ? 0.02 : 0.5);
        struct rec_camera c = camera(k);
        double u = t_uniform(-100, 740), v = t_uniform(-100, 580), o[3], d[3], X[3], uv[2];
        if (!rec_camera_ray(&c, u, v, o, d))
            continue;
        answered++;
        for (int a = 0; a < 3; a++)
            X[a] = o[a] + 2 * d[a];
        if (!rec_camera_project(&c, X, uv))
            continue; /* on the very edge of the domain */
        T_NEAR(uv[0], u, 1e-7);
        T_NEAR(uv[1], v, 1e-7);
    }
    T_OK(answered > 3000);
}

/* x right, y up, seen from above; from below x runs to the left. */
T_CASE(looks_straight_down_and_up)
{
    for (int side = 1; side >= -1; side -= 2) {
        const double at[3] = {0.3, -0.2, 2.0 * side}, to[3] = {0.3, -0.2, 0.1};
        const double R[9] = {side, 0, 0, 0, -1, 0, 0, 0, -side};
        struct rec_camera c = {.width = 64, .height = 48, .fx = 50, .fy = 50, .cx = 31, .cy = 23};
        double centre[3], uv[2];
        rec_camera_look(at, to, &c);
        for (int i = 0; i < 9; i++)
            T_NEAR(c.R[i], R[i], 0);
        rec_camera_centre(&c, centre);
        for (int i = 0; i < 3; i++)
            T_NEAR(centre[i], at[i], 1e-12);
        T_OK(rec_camera_sees(&c, to, uv));
        T_NEAR(uv[0], 31, 1e-9);
        const double beside[3] = {0.3 + 1.9, -0.2, 0.1}, behind[3] = {0.3, -0.2, 3.0 * side};
        T_OK(rec_camera_project(&c, beside, uv) && !rec_camera_sees(&c, beside, uv));
        T_OK(!rec_camera_sees(&c, behind, uv));
    }
}

T_CASE(centre_maps_to_origin)
{
    struct rec_camera c = camera(lenses[0]);
    double x[3];
    rec_camera_centre(&c, x);
    for (int i = 0; i < 3; i++)
        T_NEAR(c.R[3 * i] * x[0] + c.R[3 * i + 1] * x[1] + c.R[3 * i + 2] * x[2] + c.t[i], 0,
               1e-12);
}

/* ---- windows ---- */

/* Plates in front of a camera that looks along +z of its own axes from its centre, at 0.3 m and 0.5 m, turned by up to
 * `turn` rad each. */
static void glaze(struct rec_camera *c, struct optics_plate *p, int n, double turn)
{
    double o[3], first[3];
    rec_camera_centre(c, o);
    for (int i = 0; i < n; i++) {
        double a = t_uniform(-turn, turn), b = t_uniform(-turn, turn);
        double f[3] = {tan(a), tan(b), 1}, length = sqrt(optics_dot(f, f));
        struct rec_glass *w = &c->window[i];
        for (int k = 0; k < 3; k++)
            w->normal[k] = (c->R[k] * f[0] + c->R[3 + k] * f[1] + c->R[6 + k]) / length;
        if (i == 0)
            memcpy(first, w->normal, sizeof first);
        w->at = optics_dot(w->normal, o) + 0.3 + 0.6 * i;
        w->thickness = t_uniform(0.001, 0.05);
        w->index = t_uniform(1, 1.9);
        p[i] = (struct optics_plate){.at = w->at, .thickness = w->thickness, .index = w->index};
        memcpy(p[i].n, w->normal, sizeof p[i].n);
    }
    c->n_windows = n;
}

/* The ray is the one that Snell's law gives at each face, one or several plates, and project inverts it; its slopes are
 * differences. */
T_CASE(windows_refract_by_snell)
{
    double worst = 0, slope = 0;
    int lost = 0, tried = 0, moved = 0;
    for (int i = 0; i < 4000; i++) {
        struct rec_camera c = camera(lenses[i % LENSES]), bare;
        struct optics_plate plate[REC_WINDOWS];
        bare = c;
        glaze(&c, plate, 1 + i % 3, 0.6);
        double u = t_uniform(-20, 660), v = t_uniform(-20, 500), o[3], d[3], x[3], e[3], X[3],
               uv[2];
        if (!rec_camera_ray(&c, u, v, o, d)) {
            lost++;
            continue;
        }
        T_OK(rec_camera_ray(&bare, u, v, x, e));
        T_OK(optics_plates(plate, c.n_windows, x, e));
        for (int a = 0; a < 3; a++) {
            T_NEAR(e[a], d[a], 1e-14);
            x[a] -= o[a];
        }
        double along = optics_dot(x, d);
        for (int a = 0; a < 3; a++)
            T_NEAR(x[a], along * d[a], 1e-13);
        T_LE(along, 1e-12); /* it begins where it leaves the last plate, wherever plates cross */
        T_NEAR(c.n_windows == 1 ? along : 0, 0, 1e-12);
        double s = t_uniform(0.01, 5);
        for (int a = 0; a < 3; a++)
            X[a] = o[a] + s * d[a];
        tried++;
        if (!rec_camera_project(&c, X, uv)) {
            lost++;
            continue;
        }
        worst = fmax(worst, hypot(uv[0] - u, uv[1] - v));
        moved += rec_camera_project(&bare, X, x) && hypot(x[0] - u, x[1] - v) > 1;
        struct rec_projection p, q;
        double D[6];
        T_OK(rec_camera_slopes(&c, X, &p, D));
        T_OK(p.u == uv[0]);
        for (int a = 0; a < 3; a++) {
            double by = 1e-6, Y[3] = {X[0], X[1], X[2]}, u2[2], got[2], size = 0;
            for (int k = 0; k < 3; k++)
                Y[k] += by * c.R[3 * a + k];
            T_OK(rec_camera_project(&c, Y, u2));
            for (int k = 0; k < 3; k++)
                Y[k] -= 2 * by * c.R[3 * a + k];
            T_OK(rec_camera_project_full(&c, Y, &q));
            got[0] = (u2[0] - q.u) / (2 * by);
            got[1] = (u2[1] - q.v) / (2 * by);
            for (int k = 0; k < 6; k++)
                size = fmax(size, fabs(D[k]));
            slope = fmax(slope, hypot(got[0] - D[a], got[1] - D[3 + a]) / size);
        }
    }
    T_LE(worst, 1e-9);
    T_LE(slope, 1e-6);
    T_LE(lost, 0.02 * tried); /* what looks along a plate */
    T_LE(0.5 * tried, moved);
}

/* At 75 degrees through thick glass of a high index, where Newton's method has the longest way. */
T_CASE(windows_at_a_grazing_angle)
{
    struct rec_camera c = {.width = 640, .height = 480, .fx = 100, .fy = 100, .cx = 320, .cy = 240};
    c.R[0] = c.R[4] = c.R[8] = 1;
    c.n_windows = 1;
    c.window[0] = (struct rec_glass){{0, 0, 1}, 0.01, 0.2, 2.4};
    for (int i = 0; i < 2000; i++) {
        double u = t_uniform(-60, 700), v = t_uniform(-60, 540), o[3], d[3], uv[2];
        T_OK(rec_camera_ray(&c, u, v, o, d));
        double s = i % 2 == 0 ? 0 : t_uniform(0, 0.1); /* also on the face itself */
        for (int a = 0; a < 3; a++)
            o[a] += s * d[a];
        o[2] = fmax(o[2], 0.21);
        T_OK(rec_camera_project(&c, o, uv));
        T_NEAR(uv[0], u, 1e-9);
        T_NEAR(uv[1], v, 1e-9);
    }
    double in[3] = {0, 0, 0.1}, before[3] = {0, 0, 0.005}, uv[2], o[3], d[3];
    T_OK(!rec_camera_project(&c, in, uv)); /* in the glass, and before it */
    T_OK(!rec_camera_project(&c, before, uv));
    c.window[0].normal[2] = -1; /* glass behind the camera */
    T_OK(!rec_camera_ray(&c, 320, 240, o, d));
    T_OK(!rec_camera_project(&c, in, uv));
}

/* Index 1 is air: the same bits but for the origin of rays. */
T_CASE(windows_of_air_change_nothing)
{
    for (int i = 0; i < 200; i++) {
        struct rec_camera c = camera(lenses[i % LENSES]), bare = c;
        struct optics_plate plate[REC_WINDOWS];
        double X[3], uv[2], o[3], d[3];
        glaze(&c, plate, 2, 0.3);
        c.window[0].index = c.window[1].index = 1;
        T_OK(rec_camera_ray(&c, t_uniform(0, 640), t_uniform(0, 480), o, d));
        for (int a = 0; a < 3; a++)
            X[a] = o[a] + 2 * d[a];
        T_OK(rec_camera_project(&c, X, uv));
        T_OK(rec_camera_project(&bare, X, o));
        T_NEAR(uv[0], o[0], 1e-9);
        T_NEAR(uv[1], o[1], 1e-9);
    }
}

/* ---- Scheimpflug and telecentric ---- */

/* The sensor as a plane in space behind OpenCV's formula: turned by R_y R_x about the point at distance 1 on the axis,
 * and scaled along the axis so that its middle keeps the focal length.  A ray meets it; no homography is written. */
static void on_sensor(double tx, double ty, const double p[2], double out[2])
{
    double cx = cos(tx), sx = sin(tx), cy = cos(ty), sy = sin(ty);
    const double right[3] = {cy, sy * sx, -sy * cx}, down[3] = {0, cx, sx}; /* rows of R_y R_x */
    const double out_of[3] = {sy, -cy * sx, cy * cx};
    /* the plane out_of . x = cy cx goes through (0,0,1); in its own axes the ray hits at (r.x, d.x) */
    double x[3] = {p[0], p[1], 1}, s = cy * cx / optics_dot(out_of, x), zero[3] = {0, 0, 1};
    for (int a = 0; a < 3; a++)
        x[a] = s * x[a] - zero[a];
    out[0] = optics_dot(right, x);
    out[1] = optics_dot(down, x);
}

T_CASE(scheimpflug_is_a_tilted_plane)
{
    double worst = 0, slope = 0;
    for (int i = 0; i < 3000; i++) {
        struct rec_camera c = camera(lenses[i % LENSES]), flat = c;
        double u = t_uniform(0, 640), v = t_uniform(0, 480), o[3], d[3], X[3], p[2], want[2];
        c.model = REC_SCHEIMPFLUG;
        c.tilt[0] = t_uniform(-0.2, 0.2);
        c.tilt[1] = t_uniform(-0.2, 0.2);
        T_OK(rec_camera_ray(&flat, u, v, o, d)); /* what the flat sensor sees at (u,v) */
        for (int a = 0; a < 3; a++)
            X[a] = o[a] + 1.7 * d[a];
        p[0] = (u - c.cx) / c.fx;
        p[1] = (v - c.cy) / c.fy;
        on_sensor(c.tilt[0], c.tilt[1], p, want);
        struct rec_projection q, r;
        double D[6], e[3];
        T_OK(rec_camera_slopes(&c, X, &q, D));
        T_NEAR(q.u, c.fx * want[0] + c.cx, 1e-8);
        T_NEAR(q.v, c.fy * want[1] + c.cy, 1e-8);
        T_OK(rec_camera_ray(&c, q.u, q.v, o, e));
        worst = fmax(worst, fmax(fabs(e[0] - d[0]), fmax(fabs(e[1] - d[1]), fabs(e[2] - d[2]))));
        for (int a = 0; a < 3; a++) {
            double by = 1e-7, Y[3];
            for (int k = 0; k < 3; k++)
                Y[k] = X[k] + by * c.R[3 * a + k];
            T_OK(rec_camera_project_full(&c, Y, &r));
            slope = fmax(slope, hypot((r.u - q.u) / by - D[a], (r.v - q.v) / by - D[3 + a]));
        }
    }
    T_LE(worst, 1e-11);
    T_LE(slope, 0.02); /* of some 300 px/m */
}

/* What OpenCV 4.6's projectPoints gives for this K and these 14 numbers. */
T_CASE(scheimpflug_is_opencvs)
{
    static const double X[5][3] = {
        {0, 0, 1}, {0.3, -0.2, 1}, {-0.4, 0.3, 0.9}, {0.2, 0.35, 0.8}, {0.001, 0.002, 3}};
    static const double want[5][2] = {{322.100000000000, 236.700000000000},
                                      {467.934726230527, 140.251063886346},
                                      {114.119288890636, 392.077667742175},
                                      {450.860765025867, 465.461510763052},
                                      {322.267365680710, 237.040821197083}};
    static const double k[8] = {-0.2, 0.3, -1e-3, 3e-3, -0.05, 0.1, 0.05, 0.01};
    struct rec_camera c = {.fx = 500,
                           .fy = 503,
                           .cx = 322.1,
                           .cy = 236.7,
                           .model = REC_SCHEIMPFLUG,
                           .tilt = {0.14, -0.09}};
    c.R[0] = c.R[4] = c.R[8] = 1;
    memcpy(c.dist, k, sizeof k);
    for (int i = 0; i < 5; i++) {
        double uv[2];
        T_OK(rec_camera_project(&c, X[i], uv));
        T_NEAR(uv[0], want[i][0], 1e-9);
        T_NEAR(uv[1], want[i][1], 1e-9);
    }
}

T_CASE(telecentric_rays_are_parallel)
{
    for (int i = 0; i < 300; i++) {
        struct rec_camera c = camera(lenses[0]);
        struct optics_plate plate[REC_WINDOWS];
        c.model = REC_TELECENTRIC;
        if (i % 2 == 1)
            glaze(&c, plate, 1 + i / 2 % 2, 0.6);
        double u = t_uniform(0, 640), v = t_uniform(0, 480), o[3], d[3], X[3], uv[2], D[6];
        struct rec_projection p;
        T_OK(rec_camera_ray(&c, u, v, o, d));
        for (int a = 0; a < 3; a++) {
            T_NEAR(d[a], c.R[6 + a], 1e-15);
            X[a] = o[a] + 2 * d[a];
        }
        T_OK(rec_camera_slopes(&c, X, &p, D));
        T_NEAR(p.u, u, 1e-9);
        T_NEAR(p.v, v, 1e-9);
        T_NEAR(D[0], c.fx, 1e-9);
        T_NEAR(D[4], c.fy, 1e-9);
        T_NEAR(fabs(D[1]) + fabs(D[2]) + fabs(D[3]) + fabs(D[5]), 0, 1e-9);
        T_OK(rec_camera_depth(&c, X) == 1);
        for (int a = 0; a < 3; a++)
            X[a] -= 9 * d[a];
        T_OK(!rec_camera_project(&c, X, uv)); /* behind it */
    }
}
