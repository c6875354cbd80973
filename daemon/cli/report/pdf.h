/* pdf.h - a PDF of a page of HTML, made by weasyprint.
 * Threads: one. */
#ifndef REPORT_PDF_H
#define REPORT_PDF_H
#include "base/err.h"

/* Make DIR/report.pdf of DIR/report.html.  If weasyprint is missing or fails, that is printed on stderr, and there is no
 * PDF, not even an older one, which would show other figures.  PVX_ECANCELED: stopped. */
PVX_MUST_CHECK pvx_err report_pdf(const char *dir);

#endif
