/* test_ray_table.c - rays from a file that were made with a lens behind glass see what that camera sees. */
#include "recon/geom/ray_table.h"

#include "base/file.h"
#include "recon/geom/bundle.h"
#include "recon/geom/rig.h"
#include "recon/matrix/sysmat.h"
#include "recon/view/flame.h"
#include "tests/lib/entries.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

enum { W = 64, H = 48 };

static const struct rec_grid grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {12, 12, 12}, REC_TRILINEAR};

static struct rec_camera lens(void)
{
    struct rec_camera c = {
        .width = W, .height = H, .fx = 60, .fy = 61, .cx = 31, .cy = 24, .gain = {1, 1, 1}};
    const double at[3] = {1.9, -1.1, 0.8}, to[3] = {0, 0, 0.5};
    rec_camera_look(at, to, &c);
    c.dist[0] = -0.1;
    c.n_windows = 1;
    for (int a = 0; a < 3; a++)
        c.window[0].normal[a] = 0.8 * c.R[6 + a] + 0.6 * c.R[a];
    c.window[0].at = c.window[0].normal[0] * 1.9 - c.window[0].normal[1] * 1.1 +
                     c.window[0].normal[2] * 0.8 + 0.3;
    c.window[0].thickness = 0.1;
    c.window[0].index = 1.5;
    snprintf(c.name, sizeof c.name, "a");
    return c;
}

static FILE *new_file(const char *name, int size, const char *shape)
{
    char text[256];
    int n = snprintf(text, sizeof text,
                     "{'descr': '<f%d', 'fortran_order': False, 'shape': (%s), }", size, shape);
    memset(text + n, ' ', (size_t)(118 - n));
    text[117] = '\n';
    FILE *f = fopen(name, "wb");
    fwrite("\x93NUMPY\x01\x00\x76\x00", 1, 10, f);
    fwrite(text, 1, 118, f);
    return f;
}

/* Its rays, moved along themselves at random, as a file.  size 4 or 8; hole: one pixel without a ray. */
static void write_rays(const struct rec_camera *c, const char *name, int size, bool hole)
{
    FILE *f = new_file(name, size, "48, 64, 6");
    for (int i = 0; i < W * H; i++) {
        double r[6], s = t_uniform(-0.3, 0.3), k = t_uniform(0.5, 2);
        T_OK(rec_camera_ray(c, i % W, i / W, r, r + 3));
        for (int a = 0; a < 3; a++) {
            r[a] += s * r[3 + a];
            r[3 + a] *= k;
        }
        for (int a = 0; a < 6; a++) {
            if (hole && i == 20 * W + 20)
                r[a] = NAN;
            float v = (float)r[a];
            fwrite(size == 4 ? (const void *)&v : (const void *)&r[a], (size_t)size, 1, f);
        }
    }
    fclose(f);
}

static pvx_err load(const char *file, struct rec_rig *r, struct pvx_diag *d)
{
    char text[1000];
    snprintf(text, sizeof text,
             "version: 1\nvolume: { min: [-0.5,-0.5,0], max: [0.5,0.5,1], voxels: [12,12,12] }\n"
             "cameras:\n  - name: a\n    size: [64, 48]\n    model: rays\n    rays: %s\n",
             file);
    d->text[0] = '\0';
    return rec_rig_parse(text, strlen(text), at("rig.yaml"), r, d);
}

