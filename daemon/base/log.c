#include "base/log.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"

#define TEXT_MAX 1984

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

int pvx_log_syslog(enum pvx_log_level level)
{
    return level_syslog[level];
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

static _Atomic(pvx_log_sink *) current_sink;
static int64_t (*_Atomic current_clock)(void) = pvx_now_mono;

void pvx_log_set_sink(pvx_log_sink *sink)
{
    atomic_store(&current_sink, sink);
}

void pvx_log_set_clock(int64_t (*now)(void))
{
    atomic_store(&current_clock, now != NULL ? now : pvx_now_mono);
}

static bool wanted(enum pvx_log_level level)
{
    return (int)level <= atomic_load(&current_level);
}

static void out(enum pvx_log_level level, const struct pvx_about *about, const char *text)
{
    pvx_log_sink *sink = atomic_load(&current_sink);
    if (sink != NULL && sink(level, about, text))
        return;
    char line[TEXT_MAX + 64];
    int n;
    if (getenv("JOURNAL_STREAM") != NULL) {
        n = snprintf(line, sizeof line, "<%d>%s\n", level_syslog[level], text);
    } else {
        struct timespec ts;
        struct tm tm;
        clock_gettime(CLOCK_REALTIME, &ts);
        localtime_r(&ts.tv_sec, &tm);
        n = snprintf(line, sizeof line, "%02d:%02d:%02d.%03ld %-5s %s\n", tm.tm_hour, tm.tm_min,
                     tm.tm_sec, ts.tv_nsec / 1000000, level_names[level], text);
    }
    ssize_t w = write(STDERR_FILENO, line, (size_t)n);
    (void)w; /* nothing can be done if stderr is closed */
}

PVX_PRINTF(3, 0)
static void log_print(char text[TEXT_MAX], enum pvx_log_topic topic, const char *fmt, va_list ap)
{
    int n = snprintf(text, TEXT_MAX, "%s: ", topic_names[topic]);
    vsnprintf(text + n, TEXT_MAX - (size_t)n, fmt, ap);
}

void pvx_log(enum pvx_log_level level, enum pvx_log_topic topic, const struct pvx_about *about,
             const char *fmt, ...)
{
    char text[TEXT_MAX];
    va_list ap;
    if (!wanted(level))
        return;
    va_start(ap, fmt);
    log_print(text, topic, fmt, ap);
    va_end(ap);
    out(level, about, text);
}

/* ---- bounds ------------------------------------------------------------------------------------ */

#define FREE_LINES 8
#define SPACE_MAX  (3600 * PVX_NS_PER_S)

/* Least time from the n-th line to the next. */
static int64_t space(uint32_t n, int64_t least)
{
    if (n < FREE_LINES)
        return least;
    return n - FREE_LINES < 12 ? PVX_NS_PER_S << (n - FREE_LINES) : SPACE_MAX;
}

/* Only one thread can advance next_ns; only that thread then writes `passed`. */
static bool log_pass(struct pvx_log_gate *g, int64_t now, int64_t least)
{
    int64_t next = __atomic_load_n(&g->next_ns, __ATOMIC_RELAXED);
    int64_t last = __atomic_exchange_n(&g->last_ns, now, __ATOMIC_RELAXED);
    uint32_t n = __atomic_load_n(&g->passed, __ATOMIC_RELAXED);
    if (n > 0 && now - last >= SPACE_MAX)
        n = 0;
    else if (n > 0 && now < next)
        return false;
    if (!__atomic_compare_exchange_n(&g->next_ns, &next, now + space(n + 1, least), 0,
                                     __ATOMIC_RELAXED, __ATOMIC_RELAXED))
        return false;
    __atomic_store_n(&g->passed, n + 1, __ATOMIC_RELAXED);
    return true;
}

bool pvx_log_gate_pass(struct pvx_log_gate *g, uint64_t *held)
{
    if (!log_pass(g, atomic_load(&current_clock)(), PVX_NS_PER_S)) {
        __atomic_fetch_add(&g->held, 1, __ATOMIC_RELAXED);
        return false;
    }
    *held = __atomic_exchange_n(&g->held, 0, __ATOMIC_RELAXED);
    return true;
}

/* One cause of one camera, with its last suppressed line. */
struct kept {
    char cause[32], camera[64];
    struct pvx_log_gate gate;
    enum pvx_log_level level;
    char text[400];
};
static struct kept kept[512];
static pthread_mutex_t kept_lock = PTHREAD_MUTEX_INITIALIZER;

static const char *or_empty(const char *s)
{
    return s != NULL ? s : "";
}

/* The place of a cause and camera: its own, else a free one, else that of the longest quiet cause without a
 * suppressed line.  If all have one, it shares the first. */
static struct kept *log_place(const struct pvx_about *a)
{
    struct kept *best = NULL;
    for (size_t i = 0; i < sizeof kept / sizeof *kept; i++) {
        struct kept *k = &kept[i];
        if (strncmp(k->cause, or_empty(a->cause), sizeof k->cause - 1) == 0 &&
            strncmp(k->camera, or_empty(a->camera), sizeof k->camera - 1) == 0 &&
            k->gate.passed > 0)
            return k;
        if (k->gate.held == 0 && (best == NULL || k->gate.last_ns < best->gate.last_ns))
            best = k;
    }
    if (best == NULL)
        return &kept[0];
    *best = (struct kept){0};
    snprintf(best->cause, sizeof best->cause, "%s", or_empty(a->cause));
    snprintf(best->camera, sizeof best->camera, "%s", or_empty(a->camera));
    return best;
}

static void out_counted(enum pvx_log_level level, const struct pvx_about *about, const char *text,
                        uint64_t held)
{
    char counted[TEXT_MAX];
    snprintf(counted, sizeof counted, "%.*s (%llu more like it held back)", TEXT_MAX - 64, text,
             (unsigned long long)held);
    out(level, about, counted);
}

void pvx_log_about(enum pvx_log_level level, enum pvx_log_topic topic,
                   const struct pvx_about *about, const char *fmt, ...)
{
    if (!wanted(level))
        return;
    char text[TEXT_MAX];
    va_list ap;
    va_start(ap, fmt);
    log_print(text, topic, fmt, ap);
    va_end(ap);
    pthread_mutex_lock(&kept_lock);
    struct kept *k = log_place(about);
    bool now = log_pass(&k->gate, atomic_load(&current_clock)(), 0);
    uint64_t held = k->gate.held;
    k->gate.held = now ? 0 : held + 1;
    if (!now) {
        k->level = level;
        snprintf(k->text, sizeof k->text, "%.*s", (int)sizeof k->text - 1, text);
    }
    pthread_mutex_unlock(&kept_lock);
    if (now && held > 0)
        out_counted(level, about, text, held);
    else if (now)
        out(level, about, text);
}

/* Takes the suppressed line out of k if it is due. */
static bool log_take(struct kept *k, bool all, struct kept *due)
{
    int64_t now = atomic_load(&current_clock)(), last = k->gate.last_ns;
    if (k->gate.held == 0 || (!all && now < k->gate.next_ns))
        return false;
    (void)log_pass(&k->gate, now, 0);
    k->gate.last_ns = last; /* the line is repeated; the event did not happen again */
    *due = *k;
    k->gate.held = 0;
    return true;
}

void pvx_log_flush(bool all)
{
    for (size_t i = 0; i < sizeof kept / sizeof *kept; i++) {
        struct kept due;
        pthread_mutex_lock(&kept_lock);
        bool is = log_take(&kept[i], all, &due);
        pthread_mutex_unlock(&kept_lock);
        if (is) /* one of the suppressed lines is shown */
            out_counted(due.level, ABOUT(.cause = due.cause, .camera = due.camera), due.text,
                        due.gate.held - 1);
    }
}
