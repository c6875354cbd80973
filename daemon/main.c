/* main.c - pyrovoxd: arguments and start/stop order only. */
#include <argp.h>
#include <malloc.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <systemd/sd-daemon.h>

#include "base/clock.h"
#include "base/cpu.h"
#include "base/log.h"
#include "daemon/control/control.h"
#include "daemon/config/endpoints.h"
#include "daemon/config/keys.h"
#include "daemon/control/journal.h"
#include "daemon/control/json.h"
#include "daemon/control/metrics.h"
#include "daemon/control/survive.h"
#include "daemon/pipeline/compute.h"
#include "daemon/pipeline/live.h"

#define TICK_NS  (200 * PVX_NS_PER_MS)
#define STUCK_NS (10 * PVX_NS_PER_S) /* a stage without a heartbeat for so long is stuck */

struct args {
    const char *config, *level;
    bool check, print;
};

/* What the control thread may look at; `pipeline` is set once the pipeline runs. */
struct daemon {
    _Atomic(dmn_live *) pipeline;
    _Atomic double matrix_done; /* share of the matrix that is built, while it is */
    atomic_bool stop;
    pvp_auth *auth;         /* NULL: no keys */
    struct dmn_state state; /* control thread's, and so are: */
    struct dmn_config cfg;  /* the options in effect */
};

static const char doc[] =
    "Reconstruct a flame from the cameras of a rig, live, and publish one volume per frame set.\v"
    "The configuration gives the rig, the cameras and the settings.  Three lines are enough:\n"
    "  rig: rig.yaml\n"
    "  cameras: \"aravis:192.168.10.11+\"\n"
    "  fps: 20\n\n"
    "Examples:\n"
    "  pyrovoxd --config pyrovoxd.yaml --check-config\n"
    "  pyrovoxd --print-config > every-key.yaml     # explained\n"
    "  pyrovoxd --config pyrovoxd.yaml\n\n"
    "`pyrovox status` and `pyrovox top` show its state.  SIGTERM or Ctrl-C ends it.";

static const struct argp_option options[] = {
    {"config", 'c', "FILE", 0, "Configuration, default /etc/pyrovox/pyrovoxd.yaml", 0},
    {"check-config", 'k', NULL, 0, "Check configuration and rig, report errors, exit", 0},
    {"print-config", 'p', NULL, 0,
     "Print every key with its value and meaning, exit. Without --config: the defaults", 0},
    {"log-level", 'l', "LEVEL", 0, "error, warn, info or debug. Overrides the configuration", 0},
    {0}};

static error_t daemon_main_parse(int key, char *arg, struct argp_state *state)
{
    struct args *a = state->input;
    enum pvx_log_level level;
    switch (key) {
    case 'c': a->config = arg; return 0;
    case 'k': a->check = true; return 0;
    case 'p': a->print = true; return 0;
    case 'l':
        if (pvx_log_level_parse(arg, &level) != PVX_OK)
            argp_error(state, "--log-level: '%s' is not one of error, warn, info, debug", arg);
        a->level = arg;
        return 0;
    case ARGP_KEY_ARG: argp_error(state, "'%s': the daemon takes options only", arg); return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static int daemon_main_fail(const struct pvx_diag *d, pvx_err e)
{
    LOG_E(DAEMON, "%s", pvx_diag_text(d, e));
    return 1;
}

/* ---- control ---- */

static size_t control_status(void *ctx, char *out, size_t size)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    if (p != NULL) {
        dmn_live_snapshot(p, &dm->state);
        return dmn_state_json(&dm->state, out, size);
    }
    struct dmn_json j;
    dmn_json_init(&j, out, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_bool(&j, "starting", true);
    dmn_json_num(&j, "matrix_done", atomic_load(&dm->matrix_done));
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

static void control_reset(void *ctx)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    if (p != NULL)
        dmn_live_reset_latency(p);
}

static pvx_err control_record(void *ctx, bool start, const char *path, char *where, size_t size,
                              struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    if (p == NULL)
        return pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
    pvx_err e = dmn_live_record(p, start, path, where, size, d);
    if (e == PVX_OK || !start)
        dmn_remember_recording(start);
    return e;
}

static pvx_err control_trigger(void *ctx, const char *name, int64_t *t_ns, struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    return p != NULL ? dmn_live_trigger(p, name, t_ns, d)
                     : pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
}

static pvx_err control_record_volumes(void *ctx, bool start, char *where, size_t size,
                                      struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    return p != NULL ? dmn_live_record_volumes(p, start, where, size, d)
                     : pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
}

static pvx_err control_snapshot(void *ctx, const char *path, char *where, size_t size,
                                struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    return p != NULL ? dmn_live_keep(p, &dm->cfg, path, where, size, d)
                     : pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
}

static pvx_err control_background(void *ctx, uint32_t sets, struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    return p != NULL ? dmn_live_background(p, sets, d)
                     : pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
}

static void control_background_state(void *ctx, struct dmn_background_state *out)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    *out = (struct dmn_background_state){0};
    if (p != NULL)
        dmn_live_background_state(p, out);
}

static pvx_err control_check(void *ctx, struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    return p != NULL ? dmn_live_check_begin(p, d)
                     : pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
}

static void control_check_state(void *ctx, struct dmn_check_request *out)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    *out = (struct dmn_check_request){0};
    if (p != NULL)
        dmn_live_check_state(p, out);
}

