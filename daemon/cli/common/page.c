#include "daemon/cli/common/page.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

void page_open(void)
{
    fputs("\033[?1049h\033[?25l\033[2J", stdout);
}

void page_close(void)
{
    fputs("\033[?25h\033[?1049l", stdout);
    fflush(stdout);
}

void page_begin(struct page *p)
{
    struct winsize w = {0};
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &w) != 0 || w.ws_row == 0)
        w = (struct winsize){.ws_row = 24, .ws_col = 80};
    p->rows = w.ws_row;
    p->cols = w.ws_col;
    p->row = 0;
    p->len = (size_t)snprintf(p->text, sizeof p->text, "\033[H");
}

void page_line(struct page *p, const char *fmt, ...)
{
    char s[512];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(s, sizeof s, fmt, ap);
    va_end(ap);
    if (p->row >= p->rows)
        return;
    int n = snprintf(p->text + p->len, sizeof p->text - p->len, "%s%.*s\033[K",
                     p->row > 0 ? "\r\n" : "", p->cols, s);
    if (n > 0 && (size_t)n < sizeof p->text - p->len) {
        p->len += (size_t)n;
        p->row++;
    }
}

void page_words(struct page *p, int label, const char *name, const char *text)
{
    int room = p->cols - label - 1;
    while (*text != '\0') {
        int n = (int)strlen(text);
        if (n > room && room > 0)
            for (n = room; n > 0 && text[n] != ' ';)
                n--;
        if (n == 0) /* one long word: page_line cuts it */
            n = (int)strlen(text);
        page_line(p, "%-*.*s %.*s", label, label, name, n, text);
        name = "";
        text += n;
        text += *text == ' ';
    }
}

void page_show(struct page *p)
{
    p->len += (size_t)snprintf(p->text + p->len, sizeof p->text - p->len, "\033[J");
    fwrite(p->text, 1, p->len, stdout);
    fflush(stdout);
}
