/* test_photo_bands.c - photometry in bands against photo.h taken literally, one bin and one channel after
 * the other: the same bits in b, weights, silhouettes and figures for every instruction set and number
 * of threads, for pictures of all kinds and odd sizes, several at once, and nothing read or written
 * beside them (guard pages behind them). */
#include "tests/lib/guarded.h"
#include "tests/t.h"

#include "base/cpu.h"
#include "base/mem.h"
#include "recon/carve/photo_pass.h"

enum { CAMERAS = 4 };
static const uint8_t cell[4] = {1, 0, 2, 1};
static const float gain[3] = {1.5f, 1, 0.75f};

/* ---- the reference ---- */

static size_t at(const struct rec_photo_image *im, int x, int y)
{
    return (size_t)y * (size_t)im->bw + (size_t)x;
}
static int measures(const struct rec_photo_image *im, int x, int y, int c)
{
    return c < im->nch && (im->cell == NULL || im->cell[(y & 1) * 2 + (x & 1)] == c);
}
static size_t lanes(const struct rec_photo_image *im)
{
    return im->nch == 3 ? 4 : 1;
}
static float *value(const struct rec_photo_image *im, float *of, int x, int y, int c)
{
    return of + at(im, x, y) * lanes(im) + c;
}

static void ref_linear(const struct rec_photo_image *im, uint8_t *raw)
{
    const struct rec_photo_params *p = im->params;
    float full = p->saturation < 0 ? REC_PHOTO_FULL : p->saturation;
    for (int y = 0; y < im->bh; y++)
        for (int x = 0; x < im->bw; x++) {
            size_t i = at(im, x, y);
            float b[4] = {0};
            int bad = 0, saturated = 0;
            for (int c = 0; c < im->nch; c++)
                if (measures(im, x, y, c)) {
                    float v = *value(im, im->img, x, y, c);
                    saturated |= v >= full;
                    v -= p->black;
                    if (im->background != NULL)
                        v -= im->background[i * lanes(im) + (size_t)c];
                    b[c] = im->gain[c] * v;
                    bad |= !(fabsf(b[c]) <= 1e9f);
                }
            for (size_t l = 0; l < lanes(im); l++)
                im->img[i * lanes(im) + l] = bad ? 0 : b[l];
            im->weight[i] = !bad && !saturated;
            raw[i] = bad || saturated ? REC_FORCED : REC_UNLIT;
            im->stats->not_finite += (uint32_t)bad;
            im->stats->saturated += !bad && saturated;
        }
}

/* One channel of one block; whether it has enough differences. */
static int ref_block(const struct rec_photo_image *im, int x0, int y0, int step, int c, float low,
                     float out[3])
{
    int x1 = x0 + 8 < im->bw ? x0 + 8 : im->bw, y1 = y0 + 8 < im->bh ? y0 + 8 : im->bh;
    float sum = 0, diff2 = 0, bins = 0, cells = 0, at_low = 0;
    for (int x = x0; x < x1; x++) {
        float column = 0, column2 = 0;
        for (int y = y0; y < y1; y++) {
            if (im->weight[at(im, x, y)] == 0 || !measures(im, x, y, c))
                continue;
            float a = *value(im, im->img, x, y, c);
            column += a;
            bins++;
            at_low += a <= low;
            if (x + step >= x1 || y + step >= y1 || im->weight[at(im, x + step, y)] == 0 ||
                im->weight[at(im, x, y + step)] == 0 || im->weight[at(im, x + step, y + step)] == 0)
                continue;
            float d =
                (a - *value(im, im->img, x + step, y, c)) -
                (*value(im, im->img, x, y + step, c) - *value(im, im->img, x + step, y + step, c));
            column2 += d * d;
            cells++;
        }
        sum += column;
        diff2 += column2;
    }
    out[0] = sum / bins;
    out[1] = diff2 / (4 * cells);
    out[2] = at_low / bins;
    return cells >= 4;
}

