/* A flame that absorbs its own light: the closed form against the integral, what it does to a picture, and a
 * volume and its c from pictures that were made by marching. */
#include <math.h>

#include "recon/carve/absorb.h"
#include "recon/check/absorption.h"
#include "tests/lib/scene.h"

/* Light of n slabs of emission e[][3], the nearest first, each ds thick. */
static void march(const double (*e)[3], size_t n, double ds, double c, double out[3])
{
    double depth = 0;
    out[0] = out[1] = out[2] = 0;
    for (size_t i = 0; i < n; i++) {
        double thick = c * (e[i][0] + e[i][1] + e[i][2]) / 3 * ds;
        double left = exp(-depth) * (thick > 0 ? -expm1(-thick) / thick : 1);
        for (int l = 0; l < 3; l++)
            out[l] += e[i][l] * ds * left;
        depth += thick;
    }
}

T_CASE(what_is_seen_does_not_depend_on_where_it_burns)
{
    for (int k = 0; k < 200; k++) {
        double e[50][3], turned[50][3], near[3], far[3], sum = 0, c = 0.1 + 3 * t_uniform(0, 1);
        for (int i = 0; i < 50; i++)
            for (int l = 0; l < 3; l++)
                turned[49 - i][l] = e[i][l] = i % 7 == 0 ? 0 : t_uniform(0, 1) * (l == 0);
        for (int i = 0; i < 50; i++)
            sum += e[i][0] * 0.05 / 3;
        march(e, 50, 0.05, c, near);
        march(turned, 50, 0.05, c, far);
        T_NEAR(near[0], far[0], 1e-12);
        T_NEAR(rec_absorb_seen(c, sum), near[0] / 3, 1e-12);
        T_NEAR(rec_absorb_emitted(c, near[0] / 3), sum, 1e-9);
    }
}

T_CASE(emitted_and_seen_are_inverse_and_smooth_everywhere)
{
    for (double c = 0.01; c < 50; c *= 1.7)
        for (double e = -0.2; e < 3; e += 0.0137) {
            double seen = rec_absorb_seen(c, e), h = 1e-6;
            T_NEAR(rec_absorb_emitted(c, seen), e, 1e-7 * (1 + fabs(e)));
            if (c * e < 3.9 && e > 0.01) { /* the derivative is the ray's transmission */
                double slope = (rec_absorb_seen(c, e + h) - rec_absorb_seen(c, e - h)) / (2 * h);
                T_NEAR(slope, exp(-c * e), 1e-5);
            }
            T_OK(rec_absorb_seen(c, e + 0.01) > seen); /* beyond what can be seen too */
        }
}

T_CASE(channels_of_one_colour_come_back_and_others_nearly)
{
    static const uint8_t lit[1] = {1};
    for (int k = 0; k < 500; k++) {
        double e[30][3], c = 0.2 + 2 * t_uniform(0, 1), seen[3], sum[3] = {0}, mean = 0;
        double vary = k % 2 == 0 ? 0 : 0.3, tint[3] = {1, 0.6, 0.2};
        for (int i = 0; i < 30; i++) {
            double much = t_uniform(0, 1), hue = vary * (t_uniform(0, 1) - 0.5);
            for (int l = 0; l < 3; l++) {
                e[i][l] = much * (tint[l] + hue * (l - 1));
                sum[l] += e[i][l] * 0.1;
                mean += e[i][l] * 0.1 / 3;
            }
        }
        if (c * mean > 3.5)
            continue;
        march(e, 30, 0.1, c, seen);
        float b[4] = {(float)seen[0], (float)seen[1], (float)seen[2], 0}, w[1] = {1};
        rec_absorb_apply(&(struct rec_absorb_picture){
            .c = c, .n = 1, .nch = 3, .lit = lit, .b = b, .weight = w});
        for (int l = 0; l < 3; l++)
            T_NEAR((double)b[l], sum[l], (vary > 0 ? 0.1 : 1e-4) * (mean + 0.01));
        T_OK(w[0] > 0 && w[0] < 1);
        double D = exp(-c * mean), R = -expm1(-c * mean) / (c * mean);
        T_NEAR((double)w[0], 1 / (1 / (R * R) + (1 / (D * D) - 1 / (R * R)) / 3), 1e-4);
    }
}