T_CASE(rays_see_what_their_camera_sees)
{
    struct pvx_diag d;
    scratch_new();
    for (int size = 4; size <= 8; size += 4) {
        struct rec_camera was = lens();
        struct rec_rig r, back;
        double worst = 0, slope = 0, round = 0;
        write_rays(&was, at("rays%d.npy", size), size, false);
        T_EQ_I(load(size == 4 ? "rays4.npy" : "rays8.npy", &r, &d), PVX_OK);
        T_EQ_S(d.text, "");
        const struct rec_camera *c = &r.cameras[0];
        T_EQ_I(c->model, REC_RAYS);
        for (int i = 0; i < 2000; i++) {
            double X[3] = {t_uniform(-0.5, 0.5), t_uniform(-0.5, 0.5), t_uniform(0, 1)}, u[2], v[2];
            double o[3], e[3], p[2], D[6];
            struct rec_projection q, n;
            T_OK(rec_camera_project(&was, X, u));
            T_OK(rec_camera_slopes(c, X, &q, D));
            worst = fmax(worst, hypot(u[0] - q.u, u[1] - q.v));
            for (int a = 0; a < 3; a++) {
                double Y[3];
                for (int k = 0; k < 3; k++)
                    Y[k] = X[k] + 1e-7 * c->R[3 * a + k];
                T_OK(rec_camera_project_full(c, Y, &n));
                slope =
                    fmax(slope, hypot((n.u - q.u) / 1e-7 - D[a], (n.v - q.v) / 1e-7 - D[3 + a]));
            }
            v[0] = t_uniform(0, W - 1);
            v[1] = t_uniform(0, H - 1);
            T_OK(rec_camera_ray(c, v[0], v[1], o, e));
            for (int a = 0; a < 3; a++)
                X[a] = o[a] + 1.5 * e[a];
            T_OK(rec_camera_project(c, X, p));
            round = fmax(round, hypot(p[0] - v[0], p[1] - v[1]));
        }
        T_LE(worst, size == 4 ? 3e-3 : 2e-3);
        T_LE(round, 1e-8);
        T_LE(slope, 0.5); /* of some 30 px/m; more only where a cell ends */
        T_NEAR(c->fx / rec_camera_depth(c, (double[3]){0, 0, 0.5}), 60 / 2.2, 3);
        char *text;
        size_t len;
        T_EQ_I(rec_rig_format(&r, &text, &len), PVX_OK);
        T_EQ_I(rec_rig_parse(text, len, "elsewhere.yaml", &back, &d), PVX_OK);
        T_OK(memcmp(r.cameras, back.cameras, sizeof *r.cameras) == 0);
        T_OK(rec_rig_hash(&r) == rec_rig_hash(&back));
        free(text);
        rec_rig_fini(&back);

        struct rec_rig pin = {.grid = grid, .n_cameras = 1, .cameras = &was};
        const struct rec_sysmat_params p = {2, 2};
        rec_sysmat *a, *b;
        T_EQ_I(rec_sysmat_build(&r, &p, NULL, NULL, NULL, &a, NULL), PVX_OK);
        T_EQ_I(rec_sysmat_build(&pin, &p, NULL, NULL, NULL, &b, NULL), PVX_OK);
        struct entries x = entries_of(a), y = entries_of(b);
        double sum = 0, other = 0;
        for (uint64_t i = 0; i < x.nnz; i++)
            sum += entries_value(&x, i);
        for (uint64_t i = 0; i < y.nnz; i++)
            other += entries_value(&y, i);
        T_NEAR(sum, other, 2e-3 * other);
        for (size_t j = 0; j < x.n; j++)
            for (uint32_t k = x.colptr[j]; k < x.colptr[j + 1]; k++) {
                struct rec_rect f = rec_footprint(a, 0, (int32_t)j);
                uint32_t bw = (uint32_t)a->block[0].bw, u = x.row[k] % bw, v = x.row[k] / bw;
                T_OK(rec_rect_seen(f) && u >= f.x0 && u <= f.x1 && v >= f.y0 && v <= f.y1);
            }
        entries_free(&x);
        entries_free(&y);
        rec_sysmat_free(&a);
        rec_sysmat_free(&b);
        rec_rig_fini(&r);
    }
    scratch_remove();
}

static void refused(const char *file, pvx_err e, const char *part)
{
    struct rec_rig r;
    struct pvx_diag d;
    T_EQ_I(load(file, &r, &d), e);
    T_CONTAINS(d.text, part);
    rec_rig_fini(&r);
}

