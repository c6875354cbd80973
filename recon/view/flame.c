#include "recon/view/flame.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "recon/geom/bundle.h"

#define PI  3.14159265358979323846
#define CUT 5.0 /* sigmas */

static double clamp(double x, double lo, double hi)
{
    return x < lo ? lo : x > hi ? hi : x;
}

static double flame_mix(double a, double b, double t)
{
    return a + (b - a) * t;
}

/* Random number `which` of blob g, 0..1, from the seed (splitmix64's finaliser). */
static double flame_draw(const struct rec_flame *f, int g, int which)
{
    uint64_t z = ((uint64_t)f->seed << 32) + (uint64_t)g * 64 + (uint64_t)which;
    z = (z + 1) * 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

/* One blob at phase `turn` (0..1 of the period) in the unit box [-0.5,0.5]^2 x [0,1]. */
static void unit_blob(const struct rec_flame *f, int g, double turn, struct rec_blob *b)
{
    double angle = 2 * PI * flame_draw(f, g, 0), start = flame_draw(f, g, 1),
           reach = flame_draw(f, g, 2);
    double size = flame_draw(f, g, 3);
    bool bed = g % 5 == 0; /* embers that stay; the others are tongues that rise */
    double life, z, r;     /* brightness over a life, height, distance from axis */
    double s_xy, s_z, heat;
    if (bed) {
        int beats = 1 + g / 5 % 3;
        life = 0.8 + 0.2 * sin(2 * PI * (beats * turn + start));
        r = 0.13 * sqrt(reach);
        z = 0.15 + 0.05 * size;
        s_xy = 0.034 + 0.014 * size;
        s_z = 0.034;
        heat = 0.6 - 0.4 * reach;
        life *= 0.8;
    } else {
        int lives = 1 + g % 2;
        double p = lives * turn + start; /* phase of this life */
        p -= floor(p);
        life = sin(PI * p) * sin(PI * p); /* 0 where the blob jumps back to the base */
        double outer = sqrt(reach);       /* even over the area of a disc */
        life *= 1 + 2 * p;                /* tongues thin out but burn on */
        double top = flame_mix(1.0, 0.6, outer * (0.4 + 0.6 * size));
        z = flame_mix(0.10, top, pow(p, 0.85));
        /* narrow at the base, widest at a third of the way, closing to a tip */
        r = 0.25 * outer * (0.35 + 0.65 * sin(PI * pow(p, 0.6))) * (1 - 0.5 * p);
        s_xy = flame_mix(0.050, 0.030, p) * (0.6 + 0.7 * size);
        s_z = s_xy * flame_mix(1.4, 2.8, p);
        heat = 1.25 * (1 - 0.8 * p) * (1 - 0.95 * outer);
        angle += 2 * PI * 0.3 * p * (g % 4 < 2 ? 1 : -1);
    }
    /* the whole flame leans and licks, more the higher up */
    double lean = 0.09 * z * z;
    b->m[0] = r * cos(angle) + lean * sin(2 * PI * (turn - 0.7 * z));
    b->m[1] = r * sin(angle) + lean * sin(2 * PI * (2 * turn - 0.9 * z) + 1);
    b->m[2] = z;
    b->s[0] = b->s[1] = s_xy;
    b->s[2] = s_z;
    for (int a = 0; a < 3; a++) {
        double lo = a < 2 ? -0.4 : 0.02, hi = a < 2 ? 0.4 : 0.95;
        b->m[a] = clamp(b->m[a], lo + 3 * b->s[a], hi - 3 * b->s[a]);
    }
    static const double outer_rgb[3] = {0.95, 0.16, 0.010}, core_rgb[3] = {2.2, 1.40, 0.45};
    for (int ch = 0; ch < 3; ch++)
        b->a[ch] = life * flame_mix(outer_rgb[ch], core_rgb[ch], clamp(heat, 0, 1));
}

void rec_flame_at(const struct rec_flame *f, double t_s, struct rec_flame_pose *out)
{
    double turn = t_s / f->period_s;
    turn -= floor(turn);
    out->n = f->n_blobs;
    for (int g = 0; g < f->n_blobs; g++) {
        struct rec_blob *b = &out->blob[g];
        unit_blob(f, g, turn, b);
        for (int a = 0; a < 3; a++) {
            double side = f->hi[a] - f->lo[a];
            b->m[a] = f->lo[a] + side * (b->m[a] + (a < 2 ? 0.5 : 0));
            b->s[a] *= side;
            b->a[a] *= f->gain;
        }
    }
}

void rec_flame_ray(const struct rec_flame_pose *p, const double o[3], const double d[3],
                   double out[3])
{
    out[0] = out[1] = out[2] = 0;
    for (int g = 0; g < p->n; g++) {
        const struct rec_blob *b = &p->blob[g];
        double E[3], D[3];
        for (int a = 0; a < 3; a++) {
            E[a] = (b->m[a] - o[a]) / b->s[a];
            D[a] = d[a] / b->s[a];
        }
        double u = E[1] * D[2] - E[2] * D[1], v = E[2] * D[0] - E[0] * D[2];
        double w = E[0] * D[1] - E[1] * D[0];
        double a = D[0] * D[0] + D[1] * D[1] + D[2] * D[2];
        double e = sqrt(2 * PI / a) * exp(-0.5 * (u * u + v * v + w * w) / a);
        for (int ch = 0; ch < 3; ch++)
            out[ch] += b->a[ch] * e;
    }
}

/* Largest line integral on a fan of level rays through the flame, over one period. */
static double flame_brightest(const struct rec_flame *f)
{
    double most = 0;
    for (int it = 0; it < 8; it++) {
        struct rec_flame_pose pose;
        rec_flame_at(f, f->period_s * it / 8, &pose);
        for (int view = 0; view < 6; view++)
            for (int iz = 0; iz < 24; iz++)
                for (int ir = -4; ir <= 4; ir++) {
                    double c = cos(PI * view / 6), s = sin(PI * view / 6), off = 0.03 * ir;
                    double unit[3] = {-off * s, off * c, 0.05 + 0.03 * iz}, o[3], rgb[3];
                    for (int a = 0; a < 3; a++)
                        o[a] = flame_mix(f->lo[a], f->hi[a], unit[a] + (a < 2 ? 0.5 : 0));
                    rec_flame_ray(&pose, o, (double[3]){c, s, 0}, rgb);
                    for (int ch = 0; ch < 3; ch++)
                        most = fmax(most, rgb[ch]);
                }
    }
    return most;
}

void rec_flame_init(struct rec_flame *f, const struct rec_grid *g, uint32_t seed)
{
    *f = (struct rec_flame){.period_s = 2.0, .n_blobs = 40, .seed = seed, .gain = 1};
    memcpy(f->lo, g->min, sizeof f->lo);
    memcpy(f->hi, g->max, sizeof f->hi);
    f->gain = 0.8 / flame_brightest(f);
}

/* ---- images ----------------------------------------------------------------------------------
 * An image is worked off in tiles.  Ray directions of a tile come from 4x4 exact ones by cubic
 * interpolation, scaled to unit depth so that an ideal lens is interpolated exactly: inverting the
 * lens model once per pixel would cost more than the flame. */

enum { TILE = REC_FLAME_BAND, TILE2 = TILE * TILE };

struct rays { /* world direction of unit depth, and its length; 0 = no ray */
    float x[TILE2], y[TILE2], z[TILE2], norm[TILE2];
};

/* Direction of unit depth; false where the lens has none. */
static bool unit_depth(const struct rec_camera *c, double u, double v, double dir[3])
{
    double o[3];
    if (!rec_camera_ray(c, u, v, o, dir))
        return false;
    double depth = c->R[6] * dir[0] + c->R[7] * dir[1] + c->R[8] * dir[2];
    if (!(depth > 1e-6))
        return false;
    for (int a = 0; a < 3; a++)
        dir[a] /= depth;
    return true;
}

static void set_ray(struct rays *r, int i, const double d[3], bool ok)
{
    r->x[i] = (float)d[0];
    r->y[i] = (float)d[1];
    r->z[i] = (float)d[2];
    r->norm[i] = ok ? (float)sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) : 0.0f;
}

