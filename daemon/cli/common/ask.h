/* ask.h - one question to a daemon's control socket. */
#ifndef ASK_H
#define ASK_H
#include <cjson/cJSON.h>
#include "base/err.h"

/* Send {"cmd":`cmd`} and wait at most timeout_ms for the answer.  key: a .key file for a daemon that needs one, or
 * NULL.  Owner of *out: caller, cJSON_Delete.
 * PVX_ETIMEDOUT: no answer (diag says what to do).  PVX_EFORMAT: not JSON.  PVX_EPERM: the daemon refuses this key,
 * or needs one.  PVX_EINVAL: the daemon refuses the request (diag has its words). */
PVX_MUST_CHECK pvx_err ask(const char *endpoint, const char *key, const char *cmd, int timeout_ms,
                           cJSON **out, struct pvx_diag *d);
/* The same with a whole request, JSON text. */
PVX_MUST_CHECK pvx_err ask_request(const char *endpoint, const char *key, const char *request,
                                   int timeout_ms, cJSON **out, struct pvx_diag *d);

/* The same with words as `pyrovox ctl` takes them: the command (commands.h) first and NULL last.  timeout_ms 0: as
 * long as that command needs.  PVX_ERANGE: too many words for it. */
PVX_MUST_CHECK pvx_err ask_words(const char *endpoint, const char *key, const char *const *word,
                                 int timeout_ms, cJSON **out, struct pvx_diag *d);

/* Number or text at path a.b (b may be NULL).  0 or "": it is not there. */
double ask_num(const cJSON *j, const char *a, const char *b);
const char *ask_text(const cJSON *j, const char *a, const char *b);
#endif
