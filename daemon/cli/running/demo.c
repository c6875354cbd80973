/* demo.c - `pyrovox demo`: simulated cameras, daemon and subscriber together; `make run`. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "base/spawn.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/ask.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/running/demo_view.h"
#include "daemon/cli/running/screen.h"
#include "daemon/cli/pictures/strip.h"
#include "recon/geom/rig.h"

#define SETTLE_S      2.0 /* after the first volume, not part of the rates */
#define START_LIMIT_S 300 /* rendering and the matrix take that long at most */
#define STOP_LIMIT_S  10
#define SEED          1

enum { OPT_SIZE = 0x100, OPT_FORMAT };

struct args {
    double seconds, fps;
    int64_t cameras, grid;
    int32_t width, height;
    const char *format, *out;
    bool keep, view;
};

struct demo {
    struct args a;
    char dir[80];       /* run folder; ipc socket names in it must fit into 107 bytes */
    char bin[PATH_MAX]; /* where the programs are */
    char log[128], volumes[128], control[128];
    long long ring; /* pictures per camera */
    pid_t child;    /* pyrovox simcams, leader of its own process group */
    struct follow follow;
    bool following;
    struct screen screen;
    struct demo_view view;
    double dropped0; /* daemon's count at the start of the steady period */
    char png[PATH_MAX];
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"seconds", "N", AT(seconds), 0, 1e6, "end by itself after N seconds; 0 = at Ctrl-C (default)"},
    {"fps", "HZ", AT(fps), 0.5, 200, "frames per second of each camera (20)"},
    {"cameras", "N", AT(cameras), 2, 64, "cameras on a ring (8)"},
    {"size", "WxH", CLI_KEY(OPT_SIZE), 0, 0, "image size (640x480)"},
    {"grid", "N", AT(grid), 4, 256, "voxels per side (64)"},
    {"format", "FORMAT", CLI_KEY(OPT_FORMAT), 0, 0, "rgb8 (default), mono8 or bayerrg8"},
    {"out", "DIR", AT(out), 0, 0, "folder for flame.png, default build if it is there, else here"},
    {"view", NULL, AT(view), 0, 0,
     "the flame in a browser too: opens the page, and says its address"},
    {"keep", NULL, AT(keep), 0, 0, "keep the run folder: rig, configuration, log"},
    {0}};

static const char doc[] =
    "Watch simulated GigE Vision cameras become a turning flame.\v"
    "Starts `pyrovox simcams` and pyrovoxd in a private network, subscribes to the volumes, shows "
    "them against the known flame, and ends with a picture of the flame from viewpoints over 120 "
    "degrees.  The last line is\n"
    "  result: "
    "{\"sets\":..,\"sets_per_s\":..,\"lost\":..,\"latency_ms_p50\":..,\"latency_ms_p99\":..,"
    "\"rel_error\":..}\n"
    "for the time after everything had started.\n\nExamples:\n"
    "  pyrovox demo\n"
    "  pyrovox demo --view\n"
    "  pyrovox demo --seconds 20 --fps 15 --grid 32 --size 320x240";

static error_t demo_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case OPT_SIZE: cli_arg_size(st, "size", arg, 16, 4096, &a->width, &a->height); return 0;
    case OPT_FORMAT:
        if (strcmp(arg, "rgb8") != 0 && strcmp(arg, "mono8") != 0 && strcmp(arg, "bayerrg8") != 0)
            argp_error(st, "--format %s: should be rgb8, mono8 or bayerrg8", arg);
        a->format = arg;
        return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': takes options only", arg); return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

/* ---- run folder ---- */

static pvx_err demo_write_text(struct demo *m, const char *name, const char *text,
                               struct pvx_diag *d)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", m->dir, name);
    return pvx_file_write(path, text, strlen(text), d);
}

static pvx_err demo_write_rig(struct demo *m, struct pvx_diag *d)
{
    struct rec_rig rig;
    char *text;
    size_t len;
    PVX_TRY(
        rec_rig_ring((size_t)m->a.cameras, 2.5, m->a.width, m->a.height, (int32_t)m->a.grid, &rig));
    pvx_err e = rec_rig_format(&rig, &text, &len);
    rec_rig_fini(&rig);
    if (e != PVX_OK)
        return e;
    e = demo_write_text(m, "rig.yaml", text, d);
    free(text);
    return e;
}

