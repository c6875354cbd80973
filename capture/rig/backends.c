#include "capture/rig/backends.h"

#include <string.h>

static const struct cap_source_ops *const backends[] = {
    &cap_source_aravis,
    &cap_source_v4l2,
    &cap_source_libcamera,
    &cap_source_sim,
    &cap_source_files,
    &cap_source_take,
    NULL,
};

const struct cap_source_ops *const *cap_backends(void)
{
    return backends;
}

const struct cap_source_ops *cap_backend_find(const char *uri, const char **rest)
{
    for (const struct cap_source_ops *const *b = backends; *b != NULL; b++) {
        size_t n = strlen((*b)->scheme);
        if (strncmp(uri, (*b)->scheme, n) == 0 && uri[n] == ':') {
            *rest = uri + n + 1;
            return *b;
        }
    }
    return NULL;
}
