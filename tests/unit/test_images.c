/* test_images.c - frames of a set become a frame's pixels; each that cannot be used is counted by its
 * cause and leaves its camera out of this set only. */
#include "../t.h"

#include <turbojpeg.h>

#include "base/log.h"
#include "daemon/pipeline/images.h"

enum { N = 6, W = 64, H = 48, BIN = 2 };

static struct rec_rig rig;
static pvx_pool *pool;
static rec_sysmat *S;
static rec_frame *frame;
static uint8_t yuyv[W * H * 2];
static unsigned char *coded[2]; /* a good JPEG, one of another size */
static unsigned long coded_size[2];
static struct cap_image store[N];

static void set_up(void)
{
    struct rec_sysmat_params mp = {.binning = BIN, .rays_per_bin = 1};
    struct rec_frame_params fp = rec_frame_defaults;
    struct pvx_diag d = {""};
    pvx_log_set_level(PVX_LOG_ERROR);
    T_EQ_I(rec_rig_ring(N, 2.5, W, H, 8, &rig), PVX_OK);
    T_EQ_I(pvx_pool_new(2, "test", &pool), PVX_OK);
    T_EQ_I(rec_sysmat_open(&rig, &mp, NULL, pool, (struct rec_progress){0}, &S, &d), PVX_OK);
    T_EQ_I(rec_frame_alone(S, &rig, &fp, pool, &frame, &d), PVX_OK);
    for (size_t i = 0; i < sizeof yuyv; i++)
        yuyv[i] = (uint8_t)(t_rand() >> 40);
    tjhandle tj = tjInitCompress();
    for (int k = 0; k < 2; k++) {
        unsigned char px[W * H * 3];
        for (int i = 0; i < W * H * 3; i++)
            px[i] = (unsigned char)(i / 3 % W * 3 + i % 3 * 20);
        T_EQ_I(tjCompress2(tj, px, W - k * 16, W * 3, H, TJPF_RGB, &coded[k], &coded_size[k],
                           TJSAMP_422, 90, 0),
               0);
    }
    tjDestroy(tj);
}

static void tear_down(void)
{
    tjFree(coded[0]);
    tjFree(coded[1]);
    rec_frame_free(&frame);
    rec_sysmat_free(&S);
    pvx_pool_free(&pool);
    rec_rig_fini(&rig);
}

static void put(const struct cap_image **set, size_t c, const void *data, size_t size,
                enum cap_pixfmt fmt)
{
    store[c] = (struct cap_image){data, size, W, H, (ptrdiff_t)cap_pixfmt_row(fmt, W), fmt, 0};
    set[c] = &store[c];
}

T_CASE(broken_ones_are_counted_and_left_out)
{
    dmn_images *im = NULL;
    struct dmn_images_params p = {.nch = 3, .binning = BIN};
    const struct cap_image *set[N] = {0};
    uint64_t mask, count[REC_MAX_CAMERAS][DMN_N_IMAGE];
    T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
    put(set, 0, yuyv, sizeof yuyv, CAP_YUYV);
    put(set, 1, coded[0], coded_size[0], CAP_JPEG);
    put(set, 2, coded[0], coded_size[0] * 2 / 3, CAP_JPEG);
    put(set, 3, coded[1], coded_size[1], CAP_JPEG);
    put(set, 4, yuyv, sizeof yuyv - 1, CAP_YUYV); /* camera 5 is missing */
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 2);
    T_EQ_I(mask, 3);
    dmn_images_counts(im, count);
    T_EQ_I(count[2][DMN_IMAGE_JPEG_DAMAGED], 1);
    T_EQ_I(count[3][DMN_IMAGE_JPEG_SIZE], 1);
    T_EQ_I(count[4][DMN_IMAGE_FORMAT], 1);
    uint64_t sum = 0;
    for (size_t c = 0; c < N; c++)
        for (int k = 0; k < DMN_N_IMAGE; k++)
            sum += count[c][k];
    T_EQ_I(sum, 3);

    /* what came through is what the parts give on their own */
    static float want[W / BIN * (H / BIN) * 4];
    T_EQ_I(cap_bin(&store[0], BIN, 3, 0, H / BIN, want), PVX_OK);
    T_EQ_I(memcmp(want, rec_frame_input(frame, 0), sizeof want), 0);
    T_NEAR(rec_frame_input(frame, 1)[4 * 20], pow((123.0 / 255 + 0.055) / 1.055, 2.4), 0.02);

    /* the next set is none the worse for it */
    for (size_t c = 0; c < N; c++)
        put(set, c, coded[0], coded_size[0], CAP_JPEG);
    store[5].width = W - 2;
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 5);
    T_EQ_I(mask, 31);
    T_EQ_S(dmn_images_why(im, 5), "is 62x48, but the rig says camera cam5 takes 64x48");
    dmn_images_counts(im, count);
    T_EQ_I(count[5][DMN_IMAGE_SIZE], 1);
    store[5].width = H;
    store[5].height = W;
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 5);
    T_EQ_S(dmn_images_why(im, 5),
           "is 48x64, but the rig says camera cam5 takes 64x48: width and height "
           "are swapped in its size");
    T_EQ_I(count[2][DMN_IMAGE_JPEG_DAMAGED], 1);
    dmn_images_free(&im);
    T_OK(im == NULL);
}

