#include "recon/board/sheet.h"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "recon/board/spec.h"

#define POINTS (72 / 0.0254) /* 1/72 inch in a metre */
#define RIM    0.007         /* m around the board: printers leave 4 to 6 mm empty */
#define FOOT   0.020         /* m below it, for ruler and text */
#define QUIET  0.25          /* of a square: width of the dark rim of an inverted board */

/* The board with its rim, and the foot. */
static void needed(const struct rec_print *p, double *w, double *h)
{
    double quiet = p->board.inverted ? 2 * QUIET * p->board.square : 0;
    *w = fmax(p->x1 - p->x0 + quiet, 0.1) + 2 * RIM;
    *h = p->y1 - p->y0 + quiet + 2 * RIM + FOOT;
}

static bool holds(double w, double h, double pw, double ph, struct rec_page *page)
{
    bool upright = w <= pw + 1e-9 && h <= ph + 1e-9, turned = w <= ph + 1e-9 && h <= pw + 1e-9;
    page->width = upright ? pw : ph;
    page->height = upright ? ph : pw;
    return upright || turned;
}

pvx_err rec_page_find(const struct rec_print *p, const char *name, struct rec_page *page,
                      struct pvx_diag *d)
{
    static const struct {
        const char *name;
        double mm[2];
    } sizes[] = {{"A4", {210, 297}}, {"A3", {297, 420}},  {"A2", {420, 594}},
                 {"A1", {594, 841}}, {"A0", {841, 1189}}, {"letter", {215.9, 279.4}}};
    double w, h, mm[2] = {0};
    int end = -1;
    needed(p, &w, &h);
    bool any = strcmp(name, "auto") == 0;
    *page = (struct rec_page){0};
    for (size_t i = 0; i < (any ? 5 : 6); i++)
        if (any || strcmp(name, sizes[i].name) == 0) {
            memcpy(mm, sizes[i].mm, sizeof mm);
            snprintf(page->name, sizeof page->name, "%s", sizes[i].name);
            if (holds(w, h, mm[0] / 1e3, mm[1] / 1e3, page))
                return PVX_OK;
        }
    if (any || strcmp(name, "custom") == 0) {
        page->width = ceil(w * 1e3) / 1e3;
        page->height = ceil(h * 1e3) / 1e3;
        snprintf(page->name, sizeof page->name, "%.0fx%.0f mm", page->width * 1e3,
                 page->height * 1e3);
        return PVX_OK;
    }
    if (mm[0] == 0 && (strspn(name, "0123456789.x") != strlen(name) ||
                       sscanf(name, "%lfx%lf%n", &mm[0], &mm[1], &end) != 2 || name[end] != '\0' ||
                       !(mm[0] >= 50 && mm[1] >= 50) || !(mm[0] <= 5000 && mm[1] <= 5000)))
        return pvx_fail(d, PVX_EINVAL,
                        "no page '%s'; pages are A0 to A4, letter, auto, custom (as large as "
                        "needed) or millimetres across x down, as 420x297",
                        name);
    snprintf(page->name, sizeof page->name, "%.5gx%.5g mm", mm[0], mm[1]);
    if (holds(w, h, mm[0] / 1e3, mm[1] / 1e3, page))
        return PVX_OK;
    return pvx_fail(d, PVX_ERANGE,
                    "the board with its margin takes %.0f x %.0f mm, page %s has %.0f x %.0f: take "
                    "a larger page, fewer or smaller squares, or --page custom",
                    w * 1e3, h * 1e3, name, mm[0], mm[1]);
}

/* A rectangle of the board, from its corner (x, y). */
static void rect(cairo_t *cr, double x, double y, double w, double h)
{
    cairo_rectangle(cr, x, y, w, h);
}

