/* log.h - levelled, topic-tagged messages on stderr, fit for journald.
 *
 * Line: "<N>topic: text" under systemd (JOURNAL_STREAM set), else "HH:MM:SS.mmm level topic: text".
 * One write(2) per line.  Threads: any thread may log; the frame path uses LOG_EVERY only, which
 * allows one line per second and place and says how many it kept back.
 * Never log in a camera's driver callback. */
#ifndef PVX_LOG_H
#define PVX_LOG_H
#include <stdint.h>
#include "base/err.h"

enum pvx_log_level { PVX_LOG_ERROR, PVX_LOG_WARN, PVX_LOG_INFO, PVX_LOG_DEBUG };
enum pvx_log_topic { TOPIC_DAEMON, TOPIC_CAPTURE, TOPIC_RECON, TOPIC_PROTO, TOPIC_SIM, TOPIC_N };

/* Messages above `level` are dropped.  Live; default INFO. */
void pvx_log_set_level(enum pvx_log_level level);
enum pvx_log_level pvx_log_get_level(void);
/* "error" "warn" "info" "debug"; PVX_EINVAL otherwise. */
PVX_MUST_CHECK pvx_err pvx_log_level_parse(const char *name, enum pvx_log_level *out);

void pvx_log(enum pvx_log_level level, enum pvx_log_topic topic, const char *fmt, ...)
    PVX_PRINTF(3, 4);

/* Rate limit for one place in the code: returns 1 if the message may go out now, and then gives in
 * *held how many were kept back since the last one. */
struct pvx_log_gate {
    int64_t next_ns;
    uint64_t held;
};
int pvx_log_gate_pass(struct pvx_log_gate *g, uint64_t *held);

#define LOG_E(topic, ...) pvx_log(PVX_LOG_ERROR, TOPIC_##topic, __VA_ARGS__)
#define LOG_W(topic, ...) pvx_log(PVX_LOG_WARN, TOPIC_##topic, __VA_ARGS__)
#define LOG_I(topic, ...) pvx_log(PVX_LOG_INFO, TOPIC_##topic, __VA_ARGS__)
#define LOG_D(topic, ...) pvx_log(PVX_LOG_DEBUG, TOPIC_##topic, __VA_ARGS__)
/* At most one line a second from this place; `fmt` gets a trailing "(N more like it)" */
#define LOG_EVERY(level, topic, fmt, ...)                                                      \
    do {                                                                                       \
        static struct pvx_log_gate gate_;                                                      \
        uint64_t held_;                                                                        \
        if (pvx_log_gate_pass(&gate_, &held_))                                                 \
            pvx_log(level, TOPIC_##topic, fmt " (%llu more like it held back)", ##__VA_ARGS__, \
                    (unsigned long long)held_);                                                \
    } while (0)

#endif
