#include "base/log.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"

static atomic_int current_level = PVX_LOG_INFO;
static const char *const topic_names[TOPIC_N] = {"daemon", "capture", "recon", "proto", "sim"};
static const char *const level_names[] = {"error", "warn", "info", "debug"};
/* syslog(3) priorities that journald reads from "<N>" */
static const int level_syslog[] = {3, 4, 6, 7};

void pvx_log_set_level(enum pvx_log_level level)
{
    tzset(); /* here, so that the first line allocates nothing */
    atomic_store(&current_level, (int)level);
}

enum pvx_log_level pvx_log_get_level(void)
{
    return (enum pvx_log_level)atomic_load(&current_level);
}

pvx_err pvx_log_level_parse(const char *name, enum pvx_log_level *out)
{
    for (int i = 0; i <= PVX_LOG_DEBUG; i++)
        if (strcmp(name, level_names[i]) == 0) {
            *out = (enum pvx_log_level)i;
            return PVX_OK;
        }
    return PVX_EINVAL;
}

void pvx_log(enum pvx_log_level level, enum pvx_log_topic topic, const char *fmt, ...)
{
    if ((int)level > atomic_load(&current_level))
        return;
    char line[2048];
    int n;
    if (getenv("JOURNAL_STREAM") != NULL) {
        n = snprintf(line, sizeof line, "<%d>%s: ", level_syslog[level], topic_names[topic]);
    } else {
        struct timespec ts;
        struct tm tm;
        clock_gettime(CLOCK_REALTIME, &ts);
        localtime_r(&ts.tv_sec, &tm);
        n = snprintf(line, sizeof line, "%02d:%02d:%02d.%03ld %-5s %s: ", tm.tm_hour, tm.tm_min,
                     tm.tm_sec, ts.tv_nsec / 1000000, level_names[level], topic_names[topic]);
    }
    va_list ap;
    va_start(ap, fmt);
    int m = vsnprintf(line + n, sizeof line - (size_t)n - 1, fmt, ap);
    va_end(ap);
    size_t len = (size_t)n + (m < 0 ? 0 : (size_t)m);
    if (len > sizeof line - 2)
        len = sizeof line - 2;
    line[len++] = '\n';
    ssize_t w = write(STDERR_FILENO, line, len);
    (void)w; /* nothing to be done when stderr is gone */
}

int pvx_log_gate_pass(struct pvx_log_gate *g, uint64_t *held)
{
    int64_t now = pvx_now_mono();
    int64_t next = __atomic_load_n(&g->next_ns, __ATOMIC_RELAXED);
    if (now < next || !__atomic_compare_exchange_n(&g->next_ns, &next, now + 1000000000, 0,
                                                   __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
        __atomic_fetch_add(&g->held, 1, __ATOMIC_RELAXED);
        return 0;
    }
    *held = __atomic_exchange_n(&g->held, 0, __ATOMIC_RELAXED);
    return 1;
}
