/* backends.h - the table of all built-in sources. */
#ifndef CAP_RIG_BACKENDS_H
#define CAP_RIG_BACKENDS_H
#include "capture/source/backends.h"

/* NULL-terminated. */
const struct cap_source_ops *const *cap_backends(void);
/* The source for "scheme:rest" (*rest = the part after the colon); NULL = no such scheme. */
const struct cap_source_ops *cap_backend_find(const char *uri, const char **rest);
#endif
