#include "capture/files/said.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"

pvx_err cap_said_add(char **text, const char *fmt, ...)
{
    char line[2048], *all;
    va_list args;
    va_start(args, fmt);
    vsnprintf(line, sizeof line, fmt, args);
    va_end(args);
    pvx_one_line(line);
    if (asprintf(&all, "%s%s\n", *text != NULL ? *text : "", line) < 0)
        return PVX_ENOMEM;
    free(*text);
    *text = all;
    return PVX_OK;
}

char *cap_said_next(char **rest)
{
    char *line = strsep(rest, "\n");
    return line != NULL && *line != '\0' ? line : NULL;
}
