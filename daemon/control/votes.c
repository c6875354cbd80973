#include "daemon/control/votes.h"

#include <stdio.h>

#include "base/log.h"

static void log_it(void *ctx, bool bad, const struct pvx_about *about, const char *sentence)
{
    (void)ctx;
    LOG_ABOUT(bad ? PVX_LOG_WARN : PVX_LOG_INFO, RECON, about, "%s", sentence);
}
const struct dmn_votes_listener dmn_votes_log = {log_it, NULL};

static bool votes_has(uint64_t set, size_t c)
{
    return (set >> c & 1) != 0;
}

static void say_camera(const struct dmn_votes *v, size_t c, const struct rec_rig *rig,
                       const struct dmn_votes_listener *to)
{
    char text[400];
    enum rec_wrong why = (enum rec_wrong)v->why[c];
    if (votes_has(v->out, c))
        snprintf(text, sizeof text, "camera %s is left out, it contradicts the others: %s; %s",
                 rig->cameras[c].name, rec_wrong_name(why), rec_wrong_remedy(why));
    else
        snprintf(text, sizeof text, "camera %s agrees with the others again and is back",
                 rig->cameras[c].name);
    to->say(to->ctx, votes_has(v->out, c),
            ABOUT(.cause = "voted_out", .camera = rig->cameras[c].name), text);
}

static void say_state(struct dmn_votes *v, const struct dmn_votes_listener *to)
{
    bool torn = v->state == REC_VOTE_TORN;
    int lasts = v->patience > 0 ? v->patience : 1;
    if (torn && v->lasting < lasts)
        v->lasting++;
    else if (!torn && v->lasting > 0)
        v->lasting--;
    if (v->state == REC_VOTE_FEW && !v->said_few) {
        v->said_few = true;
        to->say(to->ctx, false, ABOUT(.cause = "few_cameras"),
                "fewer than four cameras: none is left out, whatever it shows");
    }
    if (v->lasting == lasts && !v->said_torn) {
        v->said_torn = true;
        to->say(to->ctx, true, ABOUT(.cause = "torn"),
                "the cameras contradict each other, and which of them are wrong cannot be told: "
                "pyrovox calibrate check");
    } else if (v->lasting == 0 && v->said_torn) {
        v->said_torn = false;
        to->say(to->ctx, false, ABOUT(.cause = "torn"), "the cameras agree again");
    }
}

void dmn_votes_add(struct dmn_votes *v, const struct rec_verdict *set, const struct rec_rig *rig,
                   const struct dmn_votes_listener *to)
{
    uint64_t changed = set->out ^ v->out;
    bool judged = set->state >= REC_VOTE_AGREE || set->out != 0;
    if (set->state == REC_VOTE_NONE)
        return;
    for (size_t c = 0; c < rig->n_cameras; c++)
        if (votes_has(set->out, c)) {
            if (v->why[c] == REC_WRONG_DISAGREES && set->why[c] != REC_WRONG_DISAGREES)
                changed |= (uint64_t)1 << c; /* the cause has become clear */
            v->left_out[c][set->why[c]]++;
        }
    if (judged) {
        v->out = set->out;
        for (size_t c = 0; c < rig->n_cameras; c++)
            if (votes_has(changed, c)) {
                v->why[c] = votes_has(set->out, c) ? set->why[c] : REC_WRONG_NOTHING;
                say_camera(v, c, rig, to);
            }
    }
    v->torn += set->state == REC_VOTE_TORN;
    if (judged || set->state == REC_VOTE_FEW) {
        v->state = set->state;
        say_state(v, to);
    }
}

void dmn_votes_camera_json(struct dmn_json *j, const struct dmn_votes *v, size_t c)
{
    bool out = votes_has(v->out, c);
    enum rec_wrong why = out ? (enum rec_wrong)v->why[c] : REC_WRONG_NOTHING;
    uint64_t sets = 0;
    for (int w = 0; w < REC_N_WRONG; w++)
        sets += v->left_out[c][w];
    dmn_json_open(j, "vote", '{');
    dmn_json_bool(j, "out", out);
    dmn_json_str(j, "why", rec_wrong_name(why));
    dmn_json_str(j, "remedy", rec_wrong_remedy(why));
    dmn_json_int(j, "sets", (long long)sets);
    dmn_json_open(j, "causes", '{');
    for (int w = REC_WRONG_NOTHING + 1; w < REC_N_WRONG; w++)
        if (v->left_out[c][w] > 0)
            dmn_json_int(j, rec_wrong_name((enum rec_wrong)w), (long long)v->left_out[c][w]);
    dmn_json_close(j, '}');
    dmn_json_close(j, '}');
}

void dmn_verdict_json(cJSON *o, const struct rec_verdict *set, const struct rec_rig *rig)
{
    cJSON *vote = cJSON_AddObjectToObject(o, "vote");
    cJSON_AddStringToObject(vote, "state", rec_vote_state_name(set->state));
    cJSON_AddNumberToObject(vote, "misfit", (double)set->misfit);
    cJSON_AddNumberToObject(vote, "doubt", (double)set->doubt);
    cJSON *out = cJSON_AddArrayToObject(o, "out");
    for (size_t c = 0; c < rig->n_cameras; c++) {
        if (!votes_has(set->out, c))
            continue;
        cJSON *k = cJSON_CreateObject();
        cJSON_AddStringToObject(k, "camera", rig->cameras[c].name);
        cJSON_AddStringToObject(k, "why", rec_wrong_name((enum rec_wrong)set->why[c]));
        cJSON_AddNumberToObject(k, "cost", (double)set->cost[c]);
        cJSON_AddItemToArray(out, k);
    }
}
