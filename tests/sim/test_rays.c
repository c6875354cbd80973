/* test_rays.c - volumes from cameras behind glass, with tilted sensors and out of focus, against those of perfect
 * pinholes.  The pictures come from a tracer that shares no code and no formula with the camera models
 * (tests/lib/optics.h).  NUMERICS.md, 20, has the table that this prints. */
#include "base/clock.h"
#include "base/pool.h"
#include "recon/frame/frame.h"
#include "recon/geom/ray_table.h"
#include "recon/view/flame.h"
#include "recon/view/metrics.h"
#include "tests/lib/must.h"
#include "tests/lib/normal.h"
#include "tests/lib/optics.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

#define CAMERAS 8
#define SETS    2 /* of the long test; else 1 */

enum kind { PINHOLE, GLASS_2, GLASS_8, TILTED, DISC_2, BUNDLES, DISC_4, KINDS };
static const char *const names[KINDS] = {"pinholes",
                                         "2 of 8 behind one window",
                                         "8 behind 4 windows",
                                         "Scheimpflug 8 degrees",
                                         "defocus, disc of 2 px",
                                         "the same from files",
                                         "defocus, disc of 4 px"};
static int W, H, N, sets; /* pixels, voxels */

/* A camera as it is made: a thin lens of `aperture` m before a sensor that is turned, perhaps a plate. */
struct maker {
    struct rec_camera pose; /* R, t, K: nothing else of it is used */
    double tilt;            /* rad, about the sensor's x, then about its y */
    double aperture, focus; /* m */
    struct optics_plate plate;
    int plates;
};

struct bed {
    enum kind kind;
    struct rec_rig rig, pretended; /* as the product describes it; without what is special */
    struct maker maker[CAMERAS];
    struct rec_flame_pose flame[SETS];
    float *picture[SETS][CAMERAS];
    int set; /* in work */
};

static pvx_pool *pool;

/* ---- pictures --------------------------------------------------------------------------------- */

/* Mean of the channels along a ray, by rec_flame.h (2); blobs that are 6 sigma away are dark. */
static double flame_light(const struct rec_flame_pose *f, const double o[3], const double d[3])
{
    double sum = 0;
    for (int g = 0; g < f->n; g++) {
        const struct rec_blob *b = &f->blob[g];
        double a = 0, e = 0, c = 0;
        for (int k = 0; k < 3; k++) {
            double w = 1 / b->s[k], x = (o[k] - b->m[k]) * w, y = d[k] * w;
            a += y * y;
            e += x * y;
            c += x * x;
        }
        double q = c - e * e / a;
        if (q < 36)
            sum += (b->a[0] + b->a[1] + b->a[2]) / 3 * sqrt(6.283185307179586 / a) * exp(-0.5 * q);
    }
    return sum;
}

/* Where (u,v) lies on the sensor, in camera axes before the lens, at distance 1: the sensor is a plane through
 * (0,0,1), turned. */
static void on_sensor(const struct maker *m, double u, double v, double out[3])
{
    double c = cos(m->tilt), s = sin(m->tilt);
    double a = (u - m->pose.cx) / m->pose.fx, b = (v - m->pose.cy) / m->pose.fy;
    const double right[3] = {c, s * s, -s * c}, down[3] = {0, c, s};
    for (int i = 0; i < 3; i++)
        out[i] = a * right[i] + b * down[i] + (i == 2);
}