static int by_value(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}
static float ranked(const float *v, int n, int k)
{
    float s[REC_PHOTO_BLOCKS];
    memcpy(s, v, (size_t)n * sizeof *s);
    qsort(s, (size_t)n, sizeof *s, by_value);
    return s[k];
}

static void ref_noise(const struct rec_photo_image *im, int step, float sigma[3], float dark[3])
{
    static float m[3][REC_PHOTO_BLOCKS], d[3][REC_PHOTO_BLOCKS], l[3][REC_PHOTO_BLOCKS];
    float low[3] = {INFINITY, INFINITY, INFINITY};
    int across = (im->bw + 7) / 8, all = across * ((im->bh + 7) / 8), n = 0;
    for (int y = 0; y < im->bh; y++)
        for (int x = 0; x < im->bw; x++)
            for (int c = 0; c < 3; c++)
                if (measures(im, x, y, c) && im->weight[at(im, x, y)] != 0)
                    low[c] = fminf(low[c], *value(im, im->img, x, y, c));
    for (int k = 0; k < all; k += (all + REC_PHOTO_BLOCKS - 1) / REC_PHOTO_BLOCKS) {
        int enough = 1;
        for (int c = 0; c < 3 && c < im->nch; c++) {
            float o[3];
            enough &= ref_block(im, k % across * 8, k / across * 8, step, c, low[c], o);
            m[c][n] = o[0];
            d[c][n] = o[1];
            l[c][n] = o[2];
        }
        n += enough;
    }
    for (int c = 0; c < 3 && c < im->nch && n > 0; c++) {
        float limit = ranked(m[c], n, n / 2);
        int half = 0;
        dark[c] = fmaxf(0, ranked(m[c], n, n / 4));
        for (int i = 0; i < n; i++)
            if (m[c][i] <= limit) {
                d[c][half] = d[c][i];
                l[c][half++] = l[c][i];
            }
        float s = sqrtf(ranked(d[c], half, half / 2)), z = ranked(l[c], half, half / 2);
        sigma[c] = z > 0.25f && z < 0.75f ? s / 0.5838f : s;
    }
}

/* Samples of row y, mirrored, in the weights 1 2 1. */
static float ref_down(const struct rec_photo_image *im, int x, int y, int c)
{
    int up = y > 0 ? y - 1 : 1, down = y + 1 < im->bh ? y + 1 : im->bh - 2;
    return *value(im, im->img, x, up, c) + 2 * *value(im, im->img, x, y, c) +
           *value(im, im->img, x, down, c);
}
static void ref_plane(const struct rec_photo_image *im)
{
    for (int y = 0; y < im->bh; y++)
        for (int x = 0; x < im->bw; x++)
            for (int c = 0; c < 3; c++) {
                int left = x > 0 ? x - 1 : 1, right = x + 1 < im->bw ? x + 1 : im->bw - 2;
                *value(im, im->plane, x, y, c) =
                    (c == 1 ? 2.0f : 4.0f) / 16 *
                    (ref_down(im, left, y, c) + 2 * ref_down(im, x, y, c) +
                     ref_down(im, right, y, c));
            }
}

/* Lights bins whose mean over side x side, each at most cap, reaches the limit. */
static void ref_means(const struct rec_photo_image *im, float *pic, int side, const float limit[3],
                      const float cap[3], uint8_t *raw)
{
    int r = side / 2;
    for (int y = r; y + r < im->bh; y++)
        for (int x = r; x + r < im->bw; x++)
            for (int c = 0; c < im->nch; c++) {
                float sum = 0;
                for (int u = x - r; u <= x + r; u++) {
                    float column = 0;
                    for (int v = y - r; v <= y + r; v++)
                        column += fminf(*value(im, pic, u, v, c), cap[c]);
                    sum += column;
                }
                if (sum >= limit[c] * (float)(side * side))
                    raw[at(im, x, y)] |= REC_LIT;
            }
}

