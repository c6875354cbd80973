/* scratch.h - a folder of the test's own below /tmp, and the names of what lies in it. */
#ifndef TESTS_SCRATCH_H
#define TESTS_SCRATCH_H
#include <ftw.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

static char dir[64];

/* Nothing in a test makes sense without it. */
static inline void scratch_new(void)
{
    snprintf(dir, sizeof dir, "/tmp/pyrovox-test-XXXXXX");
    if (mkdtemp(dir) == NULL)
        exit(1);
}

static inline int scratch_remove_one(const char *path, const struct stat *st, int type,
                                     struct FTW *w)
{
    (void)st, (void)type, (void)w;
    return remove(path);
}

/* A file, or a folder with all that is in it; nothing where there is none. */
static inline void remove_all(const char *path)
{
    nftw(path, scratch_remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

static inline void scratch_remove(void)
{
    if (dir[0] != '\0')
        remove_all(dir);
    dir[0] = '\0';
}

/* The path of a name in it, good for seven more. */
__attribute__((format(printf, 1, 2))) static inline const char *at(const char *fmt, ...)
{
    static char path[8][512];
    static int turn;
    char *p = path[turn++ & 7];
    int n = snprintf(p, 512, "%s/", dir);
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(p + n, 512 - (size_t)n, fmt, ap);
    va_end(ap);
    return p;
}
#endif
