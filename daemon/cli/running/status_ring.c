#include "daemon/cli/running/status_ring.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "daemon/cli/common/ask.h"

size_t ring_line(const cJSON *status, char *out, size_t size)
{
    const cJSON *r = cJSON_GetObjectItemCaseSensitive(status, "ring"), *k;
    if (r == NULL || size == 0)
        return 0;
    size_t n = (size_t)snprintf(
        out, size, "%.2f s, %.0f frames a camera, %.1f of %.1f MB; %.0f takes, %.0f failed",
        ask_num(r, "seconds", NULL), ask_num(r, "frames", NULL), ask_num(r, "bytes", NULL) * 1e-6,
        ask_num(r, "bytes_max", NULL) * 1e-6, ask_num(r, "takes", NULL),
        ask_num(r, "failed", NULL));
    if (cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(r, "writing")) && n < size)
        n += (size_t)snprintf(out + n, size - n, "; writing %s, %.0f wait",
                              ask_text(r, "name", NULL), ask_num(r, "waiting", NULL));
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(r, "lost")) if (n < size) n +=
        (size_t)snprintf(out + n, size - n, "; frames lost, %s: %.0f", k->string, k->valuedouble);
    if (ask_text(r, "error", NULL)[0] != '\0' && n < size)
        n += (size_t)snprintf(out + n, size - n, "; %s", ask_text(r, "error", NULL));
    return n;
}

void trigger_line(const cJSON *trigger, char *out, size_t size)
{
    const char *when = ask_text(trigger, "when", NULL);
    size_t n = (size_t)snprintf(out, size, "%s: ", ask_text(trigger, "name", NULL));
    if (strcmp(when, "order") == 0 || strcmp(when, "at") == 0)
        n += (size_t)snprintf(out + n, size - n, "by %s", when);
    else if (strcmp(when, "line") == 0)
        n += (size_t)snprintf(out + n, size - n, "line %s",
                              !cJSON_IsNumber(cJSON_GetObjectItemCaseSensitive(trigger, "value"))
                                  ? "not reported"
                              : ask_num(trigger, "value", NULL) > 0 ? "high"
                                                                    : "low");
    else if (n < size)
        n += (size_t)snprintf(
            out + n, size - n, "%s %.4g %s of %.4g, %s", when, ask_num(trigger, "value", NULL),
            ask_text(trigger, "unit", NULL), ask_num(trigger, "above", NULL),
            cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(trigger, "ready")) ? "ready"
                                                                             : "not ready");
    if (n < size)
        n += (size_t)snprintf(out + n, size - n, ", fired %.0f times",
                              ask_num(trigger, "fired", NULL));
    time_t s = (time_t)(ask_num(trigger, "last_ns", NULL) * 1e-9);
    struct tm tm;
    char text[32];
    if (s > 0 && n < size && gmtime_r(&s, &tm) != NULL &&
        strftime(text, sizeof text, "%H:%M:%S UTC", &tm) > 0)
        snprintf(out + n, size - n, ", last at %s", text);
}
