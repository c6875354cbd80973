/* html.h - text and numbers into a page that is HTML and, read as XML, well-formed: whatever a folder, a camera or a
 * message is called, it stays text. */
#ifndef CALIBRATE_REPORT_HTML_H
#define CALIBRATE_REPORT_HTML_H
#include <stdint.h>
#include <stdio.h>

/* The style sheet of every page: light, dark by the reader's own choice, and on paper. */
extern const char report_style[];

/* Escaped, between tags as well as in quotes; what is no UTF-8 or no character of XML becomes a '?'. */
void html_text(FILE *f, const char *s);
/* With so many decimals; a dash where it is no number. */
void html_number(FILE *f, double v, int decimals);
/* The same as a cell of a table. */
void html_cell(FILE *f, double v, int decimals);
/* A file inside the page, behind "data:TYPE;base64,". */
void html_base64(FILE *f, const uint8_t *v, size_t n);

#endif
