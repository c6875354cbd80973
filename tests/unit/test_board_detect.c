/* test_board_detect.c - boards found in pictures with known truth: how exactly, which face, and what is said
 * where none is found. */
#include "../t.h"

#include "recon/board/detect_int.h"
#include "recon/board/spec.h"
#include "tests/lib/board_judge.h"

#define W 320
#define H 240

static struct rec_board board;
static rec_board_detector *det;
static float level[W * H];
static uint8_t bytes[W * H];

static void use(const char *text)
{
    struct pvx_diag d = {""};
    rec_board_detector_free(&det);
    pvx_err e = rec_board_parse(text, &board, &d);
    if (e == PVX_OK)
        e = rec_board_detector_new(&board, &det, &d);
    T_CHECK_(e == PVX_OK, "%s: %s", text, d.text);
    if (e != PVX_OK)
        exit(1);
}

/* A shot of 320x240, blurred by a pixel, with 1 % noise. */
static struct board_shot shot(enum rec_board_face face, double square, double tilt, double about,
                              double roll)
{
    struct board_shot s = board_shot_of(&board, face, square, tilt, about, roll);
    s.width = W;
    s.height = H;
    s.cx = 158.7;
    s.cy = 121.2;
    s.across = 3;
    s.blur = 1;
    s.noise = 0.01;
    return s;
}

static struct rec_board_sight look_at(const float *pixels)
{
    struct rec_board_sight s;
    for (size_t i = 0; i < W * H; i++)
        bytes[i] = (uint8_t)lrint(255 * fmin(1, fmax(0, pixels[i])));
    T_EQ_I(rec_board_detect(det, &(struct rec_board_picture){bytes, W, H, W, false}, &s), PVX_OK);
    return s;
}

static struct rec_board_sight look(const struct rec_board *b, const struct board_shot *s)
{
    board_picture(b, s, level);
    return look_at(level);
}

/* The bounds of a corner detector: bias 0.05 px, sigma 0.1 px, 95 % found, none astray, and a covariance that
 * is neither a boast nor an excuse. */
static void good(const struct board_judged *j, const char *what)
{
    int before = t_case_fails;
    T_LE(fabs(j->bias[0]), 0.05);
    T_LE(fabs(j->bias[1]), 0.05);
    T_LE(j->sigma[0], 0.1);
    T_LE(j->sigma[1], 0.1);
    T_LE(0.95 * (double)j->visible, (double)j->found);
    T_EQ_I(j->strays, 0);
    T_LE(j->chi2, 3);
    T_LE(0.2, j->chi2);
    if (t_case_fails > before)
        printf("  %s: found %zu of %zu, bias %.3f %.3f, sigma %.3f %.3f, worst %.2f, chi2 %.2f\n",
               what, j->found, j->visible, j->bias[0], j->bias[1], j->sigma[0], j->sigma[1],
               j->worst, j->chi2);
}

/* Squares of 20 px, tilted by up to 60 degrees in all directions, with a lens that bends. */
static void accurate(const char *text, double side, double most, int shots)
{
    use(text);
    for (double tilt = T_SANITIZED ? most : 0; tilt <= most; tilt += most / 2) {
        struct board_judged j = {0};
        for (int i = 0; i < shots; i++) {
            struct board_shot s = shot(board.two_sided && i % 2 ? REC_BACK : REC_FRONT, side, tilt,
                                       17 + 47 * i, 80 * i);
            s.k[0] = -0.3;
            s.k[1] = 0.1;
            s.k[2] = 0.002;
            s.seed = (uint64_t)i;

            board_judge(&j, &board, det, &s, i % 2);
        }
        board_judged(&j);
        good(&j, text);
    }
}

/* OpenCV's markers, each four times. */
static struct rec_cv four_times;
static const struct rec_cv *once;

static int markers_four_times(const struct rec_cv_picture *p, const struct rec_cv_search *s,
                              struct rec_cv_marker *out, size_t max, size_t *n)
{
    int failed = once->markers(p, s, out, max / 4, n);
    size_t m = failed ? 0 : *n;
    for (size_t i = m; i-- > 0;) /* those of the dictionary stay first */
        for (size_t k = 4; k-- > 0;)
            out[4 * i + k] = out[i];
    *n = 4 * m;
    return failed;
}

