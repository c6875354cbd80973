/* test_cl_photo.c - photometry on a device against that of the processor: the same bits in b, weights, silhouettes and
 * figures, for pictures of all kinds and odd sizes, several at once. */
#include "tests/t.h"
#include "tests/lib/cl_bed.h"

#include "base/mem.h"
#include "recon/carve/photo_pass.h"
#include "recon/opencl/photo.h"

enum { CAMERAS = 5, ROUNDS = 60 };
static const uint8_t cell[4] = {1, 0, 2, 1};
static const float gain[3] = {1.5f, 1, 0.75f};
static const int sizes[][2] = {{1, 1},   {1, 9},   {9, 1},    {2, 2},     {3, 5},    {5, 3},
                               {8, 8},   {9, 9},   {16, 16},  {17, 33},   {40, 4},   {31, 17},
                               {64, 48}, {65, 49}, {161, 67}, {300, 144}, {130, 40}, {200, 170}};
enum { N_SIZES = sizeof sizes / sizeof *sizes };

/* Oclgrind checks every access, and is slow: few and small pictures. */
static bool slow;

static rec_cl *cl;

struct bed {
    struct rec_photo_image im[CAMERAS];
    struct rec_photo_params params[CAMERAS];
    struct rec_photo_stats stats[CAMERAS];
    float noise[CAMERAS][3];
    size_t rows, cs, row0[CAMERAS];
    float *picture, *b, *w, *w4, *plane, *back; /* of all cameras; picture: before photometry */
    uint8_t *lit;
    bool per_channel;
};

static void kind_of(struct bed *b, int c, int nch)
{
    struct rec_photo_params *p = &b->params[c];
    struct rec_photo_image *im = &b->im[c];
    const int *size = sizes[t_rand() % (slow ? N_SIZES - 4 : N_SIZES)];
    bool mosaic = nch == 3 && size[0] > 1 && size[1] > 1 && t_rand() % 2 != 0;
    *im = (struct rec_photo_image){.absent = t_rand() % 6 == 0,
                                   .bw = size[0],
                                   .bh = size[1],
                                   .nch = nch,
                                   .binning = (int32_t)(t_rand() % 4),
                                   .pictures = t_rand() % 4 == 0 ? 20 : 0,
                                   .cell = mosaic ? cell : NULL,
                                   .bayer = t_rand() % 2 == 0 ? (int32_t)(t_rand() % 3) : 0,
                                   .gain = gain,
                                   .params = p,
                                   .stats = &b->stats[c],
                                   .work = rec_photo_work_new(size[0], size[1])};
    *p = rec_photo_defaults;
    p->black = t_rand() % 3 == 0 ? (float)t_uniform(0, 0.02) : 0;
    p->margin = t_rand() % 3 == 0 ? (int32_t)(t_rand() % 20) : 0;
    p->despeckle = t_rand() % 4 != 0;
    p->dim = t_rand() % 3 == 0 ? 0.005f : 0;
    p->threshold = t_rand() % 5 == 0 ? 0.1f : -1;
    if (t_rand() % 4 == 0)
        p->saturation = REC_PHOTO_UNSATURATED;
}

/* Camera 0 always has single samples of 8 bits, and a dark that is all 0 but for a few: (6) of clipped.h. */
static void quiet(struct bed *b)
{
    b->im[0].absent = false;
    b->im[0].binning = 1;
    b->im[0].pictures = 0;
    b->im[0].bayer = 0;
    b->params[0].black = 0;
}

static void bed_new(struct bed *b, int nch)
{
    *b = (struct bed){.cs = nch == 3 ? 4 : 1};
    for (int c = 0; c < CAMERAS; c++) {
        kind_of(b, c, nch);
        if (c == 0)
            quiet(b);
        b->row0[c] = b->rows;
        b->rows += (size_t)(b->im[c].bw * b->im[c].bh);
        b->per_channel |= b->im[c].cell != NULL && !b->im[c].absent;
    }
    b->picture = pvx_calloc(b->rows * b->cs, sizeof(float));
    b->b = pvx_calloc(b->rows * b->cs, sizeof(float));
    b->back = pvx_calloc(b->rows * b->cs, sizeof(float));
    b->w = pvx_calloc(b->rows, sizeof(float));
    b->w4 = pvx_calloc(b->rows * 4, sizeof(float));
    b->plane = pvx_calloc(b->rows * 4, sizeof(float));
    b->lit = pvx_calloc(b->rows, 1);
    for (int c = 0; c < CAMERAS; c++) {
        struct rec_photo_image *im = &b->im[c];
        im->img = b->b + b->row0[c] * b->cs;
        im->weight = b->w + b->row0[c];
        im->weight4 = b->per_channel ? b->w4 + b->row0[c] * 4 : NULL;
        im->plane = b->plane + b->row0[c] * 4;
        im->lit = b->lit + b->row0[c];
        im->background = c > 0 && t_rand() % 3 == 0 ? b->back + b->row0[c] * b->cs : NULL;
        im->noise = b->noise[c];
    }
}
static void bed_free(struct bed *b)
{
    for (int c = 0; c < CAMERAS; c++)
        free(b->im[c].work);
    free(b->picture);
    free(b->b);
    free(b->back);
    free(b->w);
    free(b->w4);
    free(b->plane);
    free(b->lit);
}