/* Light of a pixel: rays at random over its area and over the lens, followed to the flame. */
static double light(const struct maker *m, const struct rec_flame_pose *f, int x, int y,
                    uint64_t *state)
{
    int n = m->aperture > 0 ? 36 : 9;
    double sum = 0, centre[3];
    const double *R = m->pose.R, *t = m->pose.t;
    for (int a = 0; a < 3; a++)
        centre[a] = -(R[a] * t[0] + R[3 + a] * t[1] + R[6 + a] * t[2]);
    for (int i = 0; i < n; i++) {
        int side = m->aperture > 0 ? 6 : 3; /* jittered: one in each part of the pixel */
        double u = x - 0.5 + (i % side + pvx_uniform(state)) / side, p[3], q[3], o[3], d[3];
        double v = y - 0.5 + (i / side + pvx_uniform(state)) / side, r, turn;
        on_sensor(m, u, v, p);
        q[0] = q[1] = 0;
        if (m->aperture >
            0) { /* the lens equation: slope after = slope before - height / focal length */
            double back = 0.05, power = 1 / back + 1 / m->focus;
            r = 0.5 * m->aperture * sqrt(pvx_uniform(state));
            turn = 6.283185307179586 * pvx_uniform(state);
            q[0] = r * cos(turn);
            q[1] = r * sin(turn);
            for (int a = 0; a < 2; a++) /* the sensor point is at -back p behind the lens */
                p[a] = (q[a] + back * p[a] / p[2]) / back - q[a] * power;
            p[2] = 1;
        }
        double length = sqrt(optics_dot(p, p));
        for (int a = 0; a < 3; a++) {
            d[a] = (R[a] * p[0] + R[3 + a] * p[1] + R[6 + a] * p[2]) / length;
            o[a] = centre[a] + R[a] * q[0] + R[3 + a] * q[1];
        }
        if (!optics_plates(&m->plate, m->plates, o, d))
            continue;
        sum += flame_light(f, o, d);
    }
    return sum / n;
}

static void shoot_rows(void *ctx, size_t task)
{
    struct bed *b = ctx;
    size_t c = task / (size_t)H, y = task % (size_t)H;
    uint64_t state = task * 7919 + (uint64_t)b->set + 1;
    for (int x = 0; x < W; x++)
        b->picture[b->set][c][y * (size_t)W + (size_t)x] =
            (float)(light(&b->maker[c], &b->flame[b->set], x, (int)y, &state) +
                    0.008 * normal_deviate(&state)); /* 1 % of the brightest pixel */
}

/* ---- rigs ------------------------------------------------------------------------------------- */

/* Cameras a to b look through one plate, 30 degrees oblique to the mean of their axes. */
static void glaze(struct bed *b, size_t from, size_t to)
{
    double axis[3] = {0}, n[3], length;
    for (size_t c = from; c < to; c++)
        for (int a = 0; a < 3; a++)
            axis[a] += b->rig.cameras[c].R[6 + a];
    axis[2] = 0;
    length = sqrt(optics_dot(axis, axis));
    for (int a = 0; a < 3; a++)
        n[a] = cos(M_PI / 6) * axis[a] / length + (a == 2 ? sin(M_PI / 6) : 0);
    struct optics_plate p = {.at = n[2] * 0.5 - 1.0, .thickness = 0.02, .index = 1.458};
    memcpy(p.n, n, sizeof n);
    for (size_t c = from; c < to; c++) {
        struct rec_glass *w = &b->rig.cameras[c].window[0];
        memcpy(w->normal, n, sizeof n);
        w->at = p.at;
        w->thickness = p.thickness;
        w->index = p.index;
        b->rig.cameras[c].n_windows = 1;
        b->maker[c].plate = p;
        b->maker[c].plates = 1;
    }
}

/* The rays of the maker's lens as a file, 24 for each pixel, in place of the product's model of a lens. */
static void from_file(const struct maker *m, const char *name, struct rec_camera *k)
{
    enum { RAYS = 24 };
    const double *R = m->pose.R, *t = m->pose.t;
    char head[128];
    int n = snprintf(head, sizeof head,
                     "{'descr': '<f4', 'fortran_order': False, 'shape': (%d, %d, %d, 6), }", H, W,
                     RAYS);
    FILE *f = fopen(name, "wb");
    fprintf(f, "\x93NUMPY\x01%c%c%c%s", 0, n, 0, head);
    for (int i = 0; i < W * H * RAYS; i++) {
        double p[3], r = 0.5 * m->aperture * sqrt((i % RAYS + 0.5) / RAYS), turn = 2.399963 * i;
        const double q[2] = {r * cos(turn), r * sin(turn)};
        float ray[6];
        on_sensor(m, i / RAYS % W, i / RAYS / W, p);
        for (int a = 0; a < 3; a++) { /* to where the lens is sharp */
            double x = m->focus * p[0] - q[0], y = m->focus * p[1] - q[1], z = m->focus;
            ray[a] = (float)(R[a] * (q[0] - t[0]) + R[3 + a] * (q[1] - t[1]) - R[6 + a] * t[2]);
            ray[3 + a] = (float)(R[a] * x + R[3 + a] * y + R[6 + a] * z);
        }
        fwrite(ray, sizeof ray, 1, f);
    }
    T_EQ_I(fclose(f), 0);
    T_EQ_I(rec_ray_table_get(name, W, H, &k->table, NULL), PVX_OK);
    remove(name);
    k->model = REC_RAYS;
    k->blur = (struct rec_blur){.rays = RAYS};
    k->fx = k->fy = 1;
    k->cx = k->cy = 0;
    memcpy(k->R, k->table->R, sizeof k->R);
    memcpy(k->t, k->table->t, sizeof k->t);
}

