/* logged.h - what a test logs, to be looked at: standard error goes to a file from log_begin to log_end. */
#ifndef TESTS_LOGGED_H
#define TESTS_LOGGED_H
#include "tests/t.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/log.h"

static char log_text[1 << 20]; /* of the last log_end */
static int log_to = -1, log_err = -1;

static void log_begin(enum pvx_log_level level)
{
    char path[] = "/tmp/pyrovox-test-XXXXXX";
    log_to = mkstemp(path);
    log_err = dup(STDERR_FILENO);
    T_OK(log_to >= 0 && log_err >= 0);
    unlink(path);
    dup2(log_to, STDERR_FILENO);
    pvx_log_set_level(level);
}

static void log_end(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    dup2(log_err, STDERR_FILENO);
    close(log_err);
    ssize_t n = pread(log_to, log_text, sizeof log_text - 1, 0);
    close(log_to);
    log_text[n > 0 ? n : 0] = '\0';
}

/* So often it stands in log_text. */
static inline int log_count(const char *what)
{
    int n = 0;
    for (const char *p = log_text; (p = strstr(p, what)) != NULL; p += strlen(what))
        n++;
    return n;
}
#endif