static int no_chessboard(const struct rec_cv_picture *p, int cols, int rows, float *xy, int *found)
{
    (void)p, (void)cols, (void)rows, (void)xy;
    T_CHECK_(false, "OpenCV is asked");
    *found = 0;
    return 0;
}

T_CASE(a_marker_that_is_read_twice_counts_once)
{
    use("charuco:5x6:0.06:0.045");
    struct board_shot s = shot(REC_FRONT, 30, 20, 40, 10);
    struct rec_board_sight a = look(&board, &s);
    size_t n = a.view.n;
    T_OK(n >= 12);
    T_EQ_I(a.outcome, REC_SIGHT_FOUND);
    once = det->cv;
    four_times = *once;
    four_times.markers = markers_four_times;
    det->cv = &four_times;
    struct rec_board_sight b = look(&board, &s);
    T_EQ_I(b.outcome, REC_SIGHT_FOUND);
    T_EQ_I(b.view.n, n);
    T_EQ_I(b.markers, a.markers);
    rec_board_detector_free(&det);
}

T_CASE(charuco_is_accurate)
{
    accurate("charuco:6x8:0.03:0.022", 20, 60, 4);
}

T_CASE(both_faces_are_accurate)
{
    accurate("charuco:6x8:0.03:0.022:thickness=0.004", 20, 60, 2);
}

/* So many pixels that the picture is looked at made smaller first; and a board on edge, of which nothing is found. */
T_CASE(large_pictures)
{
    struct board_judged j = {0}, edge = {0};
    use("charuco:6x8:0.03:0.022:two-sided");
    for (int i = 0; i < 3; i++) {
        struct board_shot s = board_shot_of(&board, i % 2 ? REC_BACK : REC_FRONT, 30,
                                            i == 2 ? 86 : 40, 30 + 70 * i, 9);
        s.width = 1100;
        s.height = 820;
        s.f *= 1.7;
        s.cx *= 1.7;
        s.cy *= 1.7;
        s.across = 2;
        s.blur = 1;
        s.noise = 0.01;
        s.seed = (uint64_t)i;
        board_judge(i == 2 ? &edge : &j, &board, det, &s, false);
    }
    board_judged(&j);
    good(&j, "1100x820");
    T_EQ_I(edge.found, 0);
    T_EQ_I(edge.strays, 0);
}

T_CASE(inverted_is_accurate)
{
    accurate("charuco:6x7:0.03:0.022:inverted", 20, 60, 2);
}

T_CASE(
    chessboard_is_accurate) /* rolled by 240 degrees too: the first corner is told by the colours */
{
    accurate("chessboard:8x5:0.03", 20, 60, 2);
}

T_CASE(aprilgrid_is_accurate)
{
    accurate("aprilgrid:3x3:0.03:0.009", 40, 60, 2);
}

/* A grid is read as it was drawn, whichever way the spec says. */
T_CASE(layouts_of_aprilgrids)
{
    static const char *const given[] = {"aprilgrid:4x3:0.03:0.009",
                                        "aprilgrid:4x3:0.03:0.009:kalibr"};
    for (int i = 0; i < 2; i++) {
        use(given[i]);
        for (int grid = 0; grid <= REC_GRID_KALIBR; grid++) {
            struct rec_board seen = board;
            struct board_shot s = shot(REC_FRONT, 44, 25, 30 * grid, 50 * grid);
            seen.grid = (uint8_t)grid;
            struct rec_board_sight sight = look(&seen, &s);
            T_CHECK_(sight.outcome == REC_SIGHT_FOUND, "%s, %d: %s", given[i], grid, sight.text);
            T_EQ_I(sight.grid, grid);
            T_LE(36, sight.view.n);
            for (size_t k = 0; k < sight.view.n; k++) {
                double xy[2];
                board_truth(&seen, &s, sight.view.corner[k].id, xy);
                T_NEAR(sight.view.corner[k].x, xy[0], 0.3);
                T_NEAR(sight.view.corner[k].y, xy[1], 0.3);
            }
        }
    }
    accurate("aprilgrid:3x3:0.03:0.009:kalibr", 50, 40, 2);
    /* ids that the grid does not have, and a grid of another size */
    struct rec_board seen;
    T_EQ_I(rec_board_parse("aprilgrid:3x4:0.03:0.009:kalibr", &seen, NULL), PVX_OK);
    use("aprilgrid:4x3:0.03:0.009");
    struct board_shot s = shot(REC_FRONT, 40, 10, 30, 5);
    struct rec_board_sight sight = look(&seen, &s);
    T_EQ_I(sight.outcome, REC_SIGHT_OTHER_BOARD);
    T_CONTAINS(sight.text, "fit 3x4 (or more rows), not 4x3");
    T_EQ_I(sight.view.n, 0);
}

