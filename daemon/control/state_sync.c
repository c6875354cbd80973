#include "daemon/control/state_sync.h"

static void state_sync_bins(struct dmn_json *j, const char *key, const uint64_t *n, int count)
{
    dmn_json_open(j, key, '[');
    for (int i = 0; i < count; i++)
        dmn_json_int(j, NULL, (long long)n[i]);
    dmn_json_close(j, ']');
}

static void us(struct dmn_json *j, const char *key, double ns)
{
    dmn_json_num(j, key, ns * 1e-3);
}

static void skew(struct dmn_json *j, const struct cap_skew *k)
{
    dmn_json_open(j, "skew", '{');
    dmn_json_int(j, "n", (long long)k->n);
    us(j, "mean_us", k->mean_ns);
    us(j, "p50_us", (double)k->p50_ns);
    us(j, "p99_us", (double)k->p99_ns);
    us(j, "max_us", (double)k->max_ns);
    state_sync_bins(j, "bins", k->bin, CAP_SKEW_BINS);
    dmn_json_close(j, '}');
}

void dmn_state_sync_camera(struct dmn_json *j, const struct cap_camera_stats *k)
{
    dmn_json_num(j, "hz", k->hz);
    dmn_json_num(j, "phase_us", k->phase_us);
    dmn_json_num(j, "walk_us_per_s", k->walk_us_per_s);
    dmn_json_num(j, "clock_delay_us", k->clock_delay_us);
    skew(j, &k->skew);
    dmn_json_open(j, "troubles", '[');
    for (uint32_t i = 0; i < k->n_troubles; i++) {
        const struct cap_trouble *t = &k->trouble[i];
        const struct cap_trouble_def *d = &cap_trouble_defs[t->cause];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "cause", cap_count_defs[t->cause].name);
        dmn_json_int(j, "n", (long long)t->n);
        dmn_json_str(j, "text", d->what);
        dmn_json_str(j, "detail", t->detail);
        dmn_json_str(j, "remedy", d->remedy);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

void dmn_state_sync(struct dmn_json *j, const struct cap_stats *s)
{
    dmn_json_open(j, "skew", '{');
    dmn_json_open(j, "edges_us", '[');
    for (int i = 0; i < CAP_SKEW_BINS - 1; i++)
        us(j, NULL, (double)cap_skew_edges_ns[i]);
    dmn_json_close(j, ']');
    state_sync_bins(j, "spread_bins", s->spread_bin, CAP_SPREAD_BINS);
    dmn_json_close(j, '}');
    dmn_json_int(j, "all_gone", (long long)s->all_gone);
    dmn_json_open(j, "host_clock", '{');
    dmn_json_int(j, "steps", (long long)s->host_steps);
    dmn_json_num(j, "last_step_s", (double)s->host_step_ns * 1e-9);
    dmn_json_close(j, '}');
}

void dmn_state_health(struct dmn_json *j, const struct cap_camera_stats *k)
{
    const struct cap_health *h = &k->health;
    const struct cap_action_answers *a = &k->action;
    dmn_json_open(j, "health", '{');
    dmn_json_str(j, "serial", h->serial);
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