static const struct dmn_config *control_config(void *ctx)
{
    const struct daemon *dm = ctx;
    return &dm->cfg;
}

static pvx_err control_apply(void *ctx, const struct dmn_config *c, struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    if (p == NULL && c->log_level == dm->cfg.log_level)
        return pvx_fail(d, PVX_EBUSY, "the daemon is still starting");
    PVX_TRY(dmn_config_compute(c, d));
    pvx_log_set_level((enum pvx_log_level)c->log_level);
    if (p != NULL)
        dmn_live_tune(p, c);
    dm->cfg = *c;
    return PVX_OK;
}

static pvx_err control_reload_keys(void *ctx, struct pvx_diag *d)
{
    struct daemon *dm = ctx;
    return dm->auth != NULL ? pvp_auth_reload(dm->auth, d)
                            : pvx_fail(d, PVX_ENOENT,
                                       "there are no keys to read again, because the "
                                       "configuration has no keys.server");
}

static bool metrics_state(void *ctx, struct dmn_state *out)
{
    struct daemon *dm = ctx;
    dmn_live *p = atomic_load(&dm->pipeline);
    if (p != NULL)
        dmn_live_snapshot(p, out);
    return p != NULL;
}

static void control_stop(void *ctx)
{
    struct daemon *dm = ctx;
    atomic_store(&dm->stop, true);
}

/* ---- signals ---- */

/* Blocked in every thread and taken here, so no handler interrupts anything. */
static void block_signals(sigset_t *set)
{
    sigemptyset(set);
    sigaddset(set, SIGINT);
    sigaddset(set, SIGTERM);
    sigaddset(set, SIGHUP);
    pthread_sigmask(SIG_BLOCK, set, NULL);
    signal(SIGINT,
           SIG_DFL); /* a shell's background job starts with it ignored, and then it is lost */
}

static void read_keys_again(pvp_auth *auth)
{
    struct pvx_diag d = {""};
    if (auth == NULL) {
        LOG_I(DAEMON, "SIGHUP: there are no keys to read again");
        return;
    }
    pvx_err e = pvp_auth_reload(auth, &d);
    if (e == PVX_OK)
        LOG_I(DAEMON, "keys: read again, clients listed: %zu", pvp_auth_clients(auth));
    else
        LOG_E(DAEMON, "keys stay as they were: %s", pvx_diag_text(&d, e));
}