/* black: the pedestal that `pyrovox simcams` gives its images by default. */
static pvx_err write_config(struct demo *m, struct pvx_diag *d)
{
    const char *format = strcmp(m->a.format, "rgb8") == 0    ? "RGB8"
                         : strcmp(m->a.format, "mono8") == 0 ? "Mono8"
                                                             : "BayerRG8";
    char text[1024];
    snprintf(text, sizeof text,
             "rig: rig.yaml\n"
             "cameras: \"aravis:127.0.0.2+\"\n"
             "fps: %.17g\n"
             "pixel_format: %s\n"
             "shared_clock: true\n"
             "photometry: { black: 0.02 }\n"
             "publish:\n  endpoints: [\"%s\"]\n"
             "control:\n  endpoint: \"%s\"\n",
             m->a.fps, format, m->volumes, m->control);
    return demo_write_text(m, "pyrovoxd.yaml", text, d);
}

static pvx_err demo_make_folder(struct demo *m, struct pvx_diag *d)
{
    const char *tmp = getenv("TMPDIR");
    if (tmp == NULL || tmp[0] == '\0')
        tmp = "/tmp";
    if (snprintf(m->dir, sizeof m->dir, "%s/pyrovox-demo-XXXXXX", tmp) >= (int)sizeof m->dir) {
        m->dir[0] = '\0';
        return pvx_fail(d, PVX_EINVAL, "TMPDIR=%s: too long a name for sockets in it", tmp);
    }
    if (mkdtemp(m->dir) == NULL) {
        m->dir[0] = '\0';
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: no folder to be made: %s", tmp,
                        strerror(errno));
    }
    snprintf(m->log, sizeof m->log, "%s/log", m->dir);
    snprintf(m->volumes, sizeof m->volumes, "ipc://%s/volumes", m->dir);
    snprintf(m->control, sizeof m->control, "ipc://%s/control", m->dir);
    PVX_TRY(demo_write_rig(m, d));
    return write_config(m, d);
}

static void demo_remove_folder(struct demo *m)
{
    static const char *const names[] = {"rig.yaml", "pyrovoxd.yaml", "log",         "volumes",
                                        "control",  "volumes.lock",  "control.lock"};
    char path[128];
    if (m->dir[0] == '\0')
        return;
    if (m->a.keep) {
        fprintf(stderr, "run folder: %s\n", m->dir);
        return;
    }
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        snprintf(path, sizeof path, "%s/%s", m->dir, names[i]);
        unlink(path);
    }
    if (rmdir(m->dir) != 0)
        fprintf(stderr, "pyrovox demo: %s stays: %s\n", m->dir, strerror(errno));
}

/* ---- the programs ---- */

/* In the child, after fork. */
static void demo_become(struct demo *m)
{
    char pyrovox[PATH_MAX + 16], daemon[PATH_MAX + 16], rig[128], config[128], fps[40], ring[24];
    snprintf(pyrovox, sizeof pyrovox, "%s/pyrovox", m->bin);
    snprintf(daemon, sizeof daemon, "%s/pyrovoxd", m->bin);
    snprintf(rig, sizeof rig, "%s/rig.yaml", m->dir);
    snprintf(config, sizeof config, "%s/pyrovoxd.yaml", m->dir);
    snprintf(fps, sizeof fps, "%.17g", m->a.fps);
    snprintf(ring, sizeof ring, "%lld", m->ring);
    setpgid(0, 0); /* only the demo receives a terminal's Ctrl-C, and ends the whole group */
    int log = open(m->log, O_WRONLY | O_CREAT | O_APPEND, 0600), null = open("/dev/null", O_RDONLY);
    if (log < 0 || null < 0 || dup2(null, 0) < 0 || dup2(log, 1) < 0 || dup2(log, 2) < 0)
        _exit(125);
    execl(pyrovox, pyrovox, "simcams", "--private-net", "--rig", rig, "--format", m->a.format,
          "--fps", fps, "--ring", ring, "--seed", "1", "--max-memory", "4096", "--", daemon,
          "--config", config, (char *)NULL);
    dprintf(2, "cannot run %s: %s\n", pyrovox, strerror(errno));
    _exit(127);
}

static bool child_gone(struct demo *m)
{
    int status;
    if (m->child <= 0)
        return true;
    if (waitpid(m->child, &status, WNOHANG) != m->child)
        return false;
    kill(-m->child, SIGKILL); /* the daemon, if it is still running */
    m->child = 0;
    return true;
}

/* Send SIGTERM to simcams, which passes it to the daemon and waits for the daemon. */
static bool stop_child(struct demo *m)
{
    if (child_gone(m))
        return false;
    kill(m->child, SIGTERM);
    for (int i = 0; i < STOP_LIMIT_S * 20; i++) {
        if (child_gone(m))
            return true;
        pvx_sleep_until_mono(pvx_now_mono() + 50 * PVX_NS_PER_MS);
    }
    kill(-m->child, SIGKILL);
    waitpid(m->child, NULL, 0);
    m->child = 0;
    return false;
}

