#include "daemon/state_health.h"

void dmn_state_health(struct dmn_json *j, const struct cap_camera_stats *k)
{
    const struct cap_health *h = &k->health;
    const struct cap_action_answers *a = &k->action;
    dmn_json_open(j, "health", '{');
    dmn_json_num(j, "temperature_c", h->temperature_c);
    dmn_json_num(j, "link_mbps", h->link_mbps);
    dmn_json_str(j, "ptp", h->ptp);
    dmn_json_num(j, "ptp_offset_ns", h->ptp_offset_ns);
    dmn_json_int(j, "packets_resent", (long long)h->packets_resent);
    dmn_json_int(j, "packets_missing", (long long)h->packets_missing);
    dmn_json_close(j, '}');
    dmn_json_open(j, "action", '{');
    dmn_json_int(j, "acknowledged", (long long)a->acknowledged);
    dmn_json_int(j, "silent", (long long)a->silent);
    dmn_json_int(j, "refused", (long long)a->refused);
    dmn_json_int(j, "too_late", (long long)a->too_late);
    dmn_json_int(j, "no_clock", (long long)a->no_clock);
    dmn_json_close(j, '}');
}

void dmn_state_action(struct dmn_json *j, const struct cap_stats *s)
{
    dmn_json_open(j, "action", '{');
    dmn_json_int(j, "sent", (long long)s->action.sent);
    dmn_json_int(j, "late", (long long)s->action.late);
    dmn_json_int(j, "failed", (long long)s->action.failed);
    dmn_json_close(j, '}');
}