/* SIGINT or SIGTERM; 0 in time. */
static int wait_signal(const struct daemon *dm, const sigset_t *set, int64_t ns)
{
    struct timespec ts = {.tv_sec = ns / PVX_NS_PER_S, .tv_nsec = ns % PVX_NS_PER_S};
    int sig = sigtimedwait(set, NULL, &ts);
    if (sig == SIGHUP)
        read_keys_again(dm->auth);
    return sig == SIGHUP || sig < 0 ? 0 : sig;
}

struct building {
    struct daemon *dm;
    const sigset_t *set;
    double said;
};

static bool daemon_main_progress(void *ctx, double done)
{
    struct building *b = ctx;
    atomic_store(&b->dm->matrix_done, done);
    if (done >= b->said + 0.1 || (done >= 1 && b->said < 1)) {
        b->said = done;
        LOG_I(RECON, "building the system matrix: %.0f %%", done * 100);
        sd_notifyf(0, "STATUS=building the system matrix: %.0f %%", done * 100);
    }
    if (wait_signal(b->dm, b->set, 0) > 0)
        atomic_store(&b->dm->stop, true);
    return !atomic_load(&b->dm->stop);
}

/* ---- running ---- */

static void log_summary(const struct dmn_state *s)
{
    uint64_t dropped = 0;
    char why[256] = "";
    size_t n = 0;
    for (int i = 0; i < DMN_N_DROP; i++) {
        dropped += s->dropped[i];
        if (s->dropped[i] > 0 && n < sizeof why)
            n += (size_t)snprintf(why + n, sizeof why - n, ", %s %llu", dmn_drop_defs[i].name,
                                  (unsigned long long)s->dropped[i]);
    }
    LOG_I(DAEMON,
          "%.1f s: %llu sets from the cameras, %llu published, %llu dropped%s; %llu more "
          "were incomplete, %llu displaced; latency p50 %.1f ms, p99 %.1f ms, max %.1f ms",
          s->uptime_s, (unsigned long long)s->produced, (unsigned long long)s->published,
          (unsigned long long)dropped, why, (unsigned long long)s->capture.sets_failed,
          (unsigned long long)s->capture.sets_dropped, s->latency_p50_ms, s->latency_p99_ms,
          s->latency_max_ms);
}

/* It was ended while it recorded: what came since is lost, what comes is not. */
static void record_again(dmn_live *p)
{
    char where[512];
    struct pvx_diag d = {""};
    if (!dmn_was_recording())
        return;
    pvx_err e = dmn_live_record(p, true, NULL, where, sizeof where, &d);
    if (e == PVX_OK)
        LOG_W(DAEMON, "the last run ended while it recorded: recording goes on in %s", where);
    else if (e != PVX_EBUSY) /* it records as its configuration says */
        LOG_W(DAEMON, "the last run ended while it recorded: %s", pvx_diag_text(&d, e));
}

/* Until a signal, a stop command or the end of the recording; says why. */
static const char *daemon_main_watch(struct daemon *dm, dmn_live *p, const sigset_t *set)
{
    static struct dmn_state s;
    char line[1024];
    uint64_t usec = 0; /* WatchdogSec, of which half may pass without a sign of life */
    int64_t next_alive = 0, next_status = 0;
    int64_t interval = sd_watchdog_enabled(0, &usec) > 0 ? (int64_t)usec * 1000 / 2 : 0;
    for (;;) {
        int sig = wait_signal(dm, set, TICK_NS);
        if (sig > 0)
            return sig == SIGINT ? "interrupted" : "terminated";
        if (atomic_load(&dm->stop))
            return "stop command";
        if (dmn_live_finished(p))
            return "end of the recording";
        int64_t now = pvx_now_mono(), stuck = dmn_live_stuck_ns(p);
        pvx_log_flush(false);
        if (stuck > STUCK_NS)
            LOG_EVERY(PVX_LOG_ERROR, DAEMON, "a stage has not moved for %.0f s",
                      (double)stuck * 1e-9);
        else if (interval > 0 && now >= next_alive) {
            sd_notify(0, "WATCHDOG=1");
            next_alive = now + interval;
        }
        if (now >= next_status) {
            next_status = now + 2 * PVX_NS_PER_S;
            dmn_live_snapshot(p, &s);
            dmn_state_sentence(&s, line, sizeof line);
            sd_notifyf(0, "STATUS=%s%s", stuck > STUCK_NS ? "a stage does not move; " : "", line);
        }
    }
}

