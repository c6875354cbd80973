/* The hard cases, one by one, through the whole chain: pixels to volume.
 *
 * A case makes the pictures (from another flame, another rig), adds noise, spoils them.  What must come
 * out is the outcome and the error that were measured, for each size of the run, basis and solver
 * (stab.h); the error is that of the volume against the flame that was there, relative to it (or to the
 * flame that is missing). */
#include "tests/stability/stab.h"

#include <stdlib.h>
#include <string.h>

#include "tests/lib/centre.h"

struct hard_case {
    const char *name;
    enum stab_rig rig;
    size_t cameras;
    void (*picture)(struct stab_bed *b); /* NULL: the flame as it is */
    double noise;                        /* share of the brightest pixel */
    void (*spoil)(struct stab_bed *b);   /* NULL: nothing */
};

static void each(struct stab_bed *b, float (*f)(float v))
{
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        for (size_t i = 0; i < stab_pixels(b, c) * 3; i++)
            b->image[c][i] = f(b->image[c][i]);
}
static void no_truth(struct stab_bed *b)
{
    memset(b->truth, 0, b->voxels * 3 * sizeof *b->truth);
}
static void scale_truth(struct stab_bed *b, double by)
{
    for (size_t i = 0; i < b->voxels * 3; i++)
        b->truth[i] = (float)(b->truth[i] * by);
    b->norm *= by;
}
static void set(struct stab_bed *b, size_t camera, int32_t x, int32_t y, float v)
{
    float *p =
        b->image[camera] + ((size_t)y * (size_t)b->rig.cameras[camera].width + (size_t)x) * 3;
    p[0] = p[1] = p[2] = v;
}

/* ---- little light, much light -------------------------------------------------------------------*/

static float zero(float v)
{
    (void)v;
    return 0;
}
/* Leaves b->peak: the noise keeps its size. */
static void dark(struct stab_bed *b)
{
    each(b, zero);
    no_truth(b);
}
static void one_pixel(struct stab_bed *b)
{
    set(b, 0, b->rig.cameras[0].width / 2, b->rig.cameras[0].height / 2, 0.5f);
}
static void one_pixel_one_camera(struct stab_bed *b)
{
    one_pixel(b);
    for (size_t c = 1; c < b->rig.n_cameras; c++)
        b->present[c] = false;
    b->p.photo.despeckle = 0;
    b->p.hull.min_views = 1;
    b->residual = true;
}
static float flat(float v)
{
    (void)v;
    return 0.5f;
}
static void all_lit(struct stab_bed *b)
{
    each(b, flat);
    no_truth(b);
    b->residual = true;
}
static float hazy(float v)
{
    return v + 0.02f;
}
static void haze(struct stab_bed *b)
{
    each(b, hazy);
}

/* ---- silhouettes --------------------------------------------------------------------------------*/

/* Camera 0 sees the flame a tenth of the picture further right than it is. */
static void shifted(struct stab_bed *b)
{
    size_t w = (size_t)b->rig.cameras[0].width, by = w / 10;
    for (size_t y = 0; y < (size_t)b->rig.cameras[0].height; y++) {
        float *row = b->image[0] + y * w * 3;
        memmove(row + by * 3, row, (w - by) * 3 * sizeof *row);
        memset(row, 0, by * 3 * sizeof *row);
    }
}
/* Each camera sees a small light, and no two of them the same one. */
static void disagree(struct stab_bed *b)
{
    dark(b);
    for (size_t c = 0; c < b->rig.n_cameras; c++) {
        int32_t w = b->rig.cameras[c].width, h = b->rig.cameras[c].height;
        int32_t x0 = (int32_t)(w * (c % 2 == 0 ? 0.3 : 0.65)),
                y0 = (int32_t)(h * (0.2 + 0.075 * c));
        for (int32_t y = y0; y < y0 + h / 20; y++)
            for (int32_t x = x0; x < x0 + w / 20; x++)
                set(b, c, x, y, 0.5f);
    }
}

/* ---- bad pixels ---------------------------------------------------------------------------------*/

