/* test_cl_raw.c - whole frame sets whose pixels go to a device as the cameras gave them: right-hand sides, weights and
 * silhouettes have the processors' bits, and so has all that follows if the device fails. */
#include "capture/pixel/pixfmt_pack.h"
#include "daemon/pipeline/images.h"
#include "recon/frame/inside.h"
#include "tests/lib/scene.h"
#include "tests/lib/card_pair.h"

enum { CAMERAS = 6, WIDTH = 128, HEIGHT = 96, GRID = 32 };

static rec_cl *cl;

/* A scene, a matrix of so many pixels a bin, and raw pictures. */
struct bed {
    struct scene s;
    rec_sysmat *S;
    struct dmn_images_params how;
    dmn_photometry *light;
    dmn_images *images[2]; /* for the frame here, there */
    struct card_pair p;
    struct cap_image image[CAMERAS];
    uint8_t *bytes[CAMERAS];
};

/* Cameras with responses, gains and, in turn, colours. */
static void bed_calibrate(struct bed *b)
{
    static const double matrix[] = {0.9, 0.15, -0.05, 0.1, 1.05, 0.02, -0.03, 0.2, 0.8};
    struct pvx_diag d = {""};
    bool rays = b->how.mosaic == CAP_MOSAIC_RAYS && b->how.binning == 1;
    for (size_t c = 0; c < CAMERAS; c++) {
        struct rec_camera *k = &b->s.rig.cameras[c];
        k->photometry.n_response = 3;
        k->photometry.response[1] = 0.4 + 0.05 * (double)c;
        k->photometry.response[2] = 1;
        k->gain[0] = 1.25F;
        k->photometry.has_matrix = b->how.nch == 3 && !rays && c % 2 == 0;
        memcpy(k->photometry.matrix, matrix, sizeof matrix);
    }
    T_EQ_I(dmn_photometry_load("rig.yaml", DMN_LIGHT_ALL, &b->s.rig, &b->light, &d), PVX_OK);
    b->how.light = b->light;
}

static void bed_new(struct bed *b, int nch, int binning, enum cap_mosaic mosaic, bool calibrated,
                    rec_cl *on)
{
    struct rec_sysmat_params m = {.binning = binning, .rays_per_bin = 1};
    struct rec_frame_params f = rec_frame_defaults;
    *b = (struct bed){.how = {.nch = nch, .binning = binning, .mosaic = mosaic}};
    f.nch = nch;
    scene_new(&b->s, CAMERAS, WIDTH, GRID, 1, 2);
    T_EQ_I(rec_sysmat_build(&b->s.rig, &m, b->s.pool, NULL, NULL, &b->S, NULL), PVX_OK);
    if (calibrated)
        bed_calibrate(b);
    for (int k = 0; k < 2; k++)
        T_EQ_I(dmn_images_new(&b->how, &b->s.rig, b->s.pool, &b->images[k], NULL), PVX_OK);
    card_pair_new(&b->p, on, b->S, &b->s.rig, f, b->s.pool);
}

static void bed_free(struct bed *b)
{
    card_pair_free(&b->p);
    for (int k = 0; k < 2; k++)
        dmn_images_free(&b->images[k]);
    dmn_photometry_free(&b->light);
    for (int c = 0; c < CAMERAS; c++)
        free(b->bytes[c]);
    rec_sysmat_free(&b->S);
    scene_free(&b->s);
}

/* Camera c's picture of the scene, with black and noise. */
static void bed_shoot(struct bed *b, size_t c, enum cap_pixfmt fmt, double black)
{
    const uint8_t *cell = cap_pixfmt_bayer(fmt);
    int samples = cap_pixfmt_channels(fmt) == 3 && cell == NULL ? 3 : 1;
    size_t row = cap_pixfmt_row(fmt, WIDTH);
    double most = cap_pixfmt_depth(fmt) < 32 ? (1 << cap_pixfmt_depth(fmt)) - 1 : 0;
    free(b->bytes[c]);
    b->bytes[c] = malloc(row * HEIGHT);
    b->image[c] =
        (struct cap_image){b->bytes[c], row * HEIGHT, WIDTH, HEIGHT, (ptrdiff_t)row, fmt, 0};
    for (int y = 0; y < HEIGHT; y++) {
        uint16_t line[WIDTH * 3];
        float float_line[WIDTH * 3];
        for (int x = 0; x < WIDTH * samples; x++) {
            int i = y * WIDTH + x / samples;
            int l = cell != NULL ? cell[y % 2 * 2 + x % 2] : x % samples;
            double v = (double)b->s.image[c][i * 4 + l] + black + 0.01 * t_normal();
            line[x] = (uint16_t)fmin(fmax(v * most + 0.5, 0), most);
            float_line[x] = (float)v;
        }
        if (fmt == CAP_RGB_F32)
            memcpy(b->bytes[c] + (size_t)y * row, float_line, row);
        else
            cap_pixfmt_pack_row(fmt, WIDTH, line, b->bytes[c] + (size_t)y * row);
    }
}
static void bed_shoot_all(struct bed *b, enum cap_pixfmt fmt, double black)
{
    for (size_t c = 0; c < CAMERAS; c++)
        bed_shoot(b, c, fmt, black);
}