/* Cubic Lagrange weights at x for nodes 0, 1, 2, 3. */
static void lagrange(double x, double w[4])
{
    w[0] = -(x - 1) * (x - 2) * (x - 3) / 6;
    w[1] = x * (x - 2) * (x - 3) / 2;
    w[2] = -x * (x - 1) * (x - 3) / 2;
    w[3] = x * (x - 1) * (x - 2) / 6;
}

/* Rays through (x0 + i + du, y0 + j + dv), i, j in 0..TILE-1. */
static void tile_rays(const struct rec_camera *c, int32_t x0, int32_t y0, double du, double dv,
                      struct rays *r)
{
    const double step = TILE / 3.0;
    double node[4][4][3], w[TILE][4];
    bool ok = true;
    for (int j = 0; j < 4 && ok; j++)
        for (int i = 0; i < 4 && ok; i++)
            ok = unit_depth(c, x0 - 0.5 + i * step, y0 - 0.5 + j * step, node[j][i]);
    if (!ok) { /* at the edge of what the lens can see: compute it ray by ray */
        for (int j = 0; j < TILE; j++)
            for (int i = 0; i < TILE; i++) {
                double d[3] = {0, 0, 1};
                bool hit = unit_depth(c, x0 + i + du, y0 + j + dv, d);
                set_ray(r, j * TILE + i, d, hit);
            }
        return;
    }
    for (int i = 0; i < TILE; i++)
        lagrange((i + 0.5 + du) / step, w[i]);
    for (int j = 0; j < TILE; j++) {
        double wv[4], row[4][3];
        lagrange((j + 0.5 + dv) / step, wv);
        for (int n = 0; n < 4; n++)
            for (int a = 0; a < 3; a++)
                row[n][a] = wv[0] * node[0][n][a] + wv[1] * node[1][n][a] + wv[2] * node[2][n][a] +
                            wv[3] * node[3][n][a];
        for (int i = 0; i < TILE; i++) {
            double d[3];
            for (int a = 0; a < 3; a++)
                d[a] = w[i][0] * row[0][a] + w[i][1] * row[1][a] + w[i][2] * row[2][a] +
                       w[i][3] * row[3][a];
            set_ray(r, j * TILE + i, d, true);
        }
    }
}

