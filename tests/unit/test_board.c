/* test_board.c - boards as text, their points, their print, and the sheet: drawn, rasterised, found again. */
#include "../t.h"

#include <cairo.h>

#include "recon/board/detect.h"
#include "recon/board/sheet.h"
#include "recon/board/spec.h"
#include "tests/lib/board_picture.h"

static struct rec_board board(const char *text)
{
    struct rec_board b;
    struct pvx_diag d = {""};
    T_CHECK_(rec_board_parse(text, &b, &d) == PVX_OK, "%s", d.text);
    return b;
}

T_CASE(text_of_boards)
{
    static const char *const cases[][2] = {
        {"charuco:8x11:0.03:0.022", "charuco:8x11:0.03:0.022:5X5_100"},
        {"charuco:8x11:30mm:22mm:DICT_6X6_250", "charuco:8x11:0.03:0.022:6X6_250"},
        {"charuco:20x20:0.03:0.022", "charuco:20x20:0.03:0.022:5X5_250"},
        {"chessboard:9x6:0.025", "chessboard:9x6:0.025"},
        {"aprilgrid:6x6:0.03:0.009", "aprilgrid:6x6:0.03:0.009:36h11"},
        {"aprilgrid:6x6:88mm:26.4mm:kalibr", "aprilgrid:6x6:0.088:0.0264:36h11:kalibr"},
        {"charuco:8x11:0.03:0.022:two-sided", "charuco:8x11:0.03:0.022:5X5_100:two-sided"},
        {"charuco:8x11:0.03:0.022:inverted:thickness=3mm",
         "charuco:8x11:0.03:0.022:5X5_100:thickness=0.003:inverted"},
        {"charuco:8x10:0.03:0.022:legacy", "charuco:8x10:0.03:0.022:5X5_100:legacy"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[REC_BOARD_TEXT];
        struct rec_board b = board(cases[i][0]);
        rec_board_text(&b, text);
        T_EQ_S(text, cases[i][1]);
    }
    T_OK(isnan(board("charuco:8x11:0.03:0.022:two-sided").thickness));
    T_OK(rec_board_symmetric(&(struct rec_board){.kind = REC_CHESSBOARD, .cols = 8, .rows = 6}));
    T_OK(!rec_board_symmetric(&(struct rec_board){.kind = REC_CHESSBOARD, .cols = 9, .rows = 6}));
}

T_CASE(what_is_no_board_is_said)
{
    static const char *const cases[][2] = {
        {"", "boards are charuco:8x11"},
        {"charucco:8x11:0.03:0.022", "no kind 'charucco'"},
        {"charuco:8y11:0.03:0.022", "write across x down, as 8x11"},
        {"charuco:2x11:0.03:0.022", "3 to 64"},
        {"charuco:8x11:0.03", "side of a marker is missing"},
        {"charuco:8x11:30:22", "write metres"},
        {"charuco:8x11:nan:0.02", "is no length"},
        {"charuco:8x11:0.022:0.03", "the order is square, marker"},
        {"charuco:8x11:0.03:0.022:5X5_40", "neither a dictionary"},
        {"charuco:30x30:0.03:0.022:5X5_100", "take a larger dictionary"},
        {"charuco:8x11:0.03:0.022:legacy", "leave it out"},
        {"charuco:8x11:0.03:0.022:4X4_100:two-sided", "seen mirrored are taken for others"},
        {"charuco:8x11:0.03:0.022:thickness=3", "no length of 0 to 0.5 m"},
        {"chessboard:9x6:0.025:two-sided", "nothing tells the back"},
        {"aprilgrid:6x6:0.03:0.1", "the gap must be"},
        {"charuco:6x6:0.03:0.02:kalibr", "kalibr is a layout of an aprilgrid"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct rec_board b;
        struct pvx_diag d = {""};
        T_OK(rec_board_parse(cases[i][0], &b, &d) != PVX_OK);
        T_CONTAINS(d.text, cases[i][1]);
        T_EQ_I(b.cols, 0);
    }
}

T_CASE(points)
{
    struct rec_board c = board("charuco:8x11:0.03:0.022:thickness=0.004"),
                     h = board("chessboard:9x6:0.025"), a = board("aprilgrid:6x5:0.03:0.009");
    double p[3];
    T_EQ_I(rec_board_corners(&c), 70);
    T_EQ_I(rec_board_corners(&h), 54);
    T_EQ_I(rec_board_corners(&a), 120);
    rec_board_point(&c, REC_FRONT, 8, p);
    T_NEAR(p[0], 0.03, 1e-12);
    T_NEAR(p[1], 0.03, 1e-12);
    T_NEAR(p[2], 0, 0);
    rec_board_point(&c, REC_BACK, 8, p);
    T_NEAR(p[0], 0.03, 1e-12);
    T_NEAR(p[2], 0.004, 0);
    rec_board_point(&h, REC_FRONT, 53, p);
    T_NEAR(p[0], 0.2, 1e-12);
    T_NEAR(p[1], 0.125, 1e-12);
    rec_board_point(&a, REC_FRONT, 12 * 3 + 2,
                    p); /* second marker of the second row, its left lower corner */
    T_NEAR(p[0], 0.039, 1e-12);
    T_NEAR(p[1], 0.069, 1e-12);
}

/* Every corner of the print is where two edges cross: opposite squares around it alike, neighbours not. */
T_CASE(ink_crosses_at_corners)
{
    static const char *const all[] = {"charuco:8x11:0.03:0.022", "charuco:5x8:0.03:0.022:legacy",
                                      "chessboard:9x6:0.025", "aprilgrid:4x3:0.03:0.009"};
    for (size_t i = 0; i < 4; i++) {
        struct rec_board b = board(all[i]);
        struct rec_print p;
        T_EQ_I(rec_print_init(&p, &b, NULL), PVX_OK);
        for (uint32_t id = 0; id < rec_board_corners(&b); id++) {
            double q[3], e = 0.001, h = 0.0005;
            rec_board_point(&b, REC_FRONT, id, q);
            double ink[4];
            for (int k = 0; k < 4; k++)
                ink[k] = rec_print_ink(&p, q[0] + (k % 2 ? e : -e), q[1] + (k / 2 ? e : -e), h, h);
            T_NEAR(ink[0], ink[3], 0);
            T_NEAR(ink[1], ink[2], 0);
            T_NEAR(ink[0] + ink[1], 1, 0);
            T_NEAR(rec_print_ink(&p, q[0], q[1], e, e), 0.5, 1e-9);
        }
        double c[4][2];
        for (int32_t id = 0; id < p.n_markers; id++) { /* a black frame */
            rec_print_marker(&p, id, c);
            T_NEAR(rec_print_ink(&p, (c[0][0] + c[1][0]) / 2, c[0][1] + p.module / 2, 1e-4, 1e-4),
                   1, 0);
        }
        rec_print_fini(&p);
    }
}

#define DPI 100.0

/* The sheet as a printer would rasterise it, grey. */
static uint8_t *raster(const struct rec_print *p, const struct rec_page *page,
                       enum rec_board_face face, int32_t *w, int32_t *h)
{
    *w = (int32_t)(page->width / 0.0254 * DPI);
    *h = (int32_t)(page->height / 0.0254 * DPI);
    cairo_surface_t *s = cairo_image_surface_create(CAIRO_FORMAT_RGB24, *w, *h);
    cairo_t *cr = cairo_create(s);
    cairo_scale(cr, DPI / 72, DPI / 72);
    rec_sheet_draw(cr, p, page, face);
    cairo_destroy(cr);
    cairo_surface_flush(s);
    uint8_t *grey = malloc((size_t)*w * (size_t)*h);
    for (int32_t v = 0; v < *h && grey != NULL; v++)
        for (int32_t u = 0; u < *w; u++)
            grey[(ptrdiff_t)v * *w + u] = cairo_image_surface_get_data(
                s)[(ptrdiff_t)v * cairo_image_surface_get_stride(s) + 4 * u];
    cairo_surface_destroy(s);
    return grey;
}

/* All corners of the printed face are found, and lie in true size. */
static void found_on_sheet(const char *text, enum rec_board_face face)
{
    struct rec_board b = board(text);
    struct rec_print p;
    struct rec_page page;
    rec_board_detector *det;
    struct rec_board_sight s;
    struct pvx_diag d = {""};
    int32_t w, h;
    T_EQ_I(rec_print_init(&p, &b, &d), PVX_OK);
    T_EQ_I(rec_page_find(&p, "auto", &page, &d), PVX_OK);
    uint8_t *grey = raster(&p, &page, face, &w, &h);
    T_EQ_I(rec_board_detector_new(&b, &det, &d), PVX_OK);
    T_EQ_I(rec_board_detect(det, &(struct rec_board_picture){grey, w, h, w, false}, &s), PVX_OK);
    T_CHECK_(s.outcome == REC_SIGHT_FOUND, "%s: %s", text, s.text);
    T_EQ_I(s.view.n, rec_board_corners(&b));
    T_EQ_I(s.view.face, face);
    T_EQ_I(s.legacy, b.legacy);
    T_EQ_I(s.grid, b.grid);
    for (size_t i = 1; i < s.view.n; i++) {
        double q[3], o[3], scale = DPI / 0.0254 * (face == REC_BACK ? -1 : 1);
        rec_board_point(&b, REC_FRONT, 0, o);
        rec_board_point(&b, REC_FRONT, (uint32_t)i, q);
        T_EQ_I(s.view.corner[i].id, i);
        T_NEAR(s.view.corner[i].x - s.view.corner[0].x, scale * (q[0] - o[0]), 0.1);
        T_NEAR(s.view.corner[i].y - s.view.corner[0].y, DPI / 0.0254 * (q[1] - o[1]), 0.1);
    }
    free(grey);
    rec_board_detector_free(&det);
    rec_print_fini(&p);
}

T_CASE(sheets_are_found)
{
    found_on_sheet("charuco:6x8:0.02:0.015", REC_FRONT);
    found_on_sheet("charuco:6x8:0.02:0.015:legacy", REC_FRONT);
    found_on_sheet("charuco:6x8:0.02:0.015:two-sided:inverted", REC_FRONT);
    found_on_sheet("charuco:6x8:0.02:0.015:two-sided:inverted", REC_BACK);
    found_on_sheet("aprilgrid:5x4:0.02:0.006", REC_FRONT);
    found_on_sheet("aprilgrid:5x4:0.02:0.006:two-sided", REC_BACK);
    found_on_sheet("aprilgrid:5x4:0.02:0.006:kalibr", REC_FRONT);
    found_on_sheet("chessboard:7x6:0.02", REC_FRONT);
}

T_CASE(pages)
{
    struct rec_board b = board("charuco:8x11:0.03:0.022");
    struct rec_print p;
    struct rec_page page;
    struct pvx_diag d = {""};
    T_EQ_I(rec_print_init(&p, &b, &d), PVX_OK);
    T_EQ_I(rec_page_find(&p, "auto", &page, &d), PVX_OK);
    T_EQ_S(page.name, "A3");
    T_EQ_I(rec_page_find(&p, "A4", &page, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "--page custom");
    T_EQ_I(rec_page_find(&p, "420x297", &page, NULL), PVX_OK);
    T_NEAR(page.width, 0.297, 1e-9); /* turned */
    T_EQ_I(rec_page_find(&p, "custom", &page, NULL), PVX_OK);
    T_OK(page.width >= 0.24 && page.width < 0.27 && page.height >= 0.33 && page.height < 0.38);
    static const char *const bad[] = {"A9", "", "10x10", "420", "420x297mm", "-1x5", "1e9x1e9"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        T_EQ_I(rec_page_find(&p, bad[i], &page, NULL), PVX_EINVAL);
    rec_print_fini(&p);
}

T_CASE(files_in_true_size)
{
    struct rec_board b = board("charuco:6x8:0.03:0.022:two-sided");
    struct rec_print p;
    struct rec_page page;
    char *bytes;
    size_t len;
    T_EQ_I(rec_print_init(&p, &b, NULL), PVX_OK);
    T_EQ_I(rec_page_find(&p, "A4", &page, NULL), PVX_OK);
    T_EQ_I(rec_sheet_file(&p, &page, REC_SHEET_PDF, REC_FRONT, &bytes, &len), PVX_OK);
    T_OK(len > 1000 && memcmp(bytes, "%PDF", 4) == 0);
    T_OK(memmem(bytes, len, "/MediaBox [ 0 0 595.275", 23) != NULL);
    T_OK(memmem(bytes, len, "/Count 2", 8) != NULL);
    free(bytes);
    T_EQ_I(rec_sheet_file(&p, &page, REC_SHEET_SVG, REC_BACK, &bytes, &len), PVX_OK);
    T_OK(memmem(bytes, len, "width=\"595.275", 14) != NULL);
    T_OK(memmem(bytes, len, "pt\"", 3) != NULL);
    free(bytes);
    rec_print_fini(&p);
}

T_MAIN(plugins_of_this_build(), cairo_debug_reset_static_data())
