/* bench_board.c - boards found in pictures: how many corners, how exactly, how fast; pictures with known truth,
 * then real ones.
 *   bench_board [OUT [SHOTS [BOARD [CASE]]]]   27, 28: 800 pictures of 0.3 and 1.2 million pixels */
#include <dirent.h>

#include "base.h"
#include "base/clock.h"
#include "base/pool.h"
#include "capture/files/imgio.h"
#include "recon/board/spec.h"
#include "tests/lib/board_judge.h"

static const char *const boards[] = {"charuco:8x11:0.03:0.022",
                                     "charuco:8x11:0.03:0.022:inverted:two-sided",
                                     "aprilgrid:6x6:0.03:0.009", "chessboard:9x6:0.025"};
static const double tilts[] = {0, 30, 60}, sides[] = {12, 20, 30}, blurs[] = {0.5, 1, 2};

static rec_board_detector *detector(const char *text, struct rec_board *b)
{
    struct pvx_diag d = {""};
    rec_board_detector *det = NULL;
    pvx_err e = rec_board_parse(text, b, &d);
    if (e == PVX_OK)
        e = rec_board_detector_new(b, &det, &d);
    if (e != PVX_OK) {
        printf("%s\n", pvx_diag_text(&d, e));
        exit(1);
    }
    return det;
}

/* The same picture, of more pixels. */
static void enlarge(struct board_shot *s, double larger)
{
    s->width = (int32_t)(larger * s->width);
    s->height = (int32_t)(larger * s->height);
    s->f *= larger;
    s->cx *= larger;
    s->cy *= larger;
}

static void simulated(FILE *csv, const char *text, int c, int shots, double larger)
{
    struct rec_board b;
    struct board_judged j = {0};
    rec_board_detector *det = detector(text, &b);
    double side = sides[c / 9], tilt = tilts[c / 3 % 3], blur = blurs[c % 3];
    for (int i = 0; i < shots; i++) {
        struct board_shot s = board_shot_of(&b, b.two_sided && i % 2 ? REC_BACK : REC_FRONT, side,
                                            tilt, 37 + 50 * i, 11 * i);
        enlarge(&s, larger);
        s.blur = blur;
        s.noise = 0.01;
        s.k[0] = -0.2;
        s.k[1] = 0.05;
        s.seed = (uint64_t)i + 1;
        board_judge(&j, &b, det, &s, i % 2);
    }
    board_judged(&j);
    bench_row(csv, "%s,%.0f,%.0f,%.0f,%.1f,%.3f,%zu,%.3f,%.3f,%.3f,%.3f,%.2f,%.2f,%.1f", text,
              640 * larger, larger * side, tilt, blur, (double)j.found / (double)j.visible,
              j.strays, j.bias[0], j.bias[1], j.sigma[0], j.sigma[1], j.worst, j.chi2,
              1e3 * j.seconds);
    rec_board_detector_free(&det);
}

/* ---- what a whole calibration takes: 800 pictures on two threads ---------------------------------- */

enum { KINDS = 40, PICTURES = 800 };

struct many {
    const char *text;
    int32_t width, height;
    float *level[KINDS];
    size_t found[2], corners[2]; /* of each thread */
    double cpu[2];               /* s */
};

static void look_at_half(void *ctx, size_t half)
{
    struct many *m = ctx;
    struct rec_board b;
    struct rec_board_sight s;
    rec_board_detector *det = detector(m->text, &b);
    double t = board_cpu_seconds();
    for (size_t i = half; i < PICTURES; i += 2) {
        if (rec_board_detect(det,
                             &(struct rec_board_picture){m->level[i / 2 % KINDS], m->width,
                                                         m->height,
                                                         m->width * (ptrdiff_t)sizeof(float), true},
                             &s) != PVX_OK)
            exit(1);
        m->found[half] += s.outcome == REC_SIGHT_FOUND;
        m->corners[half] += s.view.n;
    }
    m->cpu[half] = board_cpu_seconds() - t;
    rec_board_detector_free(&det);
}

/* Pictures as of a ring of cameras: tilted by 0 to 65 degrees, squares of 14 to 29 px (640x480), and one in five
 * with the board on edge, of which nothing is to be found. */
static void many(const char *text, double larger)
{
    struct rec_board b;
    struct many m = {.text = text};
    rec_board_detector *det = detector(text, &b);
    rec_board_detector_free(&det);
    for (int i = 0; i < KINDS; i++) {
        struct board_shot s =
            board_shot_of(&b, b.two_sided && i % 2 ? REC_BACK : REC_FRONT, 14 + i % 16,
                          i % 5 == 4 ? 86 : 65.0 * i / KINDS, 47 * i, 17 * i);
        enlarge(&s, larger);
        s.blur = 0.7;
        s.noise = 0.01;
        s.k[0] = -0.1;
        s.across = 3;
        s.seed = (uint64_t)i + 1;
        m.width = s.width;
        m.height = s.height;
        m.level[i] = malloc((size_t)m.width * (size_t)m.height * sizeof(float));
        if (m.level[i] == NULL)
            exit(1);
        board_picture(&b, &s, m.level[i]);
    }
    pvx_pool *pool;
    if (pvx_pool_new(2, "board", &pool) != PVX_OK)
        exit(1);
    int64_t t = pvx_now_mono();
    pvx_pool_run(pool, 2, look_at_half, &m);
    double seconds = 1e-9 * (double)(pvx_now_mono() - t);
    pvx_pool_free(&pool);
    printf("%s: 800 pictures of %d x %d on two threads: %.1f s, %.1f s of processor, board in %zu, "
           "%zu corners\n",
           text, m.width, m.height, seconds, m.cpu[0] + m.cpu[1], m.found[0] + m.found[1],
           m.corners[0] + m.corners[1]);
    for (int i = 0; i < KINDS; i++)
        free(m.level[i]);
}