/* A blob as one camera sees it. */
struct seen_blob {
    float E[3], inv_s[3], a[3];
    int32_t x0, x1, y0, y1; /* rectangle of pixels that 5 sigma can touch, half open */
};

static bool see_blob(const struct rec_blob *b, const struct rec_camera *c, const double centre[3],
                     struct seen_blob *out)
{
    if (!(b->a[0] > 0 || b->a[1] > 0 || b->a[2] > 0))
        return false;
    double lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY};
    bool front = false, whole = false; /* some point in front; the rectangle is unknown */
    for (int p = 0; p < 27; p++) {
        int step[3] = {p % 3 - 1, p / 3 % 3 - 1, p / 9 - 1};
        double X[3], uv[2];
        for (int a = 0; a < 3; a++)
            X[a] = b->m[a] + CUT * step[a] * b->s[a];
        front |= c->R[6] * X[0] + c->R[7] * X[1] + c->R[8] * X[2] + c->t[2] > 0;
        if (!rec_camera_project(c, X, uv)) {
            whole = true;
            continue;
        }
        for (int a = 0; a < 2; a++) {
            lo[a] = fmin(lo[a], uv[a]);
            hi[a] = fmax(hi[a], uv[a]);
        }
    }
    if (!front)
        return false;
    int32_t size[2] = {c->width, c->height}, from[2] = {0, 0}, to[2] = {c->width, c->height};
    for (int a = 0; a < 2 && !whole; a++) {
        double pad = 2 + 0.03 * (hi[a] - lo[a]); /* edges of the box bend in a real lens */
        from[a] = (int32_t)clamp(floor(lo[a] - pad), 0, size[a]);
        to[a] = (int32_t)clamp(ceil(hi[a] + pad) + 1, 0, size[a]);
    }
    *out = (struct seen_blob){.x0 = from[0], .x1 = to[0], .y0 = from[1], .y1 = to[1]};
    for (int a = 0; a < 3; a++) {
        out->E[a] = (float)((b->m[a] - centre[a]) / b->s[a]);
        out->inv_s[a] = (float)(1 / b->s[a]);
        out->a[a] = (float)(b->a[a] * sqrt(2 * PI));
    }
    return from[0] < to[0] && from[1] < to[1];
}

/* exp(-q/2) for 0 <= q <= 25 to 3e-7: 2^f by a polynomial (Taylor of 2^f, |f| <= 1/2), exponent by
 * bits.  Branch-free so that the loop below is vectorised. */