static void draw_marker(cairo_t *cr, const struct rec_print *p, int32_t id)
{
    double c[4][2], m = p->module;
    int32_t w = p->border, n = p->bits + 2 * w;
    rec_print_marker(p, id, c);
    /* the border as one frame and dark bits in runs, so that no hairlines divide them */
    rect(cr, c[0][0], c[0][1], n * m, w * m);
    rect(cr, c[0][0], c[0][1] + (n - w) * m, n * m, w * m);
    for (int32_t r = w; r < n - w; r++)
        for (int32_t a = 0, b; a < n; a = b) {
            const uint8_t *bit = p->bit + (size_t)((id * p->bits + r - w) * p->bits) - w;
            for (b = a; b < n && (b < w || b >= n - w || !bit[b]); b++) {
            }
            if (b > a)
                rect(cr, c[0][0] + a * m, c[0][1] + r * m, (b - a) * m, m);
            else
                b++;
        }
}

static void draw_board(cairo_t *cr, const struct rec_print *p)
{
    const struct rec_board *b = &p->board;
    double s = b->square, g = b->marker, quiet = QUIET * s;
    if (b->inverted) {
        rect(cr, p->x0 - quiet, p->y0 - quiet, p->x1 - p->x0 + 2 * quiet,
             p->y1 - p->y0 + 2 * quiet);
        cairo_fill(cr);
        cairo_set_source_rgb(cr, 1, 1, 1);
    }
    if (b->kind == REC_APRILGRID) {
        for (int32_t r = 0; r <= b->rows; r++)
            for (int32_t c = 0; c <= b->cols; c++)
                rect(cr, p->x0 + c * (s + g), p->y0 + r * (s + g), g, g);
    } else {
        for (int32_t r = 0; p->y0 + (r + 0.5) * s < p->y1; r++)
            for (int32_t c = 0; p->x0 + (c + 0.5) * s < p->x1; c++)
                if ((r + c) % 2 == (b->legacy ? 1 : 0))
                    rect(cr, p->x0 + c * s, p->y0 + r * s, s, s);
    }
    for (int32_t i = 0; i < p->n_markers; i++)
        draw_marker(cr, p, i);
    cairo_fill(cr);
    cairo_set_source_rgb(cr, 0, 0, 0);
}

/* A cross in a ring, in the middle of each margin and at the corners. */
static void draw_marks(cairo_t *cr, const struct rec_page *page)
{
    double r = 0.0015, in = 0.0055;
    cairo_set_line_width(cr, 0.0001);
    for (int i = 0; i < 9; i++) {
        double x = i % 3 == 0 ? in : i % 3 == 1 ? page->width / 2 : page->width - in;
        double y = i / 3 == 0 ? in : i / 3 == 1 ? page->height / 2 : page->height - in;
        if (i == 4)
            continue;
        cairo_move_to(cr, x - 1.7 * r, y);
        cairo_line_to(cr, x + 1.7 * r, y);
        cairo_move_to(cr, x, y - 1.7 * r);
        cairo_line_to(cr, x, y + 1.7 * r);
        cairo_new_sub_path(cr);
        cairo_arc(cr, x, y, r, 0, 2 * M_PI);
    }
    cairo_stroke(cr);
}

static void draw_ruler(cairo_t *cr, double x, double y)
{
    cairo_set_line_width(cr, 0.00015);
    cairo_move_to(cr, x, y);
    cairo_line_to(cr, x + 0.1, y);
    for (int i = 0; i <= 100; i++) {
        cairo_move_to(cr, x + i * 0.001, y);
        cairo_rel_line_to(cr, 0, i % 10 == 0 ? -0.004 : i % 5 == 0 ? -0.003 : -0.002);
    }
    cairo_stroke(cr);
}

/* A line of text that ends before `width`, made smaller if it is too long. */
static void sheet_text(cairo_t *cr, double x, double y, double width, const char *s)
{
    cairo_text_extents_t e;
    double size = 0.0028;
    cairo_set_font_size(cr, size);
    cairo_text_extents(cr, s, &e);
    if (e.x_advance > width)
        cairo_set_font_size(cr, size * width / e.x_advance);
    cairo_move_to(cr, x, y);
    cairo_show_text(cr, s);
}

