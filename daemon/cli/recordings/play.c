/* pyrovox play - a recording of volumes published again, to develop a client without a rig. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "base/clock.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/config/endpoints.h"
#include "daemon/control/json.h"
#include "daemon/volumes/voxels.h"
#include "proto/pub.h"

#define TICK_NS (20 * PVX_NS_PER_MS)

struct play {
    const char *file, *endpoint, *server, *clients;
    double speed; /* 0 = as fast as subscribers take them */
    bool loop, insecure, quiet;
    /* running */
    vol_reader *in;
    vol_voxels *voxels;
    pvp_auth *auth;
    bool guarded;
    enum pvp_sample sample;
    enum pvp_compress comp;
    pvp_pub *pub;
    uint64_t published, session, gap; /* gap: the next gap of the recording to publish */
};

#define AT(field) CLI_AT(struct play, field)

static const struct cli_row rows[] = {
    {"s|speed", "F", AT(speed), 0, 1000,
     "F times as fast as it was recorded (default 1); 0: as fast as subscribers take them"},
    {"loop", NULL, AT(loop), 0, 0, "Repeat; each round is a new session"},
    {"e|endpoint", "ENDPOINT", AT(endpoint), 0, 0,
     "Where to publish (default: where a local daemon would)"},
    {"k|key", "FILE", AT(server), 0, 0,
     "The server's .key file, for an address that other hosts reach"},
    {"clients", "FILE", AT(clients), 0, 0, "The list of clients that may read; with --key"},
    {"insecure", NULL, AT(insecure), 0, 0, "Serve every client that reaches the address"},
    {"q|quiet", NULL, AT(quiet), 0, 0, "Print nothing"},
    {0}};

static error_t play_parse(int key, char *arg, struct argp_state *state)
{
    struct play *p = state->input;
    switch (key) {
    case ARGP_KEY_ARG: cli_arg_one(state, "recording", arg, &p->file); return 0;
    case ARGP_KEY_END:
        if (p->file == NULL)
            argp_error(state, "name a recording of volumes");
        return 0;
    default: return cli_row(rows, key, arg, state, p);
    }
}

static const struct argp argp = {
    .parser = play_parse,
    .args_doc = "FILE",
    .doc = "Publish a recording of volumes as the daemon published them. You can develop a "
           "renderer without a rig.\vExamples:\n"
           "  pyrovox play flame.h5 --loop\n"
           "  pyrovox play flame --endpoint tcp://127.0.0.1:5555 --speed 0.5\n"
           "  pyrovox play flame --speed 0 & pyrovox record --format hdf5 --out copy.h5\n"
           "\n"
           "FILE is a folder of .npy, .vdb or .nvdb files, or an HDF5 file. Playing begins with "
           "the first subscriber. Volumes keep their set numbers, times and reports. The session "
           "is a new one, because sequence numbers begin again. With --loop each round is a new "
           "session, because set numbers go back. A slow subscriber misses volumes, as it would "
           "live. With --speed 0 no subscriber misses any.\n"
           "\n"
           "`pyrovox replay` plays raw frames of cameras through a daemon.\n"
           "\n"
           "Exit: 0 at the end, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C.",
};

/* Check by the daemon's rules whether the endpoint may be published. */
static pvx_err may_publish(struct play *p, struct pvx_diag *d)
{
    const char *open;
    struct dmn_config *c = malloc(sizeof *c);
    PVX_NEED(c);
    dmn_config_defaults(c);
    snprintf(c->name, sizeof c->name,
             "--endpoint (here --key is keys.server, --clients keys.clients)");
    c->endpoints.n = 1;
    snprintf(c->endpoints.v[0], sizeof c->endpoints.v[0], "%s", p->endpoint);
    snprintf(c->key_server, sizeof c->key_server, "%s", p->server != NULL ? p->server : "");
    snprintf(c->key_clients, sizeof c->key_clients, "%s", p->clients != NULL ? p->clients : "");
    c->insecure = p->insecure;
    p->comp = dmn_endpoints_compress(c);
    pvx_err e = dmn_endpoints_allowed(c, &open, d);
    p->guarded = e == PVX_OK && dmn_endpoint_guarded(c, p->endpoint, DMN_VOLUMES);
    if (e == PVX_OK && open != NULL)
        fprintf(stderr, "pyrovox: %s serves every client that reaches it, unencrypted\n", open);
    free(c);
    if (e == PVX_OK && p->guarded)
        e = pvp_auth_new(p->server, p->clients, &p->auth, d);
    return e == PVX_OK ? dmn_endpoint_prepare(p->endpoint, d) : e;
}