static double ref_signal(const struct rec_photo_image *im, float *pic, const uint8_t *raw)
{
    double best = 0;
    for (int c = 0; c < im->nch; c++) {
        double sum = 0, n = 0;
        for (int y = 0; y < im->bh; y++)
            for (int x = 0; x < im->bw; x++)
                if (raw[at(im, x, y)] & REC_LIT) {
                    sum += (double)*value(im, pic, x, y, c);
                    n++;
                }
        best = n > 0 ? fmax(best, sum / n / fmax((double)im->stats->sigma[c], 1e-9)) : 0;
    }
    return best;
}

static void ref_silhouette(const struct rec_photo_image *im, const uint8_t *raw)
{
    int r = im->params->margin;
    for (int y = 0; y < im->bh; y++)
        for (int x = 0; x < im->bw; x++) {
            int near = -1;
            for (int v = y - 1; v <= y + 1; v++)
                for (int u = x - 1; u <= x + 1; u++)
                    near += u >= 0 && v >= 0 && u < im->bw && v < im->bh && raw[at(im, u, v)] != 0;
            int lone = im->params->threshold < 0 && im->params->despeckle && near < 2;
            if (raw[at(im, x, y)] == REC_UNLIT || (raw[at(im, x, y)] == REC_LIT && lone))
                continue;
            for (int v = y - r; v <= y + r; v++)
                for (int u = x - r; u <= x + r; u++)
                    if (u >= 0 && v >= 0 && u < im->bw && v < im->bh)
                        im->lit[at(im, u, v)] = 1;
        }
}

static void reference(const struct rec_photo_image *im)
{
    const struct rec_photo_params *p = im->params;
    size_t n = (size_t)im->bw * (size_t)im->bh;
    struct rec_grain g = im->cell != NULL ? rec_grain_mosaic
                         : im->bayer > 0  ? rec_grain_bayer(im->bayer)
                                          : rec_grain_none;
    float limit[3] = {0}, faint[3] = {0}, fainter[3] = {0}, dark[3] = {0}, cap[3], caps[3];
    float *pic = im->cell != NULL ? im->plane : im->img;
    uint8_t *raw = pvx_calloc(n, 1);
    *im->stats = (struct rec_photo_stats){0};
    memset(im->lit, 0, n);
    ref_linear(im, raw);
    ref_noise(im, g.step, im->stats->sigma, dark);
    if (im->cell != NULL)
        ref_plane(im);
    for (int c = 0; c < im->nch; c++) {
        float s = im->stats->sigma[c];
        limit[c] = p->threshold < 0 ? fmaxf(p->floor, p->auto_k * s) : p->threshold;
        faint[c] = dark[c] + fmaxf(p->floor, p->auto_k * s / g.near[c]);
        fainter[c] = dark[c] + fmaxf(p->floor, 1.25f * p->auto_k * s / g.wide[c]);
        cap[c] = 2 * limit[c];
        caps[c] = 4 * fainter[c];
        im->stats->threshold = fmaxf(im->stats->threshold, limit[c]);
    }
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < im->nch; c++) {
            size_t k = i * lanes(im) + (size_t)c;
            raw[i] |= im->img[k] >= limit[c] || pic[k] >= limit[c] ? REC_LIT : 0;
        }
    if (p->threshold < 0 && im->bh >= 5) {
        ref_means(im, pic, 3, faint, cap, raw);
        double snr = ref_signal(im, pic, raw);
        if (snr > 0 && snr < 7.5)
            ref_means(im, pic, 7, fainter, caps, raw);
    }
    ref_silhouette(im, raw);
    for (size_t i = 0; i < n; i++) {
        im->stats->lit += im->lit[i];
        int l =
            im->cell != NULL ? im->cell[i / (size_t)im->bw % 2 * 2 + i % (size_t)im->bw % 2] : 3;
        for (int c = 0; c < 4; c++)
            im->weight4[i * 4 + (size_t)c] = c < 3 && (l == 3 || c == l) ? im->weight[i] : 0;
    }
    free(raw);
}

/* ---- pictures ---- */

