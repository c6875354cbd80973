#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "daemon/cli/common/ask.h"
#include "daemon/cli/common/cli.h"

/* As the daemon has to hear it: it runs in another folder. */
static pvx_err absolute(const char *path, char *out, size_t size, struct pvx_diag *d)
{
    char here[PATH_MAX];
    int n = path[0] == '/'                      ? snprintf(out, size, "%s", path)
            : getcwd(here, sizeof here) != NULL ? snprintf(out, size, "%s/%s", here, path)
                                                : -1;
    return n >= 0 && n < (int)size
               ? PVX_OK
               : pvx_fail(d, PVX_EINVAL, "--out %s: is not a name for a file", path);
}

int record_raw(const char *control, const char *key, const char *action, const char *out)
{
    char path[PATH_MAX + 256];
    struct pvx_diag d = {""};
    cJSON *reply = NULL;
    const char *const words[] = {"record", action, "raw", out == NULL ? NULL : path, NULL};
    pvx_err e = out == NULL ? PVX_OK : absolute(out, path, sizeof path, &d);
    if (e == PVX_OK)
        e = ask_words(control, key, words, 0, &reply, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%s %s\n", strcmp(action, "start") == 0 ? "recording raw frames to" : "recorded",
           ask_text(reply, "path", NULL));
    cJSON_Delete(reply);
    return 0;
}
