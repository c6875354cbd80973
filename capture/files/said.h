/* said.h - what is left out of frames, or odd in them: a sentence on each line of a text that grows. */
#ifndef CAP_SAID_H
#define CAP_SAID_H
#include "base/err.h"

/* Add a line; *text NULL: the first.  Owner: caller, free().  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_said_add(char **text, const char *fmt, ...)
    __attribute__((format(printf, 2, 3)));
/* The next line of such a text, which is cut up; *rest: the text at first.  NULL: no more. */
char *cap_said_next(char **rest);
#endif