static void bed_rig(struct bed *b)
{
    T_EQ_I(rec_rig_ring(CAMERAS, 2.2, W, H, N, &b->rig), PVX_OK);
    b->rig.grid.basis = REC_TRILINEAR;
    for (size_t c = 0; c < CAMERAS; c++) {
        struct rec_camera *k = &b->rig.cameras[c];
        memset(k->dist, 0, sizeof k->dist);
        b->maker[c] = (struct maker){.pose = *k};
    }
    T_EQ_I(rec_rig_copy(&b->rig, &b->pretended), PVX_OK);
    for (size_t c = 0; c < CAMERAS; c++) {
        struct rec_camera *k = &b->rig.cameras[c];
        double tilt = 8 * M_PI / 180, X[3] = {0, 0, 0.5};
        if (b->kind == TILTED) {
            b->maker[c].tilt = k->tilt[0] = k->tilt[1] = tilt;
            k->model = REC_SCHEIMPFLUG;
        }
        if (b->kind >= DISC_2) { /* focused far behind the flame */
            double z = rec_camera_depth(k, X);
            k->blur.focus = b->maker[c].focus = 2 * z;
            k->blur.aperture = b->maker[c].aperture =
                (b->kind == DISC_4 ? 4 : 2) / (k->fx * (1 / z - 0.5 / z));
        }
    }
    for (size_t c = 0; c < CAMERAS && b->kind == BUNDLES; c++)
        from_file(&b->maker[c], at("%zu.npy", c), &b->rig.cameras[c]);
    if (b->kind == GLASS_2)
        glaze(b, 0, 2);
    for (size_t c = 0; c < CAMERAS && b->kind == GLASS_8; c += 2)
        glaze(b, c, c + 2);
}

static void bed_new(struct bed *b, enum kind kind)
{
    struct rec_flame flame;
    *b = (struct bed){.kind = kind};
    bed_rig(b);
    rec_flame_init(&flame, &b->rig.grid, 5);
    for (b->set = 0; b->set < sets; b->set++) {
        rec_flame_at(&flame, 0.6 * b->set, &b->flame[b->set]);
        for (size_t c = 0; c < CAMERAS; c++)
            b->picture[b->set][c] = must_floats((size_t)(W * H));
        pvx_pool_run(pool, (size_t)(CAMERAS * H), shoot_rows, b);
    }
}

static void bed_free(struct bed *b)
{
    for (int s = 0; s < SETS; s++)
        for (size_t c = 0; c < CAMERAS; c++)
            free(b->picture[s][c]);
    rec_rig_fini(&b->rig);
    rec_rig_fini(&b->pretended);
}

/* ---- volumes ---------------------------------------------------------------------------------- */

struct outcome {
    double error, ms;
    int64_t voxels;
    double entries; /* millions */
    int left_out;   /* cameras that were voted out, all sets */
};