static float clip(float v)
{
    return v > 1 ? 1 : v;
}
static float twice(float v)
{
    return 2 * v;
}
static void exposed_twice(struct stab_bed *b)
{
    each(b, twice);
    scale_truth(b, 2);
}
static void saturate(struct stab_bed *b)
{
    each(b, clip);
}
static void hot_pixels(struct stab_bed *b)
{
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        for (size_t i = 0; i < stab_pixels(b, c); i++)
            if (pvx_uniform(&b->rng) < 0.005)
                for (size_t l = 0; l < 3; l++)
                    b->image[c][i * 3 + l] = 1;
}
static void not_finite(struct stab_bed *b)
{
    static const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f};
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        for (size_t i = 0; i < stab_pixels(b, c); i++)
            if (pvx_uniform(&b->rng) < 0.01) {
                float *p = b->image[c] + i * 3;
                p[(size_t)(3 * pvx_uniform(&b->rng))] = bad[(size_t)(5 * pvx_uniform(&b->rng))];
            }
}
static void camera_of_nans(struct stab_bed *b)
{
    for (size_t i = 0; i < stab_pixels(b, 2) * 3; i++)
        b->image[2][i] = NAN;
}
static void black_camera(struct stab_bed *b)
{
    memset(b->image[2], 0, stab_pixels(b, 2) * 3 * sizeof *b->image[2]);
}
static void camera_missing(struct stab_bed *b)
{
    b->present[2] = false;
}

/* ---- ranges -------------------------------------------------------------------------------------*/

/* Amplitudes of the blobs spread evenly, in their logarithms, over six decades. */
static void six_decades(struct stab_bed *b)
{
    for (int g = 0; g < b->pose.n; g++)
        for (int l = 0; l < 3; l++)
            b->pose.blob[g].a[l] *= pow(10, -6.0 * g / (b->pose.n - 1));
    stab_bed_render(b, NULL);
    b->p.photo.threshold = (float)(1e-7 * b->peak);
}
static double factor;
static float scaled(float v)
{
    return (float)(v * factor);
}
static void scale_pictures(struct stab_bed *b, double by)
{
    factor = by;
    each(b, scaled);
    scale_truth(b, by);
    b->peak *= by;
    b->p.photo.floor = (float)(b->p.photo.floor * by);
    b->p.photo.saturation = 1e30f;
}
static void millionth(struct stab_bed *b)
{
    scale_pictures(b, 1e-6);
}
static void million(struct stab_bed *b)
{
    scale_pictures(b, 1e6);
}
static void denormal(struct stab_bed *b)
{
    scale_pictures(b, 1e-40);
}
static void denormal_below_floor(struct stab_bed *b)
{
    scale_pictures(b, 1e-40);
    b->p.photo.floor = rec_photo_defaults.floor;
}

/* ---- what is not as it was calibrated -----------------------------------------------------------*/

static void off_by_a_pixel(struct stab_bed *b)
{
    struct rec_camera moved[REC_MAX_CAMERAS];
    for (size_t c = 0; c < b->rig.n_cameras; c++) {
        moved[c] = b->rig.cameras[c];
        moved[c].cx += c % 2 == 0 ? 1 : -1;
        moved[c].cy += c / 2 % 2 == 0 ? 1 : -1;
    }
    stab_bed_render(b, moved);
}
static void off_by_a_pixel_with_margin(struct stab_bed *b)
{
    off_by_a_pixel(b);
    b->p.photo.margin = 1;
}
static float eight_bits(float v)
{
    return v < 0 ? 0 : v > 1 ? 1 : floorf(v * 255 + 0.5f) / 255;
}
static void quantised(struct stab_bed *b)
{
    each(b, eight_bits);
}
static void any_value(struct stab_bed *b)
{
    b->p.photo.saturation = 1e30f;
}

#define RING RIG_RING, 8
/* ---- terms of the model -------------------------------------------------------------------------*/

