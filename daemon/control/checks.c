#include "daemon/control/checks.h"

#include <stdio.h>

static int patience_of(const struct dmn_checks *k)
{
    return k->patience > 0 ? k->patience : 1;
}

/* Up or down by one, within 0 and `most`. */
static int checks_count(int n, bool up, int most)
{
    if (up)
        return n < most ? n + 1 : most;
    return n > 0 ? n - 1 : 0;
}

static void checks_say(struct dmn_checks_camera *o, uint8_t known, const char *camera,
                       const struct dmn_votes_listener *to)
{
    char words[DMN_CHECK_WORDS], text[DMN_CHECK_WORDS + REC_NAME_MAX + 80];
    bool wrong = o->figures.wrong != REC_WRONG_NOTHING;
    if (wrong ? (enum rec_wrong)known == o->figures.wrong : !o->said)
        return;
    dmn_check_sentence(&o->figures, words);
    if (wrong)
        snprintf(text, sizeof text, "camera %s does not agree with the flame: %s", camera, words);
    else
        snprintf(text, sizeof text, "camera %s agrees with the flame again", camera);
    o->said = wrong;
    to->say(to->ctx, wrong, ABOUT(.cause = "check", .camera = camera), text);
}

static void checks_name(struct dmn_checks_camera *o, enum rec_wrong now, int patience)
{
    o->lasting = checks_count(o->lasting, now != REC_WRONG_NOTHING, patience);
    if (o->lasting == 0)
        o->figures.wrong = REC_WRONG_NOTHING;
    else if (o->lasting == patience && (patience == 1 || now == o->last))
        o->figures.wrong = now;
    o->last = now;
}

static void torn(struct dmn_checks *k, size_t n, const struct dmn_votes_listener *to)
{
    char text[DMN_CHECK_WORDS];
    int most = patience_of(k);
    k->torn = checks_count(k->torn, k->outcome == REC_CHECK_UNTOLD, most);
    if (k->torn == most && !k->said_torn) {
        dmn_check_conclusion(k->outcome, k->n_wrong, n, text);
        to->say(to->ctx, true, ABOUT(.cause = "check"), text);
        k->said_torn = true;
    } else if (k->torn == 0 && k->said_torn) {
        to->say(to->ctx, false, ABOUT(.cause = "check"),
                "it can be told again which cameras agree with the flame");
        k->said_torn = false;
    }
}

void dmn_checks_add(struct dmn_checks *k, const struct dmn_checks_news *news,
                    const struct rec_rig *rig, const struct dmn_votes_listener *to)
{
    const struct rec_check_verdict *v = news->verdict;
    k->n++;
    k->failed = 0;
    k->outcome = v->outcome;
    k->n_wrong = v->n_wrong;
    for (size_t c = 0; c < rig->n_cameras; c++) {
        struct dmn_checks_camera *o = &k->camera[c];
        enum rec_wrong was = o->figures.wrong;
        if ((news->mask >> c & 1) == 0)
            continue; /* without a picture there is nothing new */
        o->figures = v->figures.camera[c];
        o->figures.wrong = was;
        if (v->outcome == REC_CHECK_UNTOLD)
            continue; /* which are wrong is not known: no camera is named and none is cleared */
        checks_name(o, v->figures.camera[c].wrong, patience_of(k));
        if (o->figures.wrong != was)
            checks_say(o, news->known[c], rig->cameras[c].name, to);
    }
    torn(k, rig->n_cameras, to);
}

void dmn_checks_camera_json(struct dmn_json *j, const struct dmn_checks *k, size_t c)
{
    const struct rec_check_camera *o = &k->camera[c].figures;
    char text[DMN_CHECK_WORDS];
    dmn_check_sentence(o, text);
    dmn_json_open(j, "check", '{');
    dmn_json_str(j, "wrong", rec_wrong_name(o->wrong));
    dmn_json_str(j, "text", text);
    dmn_check_figures_json(j, o);
    dmn_json_close(j, '}');
}

void dmn_checks_json(struct dmn_json *j, const struct dmn_checks *k, size_t n_cameras)
{
    char text[DMN_CHECK_WORDS] = "";
    if (k->n > 0)
        dmn_check_conclusion(k->outcome, k->n_wrong, n_cameras, text);
    dmn_json_open(j, "check", '{');
    dmn_json_int(j, "checks", (long long)k->n);
    dmn_json_int(j, "failed", (long long)k->failed);
    dmn_json_str(j, "outcome", k->n > 0 ? dmn_check_outcome(k->outcome) : "");
    dmn_json_str(j, "text", text);
    dmn_json_close(j, '}');
}
