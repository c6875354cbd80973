#include "cli/health.h"

#include <stdio.h>
#include <string.h>

#include "cli/ask.h"

/* A number with so many places, or a dash when the camera does not say. */
static const char *number(const cJSON *k, const char *name, int places, char out[32])
{
    const cJSON *v = cJSON_GetObjectItemCaseSensitive(k, name);
    if (cJSON_IsNumber(v))
        snprintf(out, 32, "%.*f", places, v->valuedouble);
    else
        snprintf(out, 32, "-");
    return out;
}

static int says_something(const cJSON *h)
{
    return cJSON_IsNumber(cJSON_GetObjectItemCaseSensitive(h, "temperature_c")) ||
           cJSON_IsNumber(cJSON_GetObjectItemCaseSensitive(h, "link_mbps")) ||
           ask_text(h, "ptp", NULL)[0] != '\0';
}

static void print_health(const cJSON *cameras)
{
    const cJSON *k;
    int head = 0;
    cJSON_ArrayForEach(k, cameras)
    {
        const cJSON *h = cJSON_GetObjectItemCaseSensitive(k, "health");
        char t[32], link[32], offset[32];
        if (!says_something(h))
            continue;
        if (!head++)
            printf("\n%-16s %5s %9s %-12s %14s %9s %9s\n", "health", "C", "link Mb/s", "PTP",
                   "PTP offset ns", "resent", "missing");
        const char *ptp = ask_text(h, "ptp", NULL);
        printf("%-16s %5s %9s %-12s %14s %9.0f %9.0f\n", ask_text(k, "name", NULL),
               number(h, "temperature_c", 0, t), number(h, "link_mbps", 0, link),
               ptp[0] != '\0' ? ptp : "-", number(h, "ptp_offset_ns", 0, offset),
               ask_num(h, "packets_resent", NULL), ask_num(h, "packets_missing", NULL));
    }
}

static void print_action(const cJSON *s, const cJSON *cameras)
{
    const cJSON *k;
    double sent = ask_num(s, "action", "sent"), late = ask_num(s, "action", "late"),
           failed = ask_num(s, "action", "failed");
    if (sent + late + failed == 0)
        return;
    printf(
        "\naction commands: %.0f sent, %.0f left out (too late to be scheduled), %.0f not sent to "
        "all networks\n",
        sent, late, failed);
    printf("%-16s %12s %9s %9s %9s %9s\n", "camera", "acknowledged", "silent", "refused",
           "too late", "no clock");
    cJSON_ArrayForEach(k, cameras)
        printf("%-16s %12.0f %9.0f %9.0f %9.0f %9.0f\n", ask_text(k, "name", NULL),
               ask_num(k, "action", "acknowledged"), ask_num(k, "action", "silent"),
               ask_num(k, "action", "refused"), ask_num(k, "action", "too_late"),
               ask_num(k, "action", "no_clock"));
}

void health_print(const cJSON *status)
{
    const cJSON *cameras = cJSON_GetObjectItemCaseSensitive(status, "cameras");
    print_health(cameras);
    print_action(status, cameras);
}