/* A camera that was asked for another format has no decoder, and a JPEG from it does no harm. */
T_CASE(jpeg_that_nobody_asked_for)
{
    dmn_images *im = NULL;
    struct dmn_images_params p = {
        .nch = 3, .binning = BIN, .fmt = CAP_YUYV, .transfer = CAP_TRANSFER_LINEAR};
    const struct cap_image *set[N] = {0};
    uint64_t mask, count[REC_MAX_CAMERAS][DMN_N_IMAGE];
    T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
    put(set, 0, yuyv, sizeof yuyv, CAP_YUYV);
    put(set, 1, coded[0], coded_size[0], CAP_JPEG);
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1);
    dmn_images_counts(im, count);
    T_EQ_I(count[1][DMN_IMAGE_JPEG_KIND], 1);
    static float want[W / BIN * (H / BIN) * 4];
    struct cap_convert_params linear = {.binning = BIN, .nch = 3, .transfer = CAP_TRANSFER_LINEAR};
    T_EQ_I(cap_convert(&store[0], &linear, 0, H / BIN, want), PVX_OK);
    T_EQ_I(memcmp(want, rec_frame_input(frame, 0), sizeof want), 0);
    dmn_images_free(&im);
}

/* An image of integers is saturated at its full scale, one of floats beside it in the same set is not. */
T_CASE(floats_have_no_full_scale)
{
    dmn_images *im = NULL;
    struct dmn_images_params p = {.nch = 3, .binning = BIN};
    const struct cap_image *set[N] = {0};
    static float bright[W * H * 3];
    static uint8_t full[W * H * 3];
    uint64_t mask;
    for (size_t i = 0; i < W * H * 3; i++) {
        bright[i] = 1.5f;
        full[i] = 255;
    }
    T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
    for (int integers = 0; integers < 2; integers++) {
        put(set, 0, bright, sizeof bright, CAP_RGB_F32);
        if (integers)
            put(set, 1, full, sizeof full, CAP_RGB8);
        T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1 + integers);
        rec_frame_carve(frame);
        T_EQ_I(rec_frame_get_report(frame)->saturated, integers * (W / BIN) * (H / BIN));
        rec_frame_reset(frame);
    }
    dmn_images_free(&im);
}

/* A grey picture says nothing of colours.  While another camera has colour it is left out and named; alone it is
 * used, and with one channel both are. */
T_CASE(grey_beside_colour)
{
    static uint8_t grey[W * H], rgb[W * H * 3];
    const struct cap_image *set[N] = {0};
    uint64_t mask, count[REC_MAX_CAMERAS][DMN_N_IMAGE];
    for (int nch = 1; nch <= 3; nch += 2)
        for (int alike = 0; alike < 2; alike++) {
            dmn_images *im = NULL;
            struct dmn_images_params p = {.nch = nch, .binning = BIN, .alike = alike};
            static float room[N][W / BIN * (H / BIN) * 4];
            float *out[N];
            for (int c = 0; c < N; c++)
                out[c] = room[c];
            T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
            memset(set, 0, sizeof set);
            put(set, 0, grey, sizeof grey, CAP_GREY8);
            T_EQ_I(dmn_images_bin(im, set, out, &mask), 1);
            put(set, 1, rgb, sizeof rgb, CAP_RGB8);
            put(set, 2, grey, sizeof grey, CAP_BAYER_RG8); /* colour too */
            uint64_t want = !alike ? 7 : nch == 3 ? 6 : 1;
            T_EQ_I(dmn_images_bin(im, set, out, &mask), __builtin_popcountll(want));
            T_EQ_I(mask, want);
            if (want == 6)
                T_CONTAINS(dmn_images_why(im, 0),
                           "Mono8 image, grey, but other cameras have colour");
            dmn_images_counts(im, count);
            T_EQ_I(count[0][DMN_IMAGE_KIND], want == 6);
            set[1] = set[2] = NULL; /* they are late: still cameras with colour */
            T_EQ_I(dmn_images_bin(im, set, out, &mask), want != 6);
            put(set, 1, grey, sizeof grey, CAP_GREY8); /* reopened, with another format */
            put(set, 2, grey, sizeof grey, CAP_GREY8);
            T_EQ_I(dmn_images_bin(im, set, out, &mask), 3);
            dmn_images_free(&im);
        }
}

