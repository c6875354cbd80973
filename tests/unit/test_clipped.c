/* test_clipped.c - blacks that are clipped: what photometry says of them and takes out of b, in pictures of an even level of
 * light whose noise is known. */
#include "tests/t.h"

#include "recon/carve/clipped.h"

#define W 160
#define H 96
#define S 0.02 /* noise of a sample */

static float img[W * H * 4] __attribute__((aligned(16))), was[W * H * 4], weight[W * H],
    plane[W * H * 4] __attribute__((aligned(16))), back[W * H * 4] __attribute__((aligned(16)));
static uint8_t lit[W * H];
static struct rec_photo_stats st;
static const uint8_t cell[4] = {0, 1, 1, 2};

/* How pictures are made. */
struct made {
    int nch, binning, pictures; /* a bin is the mean of so many; 0: of one */
    bool mosaic;
    double pedestal, black,
        step; /* of samples: added before they are clipped; told; of their values, 0: none */
    bool clip, background;
    double gain;
};

/* Bins of light: none in the left half, `level` in the right. */
static void paint(const struct made *m, double level)
{
    int n = m->binning * m->binning * (m->pictures > 0 ? m->pictures : 1), cs = m->nch == 3 ? 4 : 1;
    for (int i = 0; i < W * H * cs; i++) {
        double sum = 0, light = i / cs % W < W / 2 ? 0 : level;
        for (int k = 0; k < n; k++) {
            double v = light + m->pedestal + S * t_normal();
            v = m->clip ? fmax(v, 0) : v;
            sum += m->step > 0 ? m->step * floor(v / m->step + 0.5) : v;
        }
        img[i] = (float)(sum / n);
    }
}

static void apply(const struct made *m, int32_t binning)
{
    struct rec_photo_params p = rec_photo_defaults;
    struct rec_photo_work *work = rec_photo_work_new(W, H);
    const float gain[3] = {(float)m->gain, (float)m->gain, (float)m->gain};
    p.black = (float)m->black;
    rec_photo_apply(&(struct rec_photo_image){.img = img,
                                              .bw = W,
                                              .bh = H,
                                              .nch = m->nch,
                                              .binning = binning,
                                              .pictures = (uint32_t)m->pictures,
                                              .cell = m->mosaic ? cell : NULL,
                                              .background = m->background ? back : NULL,
                                              .gain = gain,
                                              .params = &p,
                                              .weight = weight,
                                              .lit = lit,
                                              .plane = plane,
                                              .stats = &st,
                                              .work = work},
                    1, NULL);
    free(work);
}

/* Mean of b over a half, of the channels that are measured. */
static double mean_of(const struct made *m, int half)
{
    double sum = 0, n = 0;
    int cs = m->nch == 3 ? 4 : 1;
    for (int y = 0; y < H; y++)
        for (int x = half * W / 2; x < (half + 1) * W / 2; x++)
            for (int c = 0; c < m->nch; c++)
                if (!m->mosaic || cell[y % 2 * 2 + x % 2] == c) {
                    sum += (double)img[(y * W + x) * cs + c];
                    n++;
                }
    return sum / n;
}

/* Without correction the dark is 0.4 S too bright, and light of S by 0.08 S.  Limits: a third more than
 * 60 seeds reached; a mosaic's blocks have few bins of red and blue, and the median of few variances is low. */
T_CASE(light_that_was_not_there)
{
    static const struct made kinds[] = {
        {.nch = 1, .binning = 1, .clip = true, .gain = 1},
        {.nch = 3, .binning = 1, .clip = true, .gain = 1.5},
        {.nch = 1, .binning = 2, .clip = true, .gain = 1},
        {.nch = 3, .binning = 3, .clip = true, .gain = 0.7},
        {.nch = 1, .binning = 4, .clip = true, .gain = 1},
        {.nch = 1, .binning = 1, .clip = true, .gain = 1, .step = 1.0 / 255},
        {.nch = 1, .binning = 2, .clip = true, .gain = 1, .step = 1.0 / 255},
        {.nch = 3, .binning = 1, .clip = true, .gain = 1, .mosaic = true},
        {.nch = 1, .binning = 1, .clip = true, .gain = 1, .pedestal = 0.5 * S, .black = 0.5 * S},
        {.nch = 1, .binning = 2, .clip = true, .gain = 1, .pedestal = 0.5 * S, .black = 0.5 * S},
        {.nch = 1, .binning = 1, .pictures = 9, .clip = true, .gain = 1},
        {.nch = 1, .binning = 2, .pictures = 4, .clip = true, .gain = 1},
        {.nch = 3, .binning = 1, .pictures = 4, .clip = true, .gain = 1, .mosaic = true},
    };
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        for (double level = 0.5; level < 6; level *= 2) {
            const struct made *m = &kinds[k];
            double own = m->gain * S, loose = m->mosaic ? 2.5 : 1;
            paint(m, level * S);
            apply(m, m->binning);
            T_NEAR(mean_of(m, 0) / own, 0, 0.12 * loose);
            T_NEAR(mean_of(m, 1) / own, level, 0.11);
            T_NEAR((double)st.sigma[0] * m->binning * sqrt(fmax(1, m->pictures)) / own, 1,
                   0.16 * loose);
            T_NEAR((double)st.cut, m->pedestal > 0 ? 0.31 : 0.5, 0.08);
            T_NEAR((double)st.pedestal / S, m->pedestal > 0 ? 2.5 : 3, 0.6 * loose);
        }
}