T_CASE(files_that_are_not_rays)
{
    struct rec_camera c = lens();
    struct rec_rig r;
    struct pvx_diag d;
    scratch_new();
    write_rays(&c, at("hole.npy"), 4, true);
    T_EQ_I(load("hole.npy", &r, &d), PVX_OK);
    double o[3], e[3];
    T_OK(!rec_camera_ray(&r.cameras[0], 20, 20, o, e));
    T_OK(rec_camera_ray(&r.cameras[0], 30, 20, o, e));
    rec_rig_fini(&r);
    refused("none.npy", PVX_ENOENT, "rig.yaml:7: cameras[0].rays: none.npy: ");
    char *bytes;
    size_t len;
    T_EQ_I(pvx_file_read(at("hole.npy"), 1 << 20, &bytes, &len, &d), PVX_OK);
    for (size_t n = 0; n < len; n += n < 140 ? 1 : 997) { /* cut off anywhere */
        FILE *f = fopen(at("cut.npy"), "wb");
        fwrite(bytes, 1, n, f);
        fclose(f);
        T_OK(load("cut.npy", &r, &d) != PVX_OK);
        T_CONTAINS(d.text, "cameras[0].rays: cut.npy: ");
    }
    static const struct {
        const char *what, *with, *said;
        pvx_err e;
    } bad[] = {
        {"'<f4'", "'>f4'", "little-endian", PVX_EFORMAT},
        {"False", "True ", "in C order", PVX_EFORMAT},
        {"(48, 64, 6)", "(64, 48, 6)", "should have the shape (48, 64, 6)", PVX_EINVAL},
        {"(48, 64, 6)", "(48, 6, 64)", "or (48, 64, k, 6) for bundles of k rays", PVX_EINVAL},
        {"(48, 64, 6), }   ", "(48, 64, 0, 6), }", "bundles of 0 rays", PVX_EINVAL},
        {"(48, 64, 6), }    ", "(48, 64, 65, 6), }", "bundles of 65 rays", PVX_EINVAL},
        {"(48, 64, 6), }    ", "(48, 64, -1, 6), }", "bundles of -1 rays", PVX_EINVAL},
        {"(48, 64, 6), }   ", "(48, 64, 2, 6), }", "not the size", PVX_EFORMAT},
        {"(48, 64, 6), }   ", "(48, 64, 6, 6), }", "not the size", PVX_EFORMAT},
        {"(48, 64, 6), }   ", "(48, 64, 6, 1), }", "should have the shape", PVX_EINVAL},
        {"(48, 64, 6), }      ", "(48, 64, 1, 1, 6), }", "should have the shape", PVX_EINVAL},
        {"(48, 64, 6)", "(48, 64, 6 ", "should have the shape", PVX_EINVAL},
        {"NUMPY", "NUMPI", "not a .npy file", PVX_EFORMAT}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char *copy = malloc(len);
        memcpy(copy, bytes, len);
        char *p = memmem(copy, len, bad[i].what, strlen(bad[i].what));
        memcpy(p, bad[i].with, strlen(bad[i].with));
        FILE *f = fopen(at("bad.npy"), "wb");
        fwrite(copy, 1, len, f);
        fclose(f);
        refused("bad.npy", bad[i].e, bad[i].said);
        free(copy);
    }
    free(bytes);
    refused("hole.npy\n    K: [1, 1, 0, 0]", PVX_EINVAL, "'K' does not go with model: rays");
    scratch_remove();
}

/* ---- bundles ---------------------------------------------------------------------------------- */

enum { RAYS = 48 };

/* The ray of a pixel's bundle that is `ray`th in the file: in another order for each pixel. */
static void lens_ray(const struct rec_camera *c, int pixel, int ray, double o[3], double e[3])
{
    int k = (ray * 7 + pixel * 5) % RAYS;
    double far = 0.5 * c->blur.aperture * sqrt((k + 0.5) / RAYS), turn = 2.399963 * k;
    const double from[2] = {far * cos(turn), far * sin(turn)};
    T_OK(rec_camera_ray_from(c, pixel % W, pixel / W, from, o, e));
}

/* Bundles through points of equal area of the lens, moved along themselves.  lost: rays that one pixel lacks. */
static void write_bundles(const struct rec_camera *c, const char *name, int lost)
{
    FILE *f = new_file(name, 8, "48, 64, 48, 6");
    for (int i = 0; i < W * H * RAYS; i++) {
        double r[6], s = t_uniform(-0.3, 0.3);
        int pixel = i / RAYS;
        lens_ray(c, pixel, i % RAYS, r, r + 3);
        for (int a = 0; a < 3; a++)
            r[a] += s * r[3 + a];
        for (int a = 0; a < 6 && pixel == 20 * W + 20 && i % RAYS < lost; a++)
            r[a] = NAN;
        fwrite(r, sizeof r, 1, f);
    }
    fclose(f);
}

