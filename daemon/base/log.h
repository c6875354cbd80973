/* log.h - levelled, topic-tagged messages on stderr, fit for journald.
 *
 * Line: "<N>topic: text" under systemd (JOURNAL_STREAM set), else "HH:MM:SS.mmm level topic: text".
 * One write(2) per line, or one call of the sink.  Threads: any thread may log; the frame path uses
 * LOG_EVERY only.  Never log in a camera's driver callback.
 *
 * Repeated lines are limited: LOG_EVERY by its place, LOG_ABOUT by cause and camera.  The first 8 lines are written
 * at once (LOG_EVERY's a second apart), the next 1, 2, 4... s apart, then one an hour.  Each gives the number of
 * suppressed lines: 187 lines in a week.  An hour without any resets the limit. */
#ifndef PVX_LOG_H
#define PVX_LOG_H
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"

/* Replaces control characters by spaces.  Quoted input, as the name of a file, may have line breaks: no line of a log
 * can be forged by it. */
static inline void pvx_one_line(char *text)
{
    for (; *text != '\0'; text++)
        if ((unsigned char)*text < ' ' || *text == 0x7f)
            *text = ' ';
}

enum pvx_log_level { PVX_LOG_ERROR, PVX_LOG_WARN, PVX_LOG_INFO, PVX_LOG_DEBUG };
enum pvx_log_topic { TOPIC_DAEMON, TOPIC_CAPTURE, TOPIC_RECON, TOPIC_PROTO, TOPIC_SIM, TOPIC_N };

/* Messages above `level` are dropped.  Live; default INFO. */
void pvx_log_set_level(enum pvx_log_level level);
enum pvx_log_level pvx_log_get_level(void);
int pvx_log_syslog(enum pvx_log_level level); /* priority of syslog(3) */
/* "error" "warn" "info" "debug"; PVX_EINVAL otherwise. */
PVX_MUST_CHECK pvx_err pvx_log_level_parse(const char *name, enum pvx_log_level *out);

/* Subject of a line, for searches (journal fields PYROVOX_CAUSE, _CAMERA, _SET).  0: not given. */
struct pvx_about {
    const char *cause;  /* a word: "lost_camera" */
    const char *camera; /* its name in the rig */
    bool of_set;        /* `set` is the number */
    uint64_t set;
};

/* Lines of one cause and camera are limited together.  Begin and end of a trouble have the same cause.  The last
 * line is always written sooner or later (pvx_log_flush). */
void pvx_log_about(enum pvx_log_level level, enum pvx_log_topic topic,
                   const struct pvx_about *about, const char *fmt, ...) PVX_PRINTF(4, 5);
/* Write the suppressed lines of LOG_ABOUT that are due.  Call it regularly.  `all`: at the end of the program,
 * also those not due. */
void pvx_log_flush(bool all);

/* Where lines go instead of stderr: text begins with "topic: " and has no newline at its end; `about` may be NULL.
 * Any thread.  Returns whether it took the line; otherwise the line goes to stderr.  NULL: stderr. */
typedef bool pvx_log_sink(enum pvx_log_level level, const struct pvx_about *about,
                          const char *text);
void pvx_log_set_sink(pvx_log_sink *sink);
/* Sets the clock of the limits, CLOCK_MONOTONIC in ns; for tests.  NULL: pvx_now_mono. */
void pvx_log_set_clock(int64_t (*now)(void));

/* The limit of one place: returns true if the message may be written now; then *held is the
 * number suppressed since the last one. */
struct pvx_log_gate {
    int64_t next_ns, last_ns;
    uint64_t held;
    uint32_t passed; /* lines since the last reset */
};
bool pvx_log_gate_pass(struct pvx_log_gate *g, uint64_t *held);
/* Writes one line; `about` may be NULL. */
void pvx_log(enum pvx_log_level level, enum pvx_log_topic topic, const struct pvx_about *about,
             const char *fmt, ...) PVX_PRINTF(4, 5);

#define LOG_E(topic, ...)                   pvx_log(PVX_LOG_ERROR, TOPIC_##topic, NULL, __VA_ARGS__)
#define LOG_W(topic, ...)                   pvx_log(PVX_LOG_WARN, TOPIC_##topic, NULL, __VA_ARGS__)
#define LOG_I(topic, ...)                   pvx_log(PVX_LOG_INFO, TOPIC_##topic, NULL, __VA_ARGS__)
#define LOG_D(topic, ...)                   pvx_log(PVX_LOG_DEBUG, TOPIC_##topic, NULL, __VA_ARGS__)
#define ABOUT(...)                          (&(const struct pvx_about){__VA_ARGS__})
#define LOG_ABOUT(level, topic, about, ...) pvx_log_about(level, TOPIC_##topic, about, __VA_ARGS__)
/* `fmt` gets a trailing "(N more like it held back)" */
#define LOG_EVERY_ABOUT(level, topic, about, fmt, ...)                                 \
    do {                                                                               \
        static struct pvx_log_gate gate_;                                              \
        uint64_t held_;                                                                \
        if (pvx_log_gate_pass(&gate_, &held_))                                         \
            pvx_log(level, TOPIC_##topic, about, fmt " (%llu more like it held back)", \
                    ##__VA_ARGS__, (unsigned long long)held_);                         \
    } while (0)
#define LOG_EVERY(level, topic, ...) LOG_EVERY_ABOUT(level, topic, NULL, __VA_ARGS__)

#endif