/* The fewer the noise of a bin, the nearer is its threshold to the light that the clipping adds.  Nothing of it counts
 * as flame, and faint light does. */
T_CASE(dark_is_not_flame)
{
    static const struct made kinds[] = {
        {.nch = 1, .binning = 1, .pictures = 256, .clip = true, .gain = 1},
        {.nch = 3, .binning = 2, .pictures = 64, .clip = true, .gain = 1.5},
        {.nch = 1, .binning = 8, .clip = true, .gain = 1},
        {.nch = 3, .binning = 1, .pictures = 100, .clip = true, .gain = 1, .mosaic = true},
    };
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        uint32_t dark = 0, light = 0;
        paint(&kinds[k], S);
        apply(&kinds[k], kinds[k].binning);
        for (int i = 0; i < W * H; i++)
            *(i % W < W / 2 - 8 ? &dark : &light) += lit[i];
        T_LE(dark, W * H / 2 / 50);
        T_OK(light > W * H / 2 * 9 / 10);
    }
}

/* Pictures that are not clipped, of any kind, and those whose clip level is not known. */
T_CASE(not_a_bit_changes)
{
    static const struct made kinds[] = {
        {.nch = 1, .binning = 1, .gain = 1},
        {.nch = 3, .binning = 1, .gain = 1.5},
        {.nch = 3, .binning = 2, .gain = 1, .step = 1.0 / 255},
        {.nch = 1, .binning = 1, .gain = 1, .clip = true, .pedestal = 3 * S, .black = 3 * S},
        {.nch = 1, .binning = 2, .gain = 1, .clip = true, .pedestal = 3 * S, .black = 3 * S},
        {.nch = 1, .binning = 2, .gain = 1, .clip = true, .pedestal = 4 * S},
        {.nch = 1, .binning = 1, .gain = 1, .clip = true, .background = true},
        {.nch = 3, .binning = 1, .gain = 1, .mosaic = true},
    };
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        const struct made *m = &kinds[k];
        struct rec_photo_stats without;
        static float raw[W * H * 4];
        paint(m, 5 * S);
        memcpy(raw, img, sizeof raw);
        apply(m, 0);
        memcpy(was, img, sizeof was);
        without = st;
        memcpy(img, raw, sizeof raw);
        apply(m, m->binning);
        T_OK(memcmp(img, was, sizeof was) == 0);
        T_OK(memcmp(&st, &without, sizeof st) == 0);
        T_EQ_I(st.cut > 0, 0);
    }
}

/* Where the dark is exactly 0 its noise is at least that of the samples' step. */
T_CASE(a_dark_of_zeros)
{
    for (int binning = 1; binning <= 2; binning++)
        for (int bits = 8; bits <= 12; bits += 4) {
            struct made m = {
                .nch = 1, .binning = binning, .gain = 1, .step = 1.0 / ((1 << bits) - 1)};
            for (int i = 0; i < W * H;
                 i++) { /* a slope without noise: one sample of a bin is brighter */
                double v = i % W < W / 2 ? 0 : m.step * (i % W - W / 2);
                img[i] = (float)(v / (binning * binning));
            }
            apply(&m, binning);
            T_NEAR((double)st.sigma[0], m.step / sqrt(12) / binning, 1e-3 * m.step);
            T_EQ_I(st.cut > 0, 0);
        }
}

/* Mean and deviation of max(0, N(t, 1)): t = 0 by (1) and (2), 3 by hand. */
T_CASE(darks_of_single_samples)
{
    double pedestal;
    T_NEAR(rec_clipped_share(0.39894 * S, 0.58379 * S, &pedestal), 0.5, 1e-3);
    T_NEAR(pedestal / S, 3, 1e-2);
    T_NEAR(rec_clipped_share(3 * S, S, &pedestal), 0, 0);
    T_NEAR(rec_clipped_share(0, 0, &pedestal), 0, 0);
    T_NEAR(pedestal, 0, 0);
}

T_CASE(what_is_said)
{
    char text[REC_PHOTO_CUT_TEXT];
    T_EQ_I(rec_photo_say_cut(0, 0, text), 0);
    T_EQ_I(rec_photo_say_cut(0.5, 0.0296, text), 1);
    T_EQ_S(
        text,
        "black is clipped: 50 % of the noise of its dark is cut off at 0; raise the camera's black "
        "level by 2.96 % of full scale (8 steps of 8 bits, 122 of 12), and give that level as "
        "photometry.black");
}