static void draw_foot(cairo_t *cr, const struct rec_print *p, const struct rec_page *page,
                      enum rec_board_face face, double x, double y)
{
    char spec[REC_BOARD_TEXT], line[3 * REC_BOARD_TEXT];
    const struct rec_board *b = &p->board;
    double width = page->width - x - RIM;
    rec_board_text(b, spec);
    cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    draw_ruler(cr, x, y + 0.0045);
    sheet_text(cr, x + 0.102, y + 0.0045, width - 0.102, "100 mm");
    snprintf(line, sizeof line, "%s%s", spec,
             !b->two_sided       ? ""
             : face == REC_FRONT ? "   FRONT: glue the sheets back to back, marks on marks"
                                 : "   BACK");
    sheet_text(cr, x, y + 0.0090, width, line);
    sheet_text(cr, x, y + 0.0130, width,
               "Print at 100 % (no \"fit to page\"), on a flat, stiff, matt plate.");
    snprintf(line, sizeof line,
             "Measure: the ruler must be 100.0 mm and the pattern %.2f x %.2f mm; if not, write "
             "what you measured into the spec.",
             (p->x1 - p->x0) * 1e3, (p->y1 - p->y0) * 1e3);
    sheet_text(cr, x, y + 0.0170, width, line);
}

void rec_sheet_draw(struct _cairo *cr, const struct rec_print *p, const struct rec_page *page,
                    enum rec_board_face face)
{
    double w = p->x1 - p->x0, h = p->y1 - p->y0, quiet = p->board.inverted ? QUIET : 0;
    double left = (page->width - w) / 2, top = (page->height - FOOT - h) / 2;
    cairo_save(cr);
    cairo_scale(cr, POINTS, POINTS);
    cairo_set_source_rgb(cr, 1, 1, 1);
    cairo_paint(cr);
    cairo_set_source_rgb(cr, 0, 0, 0);
    cairo_save(cr);
    if (face == REC_BACK) {
        cairo_translate(cr, page->width, 0);
        cairo_scale(cr, -1, 1);
    }
    cairo_translate(cr, left - p->x0, top - p->y0);
    draw_board(cr, p);
    cairo_restore(cr);
    if (p->board.two_sided)
        draw_marks(cr, page);
    double x = fmax(RIM, fmin(left, page->width / 2 - 0.05));
    draw_foot(cr, p, page, face, x, top + h + quiet * p->board.square + 0.003);
    cairo_restore(cr);
}

struct bytes {
    char *data;
    size_t n;
};

static cairo_status_t append(void *closure, const unsigned char *data, unsigned int n)
{
    struct bytes *b = closure;
    char *more = realloc(b->data, b->n + n + 1);
    if (more == NULL)
        return CAIRO_STATUS_NO_MEMORY;
    memcpy(more + b->n, data, n);
    b->data = more;
    b->n += n;
    return CAIRO_STATUS_SUCCESS;
}

pvx_err rec_sheet_file(const struct rec_print *p, const struct rec_page *page,
                       enum rec_sheet_format format, enum rec_board_face face, char **out,
                       size_t *len)
{
    struct bytes b = {0};
    char title[REC_BOARD_TEXT];
    double w = page->width * POINTS, h = page->height * POINTS;
    bool pdf = format == REC_SHEET_PDF;
    cairo_surface_t *s = pdf ? cairo_pdf_surface_create_for_stream(append, &b, w, h)
                             : cairo_svg_surface_create_for_stream(append, &b, w, h);
    if (pdf) {
        rec_board_text(&p->board, title);
        cairo_pdf_surface_set_metadata(s, CAIRO_PDF_METADATA_TITLE, title);
    } else {
        cairo_svg_surface_set_document_unit(s, CAIRO_SVG_UNIT_PT);
    }
    cairo_t *cr = cairo_create(s);
    rec_sheet_draw(cr, p, page, pdf ? REC_FRONT : face);
    cairo_show_page(cr);
    if (pdf && p->board.two_sided) {
        rec_sheet_draw(cr, p, page, REC_BACK);
        cairo_show_page(cr);
    }
    cairo_surface_finish(s);
    bool bad =
        cairo_status(cr) != CAIRO_STATUS_SUCCESS || cairo_surface_status(s) != CAIRO_STATUS_SUCCESS;
    cairo_destroy(cr);
    cairo_surface_destroy(s);
    if (bad || b.data == NULL) {
        free(b.data);
        return PVX_ENOMEM;
    }
    *out = b.data;
    *len = b.n;
    return PVX_OK;
}
