/* sheet.h - a board as a sheet to print, in true size, as vectors.
 *
 * cairo draws it, so that one code gives PDF and SVG.  The board lies in the middle of the page.  Around it are a
 * ruler of 100 mm (to notice a print that was scaled), the spec, what to measure, and for a two-sided board marks in
 * the margin.  The back is the front's mirror image, as if the ink went through: laid back to back, or printed duplex
 * along the long edge, equal marks lie on each other.
 * Threads: any, one page a call. */
#ifndef REC_BOARD_SHEET_H
#define REC_BOARD_SHEET_H
#include <stddef.h>
#include "base/err.h"
#include "recon/board/print.h"

/* [m] */
struct rec_page {
    double width, height;
    char name[40];
};

/* name: "A0" to "A4", "letter", "custom" (as large as the board needs), "420x297" (mm), or "auto": the smallest of A4
 * to A0 that holds the board, else custom.  Turned where that fits better.
 * PVX_ERANGE: the board is too large for it; d says how large a board may be. */
PVX_MUST_CHECK pvx_err rec_page_find(const struct rec_print *p, const char *name,
                                     struct rec_page *page, struct pvx_diag *d);

/* One face on a cairo context whose unit is 1/72 inch (as PDF's). */
struct _cairo;
void rec_sheet_draw(struct _cairo *cr, const struct rec_print *p, const struct rec_page *page,
                    enum rec_board_face face);

enum rec_sheet_format { REC_SHEET_PDF, REC_SHEET_SVG };
/* The bytes of a file.  PDF: both faces of a two-sided board, a page each, whatever `face` is; SVG: that
 * face.  Owner: caller, free(). */
PVX_MUST_CHECK pvx_err rec_sheet_file(const struct rec_print *p, const struct rec_page *page,
                                      enum rec_sheet_format format, enum rec_board_face face,
                                      char **out, size_t *len);
#endif