/* The pictures, but for `without`, into the frame here or there. */
static void bed_load(struct bed *b, int there, uint64_t without)
{
    const struct cap_image *set[CAMERAS];
    rec_frame *f = there ? b->p.there : b->p.here;
    uint64_t mask;
    rec_frame_reset(f);
    for (size_t c = 0; c < CAMERAS; c++)
        set[c] = without >> c & 1 ? NULL : &b->image[c];
    (void)dmn_images_bin_frame(b->images[there], set, f, &mask);
    T_EQ_I(mask, (1u << CAMERAS) - 1 - without);
}

/* What photometry made of the pictures. */
static void same_pictures(const struct bed *b)
{
    const rec_frame *h = b->p.here, *t = b->p.there;
    T_EQ_I(memcmp(h->b, t->b, h->rows * (size_t)h->cs * sizeof *h->b), 0);
    T_EQ_I(memcmp(h->weight, t->weight, h->rows * sizeof *h->weight), 0);
    T_EQ_I(memcmp(h->lit, t->lit, h->rows), 0);
    T_EQ_I(h->per_channel, t->per_channel);
    if (h->per_channel)
        T_EQ_I(memcmp(h->weight4, t->weight4, h->rows * 4 * sizeof *h->weight4), 0);
    T_EQ_I(memcmp(&h->report.sigma, &t->report.sigma, sizeof h->report.sigma), 0);
    T_EQ_I(h->report.saturated, t->report.saturated);
    T_EQ_I(memcmp(h->sigma, t->sigma, sizeof h->sigma), 0);
    T_OK(h->report.active_voxels > 500);
}

static void bed_take(struct bed *b, uint64_t without)
{
    bed_load(b, 0, without);
    bed_load(b, 1, without);
    card_pair_solve(&b->p, NULL, NULL);
    T_EQ_I(b->p.wrong, 0);
    same_pictures(b);
    T_OK(b->p.there->report.raw_on_card && !b->p.here->report.raw_on_card);
}

T_CASE(pictures_have_the_bits_of_the_processors)
{
    static const struct {
        enum cap_pixfmt fmt;
        int nch, binning;
        enum cap_mosaic mosaic;
        double black;
        bool calibrated;
    } of[] = {{CAP_RGB8, 3, 1, CAP_MOSAIC_DEMOSAIC, 0, false},
              {CAP_GREY12P, 1, 2, CAP_MOSAIC_DEMOSAIC, 0, true},
              {CAP_BAYER_RG8, 3, 2, CAP_MOSAIC_DEMOSAIC, 0, false},
              {CAP_BAYER_GB12, 3, 2, CAP_MOSAIC_DEMOSAIC, 0, true},
              {CAP_BAYER_RG8, 3, 1, CAP_MOSAIC_RAYS, 0.02, true},
              {CAP_BAYER_GB10, 3, 1, CAP_MOSAIC_RAYS, 0.02, false}};
    for (size_t k = 0; k < sizeof of / sizeof *of; k++) {
        struct bed b;
        bed_new(&b, of[k].nch, of[k].binning, of[k].mosaic, of[k].calibrated, cl);
        bed_shoot_all(&b, of[k].fmt, of[k].black);
        bed_take(&b, 0);
        T_EQ_I(b.p.here->per_channel, of[k].mosaic == CAP_MOSAIC_RAYS && of[k].binning == 1);
        bed_free(&b);
    }
}

/* Sets follow one another in a slot; cameras are missing or voted out; a background comes and goes. */
T_CASE(sets_that_differ)
{
    struct bed b;
    T_NOT_UNDER_SANITIZERS();
    bed_new(&b, 3, 1, CAP_MOSAIC_DEMOSAIC, false, cl);
    bed_shoot_all(&b, CAP_RGB8, 0);
    bed_take(&b, 1u << 2 | 1u << 5);
    T_EQ_I(b.p.there->report.cameras, 4);
    memset(b.bytes[3], 0, b.image[3].size);
    bed_take(&b, 0);
    T_EQ_I(b.p.there->report.vote.out, 1u << 3);
    size_t bins = b.S->row0[1];
    float *light = pvx_calloc(bins * 4, sizeof *light);
    for (size_t i = 0; i < bins * 4; i++)
        light[i] = i % 4 < 3 ? 0.02F * (float)(i % 7) : 0;
    bed_shoot_all(&b, CAP_RGB8, 0.1);
    rec_frame *const both[] = {b.p.here, b.p.there};
    bed_take(&b, 0);
    float before = b.p.there->b[bins * 2];
    for (int k = 0; k < 2; k++)
        T_EQ_I(rec_carver_background(both[k]->carver, 0, light), PVX_OK);
    bed_take(&b, 0);
    T_OK(b.p.there->b[bins * 2] < before || light[bins * 2] == 0);
    for (int k = 0; k < 2; k++)
        T_EQ_I(rec_carver_background(both[k]->carver, 0, NULL), PVX_OK);
    bed_take(&b, 0);
    T_OK(b.p.there->b[bins * 2] == before);
    free(light);
    bed_free(&b);
}