static inline float exp_half(float q)
{
    float t = q * -0.72134752f;                /* -log2(e)/2 */
    float n = (t + 12582912.0f) - 12582912.0f; /* nearest integer: 1.5 * 2^23 */
    float f = t - n;
    float p = 1.5403530e-4f;
    p = p * f + 1.3333558e-3f;
    p = p * f + 9.6181291e-3f;
    p = p * f + 5.5504109e-2f;
    p = p * f + 2.4022651e-1f;
    p = p * f + 6.9314718e-1f;
    p = p * f + 1.0f;
    int32_t bits = ((int32_t)n + 127) << 23;
    float scale;
    memcpy(&scale, &bits, sizeof scale);
    return p * scale;
}

/* Add blob b to the samples [i0,i1) of one row of a tile.  Separate pointer arguments, or the loop would not be
 * vectorised.  NOLINTNEXTLINE(readability-function-size) */
static void flame_add_row(const struct seen_blob *b, const float *restrict dx,
                          const float *restrict dy, const float *restrict dz,
                          const float *restrict norm, int n, float *restrict red,
                          float *restrict green, float *restrict blue)
{
    const float Ex = b->E[0], Ey = b->E[1], Ez = b->E[2];
    const float ix = b->inv_s[0], iy = b->inv_s[1], iz = b->inv_s[2];
    const float ar = b->a[0], ag = b->a[1], ab = b->a[2];
    for (int i = 0; i < n; i++) {
        float X = dx[i] * ix, Y = dy[i] * iy, Z = dz[i] * iz;
        float u = Ey * Z - Ez * Y, v = Ez * X - Ex * Z, w = Ex * Y - Ey * X;
        float inv_a = 1.0f / (X * X + Y * Y + Z * Z);
        float q = (u * u + v * v + w * w) * inv_a;
        float in = q < (float)(CUT * CUT) ? norm[i] : 0.0f;
        q = q < (float)(CUT * CUT) ? q : (float)(CUT * CUT);
        float e = in * sqrtf(inv_a) * exp_half(q);
        red[i] += ar * e;
        green[i] += ag * e;
        blue[i] += ab * e;
    }
}