/* An optical depth of `depth` along the densest ray, by the closed form of absorb.h for one colour. */
static void absorb(struct stab_bed *b, double depth)
{
    double densest = 0, c;
    for (size_t k = 0; k < b->rig.n_cameras; k++)
        for (size_t i = 0; i < stab_pixels(b, k); i++) {
            const float *v = b->image[k] + 3 * i;
            densest = fmax(densest, ((double)v[0] + (double)v[1] + (double)v[2]) / 3);
        }
    b->p.absorption = c = depth / densest;
    for (size_t k = 0; k < b->rig.n_cameras; k++)
        for (size_t i = 0; i < stab_pixels(b, k); i++) {
            float *v = b->image[k] + 3 * i;
            double thick = c * ((double)v[0] + (double)v[1] + (double)v[2]) / 3;
            for (int l = 0; l < 3 && thick > 0; l++)
                v[l] *= (float)(-expm1(-thick) / thick);
        }
    b->peak *= -expm1(-depth) / depth; /* the noise is a share of what is seen */
}
static void depth_5(struct stab_bed *b)
{
    absorb(b, 5);
}
static void bounds(struct stab_bed *b)
{
    b->p.at_least = true;
    saturate(b);
}
static float clip_low(float v)
{
    return fminf(v, 0.05F);
}
static void all_saturated(struct stab_bed *b)
{
    b->p.at_least = true;
    b->p.photo.saturation = 0.05F;
    each(b, clip_low);
}
static void in_vain(struct stab_bed *b)
{
    b->p.at_least = b->p.temporal = true;
}
static void all_terms(struct stab_bed *b)
{
    absorb(b, 2);
    in_vain(b);
}

static const struct hard_case cases[] = {
    {"nothing hard, 1 % noise", RING, NULL, 0.01, NULL},
    {"empty frame", RING, dark, 0, NULL},
    {"empty frame, noise alone", RING, dark, 0.01, NULL},
    {"one lit pixel", RING, dark, 0, one_pixel},
    /* what the other cameras deny is misfit, and misfit smooths */
    {"one lit pixel, one camera (residual)", RING, dark, 0, one_pixel_one_camera},
    {"all pixels lit evenly (residual)", RING, all_lit, 0, NULL},
    {"all pixels lit: flame behind haze", RING, NULL, 0.01, haze},
    {"2 views", RIG_RING, 2, NULL, 0.01, NULL},
    {"3 views", RIG_RING, 3, NULL, 0.01, NULL},
    {"two cameras almost in one place", RIG_TWINS, 8, NULL, 0.01, NULL},
    {"all cameras in a plane", RIG_PLANE, 8, NULL, 0.01, NULL},
    {"camera inside the volume", RIG_INSIDE, 8, NULL, 0.01, NULL},
    {"rays along faces and edges", RIG_FACES, 8, NULL, 0.01, NULL},
    {"silhouettes contradict: one shifted by a tenth", RING, NULL, 0.01, shifted},
    {"silhouettes contradict: nothing in common", RING, disagree, 0, NULL},
    {"saturated pixels, exposure doubled", RING, exposed_twice, 0.01, saturate},
    {"hot pixels, 0.5 %", RING, NULL, 0.01, hot_pixels},
    {"dynamic range 10^6", RING, six_decades, 0, NULL},
    {"pictures x 10^-6", RING, millionth, 0.01, NULL},
    {"pictures x 10^6", RING, million, 0.01, NULL},
    {"denormal pixels", RING, denormal_below_floor, 0.01, NULL},
    {"denormal pixels, threshold as low", RING, denormal, 0.01, NULL},
    {"NaN, Inf and huge pixels, 1 %", RING, NULL, 0.01, not_finite},
    {"a camera of NaNs", RING, NULL, 0.01, camera_of_nans},
    {"a black camera", RING, NULL, 0.01, black_camera},
    {"a camera missing", RING, NULL, 0.01, camera_missing},
    {"calibration off by a pixel", RING, off_by_a_pixel, 0.01, NULL},
    {"calibration off by a pixel, margin 1", RING, off_by_a_pixel_with_margin, 0.01, NULL},
    {"noise 5 %", RING, NULL, 0.05, any_value},
    {"noise 10 %", RING, NULL, 0.1, any_value},
    {"noise 20 %", RING, NULL, 0.2, any_value},
    {"noise 30 %", RING, NULL, 0.3, any_value},
    {"8-bit pictures, no noise", RING, NULL, 0, quantised},
    {"8-bit pictures, noise 5 % clipped at black", RING, NULL, 0.05, quantised},
    {"saturated pixels, exposure doubled, as bounds", RING, exposed_twice, 0.01, bounds},
    {"all of the flame saturated, as bounds", RING, NULL, 0.01, all_saturated},
    {"absorption to a depth of 5, c known", RING, depth_5, 0.01, NULL},
    {"terms that the scene has no need of", RING, NULL, 0.01, in_vain},
    {"all terms at once, depth 2", RING, all_terms, 0.01, NULL},
};
#undef RING

