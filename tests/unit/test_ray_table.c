/* test_ray_table.c - rays from a file that were made with a lens behind glass see what that camera sees. */
#include "recon/geom/ray_table.h"

#include "base/file.h"
#include "recon/geom/rig.h"
#include "recon/matrix/sysmat.h"
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

/* Its rays, moved along themselves at random, as a file.  size 4 or 8; hole: one pixel without a ray. */
static void write_rays(const struct rec_camera *c, const char *name, int size, bool hole)
{
    char text[256];
    int n =
        snprintf(text, sizeof text,
                 "{'descr': '<f%d', 'fortran_order': False, 'shape': (%d, %d, 6), }", size, H, W);
    memset(text + n, ' ', (size_t)(118 - n));
    text[117] = '\n';
    FILE *f = fopen(name, "wb");
    fwrite("\x93NUMPY\x01\x00\x76\x00", 1, 10, f);
    fwrite(text, 1, 118, f);
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
    } bad[] = {{"'<f4'", "'>f4'", "little-endian", PVX_EFORMAT},
               {"False", "True ", "in C order", PVX_EFORMAT},
               {"(48, 64, 6)", "(64, 48, 6)", "should have the shape (48, 64, 6)", PVX_EINVAL},
               {"(48, 64, 6)", "(48, 6, 64)", "bundles of rays", PVX_EINVAL},
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
