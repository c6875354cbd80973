/* page.h - a screen of text on a terminal, put together first and written at once: no flicker. */
#ifndef PAGE_H
#define PAGE_H
#include <stddef.h>
#include "base/err.h"

struct page {
    char text[16384];
    size_t len;
    int rows, cols, row;
};
/* Switch to the terminal's second screen, clean and without cursor.  page_close switches back to the first one. */
void page_open(void);
void page_close(void);

/* Start an empty page as large as the terminal is now. */
void page_begin(struct page *p);
/* Add a line, cut at the right.  Nothing happens if the page is full. */
void page_line(struct page *p, const char *fmt, ...) PVX_PRINTF(2, 3);
/* Add a text after its name, which is `label` wide, in as many lines as it needs, broken between words. */
void page_words(struct page *p, int label, const char *name, const char *text);
void page_show(struct page *p);

#endif