/* ---- log ---- */

static size_t read_tail(const struct demo *m, char *text, size_t size)
{
    int fd = open(m->log, O_RDONLY);
    struct stat st;
    text[0] = '\0';
    if (fd < 0)
        return 0;
    off_t from =
        fstat(fd, &st) == 0 && st.st_size > (off_t)size - 1 ? st.st_size - (off_t)size + 1 : 0;
    ssize_t n = pread(fd, text, size - 1, from);
    close(fd);
    text[n < 0 ? 0 : n] = '\0';
    return n < 0 ? 0 : (size_t)n;
}

static void show_progress(const struct demo *m, char last[160])
{
    char text[4096];
    size_t n = read_tail(m, text, sizeof text);
    while (n > 0 && (text[n - 1] == '\n' || text[n - 1] == '\r'))
        text[--n] = '\0';
    char *line = text + n;
    while (line > text && line[-1] != '\n' && line[-1] != '\r')
        line--;
    if (line[0] == '\0' || strncmp(line, last, 150) == 0)
        return;
    snprintf(last, 160, "%.150s", line);
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\r\033[K%.100s", last);
    else
        fprintf(stderr, "%s\n", last);
}

static void show_failure(const struct demo *m)
{
    char text[4096];
    if (read_tail(m, text, sizeof text) > 0)
        fprintf(stderr, "\n--- end of the log\n%s---\n", text);
}

/* ---- watching ---- */

/* The daemon's count of sets that did not become volumes. */
static double not_published(const cJSON *s)
{
    return ask_num(s, "sets", "dropped") + ask_num(s, "sets", "incomplete_dropped") +
           ask_num(s, "sets", "displaced");
}

/* Wait from the start of the programs until the steady state. */
static pvx_err warm_up(struct demo *m, struct pvx_diag *d)
{
    char last[160] = "";
    int64_t t0 = pvx_now_mono(), first = 0;
    while (first == 0 || (double)(pvx_now_mono() - first) * 1e-9 < SETTLE_S) {
        if (cli_stop)
            return PVX_ECANCELED;
        if (child_gone(m))
            return pvx_fail(d, PVX_EIO, "the cameras or the daemon have ended by themselves");
        if ((double)(pvx_now_mono() - t0) * 1e-9 > START_LIMIT_S)
            return pvx_fail(d, PVX_ETIMEDOUT, "no volume within %d s", START_LIMIT_S);
        PVX_TRY(follow_poll(&m->follow, 100 * PVX_NS_PER_MS, d));
        if (first == 0 && m->follow.volumes > 0)
            first = pvx_now_mono();
        show_progress(m, last);
    }
    if (isatty(STDERR_FILENO))
        fputs("\r\033[K", stderr);
    cJSON *j;
    PVX_TRY(ask(m->control, NULL, "reset-latency", 2000, &j, d));
    cJSON_Delete(j);
    PVX_TRY(ask(m->control, NULL, "status", 2000, &j, d));
    m->dropped0 = not_published(j);
    cJSON_Delete(j);
    return PVX_OK;
}

static pvx_err demo_watch(struct demo *m, struct pvx_diag *d)
{
    char title[160], hint[256];
    snprintf(title, sizeof title,
             "pyrovox demo   %lld cameras %dx%d %s at %g Hz -> %lld^3 voxels, over GigE Vision",
             (long long)m->a.cameras, m->a.width, m->a.height, m->a.format, m->a.fps,
             (long long)m->a.grid);
    const char *how = m->a.seconds > 0 ? "Ctrl-C ends it early" : "Ctrl-C ends it";
    snprintf(hint, sizeof hint, "%s%s%s", how, m->a.view ? "   page: " : "", m->view.url);
    if (m->a.view && !isatty(STDOUT_FILENO))
        printf("page: %s\n", m->view.url);
    fflush(stdout);
    follow_mark(&m->follow);
    screen_open(&m->screen);
    pvx_err e = PVX_OK;
    while (
        !cli_stop && e == PVX_OK &&
        (m->a.seconds == 0 || (double)(pvx_now_mono() - m->follow.mark_ns) * 1e-9 < m->a.seconds)) {
        e = follow_poll(&m->follow, 50 * PVX_NS_PER_MS, d);
        if (child_gone(m))
            e = pvx_fail(d, PVX_EIO, "the cameras or the daemon have ended by themselves");
        screen_draw(&m->screen, &m->follow, title, hint);
    }
    screen_close(&m->screen);
    return e;
}

/* ---- the end ---- */

static pvx_err write_picture(struct demo *m, struct pvx_diag *d)
{
    struct rec_grid g;
    int channels;
    if (!m->follow.have_dense || !follow_grid(&m->follow, &g, &channels))
        return PVX_OK;
    const char *dir = m->a.out;
    struct stat st;
    if (dir == NULL)
        dir = stat("build", &st) == 0 && S_ISDIR(st.st_mode) ? "build" : ".";
    PVX_TRY(pvx_mkdirs(dir, d));
    snprintf(m->png, sizeof m->png, "%s/flame.png", dir);
    return dmn_strip_save(&g, m->follow.dense, channels, &dmn_strip_defaults, NULL, m->png, d);
}

/* Write the figures of the steady period.  Call it before anything is stopped. */
static pvx_err result(struct demo *m, char *text, size_t size, struct pvx_diag *d)
{
    double rate = follow_rate(&m->follow);
    cJSON *j;
    PVX_TRY(ask(m->control, NULL, "status", 2000, &j, d));
    struct follow *f = &m->follow;
    /* Missing sets are counted twice: by the subscriber from exposure times, by the daemon by
     * causes.  A set at the border of the period can be in only one count, so the larger is used. */
    double seen = (double)f->missing, told = not_published(j) - m->dropped0 + (double)f->lost;
    snprintf(text, size,
             "result: {\"sets\":%llu,\"sets_per_s\":%.2f,\"lost\":%.0f,\"latency_ms_p50\":%.2f,"
             "\"latency_ms_p99\":%.2f,\"rel_error\":%.4f}",
             (unsigned long long)f->volumes, rate, seen > told ? seen : told,
             ask_num(j, "latency_ms", "p50"), ask_num(j, "latency_ms", "p99"),
             f->error_n == 0 ? 0.0 : f->error_sum / (double)f->error_n);
    cJSON_Delete(j);
    return PVX_OK;
}

static pvx_err demo_play(struct demo *m, char *line, size_t size, struct pvx_diag *d)
{
    PVX_TRY(pvx_exe_dir(m->bin, sizeof m->bin));
    PVX_TRY(demo_make_folder(m, d));
    fflush(NULL);
    m->child = pvx_fork_bound();
    if (m->child < 0)
        return pvx_fail(d, PVX_ENOMEM, "cannot start a process: %s", strerror(errno));
    if (m->child == 0)
        demo_become(m);
    struct follow_truth truth = {
        .known = true, .seed = SEED, .period_s = (double)m->ring / m->a.fps, .ring_fps = m->a.fps};
    m->following = true;
    PVX_TRY(follow_init(&m->follow, m->volumes, NULL, &truth, d));
    PVX_TRY(warm_up(m, d));
    if (m->a.view)
        PVX_TRY(demo_view_start(&m->view, m->bin, m->volumes, m->log, d));
    PVX_TRY(demo_watch(m, d));
    PVX_TRY(result(m, line, size, d));
    return write_picture(m, d);
}

static int demo_run(int argc, char **argv)
{
    struct demo *m = pvx_calloc(1, sizeof *m);
    if (m == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    m->a = (struct args){
        .fps = 20, .cameras = 8, .width = 640, .height = 480, .grid = 64, .format = "rgb8"};
    const struct argp argp = {.parser = demo_parse, .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &m->a);
    m->ring = (long long)(2 * m->a.fps + 0.5); /* two seconds of flame */
    cli_catch_stop();
    struct pvx_diag d = {0};
    char line[300] = "";
    pvx_err e = demo_play(m, line, sizeof line, &d);
    screen_close(&m->screen);
    if (e != PVX_OK && e != PVX_ECANCELED)
        show_failure(m);
    demo_view_stop(&m->view);
    uint64_t sets = m->following ? m->follow.volumes : 0;
    bool clean = stop_child(m);
    if (m->following)
        follow_fini(&m->follow);
    demo_remove_folder(m);
    if (e == PVX_OK && !clean)
        e = pvx_fail(&d, PVX_EIO, "the cameras or the daemon did not end in order");
    if (e == PVX_OK && m->png[0] != '\0')
        printf("picture: %s\n", m->png);
    if (line[0] != '\0')
        puts(line);
    free(m);
    if (e == PVX_ECANCELED)
        return 130;
    return e != PVX_OK ? cli_error(&d, e) : sets > 0 ? 0 : 1;
}

const struct cli_command cmd_demo = {
    "demo", "simulated cameras, daemon and a live screen, all in one", demo_run};
