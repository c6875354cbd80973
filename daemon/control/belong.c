#include "daemon/control/belong.h"

const char *const dmn_taking_names[] = {"none", "taking", "done", "failed"};

void dmn_belong_json(struct dmn_json *j, const struct dmn_belong *b,
                     const char (*camera)[REC_NAME_MAX], size_t n_cameras)
{
    const struct rec_plausible_verdict *v = &b->verdict;
    dmn_json_int(j, "judged", (long long)b->judged);
    dmn_json_int(j, "set", (long long)b->set);
    dmn_json_bool(j, "good", v->cause == REC_CAUSE_NONE);
    dmn_json_str(j, "cause", rec_cause_name(v->cause));
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < n_cameras; c++)
        if ((v->cameras >> c & 1) != 0)
            dmn_json_str(j, NULL, camera[c]);
    dmn_json_close(j, ']');
    dmn_json_bool(j, "meaningless", v->meaningless);
    dmn_json_str(j, "text", v->text);
    dmn_json_str(j, "next", v->next);
    dmn_json_num(j, "residual", v->residual);
    dmn_json_num(j, "noise", v->noise);
    dmn_json_num(j, "outside", v->outside);
    dmn_json_num(j, "saturated", v->saturated);
    dmn_json_num(j, "missed", v->before);
    dmn_json_num(j, "missed_then", v->after);
}
