/* wrap.h - text in lines of a terminal. */
#ifndef DMN_WRAP_H
#define DMN_WRAP_H
#include <stdio.h>

/* Print `text`, broken at blanks into lines of at most `width` columns, and a newline.  The first line
 * begins at column `at` (what stands before it is the caller's), the others are indented.  A word longer
 * than a line is not broken.  Characters of UTF-8 count as one column. */
void dmn_wrap(FILE *f, const char *text, int at, int indent, int width);
#endif