/* The difference of two cameras' matrices over the second one. */
static double matrix_off(const struct rec_rig *r, const struct rec_rig *of)
{
    const struct rec_sysmat_params p = {2, 2};
    rec_sysmat *m[2];
    struct entries e[2];
    double diff = 0, all = 0;
    for (int i = 0; i < 2; i++) {
        T_EQ_I(rec_sysmat_build(i == 0 ? r : of, &p, NULL, NULL, NULL, &m[i], NULL), PVX_OK);
        e[i] = entries_of(m[i]);
    }
    size_t rows = (size_t)m[0]->block[0].bw * (size_t)m[0]->block[0].bh;
    for (size_t j = 0; j < e[0].n; j++) {
        double column[2][W * H] = {{0}};
        for (int i = 0; i < 2; i++)
            for (uint32_t k = e[i].colptr[j]; k < e[i].colptr[j + 1]; k++)
                column[i][e[i].row[k]] = entries_value(&e[i], k);
        for (size_t k = 0; k < rows; k++) {
            diff += (column[0][k] - column[1][k]) * (column[0][k] - column[1][k]);
            all += column[1][k] * column[1][k];
        }
    }
    for (int i = 0; i < 2; i++) {
        entries_free(&e[i]);
        rec_sysmat_free(&m[i]);
    }
    return sqrt(diff / all);
}

static double picture_off(const struct rec_camera *c, const struct rec_camera *of)
{
    static float image[2][W * H * 3];
    struct rec_flame flame;
    struct rec_flame_pose pose;
    double diff = 0, all = 0;
    rec_flame_init(&flame, &grid, 5);
    rec_flame_at(&flame, 0.3, &pose);
    rec_flame_render(&pose, c, 2, 0, H, image[0]);
    rec_flame_render(&pose, of, 2, 0, H, image[1]);
    for (int i = 0; i < W * H * 3; i++) {
        double d = (double)image[0][i] - (double)image[1][i];
        diff += d * d;
        all += (double)image[1][i] * (double)image[1][i];
    }
    return sqrt(diff / all);
}

/* A lens out of focus and the file of its bundles: one matrix, one picture.  Points are projected as without the
 * blur, and the hull has the sharp footprints. */
T_CASE(bundles_are_the_defocus_of_their_lens)
{
    struct pvx_diag d;
    struct rec_rig r;
    struct rec_camera blurred = lens(), sharp;
    scratch_new();
    blurred.n_windows = 0;
    sharp = blurred;
    blurred.blur.aperture = 0.2;
    blurred.blur.focus = 4.4;
    write_bundles(&blurred, at("bundles.npy"), 0);
    T_EQ_I(load("bundles.npy", &r, &d), PVX_OK);
    T_EQ_S(d.text, "");
    struct rec_camera *c = &r.cameras[0], outline = *c;
    T_EQ_I(c->blur.rays, RAYS);
    for (int i = 0; i < 500; i++) {
        double X[3] = {t_uniform(-0.5, 0.5), t_uniform(-0.5, 0.5), t_uniform(0, 1)}, u[2], v[2];
        T_OK(rec_camera_project(&blurred, X, u));
        T_OK(rec_camera_project(c, X, v));
        T_LE(hypot(u[0] - v[0], u[1] - v[1]), 0.1); /* the points' mean is not quite the middle */
    }
    for (int i = 0; i < 500; i++) { /* each ray of a pixel is that of the file */
        int pixel = (int)t_uniform(0, W * H), ray = (int)t_uniform(0, RAYS);
        double o[3], e[3], p[3], q[3], along = 0, miss = 0;
        lens_ray(&blurred, pixel, ray, p, q);
        T_OK(rec_camera_ray_of(c, pixel % W, pixel / W, ray, o, e));
        for (int a = 0; a < 3; a++)
            along += (o[a] - p[a]) * q[a];
        for (int a = 0; a < 3; a++) {
            miss = fmax(miss, fabs(o[a] - p[a] - along * q[a]));
            T_NEAR(e[a], q[a], 1e-7);
        }
        T_LE(miss, 1e-7);
    }
    double disc = rec_blur_disc(c, &grid), most = rec_blur_disc(&blurred, &grid);
    T_LE(0.6 * most, disc); /* that of a lens takes the norm of two directions */
    T_LE(disc, most);
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig as = {.grid = grid, .n_cameras = 1, .cameras = &blurred},
                       focused = {.grid = grid, .n_cameras = 1, .cameras = &sharp};
        r.grid.basis = as.grid.basis = focused.grid.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
        T_LE(matrix_off(&r, &as), 0.05); /* other points of the aperture */
        T_LE(0.25, matrix_off(&focused, &as));
    }
    T_LE(picture_off(c, &blurred), 0.01);
    T_LE(0.08, picture_off(&sharp, &blurred));
    outline.blur = (struct rec_blur){0};
    T_LE(picture_off(&outline, &sharp), 0.02);
    rec_rig_fini(&r);
    scratch_remove();
}

