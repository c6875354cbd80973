#include "daemon/cli/common/verdict.h"

#include <stdio.h>
#include <string.h>

#include "daemon/cli/common/ask.h"
#include "recon/vote/wrong.h"

bool camera_moved(const cJSON *camera)
{
    return cJSON_IsTrue(
        cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(camera, "rig"), "moved"));
}

const char *camera_check(const cJSON *camera)
{
    const char *wrong = ask_text(camera, "check", "wrong");
    bool said = strcmp(wrong, ask_text(camera, "vote", "why")) == 0 ||
                (camera_moved(camera) && strcmp(wrong, rec_wrong_name(REC_WRONG_MOVED)) == 0);
    return said ? "" : ask_text(camera, "check", "text");
}

void camera_trouble(const cJSON *camera, char out[STATUS_LINE])
{
    const char *error = ask_text(camera, "error", NULL), *why = ask_text(camera, "vote", "why");
    const char *check = camera_check(camera);
    const cJSON *t = cJSON_GetArrayItem(cJSON_GetObjectItemCaseSensitive(camera, "troubles"), 0);
    const char *detail = ask_text(t, "detail", NULL);
    out[0] = '\0';
    if (error[0] != '\0')
        snprintf(out, STATUS_LINE, "%s", error);
    else if (why[0] != '\0' && check[0] == '\0')
        snprintf(out, STATUS_LINE, "left out: %s; %s", why, ask_text(camera, "vote", "remedy"));
    else if (why[0] == '\0' && camera_moved(camera))
        snprintf(out, STATUS_LINE, "moved by %+.1f px right, %+.1f px down; %s",
                 ask_num(camera, "rig", "right_px"), ask_num(camera, "rig", "down_px"),
                 rec_wrong_remedy(REC_WRONG_MOVED));
    else if (check[0] != '\0')
        snprintf(out, STATUS_LINE, "%s%s", why[0] != '\0' ? "left out: " : "", check);
    else if (t != NULL)
        snprintf(out, STATUS_LINE, "%s", detail[0] != '\0' ? detail : ask_text(t, "text", NULL));
}

void belong_verdict(const cJSON *belong, struct rec_plausible_verdict *out)
{
    *out = (struct rec_plausible_verdict){
        .cause = cJSON_IsFalse(cJSON_GetObjectItemCaseSensitive(belong, "good")) ? REC_CAUSE_UNTOLD
                                                                                 : REC_CAUSE_NONE,
        .residual = ask_num(belong, "residual", NULL),
        .noise = ask_num(belong, "noise", NULL)};
    snprintf(out->text, sizeof out->text, "%s", ask_text(belong, "text", NULL));
    snprintf(out->next, sizeof out->next, "%s", ask_text(belong, "next", NULL));
}

/* The camera to speak of: the first that does not run, else the first with a trouble; and how many have one. */
static const cJSON *status_cameras_first(const cJSON *status, int *wrong)
{
    const cJSON *k, *first = NULL;
    char text[STATUS_LINE];
    *wrong = 0;
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(status, "cameras"))
    {
        camera_trouble(k, text);
        *wrong += text[0] != '\0';
        if (text[0] != '\0' && (first == NULL || (ask_text(first, "error", NULL)[0] == '\0' &&
                                                  ask_text(k, "error", NULL)[0] != '\0')))
            first = k;
    }
    return first;
}

/* What is wrong with rig and pictures as a whole comes before what it does to single cameras, and after a camera that
 * does not run.  A cause that says no more than the camera's own does not. */
static bool belong_first(const cJSON *belong, const cJSON *camera)
{
    const char *cause = ask_text(belong, "cause", NULL);
    return ask_num(belong, "judged", NULL) > 0 && cause[0] != '\0' &&
           (camera == NULL || (ask_text(camera, "error", NULL)[0] == '\0' &&
                               strcmp(cause, rec_cause_name(REC_CAUSE_CAMERA)) != 0 &&
                               strcmp(cause, rec_cause_name(REC_CAUSE_GAIN)) != 0 &&
                               strcmp(cause, rec_cause_name(REC_CAUSE_UNTOLD)) != 0));
}

bool verdict_line(const cJSON *status, char out[STATUS_LINE])
{
    const cJSON *belong = cJSON_GetObjectItemCaseSensitive(status, "belong");
    struct rec_plausible_verdict v;
    char text[STATUS_LINE];
    int wrong;
    const cJSON *first = status_cameras_first(status, &wrong);
    belong_verdict(belong, &v);
    if (belong_first(belong, first)) {
        rec_plausible_line(&v, out);
        return false;
    }
    if (first != NULL) {
        char others[32] = "";
        camera_trouble(first, text);
        char *next = strstr(text, "; ");
        if (wrong > 1)
            snprintf(others, sizeof others, " (%d more cameras)", wrong - 1);
        if (next != NULL)
            *next = '\0';
        snprintf(out, STATUS_LINE, "bad: %.64s: %.400s%s%s%.250s", ask_text(first, "name", NULL),
                 text, others, next != NULL ? "; next: " : "", next != NULL ? next + 2 : "");
        return false;
    }
    if (!(ask_num(status, "sets_per_s", NULL) > 0)) {
        snprintf(out, STATUS_LINE,
                 "bad: no volumes now; next: see what dropped the sets, and the daemon's log");
        return false;
    }
    const int n = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(status, "cameras"));
    if (!(ask_num(status, "last", "active_voxels") > 0)) {
        snprintf(out, STATUS_LINE, "good: %d cameras agree; the last set has no flame", n);
        return true;
    }
    v.residual = ask_num(status, "last", "rel_residual");
    v.noise = ask_num(status, "last", "noise");
    if (v.text[0] == '\0') /* not judged yet */
        snprintf(v.text, sizeof v.text, "%d cameras agree", n);
    rec_plausible_line(&v, out);
    return true;
}