static int32_t at_least(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

static int32_t at_most(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

/* Cameras whose rays have no common centre, and blurred ones: ray by ray. */
static void flame_render_rays(const struct rec_flame_pose *p, const struct rec_camera *c, int sub,
                              int32_t y0, int32_t y1, float *image)
{
    struct rec_bundle b;
    struct rec_grid g = {.n = {1, 1, 1}};
    for (int a = 0; a < 3; a++) { /* how far out of focus the flame is */
        g.min[a] = INFINITY;
        g.max[a] = -INFINITY;
        for (int k = 0; k < p->n; k++) {
            g.min[a] = fmin(g.min[a], p->blob[k].m[a] - p->blob[k].s[a]);
            g.max[a] = fmax(g.max[a], p->blob[k].m[a] + p->blob[k].s[a]);
        }
    }
    rec_bundle_init(&b, c, 1, sub, &g);
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = 0; x < c->width; x++) {
            double sum[3] = {0}, o[3], d[3], rgb[3];
            for (int32_t i = 0; i < rec_bundle_rays(&b); i++) {
                if (!rec_bundle_ray(&b, x - 0.5, y - 0.5, i, o, d))
                    continue;
                rec_flame_ray(p, o, d, rgb);
                for (int ch = 0; ch < 3; ch++)
                    sum[ch] += rgb[ch];
            }
            for (int ch = 0; ch < 3; ch++)
                image[((size_t)y * (size_t)c->width + (size_t)x) * 3 + (size_t)ch] =
                    (float)(sum[ch] / rec_bundle_rays(&b));
        }
}

void rec_flame_render(const struct rec_flame_pose *p, const struct rec_camera *c, int sub,
                      int32_t y0, int32_t y1, float *image)
{
    struct seen_blob blob[REC_FLAME_MAX_BLOBS];
    int n = 0;
    double centre[3];
    if (c->n_windows > 0 || c->model >= REC_TELECENTRIC || c->blur.sigma > 0 ||
        c->blur.aperture > 0) {
        flame_render_rays(p, c, sub, y0, y1, image);
        return;
    }
    rec_camera_centre(c, centre);
    for (int g = 0; g < p->n; g++)
        n += see_blob(&p->blob[g], c, centre, &blob[n]);

    for (int32_t ty = y0; ty < y1; ty += TILE)
        for (int32_t tx = 0; tx < c->width; tx += TILE) {
            float sum[3][TILE2] = {{0}};
            int32_t ye = at_most(ty + TILE, y1), xe = at_most(tx + TILE, c->width);
            bool lit = false;
            for (int g = 0; g < n; g++)
                lit |= blob[g].x0 < xe && blob[g].x1 > tx && blob[g].y0 < ye && blob[g].y1 > ty;
            for (int s = 0; s < sub * sub && lit; s++) {
                struct rays r;
                tile_rays(c, tx, ty, (s % sub + 0.5) / sub - 0.5, (s / sub + 0.5) / sub - 0.5, &r);
                for (int g = 0; g < n; g++) {
                    const struct seen_blob *b = &blob[g];
                    int32_t from = at_least(b->x0, tx) - tx, len = at_most(b->x1, xe) - tx - from;
                    for (int32_t y = at_least(b->y0, ty); y < at_most(b->y1, ye) && len > 0; y++) {
                        int i = (y - ty) * TILE + from;
                        flame_add_row(b, r.x + i, r.y + i, r.z + i, r.norm + i, len, sum[0] + i,
                                      sum[1] + i, sum[2] + i);
                    }
                }
            }
            float share = 1.0f / (float)(sub * sub);
            for (int32_t y = ty; y < ye; y++)
                for (int32_t x = tx; x < xe; x++)
                    for (int ch = 0; ch < 3; ch++)
                        image[((size_t)y * (size_t)c->width + (size_t)x) * 3 + (size_t)ch] =
                            sum[ch][(y - ty) * TILE + x - tx] * share;
        }
}

/* ---- truth on a grid --------------------------------------------------------------------------
 * (1) is a product over the axes, and so is its mean over a box. */

/* Factor of cell i along `axis`: mean over the cell (box) or value at its centre (trilinear). */
static double axis_factor(const struct rec_grid *g, const struct rec_blob *b, int axis, int32_t i)
{
    double h = rec_grid_h(g, axis), s = b->s[axis];
    double x = g->min[axis] + (i + 0.5) * h - b->m[axis];
    if (g->basis == REC_TRILINEAR)
        return exp(-0.5 * x * x / (s * s));
    double k = 1 / (s * sqrt(2));
    return s * sqrt(PI / 2) / h * (erf((x + h / 2) * k) - erf((x - h / 2) * k));
}

void rec_flame_voxels(const struct rec_flame_pose *p, const struct rec_grid *g, int32_t k0,
                      int32_t k1, float *dense)
{
    size_t row = (size_t)g->n[0] * 3, slice = row * (size_t)g->n[1];
    memset(dense + (size_t)k0 * slice, 0, (size_t)(k1 - k0) * slice * sizeof *dense);
    for (int n = 0; n < p->n; n++) {
        const struct rec_blob *b = &p->blob[n];
        int32_t from[3], to[3];
        for (int a = 0; a < 3; a++) {
            double h = rec_grid_h(g, a), lim = g->n[a];
            from[a] = (int32_t)clamp(floor((b->m[a] - CUT * b->s[a] - g->min[a]) / h), 0, lim);
            to[a] = (int32_t)clamp(ceil((b->m[a] + CUT * b->s[a] - g->min[a]) / h), 0, lim);
        }
        float fx[REC_GRID_MAX], fy[REC_GRID_MAX];
        for (int32_t i = from[0]; i < to[0]; i++)
            fx[i] = (float)axis_factor(g, b, 0, i);
        for (int32_t j = from[1]; j < to[1]; j++)
            fy[j] = (float)axis_factor(g, b, 1, j);
        for (int32_t k = at_least(from[2], k0); k < at_most(to[2], k1); k++) {
            float fz = (float)axis_factor(g, b, 2, k);
            for (int32_t j = from[1]; j < to[1]; j++) {
                float *out = dense + (size_t)k * slice + (size_t)j * row;
                float yz = fy[j] * fz;
                float r = (float)b->a[0] * yz, gr = (float)b->a[1] * yz, bl = (float)b->a[2] * yz;
                for (int32_t i = from[0]; i < to[0]; i++) {
                    out[i * 3] += r * fx[i];
                    out[i * 3 + 1] += gr * fx[i];
                    out[i * 3 + 2] += bl * fx[i];
                }
            }
        }
    }
}
