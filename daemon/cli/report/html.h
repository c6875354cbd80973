/* html.h - write text and numbers into a page that is HTML and also well-formed XML.  Names of folders and cameras
 * and messages remain text whatever characters they contain. */
#ifndef CALIBRATE_REPORT_HTML_H
#define CALIBRATE_REPORT_HTML_H
#include <stdint.h>
#include <stdio.h>
#include "base/err.h"

/* The style sheet of every page: light, dark if the browser asks for it, and on paper. */
extern const char report_style[];

/* Begin a page that can be printed: all up to <body>.  more: CSS for this page alone. */
void html_begin(FILE *f, const char *title, const char *more);
/* Write s escaped, for use between tags and in quotes.  Bytes that are no UTF-8 or no XML character become '?'. */
void html_text(FILE *f, const char *s);
/* Write v with so many decimals, or a dash if v is not finite. */
void html_number(FILE *f, double v, int decimals);
/* The same as a cell of a table. */
void html_cell(FILE *f, double v, int decimals);
/* Write a file into the page, after "data:TYPE;base64,". */
void html_base64(FILE *f, const uint8_t *v, size_t n);

/* A figure of DIR/NAME, a PNG file, and its caption, which is HTML.  Errors: the file's. */
PVX_MUST_CHECK pvx_err html_picture(FILE *f, const char *dir, const char *name, const char *caption,
                                    struct pvx_diag *d);

#endif
