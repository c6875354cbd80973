/* replay.c - `pyrovox replay`: play a take through the daemon again, describe it, or export it as files.
 *
 * Playing runs pyrovoxd with the configuration and the rig that are in the take, and take: cameras. */
#include <errno.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/spawn.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/recordings/replay.h"
#include "daemon/config/config.h"

#define SETS_MAX 64

enum { OPT_INFO = 256, OPT_EXPORT, OPT_SPEED, OPT_LOSSLESS, OPT_LOOP, OPT_CONFIG, OPT_SET };

struct args {
    const char *take, *export_dir, *config;
    bool info, lossless, loop;
    double speed;
    const char *set[SETS_MAX]; /* KEY=VALUE */
    size_t n_sets;
};

static const struct argp_option options[] = {
    {"info", OPT_INFO, NULL, 0, "Say what is in the take and what is not; exit", 0},
    {"export", OPT_EXPORT, "DIR", 0,
     "Write the frames to DIR/CAMERA/SET.png (.npy, .jpg) and the rig to DIR/rig.yaml, and exit",
     0},
    {"speed", OPT_SPEED, "X", 0, "Play X times as fast as it was recorded (default 1)", 1},
    {"lossless", OPT_LOSSLESS, NULL, 0,
     "Play as fast as the solver goes, every set, none depending on another", 1},
    {"loop", OPT_LOOP, NULL, 0, "Start over at the end", 1},
    {"config", OPT_CONFIG, "FILE", 0, "This configuration and its rig instead of the take's", 1},
    {"set", OPT_SET, "KEY=VALUE", 0, "Another value for one key, as solver.name=osem; repeatable",
     1},
    {0}};

static const char doc[] =
    "Play the raw frames of a take (pyrovox record --raw, record: raw) into a daemon.\vExamples:\n"
    "  pyrovox replay take.h5\n"
    "  pyrovox replay --info take.h5\n"
    "  pyrovox replay --lossless --set publish.wait_subscriber=true take.h5 \\\n"
    "          & pyrovox record\n"
    "  pyrovox replay --speed 0.25 --loop --set solver.name=osem take.h5\n"
    "  pyrovox replay --export frames take.h5\n"
    "  pyrovox reconstruct --rig frames/rig.yaml --frames frames --black 0.02 \\\n"
    "          --out vol\n"
    "\n"
    "Runs pyrovoxd with the rig and the configuration of the take. The frame sets are exactly "
    "those of the recording, with their numbers and times. `pyrovox record`, `top` and `status` "
    "see an ordinary daemon. With --lossless the volumes are bit for bit those of the live run, if "
    "that ran with solver.warm_start: off and solver.deadline_ms: 0. A take that was cut off is "
    "played up to its last complete set. If it continues in other files, NAME-0002.h5 ..., name "
    "NAME.h5, and all of them are played.";

static error_t replay_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case OPT_INFO: a->info = true; return 0;
    case OPT_EXPORT: a->export_dir = arg; return 0;
    case OPT_SPEED: a->speed = cli_arg_double(st, "speed", arg, 0.001, 1000); return 0;
    case OPT_LOSSLESS: a->lossless = true; return 0;
    case OPT_LOOP: a->loop = true; return 0;
    case OPT_CONFIG: a->config = arg; return 0;
    case OPT_SET:
        if (a->n_sets == SETS_MAX || strchr(arg, '=') == NULL)
            argp_error(st, "--set %s: should be KEY=VALUE, at most %d times", arg, SETS_MAX);
        a->set[a->n_sets++] = arg;
        return 0;
    case ARGP_KEY_ARG: cli_arg_one(st, "take", arg, &a->take); return 0;
    case ARGP_KEY_NO_ARGS: argp_error(st, "name a take, as take.h5"); return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

/* ---- the configuration ---- */

