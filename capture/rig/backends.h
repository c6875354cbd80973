/* backends.h - the sources built in: the one table of them. */
#ifndef CAP_RIG_BACKENDS_H
#define CAP_RIG_BACKENDS_H
#include "capture/source/backends.h"

/* NULL-terminated. */
const struct cap_source_ops *const *cap_backends(void);
/* The one for "scheme:rest" (*rest = after the colon); NULL = there is none such. */
const struct cap_source_ops *cap_backend_find(const char *uri, const char **rest);
#endif
