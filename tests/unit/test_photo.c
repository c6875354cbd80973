#include "../t.h"

#include "recon/carve/photo.h"

#define W 64
#define H 48
static float img[W * H * 4] __attribute__((aligned(16))), weight[W * H],
    back[W * H * 4] __attribute__((aligned(16)));
static uint8_t lit[W * H];
static const float one[3] = {1, 1, 1};
static struct rec_photo_stats st;

static void apply(int nch, const float *background, const float *gain,
                  const struct rec_photo_params *p)
{
    struct rec_photo_work *work = rec_photo_work_new(W, H);
    rec_photo_apply(&(struct rec_photo_image){.img = img,
                                              .bw = W,
                                              .bh = H,
                                              .nch = nch,
                                              .background = background,
                                              .gain = gain,
                                              .params = p,
                                              .weight = weight,
                                              .lit = lit,
                                              .stats = &st,
                                              .work = work},
                    1, NULL);
    free(work);
}

/* A round flame of radius 10 in the middle, `top` bright, on noise. */
static void paint(int cs, double top, double noise, int clip)
{
    for (int i = 0; i < W * H; i++)
        for (int l = 0; l < cs; l++) {
            double x = i % W - W / 2, y = i / W - H / 2, r = sqrt(x * x + y * y);
            double v = (r < 10 ? top * (1 - r / 10) : 0) + noise * t_normal();
            img[i * cs + l] = (float)(clip && v < 0 ? 0 : v);
        }
}

/* A flame of a fiftieth of full scale, exact: with steps of 8 bits its outer fifth is dark, else half a percent is; no
 * picture is judged below REC_PHOTO_DIMMEST, and a bright one as ever. */
T_CASE(a_dim_picture_has_a_lower_floor)
{
    static const struct {
        double top;
        float dim, threshold;
    } cases[] = {{0.02, 0, 0.004f},     {0.2, 0.005f, 0.001f}, {0.02, 0.005f, REC_PHOTO_DIMMEST},
                 {0.8, 0.005f, 0.004f}, {3, 0.005f, 0.004f},   {0, 0.005f, REC_PHOTO_DIMMEST}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int nch = 1; nch <= 3; nch += 2) {
            struct rec_photo_params p = rec_photo_defaults;
            uint32_t above = 0;
            p.dim = cases[i].dim;
            p.despeckle = 0;
            paint(nch == 3 ? 4 : 1, cases[i].top, 0, 0);
            img[0] = -7; /* a dead bin is not the brightest */
            for (int k = 0; k < W * H; k++)
                above += img[k * (nch == 3 ? 4 : 1)] >= cases[i].threshold;
            apply(nch, NULL, one, &p);
            T_NEAR(st.threshold, cases[i].threshold, 1e-9);
            T_OK(st.lit >= above); /* and means */
            T_OK(st.lit <= (cases[i].top > 0 ? 361 : 0));
            p.threshold = 0.003f;
            paint(nch == 3 ? 4 : 1, cases[i].top, 0, 0);
            apply(nch, NULL, one, &p);
            T_NEAR(st.threshold, 0.003, 1e-9);
        }
}

T_CASE(gain_black_background)
{
    struct rec_photo_params p = rec_photo_defaults;
    const float gain[3] = {2, 1, 0.5f};
    for (int i = 0; i < W * H * 4; i++) {
        img[i] = 0.5f;
        back[i] = 0.1f;
    }
    p.black = 0.05f;
    apply(3, back, gain, &p);
    T_NEAR(img[0], 0.7, 1e-6);
    T_NEAR(img[1], 0.35, 1e-6);
    T_NEAR(img[2], 0.175, 1e-6);
    T_EQ_I(img[3], 0); /* the 4th float is cleared */
    T_EQ_I(st.lit, W * H);
    T_EQ_I(weight[5], 1);
    T_NEAR(st.sigma[0], 0, 1e-6);
}

/* In 6000 draws sigma was off by 0.0004 (one deviation; clipped by 0.0007 +- 0.0004), the threshold by 0.0021, and five
 * pixels outside were lit at most: limits are six deviations and more. */
T_CASE(noise_is_estimated)
{
    struct rec_photo_params p = rec_photo_defaults;
    for (int nch = 1; nch <= 3; nch += 2)
        for (int clip = 0; clip < 2; clip++) {
            paint(nch == 3 ? 4 : 1, 0.6, 0.01, clip);
            apply(nch, NULL, one, &p);
            for (int c = 0; c < nch; c++) /* of clipped noise a block's mean tells of its spread */
                T_NEAR(st.sigma[c], 0.01, clip ? 0.0035 : 0.0025);
            T_NEAR(st.threshold, 0.04, 0.014);
            int centre = lit[H / 2 * W + W / 2], edge = lit[H / 2 * W + W / 2 + 9], outside = 0;
            for (int i = 0; i < W * H; i++) {
                double x = i % W - W / 2, y = i / W - H / 2;
                outside += lit[i] && x * x + y * y > 13 * 13;
            }
            T_EQ_I(centre, 1);
            T_EQ_I(edge, 1); /* 0.06 bright: lit by itself or by the mean of 3x3 */
            T_LE(outside, 20);
        }
}

