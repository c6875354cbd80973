/* base.h - what every benchmark needs: stop on error, numbers by chance, memory, CSV. */
#ifndef BENCH_BASE_H
#define BENCH_BASE_H
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "base/clock.h"
#include "base/err.h"
#include "base/pool.h"
#include "base/random.h"
#include "tests/lib/must.h"
#include "tests/lib/normal.h"

/* One state for the program; a seed makes what follows independent of what came before. */
static inline uint64_t *bench_state(void)
{
    static uint64_t s = 1;
    return &s;
}

static inline void bench_seed(uint64_t seed)
{
    *bench_state() = (seed + 1) * 0x9E3779B97F4A7C15u;
}

/* Even in [0,1). */
static inline double bench_even(void)
{
    return pvx_uniform(bench_state());
}

static inline double bench_normal(void)
{
    return normal_deviate(bench_state());
}

static inline double ms(int64_t ns)
{
    return (double)ns * 1e-6;
}

/* Processor time of this process, s. */
static inline double bench_cpu(void)
{
    struct rusage u;
    getrusage(RUSAGE_SELF, &u);
    return (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
           1e-6 * (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

/* CHECK, with what the diagnosis says. */
static inline void bench_check(pvx_err e, const struct pvx_diag *d)
{
    if (e == PVX_OK)
        return;
    fprintf(stderr, "%s\n", pvx_diag_text(d, e));
    exit(1);
}

/* A file of the data that may not be shipped, PATH below $PYROVOX_DATA, into out. */
static inline void bench_data(char out[1024], const char *path)
{
    const char *root = getenv("PYROVOX_DATA");
    snprintf(out, 1024, "%s/%s", root != NULL && *root != 0 ? root : "../shared/data", path);
}

/* What main returns: 77 once a part could not run.  The reason is printed where it is found. */
static inline int *bench_status(void)
{
    static int status;
    return &status;
}
static inline void bench_not_run(const char *what, const char *needs)
{
    printf("NOT RUN: %s, needs %s\n", what, needs);
    *bench_status() = 77;
}

/* A line of a table: into its file, and in columns to look at. */
__attribute__((format(printf, 2, 3))) static inline void bench_row(FILE *csv, const char *fmt, ...)
{
    char line[1024], *rest = line;
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(line, sizeof line, fmt, ap);
    va_end(ap);
    fprintf(csv, "%s\n", line);
    for (const char *field; (field = strsep(&rest, ",")) != NULL;)
        printf(" %10s", field);
    putchar('\n');
    fflush(stdout);
}

/* NAME.csv in the folder of argv[1] (default: the current one); `head`: names of its columns. */
static inline FILE *bench_csv(int argc, char **argv, const char *name, const char *head)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.csv", argc > 1 ? argv[1] : ".", name);
    FILE *f = fopen(path, "w");
    if (f == NULL) {
        perror(path);
        exit(1);
    }
    bench_row(f, "%s", head);
    return f;
}

#endif