/* Begin a new session with its own publisher. */
static pvx_err play_begin_session(struct play *p, struct pvx_diag *d)
{
    struct pvp_start s = vol_reader_head(p->in)->start;
    uint64_t now = (uint64_t)pvx_now_real();
    s.session = p->session = now != p->session ? now : now + 1;
    const char *const at[] = {p->endpoint};
    return pvp_pub_new(&(struct pvp_pub_params){.endpoints = at,
                                                .n_endpoints = p->guarded ? 0 : 1,
                                                .guarded = at,
                                                .n_guarded = p->guarded ? 1 : 0,
                                                .auth = p->auth,
                                                .rig = vol_reader_head(p->in)->rig,
                                                .sample = p->sample,
                                                .comp = p->comp,
                                                .lossless = p->speed == 0},
                       &s, &p->pub, d);
}

static void pause_until(struct play *p, int64_t until)
{
    for (int64_t now; !cli_stop && (now = pvx_now_mono()) < until;) {
        int64_t left = until - now < TICK_NS ? until - now : TICK_NS;
        nanosleep(&(struct timespec){left / PVX_NS_PER_S, left % PVX_NS_PER_S}, NULL);
        pvp_pub_tick(p->pub);
    }
}

static void wait_for_subscriber(struct play *p)
{
    int64_t t0 = pvx_now_mono();
    bool told = p->quiet;
    pvp_pub_tick(p->pub);
    while (!cli_stop && pvp_pub_subscribers(p->pub) == 0) {
        if (!told && pvx_now_mono() - t0 > PVX_NS_PER_S) {
            fprintf(stderr, "waiting for a subscriber at %s; Ctrl-C stops\n", p->endpoint);
            told = true;
        }
        pause_until(p, pvx_now_mono() + TICK_NS);
    }
}

/* Publish the gaps before set `end` whose sets were not solved.  Without this a subscriber sees that sets are
 * missing, but cannot tell why. */
static pvx_err play_gaps(struct play *p, uint64_t end, struct pvx_diag *d)
{
    const struct vol_gap *g;
    for (; (g = vol_reader_gap(p->in, p->gap)) != NULL && g->set_last < end; p->gap++) {
        char text[256];
        struct dmn_json j;
        if (g->why != VOL_GAP_UNSOLVED)
            continue;
        dmn_json_init(&j, text, sizeof text);
        dmn_json_open(&j, NULL, '{');
        dmn_json_int(&j, "version", 1);
        dmn_json_int(&j, "time_ns", pvx_now_real());
        dmn_json_str(&j, "kind", "sets_missing");
        dmn_json_str(&j, "why", vol_gap_names[g->why]);
        dmn_json_int(&j, "set_first", (long long)g->set_first);
        dmn_json_int(&j, "set_last", (long long)g->set_last);
        dmn_json_int(&j, "volumes", (long long)g->volumes);
        dmn_json_close(&j, '}');
        pvx_err e = dmn_json_end(&j) > 0 ? pvp_pub_say(p->pub, PVP_EVENT, text) : PVX_ERANGE;
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: the gap before set %llu cannot be published: %s", p->file,
                            (unsigned long long)end, pvx_strerror(e));
    }
    return PVX_OK;
}