T_CASE(a_bundle_of_one_is_the_ray)
{
    struct rec_camera c = lens();
    struct rec_rig one, r;
    struct pvx_diag d;
    char *bytes;
    size_t len;
    scratch_new();
    write_rays(&c, at("rays.npy"), 8, true);
    T_EQ_I(pvx_file_read(at("rays.npy"), 1 << 20, &bytes, &len, &d), PVX_OK);
    FILE *f = new_file(at("one.npy"), 8, "48, 64, 1, 6");
    fwrite(bytes + 128, 1, len - 128, f);
    fclose(f);
    free(bytes);
    T_EQ_I(load("rays.npy", &r, &d), PVX_OK);
    T_EQ_I(load("one.npy", &one, &d), PVX_OK);
    const struct rec_ray_table *s = r.cameras[0].table, *t = one.cameras[0].table;
    T_OK(t->hash != s->hash);
    T_OK(memcmp(t->line, s->line, W * H * sizeof *t->line) == 0);
    T_OK(memcmp(t->R, s->R, sizeof t->R) == 0 && memcmp(t->t, s->t, sizeof t->t) == 0);
    for (int basis = 0; basis < 2; basis++) {
        r.grid.basis = one.grid.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
        T_NEAR(matrix_off(&one, &r), 0, 0);
    }
    T_NEAR(picture_off(&one.cameras[0], &r.cameras[0]), 0, 0);
    rec_rig_fini(&r);
    rec_rig_fini(&one);
    scratch_remove();
}

/* A pixel without rays sees nothing, half a bundle is refused, and so is another blur. */
T_CASE(bundles_are_whole)
{
    struct rec_camera c = lens();
    struct rec_rig r, other;
    struct rec_bundle b;
    struct pvx_diag d;
    double o[3], e[3];
    scratch_new();
    c.n_windows = 0;
    c.blur = (struct rec_blur){.aperture = 0.2, .focus = 4.4};
    write_bundles(&c, at("hole.npy"), RAYS);
    T_EQ_I(load("hole.npy", &r, &d), PVX_OK);
    rec_bundle_init(&b, &r.cameras[0], 1, 1, &grid);
    T_EQ_I(rec_bundle_rays(&b), RAYS);
    for (int i = 0; i < RAYS; i++) {
        T_OK(!rec_bundle_ray(&b, 19.5, 19.5, i, o, e));
        T_OK(rec_bundle_ray(&b, 29.5, 19.5, i, o, e));
    }
    c.blur.focus = 4.5; /* the same mean rays: the hash is of all */
    write_bundles(&c, at("other.npy"), RAYS);
    T_EQ_I(load("other.npy", &other, &d), PVX_OK);
    T_OK(rec_rig_hash(&r) != rec_rig_hash(&other));
    rec_rig_fini(&other);
    rec_rig_fini(&r);
    write_bundles(&c, at("half.npy"), 20);
    refused("half.npy", PVX_EINVAL, "half.npy: pixel (20, 20) has only 28 of its 48 rays");
    refused("hole.npy\n    blur: { sigma: 1 }", PVX_EINVAL,
            "cameras[0].blur: does not go with bundles of rays");
    scratch_remove();
}