static double error_of(const struct bed *b, int set, const rec_frame *f)
{
    struct rec_sparse v;
    size_t n = rec_grid_count(&b->rig.grid);
    float *truth = must_floats(3 * n), *dense = must_floats(n);
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    rec_flame_voxels(&b->flame[set], &b->rig.grid, 0, N, truth);
    for (size_t i = 0; i < n; i++)
        truth[i] = (truth[3 * i] + truth[3 * i + 1] + truth[3 * i + 2]) / 3;
    double e = rec_rel_l2(dense, truth, n);
    free(truth);
    free(dense);
    return e;
}

static void bin(const float *picture, int32_t by, float *out)
{
    for (int32_t y = 0; y < H / by; y++)
        for (int32_t x = 0; x < W / by; x++) {
            double sum = 0;
            for (int32_t i = 0; i < by * by; i++)
                sum += (double)picture[(y * by + i / by) * W + x * by + i % by];
            out[y * (W / by) + x] = (float)(sum / (by * by));
        }
}

static struct outcome reconstruct(const struct bed *b, const struct rec_rig *rig)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct outcome o = {.ms = INFINITY};
    rec_sysmat *S;
    rec_frame *f;
    p.nch = 1;
    p.photo.saturation = 1e30F;
    T_EQ_I(rec_sysmat_build(rig, &rec_sysmat_defaults, pool, NULL, NULL, &S, NULL), PVX_OK);
    T_EQ_I(rec_frame_alone(S, rig, &p, pool, &f, NULL), PVX_OK);
    for (int k = 0; k < 3 * sets;
         k++) { /* the fastest of three: other programs only make it slower */
        int set = k % sets;
        rec_frame_reset(f);
        for (size_t c = 0; c < CAMERAS; c++) {
            bin(b->picture[set][c], S->binning, rec_frame_input(f, c));
            rec_frame_camera(f, c)->present = true;
        }
        int64_t t0 = pvx_now_mono();
        rec_frame_carve(f);
        T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
        o.ms = fmin(o.ms, (double)(pvx_now_mono() - t0) * 1e-6);
        if (k >= sets)
            continue;
        const struct rec_frame_report *r = rec_frame_get_report(f);
        o.error += error_of(b, set, f) / sets;
        o.voxels += r->active_voxels / sets;
        o.entries += 1e-6 * (double)r->entries / sets;
        o.left_out += CAMERAS - (int)r->cameras;
    }
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    return o;
}

/* The largest error allowed, over that of perfect pinholes.  Discs of 4 px at 1 % noise take details that no model
 * brings back. */
static const double limit[KINDS] = {1, 1.1, 1.1, 1.1, 1.1, 1.15, 1.25};

static void compare(int w, int h, int n, int kinds, int of)
{
    struct outcome perfect = {0};
    sets = of;
    W = w;
    H = h;
    N = n;
    scratch_new();
    T_EQ_I(pvx_pool_new(2, "rays", &pool), PVX_OK);
    printf("  %d x %d, %d^3\n  %-26s %8s %8s %10s %9s %7s %7s %8s\n", w, h, n, "cameras", "error",
           "over", "pretended", "over", "ms", "voxels", "entries");
    for (int kind = 0; kind < kinds; kind++) {
        struct bed b;
        bed_new(&b, (enum kind)kind);
        struct outcome o = reconstruct(&b, &b.rig), flat = reconstruct(&b, &b.pretended);
        if (kind == PINHOLE)
            perfect = o;
        printf("  %-26s %8.4f %8.3f %10.4f %9.3f %7.1f %7lld %7.2fM\n", names[kind], o.error,
               o.error / perfect.error, flat.error, flat.error / perfect.error, o.ms,
               (long long)o.voxels, o.entries);
        T_LE(o.error, limit[kind] * perfect.error);
        T_EQ_I(o.left_out, 0);
        bed_free(&b);
    }
    pvx_pool_free(&pool);
    scratch_remove();
}

T_CASE_OF_THREADS(other_optics_are_as_good_as_pinholes)
{
    T_NOT_UNDER_SANITIZERS();
    if (t_long())
        compare(160, 120, 48, KINDS, SETS);
    else
        compare(120, 90, 40, DISC_4, 1);
}

T_CASE_OF_THREADS(other_optics_at_64)
{
    T_ONLY_LONG();
    compare(320, 240, 64, KINDS, SETS);
}