/* A picture without a finite bin is left out and named; with one it is used. */
T_CASE(pictures_without_a_number)
{
    dmn_images *im = NULL;
    struct dmn_images_params p = {.nch = 3, .binning = BIN};
    const struct cap_image *set[N] = {0};
    static float px[3][W * H * 3];
    uint64_t mask, count[REC_MAX_CAMERAS][DMN_N_IMAGE];
    for (size_t i = 0; i < W * H * 3; i++) {
        px[0][i] = NAN;
        px[1][i] = i % 3 == 2 ? INFINITY : 1; /* blue only */
        px[2][i] = 1e12F;
    }
    T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
    for (size_t c = 0; c < 3; c++)
        put(set, c, px[c], sizeof px[c], CAP_RGB_F32);
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 0);
    for (size_t c = 0; c < 3; c++) {
        T_CONTAINS(dmn_images_why(im, c), "no pixel is a finite number");
        for (size_t k = 0; k < 3; k++)
            px[c][(20 * W + 31) * 3 + k] = -2;
    }
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 2); /* 1e12 spoils the bin's mean */
    dmn_images_counts(im, count);
    T_EQ_I(count[0][DMN_IMAGE_NO_NUMBER] * 10 + count[2][DMN_IMAGE_NO_NUMBER], 12);
    dmn_images_free(&im);
}

/* A black level above 1 is in the unit of floats. */
T_CASE(a_black_level_of_floats)
{
    dmn_images *im = NULL;
    struct dmn_images_params p = {.nch = 3, .binning = BIN};
    const struct cap_image *set[N] = {0};
    static float bright[W * H * 3];
    static uint8_t full[W * H * 3];
    uint64_t mask;
    T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
    put(set, 0, bright, sizeof bright, CAP_RGB_F32);
    put(set, 1, full, sizeof full, CAP_RGB8);
    dmn_images_black(im, 5.1F);
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1);
    T_EQ_I(mask, 1);
    T_CONTAINS(dmn_images_why(im, 1), "RGB8 image, whose black level is a share");
    dmn_images_black(im, 1);
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 2);
    dmn_images_free(&im);
}

/* Samples of 12 bits in 16: where they end is found while pictures come, in one row of eight of each, and counts as
 * saturated from then on.  A sample above shows that it is not the end. */
T_CASE(fewer_bits_than_the_format)
{
    dmn_images *im = NULL;
    struct dmn_images_params p = {.nch = 3, .binning = BIN, .look = 8};
    const struct cap_image *set[N] = {0};
    static uint16_t px[W * H];
    uint64_t mask;
    for (size_t i = 0; i < W * H; i++)
        px[i] = i / W == 20 && i % W < 8 ? 4095 : 400;
    T_EQ_I(dmn_images_new(&p, &rig, pool, &im, NULL), PVX_OK);
    put(set, 0, px, sizeof px, CAP_GREY16);
    int sets = 0;
    for (; sets < 9 && dmn_images_bits(im, 0) == 0; sets++)
        T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1);
    T_LE(sets, 8);
    T_EQ_I(dmn_images_bits(im, 0), 12);
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1);
    T_NEAR(rec_frame_camera(frame, 0)->saturated, 4095 / 65535.0, 1e-7);
    T_NEAR(rec_frame_input(frame, 0)[10 * (W / BIN) * 4], 4095 / 65535.0, 1e-7);
    rec_frame_carve(frame);
    T_EQ_I(rec_frame_get_report(frame)->saturated, 4);
    rec_frame_reset(frame);
    store[0].fmt = CAP_GREY12; /* as what it is: at full scale */
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1);
    T_OK(rec_frame_input(frame, 0)[10 * (W / BIN) * 4] == 1 && dmn_images_saturated(im, 0) == 0);
    rec_frame_reset(frame);
    for (size_t y = 0; y < H; y++)
        px[y * W + 9] = 5000;
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 0);
    T_CONTAINS(dmn_images_why(im, 0), "Mono12 image: a sample is 5000, but 12 bits end at 4095");
    store[0].fmt = CAP_GREY16;
    T_EQ_I(dmn_images_bin_frame(im, set, frame, &mask), 1);
    T_EQ_I(dmn_images_bits(im, 0), 0);
    rec_frame_reset(frame);
    dmn_images_free(&im);
}

T_MAIN(set_up(), tear_down())
