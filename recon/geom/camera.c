#include "recon/geom/camera.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "recon/geom/glass.h"
#include "recon/geom/ray_table.h"

const char *rec_camera_model_name(enum rec_camera_model m)
{
    static const char *const names[] = {"pinhole", "fisheye", "scheimpflug", "telecentric", "rays"};
    return names[m];
}

enum { K1, K2, P1, P2, K3, K4, K5, K6 };

/* Whether the polynomial sum a[i] t^i is above 0 on all of [0,t].  A bound from the negative terms alone decides
 * nearly every point.  Otherwise the Bernstein coefficients decide: all positive proves it, a value <= 0 at an end
 * refutes it, else the interval is halved.  A root of even order (the curve touches zero) counts as not positive,
 * which is what a turning point needs. */
static bool bernstein_positive(const double *b, int n, int depth)
{
    bool all = true;
    for (int i = 0; i <= n; i++)
        all = all && b[i] > 0;
    if (all)
        return true;
    if (!(b[0] > 0) || !(b[n] > 0) || depth == 0)
        return false;
    double left[8], right[8]; /* de Casteljau at 1/2 */
    memcpy(right, b, (size_t)(n + 1) * sizeof *b);
    for (int k = 0; k <= n; k++) {
        left[k] = right[0];
        for (int i = 0; i < n - k; i++)
            right[i] = 0.5 * (right[i] + right[i + 1]);
    }
    /* after the loop right[i] holds the i-th coefficient of the right half */
    return bernstein_positive(left, n, depth - 1) && bernstein_positive(right, n, depth - 1);
}

static bool positive_up_to(const double *a, int n, double t)
{
    double low = a[0], p = 1;
    for (int i = 1; i <= n; i++) {
        p *= t;
        if (a[i] < 0)
            low += a[i] * p;
    }
    if (low > 0)
        return true;
    static const double binom[7][7] = {
        {1},
        {1, 1},
        {1, 2, 1},
        {1, 3, 3, 1},
        {1, 4, 6, 4, 1},
        {1, 5, 10, 10, 5, 1},
        {1, 6, 15, 20, 15, 6, 1},
    };
    double s[7], b[8];
    p = 1;
    for (int i = 0; i <= n; i++, p *= t)
        s[i] = a[i] * p; /* in units of [0,1] */
    for (int j = 0; j <= n; j++) {
        b[j] = 0;
        for (int i = 0; i <= j; i++)
            b[j] += binom[j][i] / binom[n][i] * s[i];
    }
    return bernstein_positive(b, n, 40);
}

/* Whether T_d of (5) rises all the way from 0 to T. */
static bool fisheye_rises(const struct rec_camera *c, double T)
{
    const double *k = c->dist, g[5] = {1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]};
    return positive_up_to(g, 4, T * T);
}

/* Whether r c(r2) of (2), or T_d of (5), rises all the way from 0 to r.  With N, D numerator and denominator in t = r2,
 * d(r c)/dr = (N D + 2 t (N' D - N D')) / D^2; both that numerator and D must stay positive. */
static bool before_fold(const struct rec_camera *c, double t)
{
    const double *k = c->dist;
    if (c->model == REC_FISHEYE)
        return fisheye_rises(c, atan(sqrt(t)));
    double N[4] = {1, k[K1], k[K2], k[K3]}, D[4] = {1, k[K4], k[K5], k[K6]};
    if (k[K4] == 0 && k[K5] == 0 && k[K6] == 0) {
        double g[4] = {1, 3 * k[K1], 5 * k[K2], 7 * k[K3]};
        return positive_up_to(g, 3, t);
    }
    double g[7] = {0};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            g[i + j] += (1 + 2 * (i - j)) * N[i] * D[j];
    return positive_up_to(D, 3, t) && positive_up_to(g, 6, t);
}