/* A flame, bright or faint against the noise, in steps of 8 bits or fine, clipped at 0 or not; some bins broken, some
 * saturated; what is in lanes without a channel is anything. */
static void paint(struct bed *b, int c)
{
    static const float strange[] = {NAN, INFINITY, -INFINITY, 1, 3e38f, -0.0f};
    const struct rec_photo_image *im = &b->im[c];
    double noise = c == 0 ? 0.0008 : t_rand() % 2 == 0 ? 0.004 : 0.1;
    double top = t_rand() % 3 == 0 ? 1.3 : 0.5;
    double odd = t_rand() % 2 == 0 ? 0 : t_rand() % 2 == 0 ? 0.002 : 0.3;
    double least = t_rand() % 3 == 0 ? -1 : t_rand() % 3 != 0 ? 0 : 0.03; /* clipped there */
    double step = c == 0 || t_rand() % 2 == 0 ? 1.0 / 255 : 0;
    float *out = b->picture + b->row0[c] * b->cs, *back = b->back + b->row0[c] * b->cs;
    for (int i = 0; i < im->bw * im->bh; i++)
        for (size_t l = 0; l < b->cs; l++, out++, back++) {
            double u = i % im->bw - im->bw / 2.0, v = i / im->bw - im->bh / 2.0;
            double r = sqrt(u * u + v * v) / (1 + im->bw / 5.0);
            double a = fmax((r < 1 ? top * (1 - r) : 0) + noise * t_normal(), least);
            int own = im->cell == NULL ? -1 : im->cell[i / im->bw % 2 * 2 + i % im->bw % 2];
            *out = (float)(step > 0 ? step * floor(a / step + 0.5) : a);
            if (t_uniform(0, 1) < odd)
                *out = strange[t_rand() % 6];
            if (l == 3 || (own >= 0 && own != (int)l))
                *out = NAN;
            *back = (float)t_uniform(-0.01, 0.01);
        }
    for (int l = 0; l < 3; l++)
        b->noise[c][l] = (float)noise;
}

struct there {
    struct rec_cl_pictures to;
    float *b, *w, *w4;
    uint8_t *lit;
    struct rec_photo_stats stats[CAMERAS];
};

static void there_free(struct there *o)
{
    free(o->b);
    free(o->w);
    free(o->w4);
    free(o->lit);
}

/* Half of the time the results come with the photometry, else afterwards. */
static void bring(struct there *o, rec_cl_queue *q, const struct bed *b)
{
    rec_cl_download(q, &o->to.b, 0, o->b, b->rows * b->cs * sizeof(float));
    rec_cl_download(q, &o->to.w, 0, o->w, b->rows * sizeof(float));
    if (b->per_channel)
        rec_cl_download(q, &o->to.w4, 0, o->w4, b->rows * 16);
    rec_cl_download(q, &o->to.lit, 0, o->lit, b->rows);
    T_OK(rec_cl_wait(q));
}