/* In a quick run the other solvers do every third case. */
static void run_case(const struct hard_case *c, struct stab_bed *b)
{
    bool box = b->rig.grid.basis == REC_BOX;
    stab_bed_reset(b);
    if (c->picture != NULL)
        c->picture(b);
    stab_bed_noise(b, c->noise);
    if (c->spoil != NULL)
        c->spoil(b);
    for (const char *const *s = rec_solver_names(); *s != NULL; s++) {
        bool standard = s == rec_solver_names();
        if (!standard && (!box || b->run->card != NULL || (b->run->quick && (c - cases) % 3 != 0)))
            continue;
        struct stab_result r = stab_reconstruct(b, *s);
        struct stab_row row = stab_row_of(c->name, b, *s, &r);
        stab_add(&row);
    }
}

/* ---- cases with a course of their own ----------------------------------------------------------*/

/* Camera 2 leaves a running flame after two frame sets and is back for the last; every set starts
 * from the one before.  The worst error of the five; and what the drop-out left behind must not show:
 * the last set solved once more from nothing has the bits of a new slot. */
static void mid_stream(const struct stab_run *run, enum rec_basis basis)
{
    struct stab_bed b;
    rec_frame *f[2];
    struct rec_sparse last = {0};
    struct stab_result worst = {.finite = true};
    struct rec_flame flame;
    stab_bed_new(&b, run, RIG_RING, 8, basis, run->size);
    rec_flame_init(&flame, &b.rig.grid, 1);
    for (int i = 0; i < 2; i++)
        CHECK(rec_frame_alone(b.S, &b.rig, &b.p, run->pool, &f[i], NULL));
    for (int k = 0; k < 5; k++) {
        rec_flame_at(&flame, 0.3 + 0.02 * k, &b.pose);
        stab_bed_render(&b, NULL);
        stab_bed_noise(&b, 0.01);
        b.present[2] = k < 2 || k > 3;
        struct stab_result r = stab_solve(&b, f[k % 2], k > 0 ? &last : NULL);
        bool fine = worst.finite && r.finite;
        if (r.error >= worst.error)
            worst = r;
        worst.finite = fine;
        rec_frame_volume(f[k % 2], &last);
    }
    struct rec_sparse again, fresh;
    rec_frame *clean;
    CHECK(rec_frame_alone(b.S, &b.rig, &b.p, run->pool, &clean, NULL));
    stab_solve(&b, f[0], NULL);
    stab_solve(&b, clean, NULL);
    rec_frame_volume(f[0], &again);
    rec_frame_volume(clean, &fresh);
    bool same =
        again.n == fresh.n && memcmp(again.value, fresh.value,
                                     (size_t)fresh.n * (size_t)fresh.cs * sizeof *fresh.value) == 0;
    struct stab_row row =
        stab_row_of("a camera drops out in mid-stream", &b, rec_solver_names()[0], &worst);
    row.sound = row.sound && same;
    stab_add(&row);
    rec_frame_free(&clean);
    for (int i = 0; i < 2; i++)
        rec_frame_free(&f[i]);
    stab_bed_free(&b);
}

/* One unknown: the one voxel of a grid, or one of 8^3 of which each camera shows one lit pixel in the
 * dark.  The error is that against the least squares solution, worked out here ray by ray,
 *
 *     x = sum s_n b_n / sum s_n^2     over all rays n that meet the voxel                    (1) */