/* Publish all volumes once, each at its time. */
static pvx_err play_once(struct play *p, struct pvx_diag *d)
{
    struct vol_volume v;
    struct pvp_voxels x, sd;
    int64_t began = pvx_now_mono(), first_ns = 0, last_ns = INT64_MAX;
    p->gap = 0;
    for (uint64_t k = 0; k < vol_reader_count(p->in) && !cli_stop; k++) {
        PVX_TRY(vol_reader_get(p->in, k, &v, d));
        if (v.v.t_exposure_ns < last_ns) { /* the first volume, or the clock was set back */
            began = pvx_now_mono();
            first_ns = v.v.t_exposure_ns;
        }
        last_ns = v.v.t_exposure_ns;
        if (p->speed > 0)
            pause_until(p, began + (int64_t)((double)(v.v.t_exposure_ns - first_ns) / p->speed));
        if (cli_stop)
            break;
        PVX_TRY(play_gaps(p, v.v.set, d));
        vol_voxels_bars(p->voxels, &v, &x, &sd);
        pvx_err e =
            v.bars.sd != NULL ? pvp_pub_bars(p->pub, &v.v, v.bars.doubt, &sd, NULL) : PVX_OK;
        PVX_THEN(e, pvp_pub_volume(p->pub, &v.v, &x, NULL));
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: set %llu cannot be published: %s", p->file,
                            (unsigned long long)v.v.set, pvx_strerror(e));
        p->published++;
    }
    return cli_stop ? PVX_OK : play_gaps(p, UINT64_MAX, d);
}

static pvx_err play_session(struct play *p, struct pvx_diag *d)
{
    PVX_TRY(play_begin_session(p, d));
    wait_for_subscriber(p);
    pvx_err e = play_once(p, d);
    if (pvp_pub_say(p->pub, PVP_END, cli_stop ? "stopped" : "end of the recording") != PVX_OK)
        fprintf(stderr, "pyrovox: subscribers were not told of the end\n");
    pvp_pub_free(&p->pub);
    return e;
}

static pvx_err open_recording(struct play *p, struct pvx_diag *d)
{
    struct vol_volume first;
    PVX_TRY(vol_reader_open(p->file, &p->in, d));
    if (vol_reader_count(p->in) == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no volume in it", p->file);
    PVX_TRY(vol_reader_get(p->in, 0, &first, d));
    p->sample = first.sample;
    const struct pvp_start *s = &vol_reader_head(p->in)->start;
    if (!p->quiet)
        fprintf(stderr, "playing %llu volumes of %u x %u x %u x %u at %s\n",
                (unsigned long long)vol_reader_count(p->in), s->grid.n[0], s->grid.n[1],
                s->grid.n[2], s->grid.channels, p->endpoint);
    if (!p->quiet && vol_reader_unsolved(p->in) > 0)
        fprintf(stderr,
                "pyrovox: %s: %llu of its sets are not solved, or their part is not there, and are "
                "skipped\n",
                p->file, (unsigned long long)vol_reader_unsolved(p->in));
    return vol_voxels_new(&s->grid, &p->voxels);
}

static int play_run(int argc, char **argv)
{
    struct play p = {.endpoint = dmn_default_endpoint(DMN_VOLUMES), .speed = 1};
    struct pvx_diag d = {""};
    cli_parse(rows, &argp, 0, argc, argv, &p);
    cli_catch_stop();
    pvx_err e = may_publish(&p, &d);
    PVX_THEN(e, open_recording(&p, &d));
    if (e == PVX_OK)
        do
            e = play_session(&p, &d);
        while (e == PVX_OK && p.loop && !cli_stop);
    if (e == PVX_OK && !p.quiet)
        fprintf(stderr, "%llu volumes published\n", (unsigned long long)p.published);
    vol_voxels_free(&p.voxels);
    vol_reader_close(&p.in);
    pvp_auth_free(&p.auth);
    return e != PVX_OK ? cli_error(&d, e) : cli_stop ? 130 : 0;
}

const struct cli_command cmd_play = {"play", "a recording of volumes published again", play_run};