/* Six markers in a row and one more do not look like a board of another ratio; and a wrong ratio is told. */
T_CASE(a_row_of_markers_shows_no_ratio)
{
    use("aprilgrid:6x6:0.03:0.009");
    const double h[9] = {900, 80, 60, -70, 700, 200, 0.2, 0.5, 1};
    for (int i = 0; i < 200; i++) {
        struct rec_cv_marker m[12];
        bool agrees[12];
        size_t n = i < 100 ? 7 : 12;
        double size = i < 100 ? 1 : 1.2;
        for (size_t k = 0; k < n; k++) {
            double xy[4][2], uv[2];
            m[k] = (struct rec_cv_marker){.id = (int32_t)(n == 7 && k == 6 ? 20 : 6 + k)};
            agrees[k] = true;
            rec_print_marker(&det->print[0], m[k].id, xy);
            for (int c = 0; c < 4; c++) {
                double x = (xy[0][0] + xy[2][0]) / 2, y = (xy[0][1] + xy[2][1]) / 2;
                rec_homography_map(h, x + size * (xy[c][0] - x), y + size * (xy[c][1] - y), uv);
                for (int a = 0; a < 2; a++)
                    m[k].xy[c][a] = (float)(uv[a] + t_uniform(-0.5, 0.5));
            }
        }
        double ratio = rec_match_ratio(&det->print[0], m, n, agrees);
        T_CHECK_(!(fabs(ratio - size) > 0.08), "%g, not %g", ratio, size);
    }
}

T_CASE(warped_and_uneven_light)
{
    use("charuco:6x8:0.03:0.022");
    struct board_judged j = {0};
    struct board_shot s = shot(REC_FRONT, 24, 40, 30, 5);
    s.warp = 0.004;
    board_judge(&j, &board, det, &s, true);
    s.dark = 0.03; /* a tenth of the light */
    s.light = 0.1;
    s.ground = 0.05;
    s.noise = 0.002;
    board_judge(&j, &board, det, &s, true);
    board_judged(&j);
    good(&j, "warped");
}

T_CASE(covered_in_part)
{
    use("charuco:6x8:0.03:0.022");
    struct board_shot s = shot(REC_FRONT, 24, 30, 30, 5);
    double cover[4] = {0, 0, 165, 110};
    memcpy(s.cover, cover, sizeof cover);
    struct rec_board_sight sight = look(&board, &s);
    uint32_t there = 0, found = 0;
    for (uint32_t id = 0; id < rec_board_corners(&board); id++) {
        double xy[2];
        there += board_truth(&board, &s, id, xy);
    }
    for (size_t i = 0; i < sight.view.n; i++) {
        double xy[2];
        const struct rec_board_corner *c = &sight.view.corner[i];
        found += board_truth(&board, &s, c->id, xy);
        T_NEAR(c->x, xy[0], 0.5); /* at the rim of the cover, or not at all */
        T_NEAR(c->y, xy[1], 0.5);
        T_OK(i == 0 || c->id > sight.view.corner[i - 1].id);
    }
    T_OK(there > 15 && there < 35);
    T_LE(0.9 * there, found);
}