static pvx_err apply_sets(const struct args *a, struct dmn_config *c, struct pvx_diag *d)
{
    for (size_t i = 0; i < a->n_sets; i++) {
        char key[128];
        const char *eq = strchr(a->set[i], '=');
        snprintf(key, sizeof key, "%.*s", (int)(eq - a->set[i]), a->set[i]);
        PVX_TRY(dmn_config_set(c, key, eq + 1, "--set", d));
    }
    return PVX_OK;
}

/* Make a name absolute.  Names in the configuration are relative to its old folder, and it moves to another one. */
static void make_absolute(const char *base, char *name, size_t size)
{
    char path[PATH_MAX + DMN_WORD_MAX];
    if (name[0] == '\0' || name[0] == '/')
        return;
    snprintf(path, sizeof path, "%s/%s", base, name);
    if (strlen(path) < size)
        snprintf(name, size, "%s", path);
}

/* Change the configuration to play the take. */
static pvx_err play_take(const struct args *a, struct dmn_config *c, struct pvx_diag *d)
{
    char path[PATH_MAX];
    if (realpath(a->take, path) == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", a->take, strerror(errno));
    char *uri = c->cameras.item[0].value;
    int n = snprintf(uri, sizeof c->cameras.item[0].value, "take:%s", path);
    if (a->speed != 1 && n < (int)sizeof c->cameras.item[0].value)
        n += snprintf(uri + n, sizeof c->cameras.item[0].value - (size_t)n, "?speed=%g", a->speed);
    if (n >= (int)sizeof c->cameras.item[0].value || strpbrk(path, "{") != NULL ||
        uri[n - 1] == '+')
        return pvx_fail(d, PVX_EINVAL,
                        "%s: not a name that a configuration can hold; link it to "
                        "a short one without { and +",
                        path);
    c->cameras.n = 1;
    c->cameras.item[0].key[0] = '\0';
    c->camera_features.n = 0;
    c->trigger = 0;
    c->record_mode = 0;
    c->loop = a->loop;
    c->lossless = a->lossless;
    if (a->lossless)
        c->deadline_ms = 0; /* results must not depend on a clock */
    else
        c->fps *= a->speed;
    return PVX_OK;
}

static pvx_err make_config(const struct args *a, const cap_take *t, struct dmn_config *c,
                           struct pvx_diag *d)
{
    const struct cap_take_head *h = &cap_take_info(t)->head;
    char base[PATH_MAX];
    if (a->config != NULL) {
        PVX_TRY(dmn_config_load(a->config, c, d));
        if (realpath(c->dir, base) == NULL)
            return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", c->dir, strerror(errno));
    } else {
        char name[PATH_MAX + 32];
        snprintf(name, sizeof name, "%s (configuration)", a->take);
        PVX_TRY(dmn_config_parse(h->config, strlen(h->config), name, c, d));
        snprintf(base, sizeof base, "%s", h->base);
        c->rig[0] = '\0'; /* the take's */
        c->ring.seconds = 0;
        c->triggers.n = 0; /* they made takes of what is a take now */
    }
    make_absolute(base, c->rig, sizeof c->rig);
    make_absolute(base, c->cache, sizeof c->cache);
    PVX_TRY(play_take(a, c, d));
    return apply_sets(a, c, d);
}

/* ---- running ---- */

struct folder {
    char dir[256], rig[300], config[300];
};

/* Let takes recorded during the replay go to the user's folder, because the replay's own folder is removed. */
static void record_here(struct dmn_config *c)
{
    char here[PATH_MAX], path[sizeof c->record_path];
    if (c->record_path[0] == '/' || getcwd(here, sizeof here) == NULL || strchr(here, '%') != NULL)
        return;
    int n = snprintf(path, sizeof path, "%s/%s", here, c->record_path);
    if (n < (int)sizeof path)
        memcpy(c->record_path, path, (size_t)n + 1);
}

static pvx_err replay_make_folder(struct folder *f, struct dmn_config *c, const cap_take *t,
                                  struct pvx_diag *d)
{
    const char *tmp = getenv("TMPDIR"), *rig = cap_take_info(t)->head.rig;
    snprintf(f->dir, sizeof f->dir, "%.200s/pyrovox-replay-XXXXXX",
             tmp != NULL && tmp[0] != '\0' ? tmp : "/tmp");
    if (mkdtemp(f->dir) == NULL) {
        f->dir[0] = '\0';
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: no folder to be made: %s",
                        tmp != NULL ? tmp : "/tmp", strerror(errno));
    }
    snprintf(f->rig, sizeof f->rig, "%s/rig.yaml", f->dir);
    snprintf(f->config, sizeof f->config, "%s/pyrovoxd.yaml", f->dir);
    if (c->rig[0] == '\0') {
        snprintf(c->rig, sizeof c->rig, "rig.yaml");
        PVX_TRY(pvx_file_write(f->rig, rig, strlen(rig), d));
    }
    record_here(c);
    char *text = dmn_config_format(c);
    PVX_NEED(text);
    pvx_err e = pvx_file_write(f->config, text, strlen(text), d);
    free(text);
    return e;
}