static const int sizes[][2] = {{1, 1},   {1, 9},   {9, 1},    {2, 2},   {3, 5},     {5, 3},
                               {8, 8},   {9, 9},   {16, 16},  {17, 33}, {40, 4},    {31, 17},
                               {64, 48}, {65, 49}, {161, 67}, {81, 16}, {300, 144}, {130, 40}};
enum { N_SIZES = sizeof sizes / sizeof *sizes };

/* Pictures of cameras of one kind and what becomes of them, each in memory of its own. */
struct bed {
    struct rec_photo_image im[CAMERAS];
    struct rec_photo_params params[CAMERAS];
    struct rec_photo_stats stats[CAMERAS];
};

static size_t bins(const struct rec_photo_image *im)
{
    return (size_t)im->bw * (size_t)im->bh;
}

static void bed_new(struct bed *b, int nch)
{
    for (int c = 0; c < CAMERAS; c++) {
        struct rec_photo_image *im = &b->im[c];
        const int *size = sizes[t_rand() % N_SIZES];
        size_t n = (size_t)(size[0] * size[1]), lane = (nch == 3 ? 4 : 1) * sizeof(float);
        bool mosaic = nch == 3 && size[0] > 1 && size[1] > 1 && t_rand() % 2 != 0;
        *im = (struct rec_photo_image){.absent = t_rand() % 5 == 0,
                                       .img = guarded(n * lane),
                                       .bw = size[0],
                                       .bh = size[1],
                                       .nch = nch,
                                       .cell = mosaic ? cell : NULL,
                                       .bayer = t_rand() % 2 == 0 ? (int32_t)(t_rand() % 3) : 0,
                                       .background = t_rand() % 2 == 0 ? guarded(n * lane) : NULL,
                                       .gain = gain,
                                       .params = &b->params[c],
                                       .weight = guarded(n * sizeof(float)),
                                       .weight4 = guarded(n * 16),
                                       .lit = guarded(n),
                                       .stats = &b->stats[c],
                                       .work = rec_photo_work_new(size[0], size[1]),
                                       .plane = guarded(n * 16)};
        b->params[c] = rec_photo_defaults;
        b->params[c].black = (float)t_uniform(0, 0.02);
        b->params[c].margin = t_rand() % 3 == 0 ? (int32_t)(t_rand() % 20) : 0;
        b->params[c].despeckle = t_rand() % 4 != 0;
        if (t_rand() % 4 == 0)
            b->params[c].threshold = 0.1f;
        if (t_rand() % 4 == 0)
            b->params[c].saturation = REC_PHOTO_UNSATURATED;
    }
}

/* A flame, bright or faint against the noise, clipped at 0 or not; some bins broken, some saturated; what
 * is in lanes without a channel is anything. */
static void paint(const struct rec_photo_image *im, float *out)
{
    double noise = t_rand() % 2 == 0 ? 0.004 : 0.1, top = t_rand() % 3 == 0 ? 1.3 : 0.5;
    double odd = t_rand() % 2 == 0 ? 0 : t_rand() % 2 == 0 ? 0.002 : 0.3;
    double least = t_rand() % 2 == 0 ? -1 : t_rand() % 2 == 0 ? 0 : 0.03; /* clipped there */
    for (int y = 0; y < im->bh; y++)
        for (int x = 0; x < im->bw; x++)
            for (size_t l = 0; l < lanes(im); l++) {
                double u = x - im->bw / 2.0, v = y - im->bh / 2.0;
                double r = sqrt(u * u + v * v) / (1 + im->bw / 5.0);
                double a = (r < 1 ? top * (1 - r) : 0) + noise * t_normal();
                static const float strange[] = {NAN, INFINITY, -INFINITY, 1, 3e38f, -0.0f};
                float *at_bin = out + at(im, x, y) * lanes(im) + l;
                *at_bin = (float)fmax(a, least);
                if (t_uniform(0, 1) < odd)
                    *at_bin = strange[t_rand() % 6];
                if (!measures(im, x, y, (int)l))
                    *at_bin = NAN;
                if (im->background != NULL)
                    ((float *)im->background)[at(im, x, y) * lanes(im) + l] =
                        (float)t_uniform(-0.01, 0.01);
            }
}