T_CASE(same_bits)
{
    use("charuco:6x8:0.03:0.022");
    struct board_shot s = shot(REC_FRONT, 14, 50, 30, 5);
    struct rec_board_sight a = look(&board, &s);
    struct rec_board_corner first[35];
    T_EQ_I(a.view.n, 35);
    memcpy(first, a.view.corner, a.view.n * sizeof *first);
    for (size_t i = 0; i < W * H; i++) /* something else in between */
        level[i] = (float)(i % 7) / 7;
    look_at(level);
    struct rec_board_sight b = look(&board, &s);
    T_EQ_I(b.view.n, a.view.n);
    for (size_t i = 0; i < b.view.n; i++)
        T_OK(first[i].x == b.view.corner[i].x && first[i].y == b.view.corner[i].y &&
             first[i].cov[0] == b.view.corner[i].cov[0]);
}

T_CASE(layout_of_even_rows_is_said)
{
    struct rec_board old;
    T_EQ_I(rec_board_parse("charuco:6x8:0.03:0.022:legacy", &old, NULL), PVX_OK);
    use("charuco:6x8:0.03:0.022");
    struct board_shot s = shot(REC_FRONT, 24, 30, 30, 5);
    struct rec_board_sight sight = look(&old, &s);
    T_EQ_I(sight.outcome, REC_SIGHT_FOUND);
    T_OK(sight.legacy);
    T_EQ_I(sight.view.n, 35);
    for (size_t i = 0; i < sight.view.n; i++) {
        double xy[2];
        board_truth(&old, &s, sight.view.corner[i].id, xy);
        T_NEAR(sight.view.corner[i].x, xy[0], 0.2);
    }
    s.blur = 2; /* markers that cannot be outlined */
    sight = look(&old, &s);
    T_OK(sight.outcome == REC_SIGHT_FOUND && sight.legacy);
    sight = look(&board, &s);
    T_OK(sight.outcome == REC_SIGHT_FOUND && !sight.legacy);
}

/* Markers of 4x4 bits give false ones when they are seen mirrored; what is found must not come of these. */
T_CASE(mirrored_is_said)
{
    static const char *const all[] = {"charuco:6x8:0.03:0.022", "charuco:6x8:0.03:0.022:4X4_1000",
                                      "charuco:6x8:0.03:0.022:ARUCO_ORIGINAL",
                                      "aprilgrid:3x3:0.03:0.009"};
    for (size_t i = 0; i < 4; i++) {
        use(all[i]);
        struct board_shot s = shot(REC_FRONT, i == 3 ? 40 : 24, 30, 30, 5);
        s.flipped = true;
        struct rec_board_sight sight = look(&board, &s);
        T_CHECK_(sight.outcome == REC_SIGHT_MIRRORED, "%s: %s %s", all[i],
                 rec_sight_name(sight.outcome), sight.text);
        T_EQ_I(sight.view.n, 0);
        T_CONTAINS(sight.text, "driver flips");
    }
}