T_CASE(noise_is_as_large_as_its_weight_says)
{
    enum { N = 20000 };
    static float b[N], w[N];
    static uint8_t lit[N];
    double c = 1.5, e = 0.9, sum = 0, sum2 = 0;
    for (int i = 0; i < N; i++) {
        b[i] = (float)(rec_absorb_seen(c, e) + 0.003 * t_normal());
        w[i] = lit[i] = 1;
    }
    rec_absorb_apply(
        &(struct rec_absorb_picture){.c = c, .n = N, .nch = 1, .lit = lit, .b = b, .weight = w});
    for (int i = 0; i < N; i++) {
        double off = (double)b[i] - e;
        sum += off;
        sum2 += (double)w[i] * off * off;
    }
    T_NEAR(sqrt(sum2 / N), 0.003, 0.0002);
    T_NEAR(sum / N, 0, 0.001);
}

T_CASE(what_is_not_a_number_or_none_stays)
{
    static const uint8_t lit[4] = {1, 1, 0, 1};
    float b[4] = {NAN, INFINITY, 0.005F, 1e9F}, w[4] = {0, 0, 1, 1}, kept[4];
    memcpy(kept, b, sizeof b);
    struct rec_absorb_picture p = {.c = 0, .n = 4, .nch = 1, .lit = lit, .b = b, .weight = w};
    rec_absorb_apply(&p);
    T_OK(memcmp(b, kept, sizeof b) == 0);
    p.c = 2;
    rec_absorb_apply(&p);
    T_OK(w[0] == 0 && w[1] == 0 && b[2] == kept[2] && w[2] == 1); /* dark: noise is left alone */
    T_OK(isfinite(b[3]) && b[3] > 1e9F && w[3] > 0 && w[3] < 0.01F);
}

/* ---- a whole chain ---- */

/* Emission of the blobs. */
static void emission(const struct rec_flame_pose *p, const double x[3], double out[3])
{
    out[0] = out[1] = out[2] = 0;
    for (int b = 0; b < p->n; b++) {
        double r2 = 0;
        for (int a = 0; a < 3; a++) {
            double u = (x[a] - p->blob[b].m[a]) / p->blob[b].s[a];
            r2 += u * u;
        }
        for (int l = 0; l < 3 && r2 < 25; l++)
            out[l] += p->blob[b].a[l] * exp(-0.5 * r2);
    }
}

/* The scene's pictures again, the light absorbed on its way.  A slab of flame: deep from two sides. */
static void darken(struct scene *s, double c)
{
    for (int b = 0; b < s->pose.n; b++) {
        s->pose.blob[b].m[0] *= 0.35;
        s->pose.blob[b].m[1] *= 1.2;
        s->pose.blob[b].s[0] *= 0.6;
    }
    rec_flame_voxels(&s->pose, &s->rig.grid, 0, s->rig.grid.n[2], s->truth);
    for (size_t k = 0; k < s->rig.n_cameras; k++) {
        const struct rec_camera *cam = &s->rig.cameras[k];
        for (int32_t i = 0; i < cam->width * cam->height; i++) {
            double o[3], d[3], e[120][3], seen[3];
            if (!rec_camera_ray(cam, i % cam->width, (double)(i / cam->width), o, d))
                continue;
            for (int n = 0; n < 120; n++) {
                double x[3];
                for (int a = 0; a < 3; a++)
                    x[a] = o[a] + (1.4 + (n + 0.5) * 1.8 / 120) * d[a];
                emission(&s->pose, x, e[n]);
            }
            march(e, 120, 1.8 / 120, c, seen);
            for (int l = 0; l < 3; l++)
                s->image[k][i * 4 + l] = (float)seen[l];
        }
    }
}