/* T_d of (5) and its derivative. */
static double fisheye_angle(const struct rec_camera *c, double T, double *slope)
{
    const double *k = c->dist;
    double t = T * T;
    *slope = 1 + t * (3 * k[0] + t * (5 * k[1] + t * (7 * k[2] + t * 9 * k[3])));
    return T * (1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
}

/* (5) and its Jacobian. */
static void fisheye(const struct rec_camera *c, double x, double y, double out[2], double J[4])
{
    double r2 = x * x + y * y, r = sqrt(r2), slope;
    double s = 1,
           ds = 2 * (c->dist[0] - 1.0 / 3); /* T_d / r and its derivative over r, both at 0 */
    if (r > 1e-7) {
        s = fisheye_angle(c, atan(r), &slope) / r;
        ds = (slope / (1 + r2) - s) / r2;
    }
    out[0] = s * x;
    out[1] = s * y;
    J[0] = s + ds * x * x;
    J[1] = J[2] = ds * x * y;
    J[3] = s + ds * y * y;
}

/* (2), (3) and the Jacobian J = d(x',y')/d(x,y), row major. */
static void distort(const struct rec_camera *c, double x, double y, double out[2], double J[4])
{
    const double *k = c->dist;
    double r2 = x * x + y * y;
    double N = 1 + r2 * (k[K1] + r2 * (k[K2] + r2 * k[K3]));
    double D = 1 + r2 * (k[K4] + r2 * (k[K5] + r2 * k[K6]));
    double dN = k[K1] + r2 * (2 * k[K2] + r2 * 3 * k[K3]);
    double dD = k[K4] + r2 * (2 * k[K5] + r2 * 3 * k[K6]);
    double over = D == 1 ? 1 : 1 / D; /* no division for the lenses that have no denominator */
    double s = N * over, ds = 2 * (dN - s * dD) * over; /* c and 2 dc/dr2 */
    out[0] = s * x + 2 * k[P1] * x * y + k[P2] * (r2 + 2 * x * x);
    out[1] = s * y + k[P1] * (r2 + 2 * y * y) + 2 * k[P2] * x * y;
    J[0] = s + ds * x * x + 2 * k[P1] * y + 6 * k[P2] * x;
    J[1] = ds * x * y + 2 * k[P1] * x + 2 * k[P2] * y;
    J[2] = J[1];
    J[3] = s + ds * y * y + 6 * k[P1] * y + 2 * k[P2] * x;
}

/* M of (6), rows that give the sensor's (x',y') times c, and c. */
static void tilt_rows(const struct rec_camera *c, double H[9])
{
    double cx = cos(c->tilt[0]), sx = sin(c->tilt[0]), cy = cos(c->tilt[1]), sy = sin(c->tilt[1]);
    const double M[9] = {cy, sy * sx, -sy * cx, 0, cx, sx, sy, -cy * sx, cy * cx};
    for (int i = 0; i < 3; i++) {
        H[i] = M[8] * M[i] - M[2] * M[6 + i];
        H[3 + i] = M[8] * M[3 + i] - M[5] * M[6 + i];
        H[6 + i] = M[6 + i];
    }
}

/* (6) applied to p; J = d(x',y')/d(x,y) goes with it.  False: p is beside the sensor's plane. */
static bool tilt(const struct rec_camera *c, double p[2], double J[4])
{
    double H[9], q[3], A[4], K[4];
    tilt_rows(c, H);
    for (int i = 0; i < 3; i++)
        q[i] = H[3 * i] * p[0] + H[3 * i + 1] * p[1] + H[3 * i + 2];
    if (!(q[2] > 1e-9))
        return false;
    for (int i = 0; i < 2; i++) {
        p[i] = q[i] / q[2];
        for (int j = 0; j < 2; j++)
            A[2 * i + j] = (H[3 * i + j] - p[i] * H[6 + j]) / q[2];
    }
    memcpy(K, J, sizeof K);
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            J[2 * i + j] = A[2 * i] * K[j] + A[2 * i + 1] * K[2 + j];
    return true;
}

/* (6) undone, by the adjugate of its homography. */
static bool untilt(const struct rec_camera *c, double *x, double *y)
{
    double H[9], q[3], p[3] = {*x, *y, 1};
    tilt_rows(c, H);
    for (int i = 0; i < 3; i++) {
        q[i] = 0;
        for (int j = 0; j < 3; j++) { /* cofactor of H_ji */
            int r = (j + 1) % 3, s = (j + 2) % 3, k = (i + 1) % 3, l = (i + 2) % 3;
            q[i] += (H[3 * r + k] * H[3 * s + l] - H[3 * r + l] * H[3 * s + k]) * p[j];
        }
    }
    *x = q[0] / q[2];
    *y = q[1] / q[2];
    return isfinite(*x) && isfinite(*y) &&
           H[6] * *x + H[7] * *y + H[8] > 1e-9; /* on the side that looks at the flame */
}

static bool has_distortion(const struct rec_camera *c)
{
    for (int i = 0; i < 8; i++)
        if (c->dist[i] != 0)
            return true;
    return c->model == REC_FISHEYE || c->model == REC_SCHEIMPFLUG;
}

/* The lens model is one-to-one from the axis out to (x,y). */
static bool in_domain(const struct rec_camera *c, double x, double y, const double J[4])
{
    return J[0] * J[3] - J[1] * J[2] > 0 && before_fold(c, x * x + y * y);
}

bool rec_camera_project_full(const struct rec_camera *c, const double X[3],
                             struct rec_projection *out)
{
    const double *R = c->R;
    double P[3];
    if (c->n_windows > 0) {
        if (!rec_glass_apparent(c, X, P))
            return false;
        X = P;
    }
    double Xc = R[0] * X[0] + R[1] * X[1] + R[2] * X[2] + c->t[0];
    double Yc = R[3] * X[0] + R[4] * X[1] + R[5] * X[2] + c->t[1];
    double Zc = R[6] * X[0] + R[7] * X[1] + R[8] * X[2] + c->t[2];
    if (!(Zc > 0))
        return false;
    double x = Xc / Zc, y = Yc / Zc, p[2] = {x, y}, J[4] = {1, 0, 0, 1};
    if (c->model == REC_TELECENTRIC) {
        x = p[0] = Xc;
        y = p[1] = Yc;
    } else if (c->model == REC_RAYS) {
        if (!rec_ray_table_find(c->table, (const double[3]){Xc, Yc, Zc}, p))
            return false;
        x = p[0];
        y = p[1];
    } else if (has_distortion(c)) {
        if (c->model == REC_FISHEYE)
            fisheye(c, x, y, p, J);
        else
            distort(c, x, y, p, J);
        if (!in_domain(c, x, y, J) || (c->model == REC_SCHEIMPFLUG && !tilt(c, p, J)))
            return false;
    }
    double u = c->fx * p[0] + c->cx, v = c->fy * p[1] + c->cy;
    if (!isfinite(u) || !isfinite(v))
        return false;
    *out = (struct rec_projection){
        x, y, u, v, {c->fx * J[0], c->fx * J[1], c->fy * J[2], c->fy * J[3]}};
    return true;
}

/* The point stays on the ray of (x,y): M d(x,y) = dX - slope dZ. */
static bool table_slopes(const struct rec_camera *c, const double X[3],
                         const struct rec_projection *p, double D[6])
{
    double line[4], s[8], M[4], Z = c->R[6] * X[0] + c->R[7] * X[1] + c->R[8] * X[2] + c->t[2];
    if (!rec_ray_table_at(c->table, p->x, p->y, line, s))
        return false;
    for (int i = 0; i < 4; i++)
        M[i] = s[i] + s[4 + i] * Z;
    double over = 1 / (M[0] * M[3] - M[1] * M[2]);
    const double B[4] = {c->fx * M[3] * over, -c->fx * M[1] * over, -c->fy * M[2] * over,
                         c->fy * M[0] * over};
    for (int r = 0; r < 2; r++) {
        D[3 * r] = B[2 * r];
        D[3 * r + 1] = B[2 * r + 1];
        D[3 * r + 2] = -(B[2 * r] * line[2] + B[2 * r + 1] * line[3]);
    }
    return isfinite(over);
}

bool rec_camera_slopes(const struct rec_camera *c, const double X[3], struct rec_projection *out,
                       double D[6])
{
    double P[3] = {X[0], X[1], X[2]};
    if (!rec_camera_project_full(c, X, out) || (c->n_windows > 0 && !rec_glass_apparent(c, X, P)))
        return false;
    const double *J = out->J;
    if (c->model == REC_RAYS)
        return table_slopes(c, X, out, D);
    double Z = c->R[6] * P[0] + c->R[7] * P[1] + c->R[8] * P[2] + c->t[2];
    for (int r = 0; r < 2; r++) {
        double a = J[2 * r] / Z, b = J[2 * r + 1] / Z, *g = D + 3 * r;
        g[0] = a;
        g[1] = b;
        g[2] = -(a * out->x + b * out->y);
        if (c->model == REC_TELECENTRIC) {
            g[0] = J[2 * r];
            g[1] = J[2 * r + 1];
            g[2] = 0;
        }
    }
    return c->n_windows == 0 || c->model == REC_TELECENTRIC || rec_glass_slopes(c, P, D);
}

bool rec_camera_project(const struct rec_camera *c, const double X[3], double uv[2])
{
    struct rec_projection p;
    if (!rec_camera_project_full(c, X, &p))
        return false;
    uv[0] = p.u;
    uv[1] = p.v;
    return true;
}

bool rec_camera_sees(const struct rec_camera *c, const double X[3], double uv[2])
{
    return rec_camera_project(c, X, uv) && uv[0] > -0.5 && uv[0] < c->width - 0.5 && uv[1] > -0.5 &&
           uv[1] < c->height - 0.5;
}

static double px_norm(const struct rec_camera *c, double x, double y)
{
    x *= c->fx;
    y *= c->fy;
    return sqrt(x * x + y * y);
}

/* Newton from *x,*y towards distort(x,y) = want, halving steps that do not help.  True when the
 * residual is below 1e-10 px (or at rounding for huge pixel coordinates) and inside the domain. */
static bool newton(const struct rec_camera *c, const double want[2], double *px, double *py)
{
    double x = *px, y = *py, got[2], J[4];
    distort(c, x, y, got, J);
    double ex = want[0] - got[0], ey = want[1] - got[1], err = px_norm(c, ex, ey);
    double tol = 1e-10 + 8 * DBL_EPSILON * px_norm(c, want[0], want[1]);
    for (int it = 0; it < 50 && !(err <= 0.01 * tol); it++) {
        double det = J[0] * J[3] - J[1] * J[2];
        if (!(fabs(det) > 1e-14))
            return false;
        double over = 1 / det, best = err, step = 1;
        double dx = (J[3] * ex - J[1] * ey) * over, dy = (J[0] * ey - J[2] * ex) * over;
        for (int half = 0; half < 20; half++, step *= 0.5) {
            double tx = x + step * dx, ty = y + step * dy;
            distort(c, tx, ty, got, J);
            double fx = want[0] - got[0], fy = want[1] - got[1];
            err = px_norm(c, fx, fy);
            if (err < best) {
                x = tx;
                y = ty;
                ex = fx;
                ey = fy;
                break;
            }
        }
        if (!(err < best)) { /* at rounding, or stuck */
            err = best;
            distort(c, x, y, got, J);
            break;
        }
    }
    *px = x;
    *py = y;
    return err <= tol && in_domain(c, x, y, J);
}

/* At radius r the radial model (2) has reached rd, or has already turned back. */
static bool radially_beyond(const struct rec_camera *c, double r, double rd)
{
    const double *k = c->dist;
    double t = r * r;
    double s =
        (1 + t * (k[K1] + t * (k[K2] + t * k[K3]))) / (1 + t * (k[K4] + t * (k[K5] + t * k[K6])));
    return r * s >= rd || !before_fold(c, t);
}

/* The radius that (2) maps to rd, or the turning point when it does not reach so far: a start for
 * Newton that cannot lie on the wrong branch. */
static double radial_inverse(const struct rec_camera *c, double rd)
{
    double lo = 0, hi = rd;
    for (int i = 0; i < 60 && !radially_beyond(c, hi, rd); i++) {
        lo = hi;
        hi *= 2;
    }
    for (int i = 0; i < 100 && hi - lo > 4 * DBL_EPSILON * hi; i++) {
        double mid = 0.5 * (lo + hi);
        if (radially_beyond(c, mid, rd))
            hi = mid;
        else
            lo = mid;
    }
    return lo;
}

/* (x,y) of (5) that give (x',y').  Newton in T.  Where it leaves the interval that holds the root, the interval is
 * halved. */
static bool fisheye_inverse(const struct rec_camera *c, double *x, double *y)
{
    double want = hypot(*x, *y), lo = 0, hi = asin(1), slope, T;
    if (!(want > 0))
        return true;
    T = fmin(want, 0.9 * hi);
    for (int it = 0; it < 200 && hi - lo > DBL_EPSILON; it++) {
        double error = fisheye_angle(c, T, &slope) - want;
        if (error >= 0 || !fisheye_rises(c, T))
            hi = T;
        else
            lo = T;
        double next = T - error / slope;
        if (fabs(next - T) <= 0.5 * DBL_EPSILON * T)
            break;
        T = next > lo && next < hi ? next : 0.5 * (lo + hi);
    }
    double tangent = tan(T), miss = fabs(fisheye_angle(c, T, &slope) - want);
    *x *= tangent / want;
    *y *= tangent / want;
    return miss * fmax(c->fx, c->fy) <= 1e-10 + 8 * DBL_EPSILON * want * fmax(c->fx, c->fy) &&
           T < asin(1) && fisheye_rises(c, T);
}

/* (x,y) of (1) from those of (3), given as *x, *y. */
static bool undistort(const struct rec_camera *c, double *x, double *y)
{
    if (c->model == REC_FISHEYE)
        return fisheye_inverse(c, x, y);
    if (c->model == REC_SCHEIMPFLUG && !untilt(c, x, y))
        return false;
    double want[2] = {*x, *y};
    if (newton(c, want, x, y))
        return true;
    double rd = hypot(want[0], want[1]), r = radial_inverse(c, rd);
    *x = rd > 0 ? want[0] * (r / rd) : 0;
    *y = rd > 0 ? want[1] * (r / rd) : 0;
    return newton(c, want, x, y);
}

static bool telecentric_ray(const struct rec_camera *c, double x, double y, double origin[3],
                            double dir[3])
{
    rec_camera_centre(c, origin);
    for (int a = 0; a < 3; a++) {
        origin[a] += c->R[a] * x + c->R[3 + a] * y;
        dir[a] = c->R[6 + a];
    }
    return true;
}

/* (x,y) of (1) that the pixel sees, or (X_cam,Y_cam) of (7). */
static bool camera_pixel(const struct rec_camera *c, double u, double v, double *x, double *y)
{
    *x = (u - c->cx) / c->fx;
    *y = (v - c->cy) / c->fy;
    return isfinite(*x) && isfinite(*y) && (!has_distortion(c) || undistort(c, x, y));
}

/* dir = R^T d, of unit length. */
static bool camera_turn(const struct rec_camera *c, double x, double y, double z, double dir[3])
{
    const double *R = c->R;
    double d[3], n2 = 0;
    for (int a = 0; a < 3; a++) {
        d[a] = R[a] * x + R[3 + a] * y + R[6 + a] * z;
        n2 += d[a] * d[a];
    }
    double n = sqrt(n2);
    if (!(n > 0) || !isfinite(n))
        return false;
    for (int a = 0; a < 3; a++)
        dir[a] = d[a] / n;
    return true;
}

static bool table_ray(const struct rec_camera *c, const double line[4], double origin[3],
                      double dir[3])
{
    if (!camera_turn(c, line[2], line[3], 1, dir))
        return false;
    rec_camera_centre(c, origin);
    for (int a = 0; a < 3; a++)
        origin[a] += c->R[a] * line[0] + c->R[3 + a] * line[1];
    return true;
}

bool rec_camera_ray(const struct rec_camera *c, double u, double v, double origin[3], double dir[3])
{
    double x, y, line[4];
    if (!camera_pixel(c, u, v, &x, &y))
        return false;
    if (c->model == REC_TELECENTRIC)
        return telecentric_ray(c, x, y, origin, dir) && rec_glass_pass(c, origin, dir);
    if (c->model == REC_RAYS)
        return rec_ray_table_at(c->table, x, y, line, NULL) && table_ray(c, line, origin, dir);
    if (!camera_turn(c, x, y, 1, dir))
        return false;
    rec_camera_centre(c, origin);
    return c->n_windows == 0 || rec_glass_pass(c, origin, dir);
}

bool rec_camera_ray_from(const struct rec_camera *c, double u, double v, const double from[2],
                         double origin[3], double dir[3])
{
    double x, y, F = c->blur.focus;
    if (!camera_pixel(c, u, v, &x, &y) || !camera_turn(c, F * x - from[0], F * y - from[1], F, dir))
        return false;
    rec_camera_centre(c, origin);
    for (int a = 0; a < 3; a++)
        origin[a] += c->R[a] * from[0] + c->R[3 + a] * from[1];
    return c->n_windows == 0 || rec_glass_pass(c, origin, dir);
}

bool rec_camera_ray_of(const struct rec_camera *c, double u, double v, int32_t i, double origin[3],
                       double dir[3])
{
    double x, y, line[4];
    return camera_pixel(c, u, v, &x, &y) && rec_ray_table_one(c->table, x, y, i, line) &&
           table_ray(c, line, origin, dir);
}

double rec_camera_depth(const struct rec_camera *c, const double X[3])
{
    double at[3], z = c->t[2], d2 = 0;
    for (int a = 0; a < 3; a++)
        z += c->R[6 + a] * X[a];
    if (c->model == REC_TELECENTRIC)
        return z > 0 ? 1 : z;
    if (c->model == REC_RAYS) { /* fx over pixels per metre */
        struct rec_projection p;
        double D[6];
        double px = rec_camera_slopes(c, X, &p, D) ? sqrt(fabs(D[0] * D[4] - D[1] * D[3])) : 0;
        return px > 0 ? c->fx / px : 0;
    }
    if (c->model != REC_FISHEYE || !(z > 0))
        return z;
    rec_camera_centre(c, at);
    for (int a = 0; a < 3; a++)
        d2 += (X[a] - at[a]) * (X[a] - at[a]);
    return sqrt(d2);
}

void rec_camera_centre(const struct rec_camera *c, double x[3])
{
    const double *R = c->R, *t = c->t;
    for (int a = 0; a < 3; a++)
        x[a] = -(R[a] * t[0] + R[3 + a] * t[1] + R[6 + a] * t[2]);
}

void rec_camera_look(const double at[3], const double to[3], struct rec_camera *c)
{
    double z[3], x[3], n = 0;
    for (int a = 0; a < 3; a++) {
        z[a] = to[a] - at[a];
        n += z[a] * z[a];
    }
    n = sqrt(n);
    for (int a = 0; a < 3; a++)
        z[a] /= n;
    double m = hypot(z[0], z[1]); /* right = forward x up, normalised; down = forward x right */
    x[0] = m > 0 ? z[1] / m : -z[2];
    x[1] = m > 0 ? -z[0] / m : 0;
    x[2] = 0;
    double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]};
    for (int a = 0; a < 3; a++) {
        c->R[a] = x[a];
        c->R[3 + a] = y[a];
        c->R[6 + a] = z[a];
    }
    for (int i = 0; i < 3; i++)
        c->t[i] = -(c->R[3 * i] * at[0] + c->R[3 * i + 1] * at[1] + c->R[3 * i + 2] * at[2]);
}