/* Cameras change their format, so other maps are made; without the card the same bins come of them. */
T_CASE(maps_that_change)
{
    static const enum cap_pixfmt fmt[] = {CAP_RGB8, CAP_RGB12, CAP_YUYV, CAP_BAYER_GR10P};
    struct bed b;
    T_NOT_UNDER_TSAN();
    bed_new(&b, 3, 1, CAP_MOSAIC_DEMOSAIC, true, cl);
    for (size_t k = 0; k < sizeof fmt / sizeof *fmt; k++) {
        for (size_t c = 0; c < CAMERAS; c++)
            bed_shoot(&b, c, fmt[k], 0.01);
        bed_take(&b, k == 2 ? 1u << 3 : 0);
    }
    bed_load(&b, 0, 0);
    bed_load(&b, 1, 0);
    T_OK(b.p.there->bin.bin != NULL);
    T_EQ_I(memcmp(rec_frame_input(b.p.there, 0), rec_frame_input(b.p.here, 0), b.p.here->rows * 16),
           0);
    bed_free(&b);
}

/* Sets whose pixels the processors have to unpack: the rest is on the device all the same. */
T_CASE(sets_that_are_not_raw)
{
    struct bed b;
    T_NOT_UNDER_SANITIZERS();
    bed_new(&b, 3, 1, CAP_MOSAIC_DEMOSAIC, false, cl);
    for (int k = 0; k < 3; k++) {
        bed_shoot_all(&b, CAP_RGB8, 0);
        if (k == 0)
            bed_shoot(&b, 4, CAP_RGB_F32, 0);
        bed_load(&b, 0, 0);
        bed_load(&b, 1, 0);
        if (k == 1) /* somebody asks for bins before the carving */
            T_EQ_I(memcmp(rec_frame_input(b.p.there, 1), rec_frame_input(b.p.here, 1),
                          b.S->row0[1] * 16),
                   0);
        for (int i = 0; i < 2; i++)
            rec_carver_absorb(i ? b.p.there->carver : b.p.here->carver, k == 2 ? 0.3 : 0);
        card_pair_solve(&b.p, NULL, NULL);
        T_EQ_I(b.p.wrong, 0);
        same_pictures(&b);
        T_OK(!b.p.there->report.raw_on_card);
    }
    bed_free(&b);
}

/* Bins of pictures that are no longer known are not made up. */
T_CASE(a_set_that_was_forgotten)
{
    struct bed b;
    T_NOT_UNDER_SANITIZERS();
    bed_new(&b, 3, 1, CAP_MOSAIC_DEMOSAIC, false, cl);
    bed_shoot_all(&b, CAP_RGB8, 0);
    bed_load(&b, 1, 0);
    rec_frame *first = b.p.there, *second = b.p.here;
    const struct cap_image *set[CAMERAS];
    uint64_t mask;
    for (size_t c = 0; c < CAMERAS; c++)
        set[c] = &b.image[c];
    (void)dmn_images_bin_frame(b.images[1], set, second, &mask);
    (void)rec_frame_input(first, 0);
    rec_frame_carve(first);
    T_EQ_I(first->report.cameras, 0);
    T_EQ_I(first->report.active_voxels, 0);
    bed_free(&b);
}

T_CASE(a_device_that_is_lost)
{
    /* before the carving; before the pictures come; in the solve */
    for (int when = 0; when < 3; when++) {
        struct bed b;
        rec_cl *own = cl_bed_open();
        bed_new(&b, 3, 1, CAP_MOSAIC_DEMOSAIC, true, own);
        bed_shoot_all(&b, CAP_RGB8, 0);
        bed_load(&b, 0, 0);
        if (when == 1)
            rec_cl_lose(own, "it was pulled out");
        bed_load(&b, 1, 0);
        rec_frame_carve(b.p.here);
        if (when == 0)
            rec_cl_lose(own, "it was pulled out");
        rec_frame_carve(b.p.there);
        T_EQ_I(b.p.there->report.raw_on_card, when == 2);
        rec_cl_lose(own, "it was pulled out");
        T_EQ_I(rec_frame_solve(b.p.here, 0, NULL), PVX_OK);
        T_EQ_I(rec_frame_solve(b.p.there, 0, NULL), PVX_OK);
        same_pictures(&b);
        size_t n = (size_t)b.p.here->report.active_voxels * 4;
        T_EQ_I(memcmp(b.p.here->x, b.p.there->x, n * sizeof *b.p.here->x), 0);
        T_EQ_S(b.p.there->report.why_here, "it was pulled out");
        bed_free(&b);
        rec_cl_close(&own);
    }
}

T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