static double error_with(const struct scene *s, double c, bool bayer)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_frame *f;
    p.photo.saturation = REC_PHOTO_UNSATURATED;
    p.absorption = c;
    if (rec_frame_alone(s->S, &s->rig, &p, s->pool, &f, NULL) != PVX_OK)
        exit(2);
    scene_shoot(s, f, 0);
    if (bayer)
        scene_filter(s, f);
    rec_frame_carve(f);
    T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
    rec_frame_volume(f, &v);
    double e = scene_error(s, &v);
    rec_frame_free(&f);
    return e;
}

struct given {
    const struct scene *s;
    float *grey[REC_MAX_CAMERAS];
};
static pvx_err get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct given *g = ctx;
    *out = (struct rec_check_set){i, (const float *const *)g->grey, true};
    return PVX_OK;
}

static struct rec_absorption find(const struct scene *s)
{
    struct given g = {.s = s};
    const struct rec_unseen_params p = {.voxels = 24, .binning = 1, .rays = 2, .margin = 1};
    struct rec_check_source from = {.n = 1, .get = get, .ctx = &g};
    struct rec_absorption a = {0};
    rec_unseen *u;
    for (size_t k = 0; k < s->rig.n_cameras; k++) {
        size_t n = s->S->row0[k + 1] - s->S->row0[k];
        g.grey[k] = pvx_calloc(n, sizeof(float));
        for (size_t i = 0; i < n; i++)
            g.grey[k][i] =
                (s->image[k][4 * i] + s->image[k][4 * i + 1] + s->image[k][4 * i + 2]) / 3;
    }
    if (rec_unseen_new(&s->rig, &p, s->pool, &u, NULL) != PVX_OK)
        exit(2);
    T_OK(rec_absorption_find(u, &from, &a, NULL) == PVX_OK);
    for (size_t k = 0; k < s->rig.n_cameras; k++) /* nothing burns */
        memset(g.grey[k], 0, (s->S->row0[k + 1] - s->S->row0[k]) * sizeof(float));
    struct rec_absorption none;
    struct pvx_diag d = {""};
    T_OK(rec_absorption_find(u, &from, &none, &d) == PVX_ENOENT && none.c == 0);
    T_OK(strstr(d.text, "no") != NULL);
    rec_unseen_free(&u);
    for (size_t k = 0; k < s->rig.n_cameras; k++)
        free(g.grey[k]);
    return a;
}

T_CASE(a_volume_and_its_absorption_from_pictures)
{
    struct scene s;
    scene_new(&s, 8, 80, 24, 2, 2);
    scene_at(&s, 0.3);
    darken(&s, 0);
    struct rec_absorption a = find(&s);
    double thin = error_with(&s, 0, false);
    T_OK(a.c == 0 && a.sets == 1 && a.views == 8);
    scene_at(&s, 0.3);
    darken(&s, 6);
    a = find(&s);
    double off = error_with(&s, 0, false), on = error_with(&s, 6, false),
           found = error_with(&s, a.c, false);
    printf("  thin %.3f; deep %.3f, with c %.3f, with the %.2f that is found %.3f (gain %.2f)\n",
           thin, off, on, a.c, found, a.gain);
    double rows = error_with(&s, 6, true), rows_off = error_with(&s, 0, true);
    printf("  Bayer pixels as they are: %.3f, without %.3f\n", rows, rows_off);
    T_OK(rows < 0.7 * rows_off);
    T_OK(off > 1.5 * thin);
    T_OK(on < 1.1 * thin);
    T_OK(found < 1.1 * thin);
    T_OK(a.c > 0.85 * 6 && a.c < 1.15 * 6);
    T_OK(a.gain > REC_ABSORPTION_GAIN && 4 * a.better >= 3 * a.views);
    scene_free(&s);
}