static int daemon_main_run(const struct dmn_config *cfg)
{
    static struct daemon dm;
    static struct dmn_state s;
    struct pvx_diag d = {0};
    sigset_t set;
    dm.cfg = *cfg;
    dm.cfg.log_level = (int)pvx_log_get_level(); /* the command line may say another */
    block_signals(&set);
    prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0); /* ours, not those of what we begin */
    dmn_survive();
    dmn_journal_use();
    const char *endpoint =
        cfg->control[0] != '\0' ? cfg->control : dmn_default_endpoint(DMN_CONTROL);
    struct dmn_control_ops ops = {.status = control_status,
                                  .reset_latency = control_reset,
                                  .stop = control_stop,
                                  .record = control_record,
                                  .trigger = control_trigger,
                                  .record_volumes = control_record_volumes,
                                  .snapshot = control_snapshot,
                                  .background = control_background,
                                  .background_state = control_background_state,
                                  .check = control_check,
                                  .check_state = control_check_state,
                                  .config = control_config,
                                  .apply = control_apply,
                                  .reload_keys = control_reload_keys,
                                  .ctx = &dm};
    dmn_control *control = NULL;
    dmn_metrics *metrics = NULL;
    dmn_live *p = NULL;
    const char *open;
    pvx_err e = dmn_endpoints_allowed(cfg, &open, &d);
    if (e == PVX_OK && open != NULL)
        LOG_W(DAEMON, "%s is open to every host that reaches it (insecure: true)", open);
    PVX_THEN(e, dmn_keys_open(cfg, &dm.auth, &d));
    PVX_THEN(e, dmn_endpoint_prepare(endpoint, &d));
    PVX_THEN(e, dmn_control_new(endpoint,
                                dmn_endpoint_guarded(cfg, endpoint, DMN_CONTROL) ? dm.auth : NULL,
                                &ops, &control, &d));
    if (e == PVX_OK && cfg->metrics[0] != '\0')
        e = dmn_metrics_new(cfg->metrics, cfg->insecure, metrics_state, &dm, &metrics, &d);
    struct building b = {.dm = &dm, .set = &set};
    PVX_THEN(e, dmn_live_new(cfg, dm.auth, daemon_main_progress, &b, &p, &d));
    bool started = false;
    if (e == PVX_OK) {
        started = true;
        e = dmn_live_start(p, &d);
    }
    if (e == PVX_OK) {
        record_again(p);
        atomic_store(&dm.pipeline, p);
        LOG_I(DAEMON, "ready; control %s", endpoint);
        sd_notify(0, "READY=1\nSTATUS=running");
        const char *why = daemon_main_watch(&dm, p, &set);
        LOG_I(DAEMON, "stopping: %s", why);
        sd_notify(0, "STOPPING=1");
        dmn_live_stop(p, why);
        dmn_live_snapshot(p, &s);
        log_summary(&s);
    } else if (started) {
        dmn_live_stop(p, "failed to start");
    }
    dmn_metrics_free(&metrics);
    dmn_control_free(&control); /* before what it looks at */
    if (started && e == PVX_OK) /* nobody can begin a recording any more */
        dmn_remember_recording(false);
    dmn_live_free(&p);
    pvp_auth_free(&dm.auth);
    pvx_log_flush(true);
    if (e == PVX_ECANCELED && atomic_load(&dm.stop))
        return 0;
    return e == PVX_OK ? 0 : daemon_main_fail(&d, e);
}

