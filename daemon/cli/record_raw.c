#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/cli/ask.h"
#include "daemon/cli/cli.h"

#define TIMEOUT_MS 60000 /* the daemon answers a stop when all that waits is written */

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

static pvx_err send_request(const char *control, const char *key, const char *action,
                            const char *path, cJSON **reply, struct pvx_diag *d)
{
    cJSON *req = cJSON_CreateObject();
    cJSON_AddStringToObject(req, "cmd", "record");
    cJSON_AddStringToObject(req, "action", action);
    if (path != NULL)
        cJSON_AddStringToObject(req, "path", path);
    char *text = cJSON_PrintUnformatted(req);
    cJSON_Delete(req);
    pvx_err e = text != NULL ? ask_request(control, key, text, TIMEOUT_MS, reply, d) : PVX_ENOMEM;
    free(text);
    return e;
}

int record_raw(const char *control, const char *key, const char *action, const char *out)
{
    char path[PATH_MAX + 256];
    struct pvx_diag d = {""};
    cJSON *reply = NULL;
    pvx_err e = out == NULL ? PVX_OK : absolute(out, path, sizeof path, &d);
    if (e == PVX_OK)
        e = send_request(control, key, action, out == NULL ? NULL : path, &reply, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%s %s\n", strcmp(action, "start") == 0 ? "recording raw frames to" : "recorded",
           ask_text(reply, "path", NULL));
    cJSON_Delete(reply);
    return 0;
}
