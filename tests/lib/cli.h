/* cli.h - pyrovox as a user runs it, in the test's scratch folder. */
#ifndef TESTS_CLI_H
#define TESTS_CLI_H
#include <string.h>
#include <sys/wait.h>

#include "base/file.h"
#include "recon/geom/rig.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

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

/* Exit code of `pyrovox ARGS`; what it prints is left in DIR/out.txt and DIR/err.  Volumes that an earlier command left
 * in its --out are removed. */
static inline int pyrovox(const char *args)
{
    char cmd[2000], out[100] = "nothing";
    const char *option = strstr(args, "--out ");
    if (option != NULL)
        sscanf(option, "--out %99s", out);
    snprintf(cmd, sizeof cmd,
             "cd %s && rm -f %s/*.npy && PYROVOX_CACHE=%s/cache %s/pyrovox %s >out.txt 2>err", dir,
             out, dir, exe, args);
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

static inline void write_rig(const char *name, const struct rec_rig *r)
{
    char *yaml;
    size_t len;
    if (rec_rig_format(r, &yaml, &len) != PVX_OK ||
        pvx_file_write(at("%s", name), yaml, len, NULL) != PVX_OK)
        exit(1);
    free(yaml);
}

/* `pyrovox BEFORE args` ends with `code`, and says that on standard error. */
struct cli_case {
    const char *args, *says;
    int code;
};
static inline void cli_cases(const char *before, const struct cli_case *c, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        char args[600];
        snprintf(args, sizeof args, "%s %s", before, c[i].args);
        int code = pyrovox(args);
        T_CHECK_(code == c[i].code, "%s: exit %d, want %d", args, code, c[i].code);
        T_CONTAINS(slurp("err"), c[i].says);
    }
}
#define CLI_CASES(before, list) cli_cases(before, list, sizeof(list) / sizeof *(list))

/* Refused, and no.yaml is not written. */
static inline void refused(const char *args, const char *says)
{
    cli_cases("", &(struct cli_case){args, says, 1}, 1);
    T_OK(access(at("no.yaml"), F_OK) != 0);
}
#endif