static uint8_t *grey_of(const struct cap_image *img)
{
    size_t n = (size_t)img->width * (size_t)img->height,
           nch = (size_t)img->stride / (size_t)img->width;
    const uint8_t *p = img->data;
    uint8_t *g = malloc(n);
    for (size_t i = 0; i < n && g != NULL; i++)
        g[i] = nch == 1 ? p[i]
                        : (uint8_t)((77 * p[3 * i] + 150 * p[3 * i + 1] + 29 * p[3 * i + 2]) >> 8);
    return g;
}

struct tally {
    int pictures, found;
    size_t corners;
};

static void count(struct tally *t, rec_board_detector *det, const struct cap_image *img)
{
    struct rec_board_sight s;
    uint8_t *g = grey_of(img);
    if (rec_board_detect(det,
                         &(struct rec_board_picture){g, img->width, img->height, img->width, false},
                         &s) != PVX_OK)
        exit(1);
    t->pictures++;
    t->found += s.outcome == REC_SIGHT_FOUND;
    t->corners += s.view.n;
    free(g);
}

/* Every picture or video of a folder whose name begins so. */
static void real(const char *text, const char *folder, const char *prefix)
{
    char dir[1024], path[2048];
    struct rec_board b;
    struct dirent **entry;
    struct tally t = {0};
    rec_board_detector *det = detector(text, &b);
    bench_data(dir, folder);
    int n = scandir(dir, &entry, NULL, alphasort);
    for (int i = 0; i < n; i++) {
        struct cap_loaded l;
        struct cap_image img;
        cap_video *v;
        double fps;
        snprintf(path, sizeof path, "%s/%s", dir, entry[i]->d_name);
        bool fits = strncmp(entry[i]->d_name, prefix, strlen(prefix)) == 0 &&
                    strpbrk(entry[i]->d_name, "0123456789");
        free(entry[i]);
        if (fits && strstr(path, ".jpg") != NULL && cap_image_load(path, &l, NULL) == PVX_OK) {
            count(&t, det, &l.img);
            cap_loaded_free(&l);
        } else if (fits && strstr(path, ".mp4") != NULL &&
                   cap_video_open(path, &v, &fps, NULL) == PVX_OK) {
            while (cap_video_next(v, &img, NULL) == PVX_OK)
                count(&t, det, &img);
            cap_video_close(&v);
        }
    }
    if (n >= 0)
        free(entry);
    rec_board_detector_free(&det);
    if (t.pictures == 0)
        bench_not_run("boards of real cameras", dir);
    else
        printf("%s, %s*: board in %d of %d pictures, %zu corners\n", folder, prefix, t.found,
               t.pictures, t.corners);
}

int main(int argc, char **argv)
{
    int shots = argc > 2 ? atoi(argv[2]) : 8, only = argc > 3 ? atoi(argv[3]) : -1,
        one = argc > 4 ? atoi(argv[4]) : -1;
    board_module_here();
    FILE *csv = bench_csv(
        argc, argv, "board",
        "board,width,side_px,tilt_deg,blur_px,found,strays,bias_x,bias_y,sigma_x,sigma_y,worst,"
        "chi2,ms");
    for (int k = 0; k < 4; k++)
        for (int c = 0; c < 27; c++)
            if ((only < 0 || only == k) && (one < 0 || one == c))
                simulated(csv, boards[k], c, shots, 1);
    if (only < 0) /* 1.3 million pixels */
        simulated(csv, boards[0], 22, shots, 2);
    fclose(csv);
    for (int k = 0; k < 2; k++)
        for (int larger = 1; larger <= 2; larger++)
            if ((only < 0 || only == k) && (one < 0 || one == 26 + larger))
                many(boards[k], larger);
    if (only >= 0)
        return 0;
    real("chessboard:9x6:0.025", "calibration/opencv_stereo", "left");
    real("chessboard:9x6:0.025", "calibration/opencv_stereo", "right");
    real("charuco:4x5:0.054:0.0405:4X4_1000:inverted",
         "calibration/caliscope_post_optimization/calibration/extrinsic", "cam_");
    real("charuco:4x5:0.054:0.0405:4X4_1000:inverted",
         "calibration/caliscope_charuco/calibration/extrinsic", "cam_");
    return *bench_status();
}