T_CASE(other_boards_are_said)
{
    struct rec_board seen;
    T_EQ_I(rec_board_parse("charuco:5x7:0.03:0.022", &seen, NULL), PVX_OK);
    use("charuco:8x11:0.03:0.022");
    struct board_shot s = shot(REC_FRONT, 30, 10, 30, 5);
    struct rec_board_sight sight = look(&seen, &s);
    T_EQ_I(sight.outcome, REC_SIGHT_OTHER_BOARD);
    T_CONTAINS(sight.text, "fit 5x7 (or more rows), not 8x11");
    T_EQ_I(rec_board_parse("chessboard:8x5:0.03", &seen, NULL), PVX_OK);
    for (int i = 0; i < 3; i++) {
        use(i == 0   ? "chessboard:9x6:0.03"
            : i == 1 ? "chessboard:6x9:0.03"
                     : "chessboard:7x6:0.03");
        once = det->cv;
        four_times = *once;
        four_times.chessboard = no_chessboard; /* it takes long where there is none */
        det->cv = &four_times;
        s = shot(REC_FRONT, 24, 40, 30 * i, 5 + 70 * i);
        sight = look(&seen, &s);
        T_EQ_I(sight.outcome, REC_SIGHT_OTHER_BOARD);
        T_CONTAINS(sight.text, "shows 8x5 inner corners, not ");
        T_OK((strstr(sight.text, "not the squares") != NULL) == (i < 2));
    }
    T_EQ_I(rec_board_parse("charuco:6x8:0.03:0.017", &seen, NULL), PVX_OK);
    use("charuco:6x8:0.03:0.024");
    s = shot(REC_FRONT, 30, 10, 30, 5);
    s.blur = 0.5;
    sight = look(&seen, &s);
    T_EQ_I(sight.outcome, REC_SIGHT_OTHER_RATIO);
    T_CONTAINS(sight.text, "of a square, the board says 0.8: measure");
    T_EQ_I(sight.view.n, 0);
    T_EQ_I(rec_board_parse("charuco:6x8:0.03:0.022:6X6_250", &seen, NULL), PVX_OK);
    T_EQ_I(look(&seen, &s).outcome, REC_SIGHT_NO_MARKER);
}

T_CASE(nothing_found_has_a_reason)
{
    use("charuco:6x8:0.03:0.022");
    struct board_shot s = shot(REC_FRONT, 22, 10, 30, 5);
    s.dark = 0.01;
    s.light = 0.012;
    s.ground = 0.011;
    s.noise = 0.001;
    T_EQ_I(look(&board, &s).outcome, REC_SIGHT_DARK);
    s = shot(REC_FRONT, 22, 10, 30, 5);
    s.blur = 6;
    T_EQ_I(look(&board, &s).outcome, REC_SIGHT_BLURRED);
    s = shot(REC_FRONT, 5, 10, 30, 5);
    s.blur = 0.5;
    T_EQ_I(look(&board, &s).outcome, REC_SIGHT_SMALL);
    s = shot(REC_BACK, 22, 10, 30, 5); /* of a board that has none: bare paper */
    struct rec_board_sight bare = look(&board, &s);
    T_EQ_I(bare.outcome, REC_SIGHT_NO_MARKER);
    T_CONTAINS(bare.text, "no marker");
    use("chessboard:8x5:0.03");
    s = shot(REC_FRONT, 22, 10, 30, 5);
    s.cx += 120; /* half of it is out of the picture */
    T_EQ_I(look(&board, &s).outcome, REC_SIGHT_FEW);
}

/* The outcome of noise, of one level, of no numbers, and of pictures that are hardly any. */
T_CASE(hostile_pictures)
{
    static const char *const all[] = {"charuco:6x8:0.03:0.022:two-sided",
                                      "aprilgrid:3x3:0.03:0.009", "chessboard:8x5:0.03"};
    struct rec_board_sight s;
    for (size_t k = 0; k < 3; k++) {
        use(all[k]);
        for (size_t i = 0; i < W * H; i++)
            level[i] = (float)t_uniform(0, 1);
        T_EQ_I(look_at(level).view.n, 0);
        for (size_t i = 0; i < W * H; i++)
            level[i] = i % 3 == 0 ? NAN : i % 3 == 1 ? INFINITY : -1e30F;
        T_EQ_I(rec_board_detect(
                   det, &(struct rec_board_picture){level, W, H, W * sizeof *level, true}, &s),
               PVX_OK);
        T_EQ_I(s.view.n, 0);
        for (int32_t n = 1; n < 40; n += 3) {
            T_EQ_I(
                rec_board_detect(det, &(struct rec_board_picture){bytes, n, 40 - n, W, false}, &s),
                PVX_OK);
            T_EQ_I(s.view.n, 0);
            T_OK(s.text[0] != '\0');
        }
        T_EQ_I(rec_board_detect(det, &(struct rec_board_picture){bytes, 0, 5, W, false}, &s),
               PVX_EINVAL);
    }
    rec_board_detector_free(&det);
}

T_MAIN(plugins_of_this_build(), rec_board_detector_free(&det))
