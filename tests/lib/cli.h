/* cli.h - pyrovox as a user runs it, in the test's scratch folder. */
#ifndef TESTS_CLI_H
#define TESTS_CLI_H
#include <string.h>
#include <sys/wait.h>

#include "base/file.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

static char exe[300];      /* folder of the programs */
static char text[1 << 20]; /* of the file read last */

/* The programs and modules of this build, and a scratch folder: scratch_remove() at the end. */
static inline void cli_begin(void)
{
    char here[250];
    plugins_of_this_build();
    if (pvx_exe_dir(here, sizeof here) != PVX_OK)
        exit(1);
    snprintf(exe, sizeof exe, "%s/../../bin", here);
    scratch_new();
}

/* Exit code of `pyrovox ARGS`; what it prints is left in DIR/out.txt and DIR/err. */
static inline int pyrovox(const char *args)
{
    char cmd[2000];
    snprintf(cmd, sizeof cmd, "cd %s && PYROVOX_CACHE=%s/cache %s/pyrovox %s >out.txt 2>err", dir,
             dir, exe, args);
    int rc = system(cmd);
    return WIFEXITED(rc) ? WEXITSTATUS(rc) : -1;
}

/* A file in DIR, into `text`; "" when there is none. */
static inline const char *slurp(const char *name)
{
    char *t;
    size_t n;
    text[0] = '\0';
    if (pvx_file_read(at("%s", name), sizeof text - 1, &t, &n, NULL) == PVX_OK) {
        memcpy(text, t, n + 1);
        free(t);
    }
    return text;
}
#endif
