#include "daemon/cli/common/take_notes.h"

#include <inttypes.h>
#include <stdio.h>

#define SHOWN 20

void take_notes(const cap_take *t)
{
    uint64_t n = cap_take_info(t)->notes;
    for (uint64_t k = 0; k < n && k < SHOWN; k++)
        fprintf(stderr, "pyrovox: %s\n", cap_take_note(t, k));
    if (n > SHOWN)
        fprintf(stderr, "pyrovox: %" PRIu64 " more: pyrovox replay --info\n", n - SHOWN);
}
