/* board.c - `pyrovox calibrate board`: the sheet to print. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/common/cli.h"
#include "recon/board/sheet.h"
#include "recon/board/spec.h"

struct args {
    const char *spec, *out, *page;
    bool two_sided;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"o|out", "FILE", AT(out), 0, 0, "write it here; .pdf or .svg"},
    {"p|page", "PAGE", AT(page), 0, 0,
     "A4, A3, A2, A1, A0, letter, millimetres as 420x297, custom: as large as the board asks for; "
     "default: the smallest of A4 to A0 that holds it"},
    {"two-sided", NULL, AT(two_sided), 0, 0,
     "a mirrored back too, with marks to lay it on: the second page of a PDF; beside FILE.svg, "
     "FILE-back.svg"},
    {0}};

static const char doc[] =
    "Draw a calibration board in true size, to print.\vExamples:\n"
    "  pyrovox calibrate board charuco:8x11:0.03:0.022 --out board.pdf\n"
    "  pyrovox calibrate board charuco:6x8:0.03:0.022 --two-sided --page A4 \\\n"
    "          --out board.pdf\n"
    "  pyrovox calibrate board chessboard:9x6:25mm --out board.svg\n"
    "\n"
    "SPEC, lengths in metres (or \"30mm\"):\n"
    "  charuco:8x11:0.03:0.022      squares across x down, square, marker; a part of it is enough: "
    "take this one\n"
    "  aprilgrid:6x6:0.03:0.009     markers across x down, marker, gap\n"
    "  chessboard:9x6:0.025         inner corners across x down, square; must be seen whole\n"
    "Then any of these, each after a colon: a dictionary of OpenCV (5X5_100, 36h11), two-sided, "
    "thickness=0.003 (of a two-sided board), inverted (white on black), legacy (charuco of even "
    "rows as OpenCV before 4.6 drew it), kalibr (aprilgrid as Kalibr draws it).\n"
    "\n"
    "Size: a square should have 20 pixels or more in every camera, and the board a third of the "
    "picture or more. If cameras stand all around, take two sides: a print on each face of one "
    "flat, stiff, matt plate, about 3 mm thick. The back is the front mirrored, so that equal "
    "corners lie behind each other.\n"
    "\n"
    "After printing, measure the ruler on the sheet. It must have 100.0 mm, else the printer has "
    "scaled it. Paper on cardboard bends. Paper on aluminium or glass does not.";

static error_t board_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG: cli_arg_one(st, "board", arg, &a->spec); return 0;
    case ARGP_KEY_END:
        if (a->spec == NULL || a->out == NULL)
            argp_error(st, "%s",
                       a->spec == NULL ? "which board? As charuco:8x11:0.03:0.022"
                                       : "where to? --out board.pdf");
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static pvx_err write_face(const struct rec_print *p, const struct rec_page *page, bool pdf,
                          enum rec_board_face face, const char *path, struct pvx_diag *d)
{
    char *bytes;
    size_t len;
    PVX_TRY(rec_sheet_file(p, page, pdf ? REC_SHEET_PDF : REC_SHEET_SVG, face, &bytes, &len));
    pvx_err e = pvx_file_write(path, bytes, len, d);
    free(bytes);
    return e;
}

static pvx_err write_sheet(const struct args *a, const struct rec_print *p,
                           const struct rec_page *page, struct pvx_diag *d)
{
    size_t stem = strlen(a->out) - 4;
    bool pdf = strcmp(a->out + stem, ".pdf") == 0;
    PVX_TRY(write_face(p, page, pdf, REC_FRONT, a->out, d));
    if (pdf || !p->board.two_sided)
        return PVX_OK;
    char *back;
    if (asprintf(&back, "%.*s-back.svg", (int)stem, a->out) < 0)
        return PVX_ENOMEM;
    pvx_err e = write_face(p, page, false, REC_BACK, back, d);
    free(back);
    return e;
}

static pvx_err board_of(const struct args *a, struct rec_board *b, struct pvx_diag *d)
{
    char text[2 * REC_BOARD_TEXT];
    if (!pvx_path_ends(a->out, ".pdf") && !pvx_path_ends(a->out, ".svg"))
        return pvx_fail(d, PVX_EUNSUP, "%s: a sheet is written as .pdf or .svg", a->out);
    snprintf(text, sizeof text, "%s%s", a->spec, a->two_sided ? ":two-sided" : "");
    return rec_board_parse(text, b, d);
}

int calibrate_board(int argc, char **argv)
{
    struct args a = {.page = "auto"};
    const struct argp argp = {.parser = board_parse_opt, .args_doc = "SPEC", .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct pvx_diag d = {""};
    struct rec_board b;
    struct rec_print p = {0};
    struct rec_page page = {0};
    pvx_err e = board_of(&a, &b, &d);
    PVX_THEN(e, rec_print_init(&p, &b, &d));
    PVX_THEN(e, rec_page_find(&p, a.page, &page, &d));
    PVX_THEN(e, write_sheet(&a, &p, &page, &d));
    if (e == PVX_OK) {
        char text[REC_BOARD_TEXT];
        rec_board_text(&b, text);
        printf("%s: %s, %u corners%s, page %s (%.0f x %.0f mm)\n"
               "print at 100 %%, measure the ruler (100.0 mm), give the board to later steps as "
               "--board %s\n",
               a.out, text, rec_board_corners(&b), b.two_sided ? " on each face" : "", page.name,
               page.width * 1e3, page.height * 1e3, text);
        if (rec_board_symmetric(&b))
            fprintf(stderr,
                    "pyrovox: this chessboard looks the same after half a turn, which several "
                    "cameras cannot share; one side even and one odd, as 9x6, or charuco does\n");
    }
    rec_print_fini(&p);
    return e == PVX_OK ? 0 : cli_error(&d, e);
}