T_CASE(faint_flame_by_means)
{
    struct rec_photo_params p = rec_photo_defaults;
    paint(4, 0, 0.01, 0);
    for (int y = 20; y < 28; y++)
        for (int x = 20; x < 28; x++)
            for (int l = 0; l < 3; l++)
                img[(y * W + x) * 4 + l] += 0.025f; /* 2.5 sigma: below the threshold of one bin */
    apply(3, NULL, one, &p);
    int inside = 0;
    for (int y = 21; y < 27; y++)
        for (int x = 21; x < 27; x++)
            inside += lit[y * W + x];
    T_OK(inside >= 34);
}

T_CASE(empty_is_unlit)
{
    struct rec_photo_params p = rec_photo_defaults;
    memset(img, 0, sizeof img);
    apply(3, NULL, one, &p);
    T_EQ_I(st.lit, 0);
    T_NEAR(st.threshold, 0.004, 1e-7);
    paint(4, 0, 0.02, 0);
    apply(3, NULL, one, &p);
    T_LE(st.lit, W * H / 200);
}

T_CASE(bad_pixels)
{
    struct rec_photo_params p = rec_photo_defaults;
    memset(img, 0, sizeof img);
    img[100 * 4 + 1] = NAN;
    img[200 * 4] = INFINITY;
    img[300 * 4 + 2] = -INFINITY;
    img[400 * 4] = 3e38f;
    img[500 * 4] = 1.0f; /* saturated */
    img[600 * 4] = 1e-40f;
    apply(3, NULL, one, &p);
    T_EQ_I(st.not_finite, 4);
    T_EQ_I(st.saturated, 1);
    T_EQ_I(st.lit, 5);
    static const int bad[] = {100, 200, 300, 400};
    for (int k = 0; k < 4; k++) {
        T_EQ_I(weight[bad[k]], 0);
        T_EQ_I(lit[bad[k]], 1);
        for (int l = 0; l < 4; l++)
            T_EQ_I(img[bad[k] * 4 + l], 0);
    }
    T_EQ_I(weight[500], 0);
    T_NEAR(img[500 * 4], 1, 0);
    T_EQ_I(weight[600], 1);
    p.saturation = 1e30f; /* floating-point images */
    img[500 * 4] = 5;
    apply(3, NULL, one, &p);
    T_EQ_I(st.saturated, 0);
    T_EQ_I(weight[500], 1);
}

T_CASE(despeckle_and_margin)
{
    struct rec_photo_params p = rec_photo_defaults;
    memset(img, 0, sizeof img);
    img[10 * W + 10] = 0.02f; /* alone; too weak for the mean of 3x3 */
    for (int y = 30; y < 33; y++)
        for (int x = 40; x < 43; x++)
            img[y * W + x] = 0.02f;
    p.floor = 0.01f;
    apply(1, NULL, one, &p);
    T_EQ_I(lit[10 * W + 10], 0);
    T_EQ_I(lit[31 * W + 41], 1);
    uint32_t plain = st.lit;
    p.margin = 2;
    apply(1, NULL, one, &p);
    T_OK(st.lit > plain);
    T_EQ_I(lit[28 * W + 38], 1);
    T_EQ_I(lit[27 * W + 41], 0);
    p.margin = 1000; /* wider than the image */
    apply(1, NULL, one, &p);
    T_EQ_I(st.lit, W * H);
    p.threshold = 0.015f; /* given: no despeckling, no means */
    p.margin = 0;
    apply(1, NULL, one, &p);
    T_EQ_I(st.lit, 10);
}

/* Every small size, so that borders and work areas are met (run under ASan). */
T_CASE(small_images)
{
    struct rec_photo_params p = rec_photo_defaults;
    for (int h = 1; h <= 9; h++)
        for (int w = 1; w <= 9; w++)
            for (int nch = 1; nch <= 3; nch += 2) {
                size_t cs = nch == 3 ? 4 : 1, n = (size_t)(w * h);
                float *v = aligned_alloc(16, (n * cs * 4 + 15) / 16 * 16), *wt = malloc(n * 4);
                struct rec_photo_work *work = rec_photo_work_new(w, h);
                uint8_t *l = malloc(n);
                for (size_t i = 0; i < n * cs; i++)
                    v[i] = 0.5f;
                p.margin = w % 3;
                rec_photo_apply(&(struct rec_photo_image){.img = v,
                                                          .bw = w,
                                                          .bh = h,
                                                          .nch = nch,
                                                          .gain = one,
                                                          .params = &p,
                                                          .weight = wt,
                                                          .lit = l,
                                                          .stats = &st,
                                                          .work = work},
                                1, NULL);
                if (w > 1 && h > 1 && n > 3)
                    T_EQ_I(st.lit, n);
                free(v);
                free(wt);
                free(work);
                free(l);
            }
}
