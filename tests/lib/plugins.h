/* plugins.h - the C++ modules of the build that a test program belongs to. */
#ifndef TESTS_PLUGINS_H
#define TESTS_PLUGINS_H
#include <stdio.h>
#include <stdlib.h>

#include "base/file.h"

static inline void plugins_of_this_build(void)
{
    char bin[400], lib[450];
    if (pvx_exe_dir(bin, sizeof bin) != PVX_OK)
        exit(1);
    snprintf(lib, sizeof lib, "%s/../../lib/pyrovox", bin);
    setenv("PYROVOX_LIBDIR", lib, 1);
}
#endif
