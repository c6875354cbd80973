#include "daemon/cli/running/status_cameras.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/common/ask.h"
#include "recon/vote/wrong.h"

#define BINS_MAX 64

/* Print a character for each bin: the darker, the larger its share of the whole. */
static void print_bins(const cJSON *bins)
{
    static const char shade[] = " .:-=+*#%@";
    char text[BINS_MAX + 1];
    double sum = 0;
    const cJSON *b;
    int n = 0;
    cJSON_ArrayForEach(b, bins) sum += b->valuedouble;
    cJSON_ArrayForEach(b, bins)
    {
        if (n == BINS_MAX)
            break;
        int s = sum > 0 ? (int)ceil(b->valuedouble / sum * 9) : 0;
        text[n++] = shade[s < 0 ? 0 : s > 9 ? 9 : s];
    }
    text[n] = '\0';
    printf("|%s|\n", text);
}

static void status_cameras_print_row(const char *name, const cJSON *skew)
{
    printf("%-16s %9.0f %9.0f %9.0f %9.0f  ", name, ask_num(skew, "mean_us", NULL),
           ask_num(skew, "p50_us", NULL), ask_num(skew, "p99_us", NULL),
           ask_num(skew, "max_us", NULL));
    print_bins(cJSON_GetObjectItemCaseSensitive(skew, "bins"));
}

void skew_print(const cJSON *status)
{
    const cJSON *k, *cameras = cJSON_GetObjectItemCaseSensitive(status, "cameras");
    double n = 0;
    cJSON_ArrayForEach(k, cameras) n += ask_num(k, "skew", "n");
    if (n == 0)
        return;
    printf("\n%-16s %9s %9s %9s %9s   %s\n", "exposure", "mean us", "p50", "p99", "max",
           "-50ms    -1ms   -20us + 20us    1ms   50ms");
    cJSON_ArrayForEach(k, cameras) status_cameras_print_row(
        ask_text(k, "name", NULL), cJSON_GetObjectItemCaseSensitive(k, "skew"));
    printf("%-16s %9s %9.0f %9.0f %9s  %14s", "spread of a set", "",
           ask_num(status, "spread_ms", "p50") * 1e3, ask_num(status, "spread_ms", "p99") * 1e3, "",
           "");
    print_bins(cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(status, "skew"),
                                                "spread_bins"));
}

void checks_print(const cJSON *status)
{
    const cJSON *k;
    double failed = ask_num(status, "check", "failed");
    if (ask_num(status, "check", "checks") == 0)
        return;
    printf("\n%-16s %7s %9s %17s %6s\n", "by the flame", "agrees", "residual", "displaced, px",
           "gain");
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(status, "cameras"))
    {
        printf("%-16s ", ask_text(k, "name", NULL));
        if (ask_num(k, "check", "sets") == 0)
            puts("      -");
        else
            printf("%7.3f %9.3f %+8.2f %+8.2f %6.2f  %s\n",
                   ask_num(k, "check", "agreement_displaced"), ask_num(k, "check", "residual"),
                   ask_num(k, "check", "right_px"), ask_num(k, "check", "down_px"),
                   ask_num(k, "check", "gain"), ask_text(k, "check", "wrong"));
    }
    puts(ask_text(status, "check", "text"));
    if (failed > 0)
        printf("the last %.0f checks found no flame that moves, to judge by\n", failed);
}

void troubles_print(const cJSON *status)
{
    const cJSON *k, *t;
    double steps = ask_num(status, "host_clock", "steps");
    if (ask_text(status, "open_to_all", NULL)[0] != '\0')
        printf("insecure: %s is open to all who reach it\n", ask_text(status, "open_to_all", NULL));
    if (steps > 0)
        printf("the host's clock was set %.0f times, last by %+.3f s\n", steps,
               ask_num(status, "host_clock", "last_step_s"));
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(status, "cameras"))
    {
        if (camera_moved(k))
            printf("%-16s moved: its pictures are %+.1f px to the right and %+.1f px down of where "
                   "the others see the flame; %s\n",
                   ask_text(k, "name", NULL), ask_num(k, "rig", "right_px"),
                   ask_num(k, "rig", "down_px"), rec_wrong_remedy(REC_WRONG_MOVED));
        if (camera_check(k)[0] != '\0')
            printf("%-16s %s\n", ask_text(k, "name", NULL), camera_check(k));
        cJSON_ArrayForEach(t, cJSON_GetObjectItemCaseSensitive(k, "troubles"))
        {
            const char *detail = ask_text(t, "detail", NULL);
            printf("%-16s %s (%.0f): %s%s%s; %s\n", ask_text(k, "name", NULL),
                   ask_text(t, "cause", NULL), ask_num(t, "n", NULL), ask_text(t, "text", NULL),
                   detail[0] != '\0' ? ": " : "", detail, ask_text(t, "remedy", NULL));
        }
    }
}

void votes_print(const cJSON *status)
{
    const cJSON *k;
    const cJSON *last = cJSON_GetObjectItemCaseSensitive(status, "last");
    if (strcmp(ask_text(last, "vote", "state"), "torn") == 0)
        puts("the cameras contradict each other, and which of them are wrong cannot be told: "
             "pyrovox calibrate check");
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(status, "cameras"))
    {
        if (!cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(
                cJSON_GetObjectItemCaseSensitive(k, "vote"), "out")))
            continue;
        printf("%-16s left out (%.0f sets), it contradicts the others: %s; %s\n",
               ask_text(k, "name", NULL), ask_num(k, "vote", "sets"), ask_text(k, "vote", "why"),
               ask_text(k, "vote", "remedy"));
    }
}

const char *selfcal_words(const cJSON *camera, char *out, size_t size)
{
    double sets = ask_num(camera, "selfcal", "sets");
    int n = 0;
    out[0] = '\0';
    if (!cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(
            cJSON_GetObjectItemCaseSensitive(camera, "selfcal"), "corrected")))
        return out;
    n = snprintf(
        out, size,
        "corrected: gain %.3f +- %.3f, flame %+.2f +- %.2f px to the right, %+.2f +- "
        "%.2f px down",
        ask_num(camera, "selfcal", "gain"), ask_num(camera, "selfcal", "gain_error"),
        ask_num(camera, "selfcal", "right_px"), ask_num(camera, "selfcal", "right_error_px"),
        ask_num(camera, "selfcal", "down_px"), ask_num(camera, "selfcal", "down_error_px"));
    if (sets > 0 && n > 0 && (size_t)n < size)
        snprintf(out + n, size - (size_t)n, " (%.0f sets)", sets);
    return out;
}

void selfcal_print(const cJSON *status)
{
    const cJSON *k;
    char words[160];
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(status, "cameras"))
    {
        if (selfcal_words(k, words, sizeof words)[0] != '\0')
            printf("%-16s %s\n", ask_text(k, "name", NULL), words);
    }
}

/* A number with so many decimals, or a dash if the camera does not report it. */
static const char *status_cameras_number(const cJSON *k, const char *name, int places, char out[32])
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
               status_cameras_number(h, "temperature_c", 0, t),
               status_cameras_number(h, "link_mbps", 0, link), ptp[0] != '\0' ? ptp : "-",
               status_cameras_number(h, "ptp_offset_ns", 0, offset),
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
