/* test_plot.c - daemon/cli/report/plot.h: what is in the drawing, and that it ends whatever is to be drawn. */
#include "../t.h"

#include <math.h>
#include <stdlib.h>

#include "daemon/cli/report/plot.h"

enum { N = 20 };

static size_t count(const char *text, const char *what)
{
    size_t n = 0;
    for (const char *at = text; (at = strstr(at, what)) != NULL; at++)
        n++;
    return n;
}

static char *draw(const double *x, const double *y, bool points)
{
    static const char *const label[N] = {"a", "b", "c", "d", "e", "f", "g", "h", "i", "j",
                                         "k", "l", "m", "n", "o", "p", "q", "r", "s", "t"};
    const struct plot_series s[2] = {{.name = "one",
                                      .colour = "#111111",
                                      .n = N,
                                      .x = x,
                                      .y = y,
                                      .label = label,
                                      .points = points},
                                     {.name = "two",
                                      .colour = "#222222",
                                      .n = N,
                                      .x = x,
                                      .y = y,
                                      .label = label,
                                      .points = points}};
    char *text = NULL;
    size_t len;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        abort();
    plot_svg(f, &(struct plot){.x = "ms", .y = "error", .log_x = true, .series = s, .n = 2});
    fclose(f);
    return text;
}

T_CASE(names_are_inside)
{
    const double x[1] = {1}, y[1] = {1};
    const struct plot_series s = {
        .name = "green, with the rim", .colour = "#111111", .n = 1, .x = x, .y = y};
    char *text = NULL;
    size_t len;
    double width = 0, at = 0;
    FILE *f = open_memstream(&text, &len);
    plot_svg(f, &(struct plot){.x = "ms", .y = "error", .series = &s, .n = 1});
    fclose(f);
    T_EQ_I(sscanf(strstr(text, "viewBox"), "viewBox=\"0 0 %lf", &width), 1);
    char *name = strstr(text, s.name);
    while (name > text && strncmp(name, "<text", 5) != 0)
        name--;
    T_EQ_I(sscanf(name, "<text x=\"%lf", &at), 1);
    T_CHECK_(at + 6.8 * (double)strlen(s.name) <= width, "from %g, of %g", at, width);
    free(text);
}

/* All at about one place, by any fraction of a pixel: each has its label, at a place of its own. */
T_CASE(labels_that_would_lie_on_each_other)
{
    for (int k = 0; k < 200; k++) {
        double x[N], y[N];
        for (int i = 0; i < N; i++) {
            x[i] = 20 * exp(t_uniform(0, 0.05));
            y[i] = 10 + t_uniform(0, 0.3);
        }
        char *text = draw(x, y, k % 2 == 0);
        T_EQ_I(count(text, "<circle"), 2 * N);
        T_EQ_I(count(text, ">a<"), 2);
        T_EQ_I(count(text, ">t<"), 2);
        T_EQ_I(count(text, "nan") + count(text, "inf"), 0);
        free(text);
    }
}

T_CASE(what_is_no_number_is_left_out)
{
    double x[N], y[N];
    for (int i = 0; i < N; i++) {
        x[i] = i == 3 ? NAN : 1 + i;
        y[i] = i == 5 ? INFINITY : i == 7 ? NAN : 2;
    }
    char *text = draw(x, y, false);
    T_EQ_I(count(text, "<circle"), 2 * (N - 3));
    T_EQ_I(count(text, "nan") + count(text, "inf"), 0);
    free(text);
}

/* A line of many points has its spread as a band, of few points as bars; ticks of a time may be fractions. */
T_CASE(spread)
{
    enum { MANY = 30 };
    double x[MANY], y[MANY], spread[MANY];
    for (int i = 0; i < MANY; i++) {
        x[i] = 0.01 * i;
        y[i] = 1 + 0.1 * sin(i);
        spread[i] = 0.2;
    }
    for (int k = 0; k < 2; k++) {
        const struct plot_series s = {.name = "a",
                                      .colour = "#111111",
                                      .n = k == 0 ? MANY : 5,
                                      .x = x,
                                      .y = y,
                                      .spread = spread};
        char *text = NULL;
        size_t len;
        FILE *f = open_memstream(&text, &len);
        plot_svg(f, &(struct plot){.x = "s", .y = "m", .fine_x = true, .series = &s, .n = 1});
        fclose(f);
        T_EQ_I(count(text, "<polygon"), k == 0 ? 1 : 0);
        T_EQ_I(count(text, "<circle"), k == 0 ? 0 : 5);
        T_OK(strstr(text, k == 0 ? ">0.05<" : ">0.01<") != NULL);
        T_EQ_I(count(text, "nan") + count(text, "inf"), 0);
        free(text);
    }
}