static void one_voxel(const struct stab_run *run, enum rec_basis basis, int32_t grid)
{
    struct stab_bed b;
    static const float emission[3] = {0.7f, 0.2f, 0.01f};
    stab_bed_new(&b, run, RIG_RING, 6, basis, (struct stab_size){grid, run->size.w, run->size.h});
    static const struct rec_sysmat_params one_ray = {.binning = 1, .rays_per_bin = 1}; /* as (1) */
    rec_sysmat_free(&b.S);
    CHECK(rec_sysmat_build(&b.rig, &one_ray, run->pool, NULL, NULL, &b.S, NULL));
    int32_t lit = rec_grid_index(&b.rig.grid, grid / 2, grid / 2, grid / 2);
    dark(&b);
    b.p.photo.threshold = 1e-6f;
    b.p.photo.despeckle = 0;
    b.p.solve.lambda = 0; /* a prior would hold x down */
    int32_t *index = malloc(rec_traverse_max(&b.rig.grid) * sizeof *index);
    float *value = malloc(rec_traverse_max(&b.rig.grid) * sizeof *value);
    if (index == NULL || value == NULL)
        CHECK(PVX_ENOMEM);
    double sb = 0, ss = 0;
    for (size_t c = 0; c < b.rig.n_cameras; c++) {
        const struct rec_camera *cam = &b.rig.cameras[c];
        double centre[3], uv[2], o[3], d[3];
        grid_centre(&b.rig.grid, lit, centre);
        if (!rec_camera_project(cam, centre, uv))
            CHECK(PVX_EINVAL);
        for (int32_t y = 0; y < cam->height; y++)
            for (int32_t x = 0; x < cam->width; x++) {
                bool seen = grid == 1 ||
                            (x == (int32_t)floor(uv[0] + 0.5) && y == (int32_t)floor(uv[1] + 0.5));
                float *p = b.image[c] + ((size_t)y * (size_t)cam->width + (size_t)x) * 3;
                if (!rec_camera_ray(cam, x, y, o, d))
                    continue;
                size_t n = rec_traverse(&b.rig.grid, o, d, index, value);
                for (size_t i = 0; i < n; i++) {
                    if (index[i] != lit)
                        continue;
                    ss += (double)value[i] * value[i];
                    sb += seen ? (double)value[i] * value[i] : 0;
                    for (int l = 0; seen && l < 3; l++)
                        p[l] = emission[l] * value[i];
                }
            }
    }
    b.norm = 0;
    for (int l = 0; l < 3; l++) {
        double x = emission[l] * sb / ss;
        b.truth[(size_t)lit * 3 + (size_t)l] = (float)x;
        b.norm += x * x;
    }
    b.norm = sqrt(b.norm);
    free(index);
    free(value);
    for (const char *const *s = rec_solver_names(); *s != NULL; s++) {
        if (s != rec_solver_names() && run->card != NULL)
            break;
        struct stab_result r = stab_reconstruct(&b, *s);
        struct stab_row row =
            stab_row_of(grid == 1 ? "grid of one voxel" : "hull of one voxel", &b, *s, &r);
        if (grid == 1) /* values are within a 254th of the diagonal, and on average half of it */
            row.bound = 1.0 / 127;
        row.sound = row.sound && r.report.active_voxels == 1;
        stab_add(&row);
    }
    stab_bed_free(&b);
}

void stab_cases(const struct stab_run *run)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        struct stab_bed b;
        const struct hard_case *made = NULL;
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
            const struct hard_case *c = &cases[i];
            if (made != NULL && (made->rig != c->rig || made->cameras != c->cameras)) {
                stab_bed_free(&b);
                made = NULL;
            }
            if (made == NULL)
                stab_bed_new(&b, run, c->rig, c->cameras, (enum rec_basis)basis, run->size);
            made = c;
            run_case(c, &b);
        }
        stab_bed_free(&b);
        mid_stream(run, (enum rec_basis)basis);
        one_voxel(run, (enum rec_basis)basis, 1);
    }
    one_voxel(run, REC_BOX, 8);
}