/* What the start does, but for the matrix, the sockets and the cameras themselves. */
static int daemon_check(const struct dmn_config *cfg)
{
    double matrix = 0;
    struct pvx_diag d = {0};
    struct rec_rig rig;
    const char *open;
    pvp_auth *auth = NULL;
    pvx_err e = dmn_endpoints_allowed(cfg, &open, &d);
    if (e == PVX_OK && dmn_keys_hidden(cfg))
        printf("%-16s %s, for the service alone: not looked at here\n", "keys.server",
               cfg->key_server);
    else if (e == PVX_OK)
        e = dmn_keys_open(cfg, &auth, &d);
    pvp_auth_free(&auth);
    PVX_THEN(e, dmn_config_rig(cfg, &rig, &d));
    if (e != PVX_OK)
        return daemon_main_fail(&d, e);
    for (size_t i = 0; i < rig.n_cameras && e == PVX_OK; i++) {
        char uri[DMN_WORD_MAX];
        e = dmn_config_source(cfg, rig.cameras[i].name, i, uri, sizeof uri, &d);
        if (e == PVX_OK)
            printf("%-16s %s\n", rig.cameras[i].name, uri);
    }
    fflush(stdout);
    PVX_THEN(e, dmn_live_check(cfg, &matrix, &d));
    struct rec_rig all;
    char path[PATH_MAX];
    dmn_config_path(cfg, cfg->rig, path, sizeof path);
    if (e == PVX_OK && rec_rig_load(path, &all, NULL) == PVX_OK) {
        if (all.n_cameras > rig.n_cameras)
            printf("%s: only %zu of the %zu cameras of %s are in cameras\n", cfg->name,
                   rig.n_cameras, all.n_cameras, path);
        rec_rig_fini(&all);
    }
    if (e == PVX_OK)
        printf("%s: ok: %zu camera%s, %dx%dx%d voxels, about %.2g GB for the system matrix\n",
               cfg->name, rig.n_cameras, rig.n_cameras == 1 ? "" : "s", rig.grid.n[0],
               rig.grid.n[1], rig.grid.n[2], matrix * 1e-9);
    rec_rig_fini(&rig);
    return e == PVX_OK ? 0 : daemon_main_fail(&d, e);
}

static int daemon_print(const struct dmn_config *cfg)
{
    char *text = dmn_config_format(cfg);
    if (text == NULL)
        return daemon_main_fail(NULL, PVX_ENOMEM);
    int bad = fputs(text, stdout) == EOF || fflush(stdout) != 0;
    free(text);
    return bad;
}

int main(int argc, char **argv)
{
    argp_program_version = "pyrovoxd " PVX_VERSION;
    struct args a = {0};
    const struct argp argp = {.options = options, .parser = daemon_main_parse, .doc = doc};
    argp_err_exit_status = 2;
    argp_parse(&argp, argc, argv, 0, NULL, &a);
    /* One heap for all threads.  A camera that comes back starts threads, and libc gives a new thread a heap of its own, up
     * to eight per processor.  Each heap would grow to its size (megabytes of GenICam) before libc uses free room again.
     * Then a daemon whose cameras are often away grows for days.  The frame path allocates nothing, so threads do not wait
     * for each other here. */
    mallopt(M_ARENA_MAX, 1);
    static struct dmn_config cfg;
    struct pvx_diag d = {0};
    if (pvx_cpu_use(NULL, &d) != PVX_OK) {
        LOG_E(DAEMON, "PYROVOX_CPU: %s", d.text);
        return 1;
    }
    dmn_config_defaults(&cfg);
    if (a.config != NULL || !a.print) {
        pvx_err e =
            dmn_config_load(a.config != NULL ? a.config : "/etc/pyrovox/pyrovoxd.yaml", &cfg, &d);
        if (e != PVX_OK)
            return daemon_main_fail(&d, e);
    }
    enum pvx_log_level level = (enum pvx_log_level)cfg.log_level;
    if (a.level != NULL && pvx_log_level_parse(a.level, &level) != PVX_OK)
        return 2;
    pvx_log_set_level(level);
    return a.print   ? daemon_print(&cfg)
           : a.check ? dmn_compute_leave(daemon_check(&cfg))
                     : dmn_compute_leave(daemon_main_run(&cfg));
}
