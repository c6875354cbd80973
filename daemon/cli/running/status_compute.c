#include "daemon/cli/running/status_compute.h"

#include <stdio.h>

#include "daemon/cli/common/ask.h"

size_t compute_line(const cJSON *status, char *out, size_t size)
{
    const char *device = ask_text(status, "compute", "device");
    double here = ask_num(status, "compute", "fell_back");
    if (device[0] == '\0' || size == 0)
        return 0;
    size_t n =
        (size_t)snprintf(out, size, "%.128s, %.0f sets, %.0f from raw pixels", device,
                         ask_num(status, "compute", "sets"), ask_num(status, "compute", "raw"));
    if (here > 0 && n < size)
        n += (size_t)snprintf(out + n, size - n, "; %.0f on the processors instead: %s", here,
                              ask_text(status, "compute", "why"));
    return n;
}