/* The same on the device, twice into the same buffers: nothing of the set before is left. */
static void on_device(struct bed *b, struct there *o)
{
    struct pvx_diag d = {""};
    struct rec_photo_image im[CAMERAS];
    rec_cl_queue *q = cl_bed_queue(cl);
    rec_cl_photo *p;
    size_t n = b->rows, lane = b->cs * sizeof(float);
    T_EQ_I(rec_cl_photo_new(cl, b->im, CAMERAS, 0, NULL, &p, &d), PVX_OK);
    o->to = (struct rec_cl_pictures){.b = cl_bed_buffer(cl, q, NULL, n * lane),
                                     .w = cl_bed_buffer(cl, q, NULL, n * sizeof(float)),
                                     .w4 = cl_bed_buffer(cl, q, NULL, b->per_channel ? n * 16 : 0),
                                     .lit = cl_bed_buffer(cl, q, NULL, n)};
    for (int c = 0; c < CAMERAS; c++) {
        im[c] = b->im[c];
        im[c].img = im[c].weight = im[c].weight4 = im[c].plane = NULL;
        im[c].lit = NULL;
        im[c].stats = &o->stats[c];
        rec_cl_photo_background(p, q, (size_t)c, im[c].background);
    }
    o->b = calloc(n, lane);
    o->w = calloc(n, sizeof(float));
    o->w4 = calloc(n, 16);
    o->lit = calloc(n, 1);
    bool here = t_rand() % 2 == 0;
    for (int round = 0; round < 2; round++) {
        if (round == 1 && here) {
            o->to.here.b = o->b;
            o->to.here.w = o->w;
            o->to.here.w4 = o->w4;
            o->to.here.lit = o->lit;
        }
        rec_cl_upload(q, &o->to.b, 0, b->picture, n * lane);
        rec_cl_photo_send(p, q, im);
        T_OK(rec_cl_photo_apply(p, q, im, &o->to, NULL));
    }
    if (!here)
        bring(o, q, b);
    rec_cl_photo_free(&p);
    rec_cl_queue_free(&q);
    rec_cl_buffer_free(cl, &o->to.b);
    rec_cl_buffer_free(cl, &o->to.w);
    rec_cl_buffer_free(cl, &o->to.w4);
    rec_cl_buffer_free(cl, &o->to.lit);
}

static void compare(const struct bed *b, const struct there *o, int c)
{
    const struct rec_photo_image *im = &b->im[c];
    size_t at = b->row0[c], n = (size_t)(im->bw * im->bh), lit = 0;
    for (size_t i = 0; i < n; i++)
        lit += o->lit[at + i] != b->lit[at + i];
    bool same = memcmp(o->b + at * b->cs, b->b + at * b->cs, n * b->cs * sizeof(float)) == 0;
    bool w = memcmp(o->w + at, b->w + at, n * sizeof(float)) == 0;
    bool w4 = !b->per_channel || memcmp(o->w4 + at * 4, b->w4 + at * 4, n * 16) == 0;
    bool stats = memcmp(&o->stats[c], im->stats, sizeof *im->stats) == 0;
    T_CHECK_(same && w && w4 && stats && lit == 0,
             "%dx%d nch %d mosaic %d bayer %d binning %d absent %d clipped %d: b %d weights %d %d, "
             "figures %d, %zu bins lit otherwise",
             im->bw, im->bh, im->nch, im->cell != NULL, im->bayer, im->binning, im->absent,
             im->work->clipped[0].is, same, w, w4, stats, lit);
}

/* That all of it was tried, and not on empty pictures alone. */
struct tried {
    int faint, clipped, one, lit, saturated, not_finite, step, here;
};
static void count(const struct bed *b, const struct there *o, struct tried *t)
{
    t->here += o->to.here.b != NULL;
    for (int c = 0; c < CAMERAS; c++) {
        const struct rec_photo_image *im = &b->im[c];
        const struct rec_photo_work *w = im->work;
        if (im->absent)
            continue;
        t->faint += w->noisy;
        for (int l = 0; l < im->nch; l++) {
            t->clipped += w->clipped[l].is && w->clipped[l].cut >= 0;
            t->one += w->clipped[l].is && w->clipped[l].cut < 0;
            t->step += w->half[l].noise2 == 0 && w->sigma[l] > 0;
        }
        t->lit += im->stats->lit > 50;
        t->saturated += im->stats->saturated > 0;
        t->not_finite += im->stats->not_finite > 0;
    }
}

T_CASE(equals_the_processors)
{
    struct tried tried = {0};
    slow = getenv("T_OPENCL") != NULL;
    for (int round = 0; round < (slow ? 3 : ROUNDS); round++) {
        struct bed b;
        struct there o = {0};
        bed_new(&b, round % 3 == 0 ? 1 : 3);
        for (int c = 0; c < CAMERAS; c++)
            paint(&b, c);
        on_device(&b, &o);
        memcpy(b.b, b.picture, b.rows * b.cs * sizeof(float));
        memset(b.lit, 9, b.rows);
        rec_photo_apply(b.im, CAMERAS, NULL);
        for (int c = 0; c < CAMERAS; c++)
            compare(&b, &o, c);
        count(&b, &o, &tried);
        there_free(&o);
        bed_free(&b);
    }
    T_OK(tried.lit > 1);
    if (slow)
        return;
    T_OK(tried.faint > 5 && tried.clipped > 2 && tried.one > 5 && tried.lit > 5);
    T_OK(tried.saturated > 5 && tried.not_finite > 5 && tried.step > 5);
    T_OK(tried.here > 5 && tried.here < ROUNDS - 5);
}
T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