static void replay_remove_folder(const struct folder *f)
{
    if (f->dir[0] == '\0')
        return;
    unlink(f->rig);
    unlink(f->config);
    if (rmdir(f->dir) != 0)
        fprintf(stderr, "pyrovox: %s stays: %s\n", f->dir, strerror(errno));
}

/* Run the daemon.  Returns its exit code; -1: it could not be started. */
static int run_daemon(const struct folder *f, struct pvx_diag *d)
{
    char bin[PATH_MAX], path[PATH_MAX + 16];
    if (pvx_exe_dir(bin, sizeof bin) != PVX_OK) {
        pvx_fail(d, PVX_ENOENT, "cannot find pyrovoxd");
        return -1;
    }
    snprintf(path, sizeof path, "%s/pyrovoxd", bin);
    fflush(NULL);
    pid_t pid = pvx_fork_bound();
    if (pid == 0) {
        execl(path, path, "--config", f->config, (char *)NULL);
        fprintf(stderr, "pyrovox: cannot run %s: %s\n", path, strerror(errno));
        _exit(127);
    }
    int status = 0;
    bool told = false;
    while (pid > 0 && waitpid(pid, &status, 0) != pid) {
        if (cli_stop && !told) /* harmless if a terminal's Ctrl-C has reached it already */
            kill(pid, SIGTERM);
        told = told || cli_stop;
    }
    if (pid < 0) {
        pvx_fail(d, PVX_EIO, "no process to be had: %s", strerror(errno));
        return -1;
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

static int replay_play(const struct args *a, const cap_take *t)
{
    struct dmn_config *c = pvx_calloc(1, sizeof *c);
    struct folder f = {.dir = ""};
    struct pvx_diag d = {""};
    if (c == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    cli_catch_stop();
    pvx_err e = make_config(a, t, c, &d);
    PVX_THEN(e, replay_make_folder(&f, c, t, &d));
    free(c);
    int rc = e == PVX_OK ? run_daemon(&f, &d) : -1;
    replay_remove_folder(&f);
    if (rc < 0)
        return cli_error(&d, e == PVX_OK ? PVX_EIO : e);
    return cli_stop ? 130 : rc;
}

static int replay_run(int argc, char **argv)
{
    struct args a = {.speed = 1};
    const struct argp argp = {
        .options = options, .parser = replay_parse, .args_doc = "TAKE", .doc = doc};
    argp_parse(&argp, argc, argv, 0, NULL, &a);
    struct pvx_diag d = {""};
    cap_take *t;
    pvx_err e = cap_take_open(a.take, &t, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    int rc = a.info                 ? replay_info(a.take, t)
             : a.export_dir != NULL ? replay_export(t, a.export_dir)
                                    : replay_play(&a, t);
    cap_take_free(&t);
    return rc;
}

const struct cli_command cmd_replay = {"replay", "raw frames through a daemon again, or as files",
                                       replay_run};