/* What the reference made of a picture, against what is there. */
static void compare(const struct rec_photo_image *im, const struct rec_photo_image *ref,
                    const char *what, unsigned threads)
{
    size_t n = bins(im), lane = lanes(im) * sizeof(float);
    size_t wrong = 0;
    for (size_t i = 0; i < n; i++)
        wrong += im->lit[i] != ref->lit[i];
    bool b = memcmp(im->img, ref->img, n * lane) == 0;
    bool w = memcmp(im->weight, ref->weight, n * sizeof(float)) == 0;
    bool w4 = memcmp(im->weight4, ref->weight4, n * 16) == 0;
    bool stats = memcmp(im->stats, ref->stats, sizeof *ref->stats) == 0;
    T_CHECK_(
        b && w && w4 && stats && wrong == 0,
        "%s, %u threads, %dx%d nch %d mosaic %d bayer %d absent %d: b %d weights %d %d, figures "
        "%d, %zu bins lit otherwise",
        what, threads, im->bw, im->bh, im->nch, im->cell != NULL, im->bayer, im->absent, b, w, w4,
        stats, wrong);
}

T_CASE(equals_the_reference)
{
    static const unsigned threads[] = {1, 2, 5};
    pvx_pool *pool[3];
    for (int t = 0; t < 3; t++)
        T_EQ_I(pvx_pool_new(threads[t], "bands", &pool[t]), PVX_OK);
    for (int round = 0; round < 40; round++) {
        struct bed b;
        float *picture[CAMERAS];
        struct rec_photo_image ref[CAMERAS];
        struct rec_photo_stats stats[CAMERAS];
        bed_new(&b, round % 3 == 0 ? 1 : 3);
        for (int c = 0; c < CAMERAS; c++) {
            size_t n = bins(&b.im[c]), size = n * lanes(&b.im[c]) * sizeof(float);
            picture[c] = pvx_calloc(1, size);
            paint(&b.im[c], picture[c]);
            ref[c] = b.im[c];
            ref[c].img = pvx_calloc(1, size);
            ref[c].weight = pvx_calloc(n, sizeof(float));
            ref[c].weight4 = pvx_calloc(n, 16);
            ref[c].lit = pvx_calloc(n, 1);
            ref[c].plane = pvx_calloc(n, 16);
            ref[c].stats = &stats[c];
            stats[c] = (struct rec_photo_stats){0};
            if (b.im[c].absent)
                continue;
            memcpy(ref[c].img, picture[c], size);
            reference(&ref[c]);
        }
        for (enum pvx_cpu cpu = PVX_CPU_REF; cpu <= pvx_cpu_have(); cpu++)
            for (int t = 0; t < 3; t++) {
                T_EQ_I(pvx_cpu_use(pvx_cpu_name(cpu), NULL), PVX_OK);
                for (int c = 0; c < CAMERAS; c++) {
                    size_t n = bins(&b.im[c]);
                    memcpy(b.im[c].img, picture[c], n * lanes(&b.im[c]) * sizeof(float));
                    memset(b.im[c].weight4, 9, n * 16);
                    memset(b.im[c].lit, 9, n);
                }
                rec_photo_apply(b.im, CAMERAS, pool[t]);
                for (int c = 0; c < CAMERAS; c++)
                    compare(&b.im[c], &ref[c], pvx_cpu_name(cpu), threads[t]);
            }
        for (int c = 0; c < CAMERAS; c++) {
            free(picture[c]);
            free(ref[c].img);
            free(ref[c].weight);
            free(ref[c].weight4);
            free(ref[c].lit);
            free(ref[c].plane);
            free(b.im[c].work);
        }
    }
    for (int t = 0; t < 3; t++)
        pvx_pool_free(&pool[t]);
}
