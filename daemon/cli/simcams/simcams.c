/* simcams.c - `pyrovox simcams`: a rig of GigE Vision cameras that look at a flame, or at a board. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/spawn.h"
#include "capture/gevsim/netns.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/simcams/options.h"
#include "daemon/cli/simcams/ring.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/spectral/soot.h"

#define MIB 1048576.0

struct view { /* of one camera */
    struct simcams_ring *ring;
    size_t c;
};

struct simcams {
    const struct simcams_args *a;
    struct rec_rig rig;
    struct simcams_board board; /* n 0: a flame */
    struct simcams_ring ring;
    cap_gvnet *net;
    cap_gvcam *cam[REC_MAX_CAMERAS]; /* NULL = dead */
    struct view view[REC_MAX_CAMERAS];
    struct simcams_state state[REC_MAX_CAMERAS];
    struct cap_gvcam_stats total[REC_MAX_CAMERAS]; /* of cameras that were killed */
    struct simcams_plan plan;
    char line[256]; /* control input so far */
    size_t line_n;
};

/* ---- setting up ------------------------------------------------------------------------------- */

static void raise_cameras(struct rec_rig *rig, double height)
{
    double at[3], middle[3];
    for (int i = 0; i < 3; i++)
        middle[i] = 0.5 * (rig->grid.min[i] + rig->grid.max[i]);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        rec_camera_centre(&rig->cameras[c], at);
        at[2] += height;
        rec_camera_look(at, middle, &rig->cameras[c]);
    }
}

static pvx_err get_rig(const struct simcams_args *a, struct rec_rig *rig, struct pvx_diag *d)
{
    if (a->rig != NULL) {
        PVX_TRY(rec_rig_load(a->rig, rig, d));
    } else {
        PVX_TRY(rec_rig_ring((size_t)a->cameras, a->radius, a->width, a->height, (int32_t)a->voxels,
                             rig));
        rig->grid.basis = REC_BASIS_DEFAULT;
        if (a->raise > 0)
            raise_cameras(rig, a->raise);
    }
    if (a->write_rig == NULL)
        return PVX_OK;
    return opt_rig_save(rig, NULL, a->write_rig, d);
}

static pvx_err get_faults(struct simcams *s, struct pvx_diag *d)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        s->state[c] = simcams_healthy();
        /* the board's paper and ground are not dark */
        s->state[c].fault.optics.pedestal = s->a->board != NULL ? 0 : s->a->black / 100;
    }
    for (size_t k = 0; k < s->a->n_set; k++)
        PVX_TRY(simcams_set_line(&s->rig, s->a->set[k], s->state, &s->plan, d));
    for (size_t k = 0; k < s->a->n_at; k++)
        PVX_TRY(simcams_at_line(&s->rig, s->a->at[k], &s->plan, d));
    return PVX_OK;
}

/* Of soot as the rig's channels see it, the largest 1. */
static pvx_err soot_colour(const struct simcams *s, double colour[3], struct pvx_diag *d)
{
    const double kelvin = s->a->kelvin;
    struct pvx_diag why = {""};
    rec_soot *soot;
    if (!(kelvin > 0))
        return PVX_OK;
    if (s->rig.spectral == NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "--kelvin: the colours of soot are known to a --rig with `spectral:` "
                        "(pyrovox calibrate spectral)");
    pvx_err e = rec_soot_new(s->rig.spectral, &rec_soot_defaults, &soot, &why);
    if (e != PVX_OK)
        return pvx_fail(d, e, "--kelvin: %s: %s", s->a->rig, pvx_diag_text(&why, e));
    rec_soot_emission(soot, kelvin, colour);
    rec_soot_free(&soot);
    double most = fmax(colour[0], fmax(colour[1], colour[2]));
    for (int q = 0; q < 3; q++)
        colour[q] /= most;
    return PVX_OK;
}

static pvx_err get_ring(struct simcams *s, struct pvx_diag *d)
{
    const struct simcams_args *a = s->a;
    struct simcams_ring_params p = {
        .fmt = a->fmt,
        .n = (size_t)a->ring,
        .fps = a->fps,
        .seed = (uint32_t)a->seed,
        .noise = {a->noise[0] / 100, a->noise[1] / 100, a->noise[2] / 100},
        .sub = (int)a->sub,
        .keep = a->write_frames == NULL && (a->control || a->n_at > 0),
        .state = s->state};
    PVX_TRY(soot_colour(s, p.colour, d));
    if (a->board != NULL) {
        PVX_TRY(simcams_board_init(a->board, &s->rig, (size_t)a->poses, a->hold_s,
                                   (uint32_t)a->seed, &s->board, d));
        p.board = &s->board;
        p.n = s->board.n * SIMCAMS_OF_POSE;
        if (simcams_board_floor(&s->board, &s->rig) < 2)
            fprintf(stderr, "pyrovox simcams: fewer than two cameras stand high enough to see the "
                            "board on the floor: --height, or a rig that does\n");
    }
    double mib = (double)simcams_ring_bytes(&s->rig, &p) / MIB;
    if (mib > (double)a->max_memory)
        return pvx_fail(d, PVX_ENOMEM,
                        "%zu cameras x %zu images take %.0f MiB, more than --max-memory %lld: take "
                        "fewer images (%s), smaller ones, mono8 or bayerrg8, or allow more",
                        s->rig.n_cameras, p.n, mib, (long long)a->max_memory,
                        a->board != NULL ? "--poses" : "--ring");
    fprintf(stderr, "rendering %zu cameras x %zu images, %.0f MiB\n", s->rig.n_cameras, p.n, mib);
    struct cli_progress bar = {.label = a->board != NULL ? "board" : "flame"};
    return simcams_ring_init(&s->rig, &p, cli_progress, &bar, &s->ring);
}

/* Write the ring to disk instead of serving it. */
static int write_frames(const struct simcams *s)
{
    struct pvx_diag d = {""};
    struct cli_progress bar = {.label = "frames"};
    const char *dir = s->a->write_frames;
    size_t step = s->a->board != NULL ? SIMCAMS_OF_POSE : 1, n = s->ring.n / step;
    pvx_err e = PVX_OK;
    for (size_t i = 0; e == PVX_OK && i < n; i++) {
        e = simcams_ring_save(&s->ring, i, step, dir, &d);
        if (!cli_progress(&bar, (double)(i + 1) / (double)n))
            return 130;
    }
    if (e != PVX_OK)
        return cli_error(&d, e);
    const struct rec_grid *g = &s->rig.grid;
    if (s->a->board != NULL)
        printf("%zu poses in %s; number 0 lies on the floor: pyrovox calibrate solve --frames %s "
               "--board %s --volume %g,%g,%g,%g,%g,%g --floor 0 --out rig.yaml\n",
               n, dir, dir, s->a->board, g->min[0], g->min[1], g->min[2], g->max[0], g->max[1],
               g->max[2]);
    else
        printf("%zu frame sets in %s; they have a black level: reconstruct them with --black %g\n",
               n, dir, s->a->black / 100);
    return 0;
}

static bool simcams_renew(void *ctx, size_t k, const struct cap_optics *o)
{
    const struct view *v = ctx;
    return simcams_ring_renew(v->ring, v->c, k, o);
}

static pvx_err start_camera(struct simcams *s, size_t c, struct pvx_diag *d)
{
    char address[16], serial[16];
    if (cap_netns_address(s->a->address, (unsigned)c, address) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL, "--address %s: %zu cameras from there on go past the end",
                        s->a->address, s->rig.n_cameras);
    snprintf(serial, sizeof serial, "SIM%02zu", c);
    const struct rec_camera *cam = &s->rig.cameras[c];
    s->view[c] = (struct view){&s->ring, c};
    struct cap_gvcam_config config = {
        .address = address,
        .serial = serial,
        .user_name = strlen(cam->name) <= CAP_GVCAM_NAME_MAX ? cam->name : NULL,
        .fmt = s->a->fmt,
        .width = cam->width,
        .height = cam->height,
        .ring = (const void *const *)(s->ring.image + c * s->ring.n),
        .n_ring = s->ring.n,
        .renew = s->ring.keep ? simcams_renew : NULL,
        .renew_ctx = &s->view[c],
        .ring_fps = s->a->fps,
        .tick_hz = s->a->tick_hz,
        .ptp_settle_ms = s->a->ptp_ms,
        .boot_clock = s->a->boot_clock,
        .zip = s->a->zip};
    PVX_TRY(cap_gvcam_new(s->net, &config, &s->cam[c], d));
    cap_gvcam_set_fault(s->cam[c], &s->state[c].fault);
    return PVX_OK;
}

/* Counts of camera c, including those before it was killed. */
static struct cap_gvcam_stats stats_of(const struct simcams *s, size_t c)
{
    struct cap_gvcam_stats sum = s->total[c], st = {0};
    if (s->cam[c] != NULL)
        cap_gvcam_stats(s->cam[c], &st);
    for (size_t k = 0; k < sizeof sum / sizeof(uint64_t); k++) /* counts, all of them */
        ((uint64_t *)&sum)[k] += ((uint64_t *)&st)[k];
    return sum;
}

static void stop_camera(struct simcams *s, size_t c)
{
    s->total[c] = stats_of(s, c);
    cap_gvcam_free(&s->cam[c]);
}

/* Apply the state to the cameras. */
static void apply(struct simcams *s)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        struct pvx_diag d = {""};
        pvx_err e = PVX_OK;
        if (!s->state[c].alive)
            stop_camera(s, c);
        else if (s->cam[c] != NULL)
            cap_gvcam_set_fault(s->cam[c], &s->state[c].fault);
        else if ((e = start_camera(s, c, &d)) != PVX_OK) {
            s->state[c].alive = false;
            LOG_E(SIM, "%s: %s", s->rig.cameras[c].name, pvx_diag_text(&d, e));
        }
    }
}

/* ---- serving ---------------------------------------------------------------------------------- */

static void print_stats(const struct simcams *s)
{
    printf("stats {");
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        struct cap_gvcam_stats st = stats_of(s, c);
        printf("%s\"%s\": {", c > 0 ? ", " : "", s->rig.cameras[c].name);
        for (const struct cap_gvcam_stat_def *k = cap_gvcam_stat_defs; k->name != NULL; k++) {
            uint64_t v;
            memcpy(&v, (const char *)&st + k->offset, sizeof v);
            printf("%s\"%s\": %llu", k != cap_gvcam_stat_defs ? ", " : "", k->name,
                   (unsigned long long)v);
        }
        printf("}");
    }
    printf("}\n");
    fflush(stdout);
}

static void simcams_carry_out(struct simcams *s, const struct simcams_order *o)
{
    static const enum cap_gvcam_act act[] = {[SIMCAMS_REBOOT] = CAP_GVCAM_REBOOT,
                                             [SIMCAMS_JUMP] = CAP_GVCAM_CLOCK_JUMP,
                                             [SIMCAMS_IDS] = CAP_GVCAM_RESTART_IDS,
                                             [SIMCAMS_MODE] = CAP_GVCAM_TRIGGER_MODE};
    switch (o->what) {
    case SIMCAMS_NOTHING: return;
    case SIMCAMS_REBOOT:
    case SIMCAMS_JUMP:
    case SIMCAMS_IDS:
    case SIMCAMS_MODE:
        for (size_t c = o->lo; c < o->hi; c++)
            if (s->cam[c] != NULL)
                cap_gvcam_do(s->cam[c], act[o->what], o->arg);
        return;
    case SIMCAMS_LINE: cap_gvnet_line(s->net, o->arg); return;
    case SIMCAMS_PULSE: cap_gvnet_pulse(s->net); return;
    case SIMCAMS_LINK: cap_gvnet_link(s->net, o->arg, (size_t)(o->arg2 * 1024)); return;
    case SIMCAMS_SWITCH: cap_gvnet_reboot(s->net, o->arg); return;
    case SIMCAMS_STATS: print_stats(s); return;
    case SIMCAMS_POSE:
        if (s->board.n == 0)
            fprintf(stderr, "pyrovox simcams: control: pose: there is no --board\n");
        else
            simcams_board_go(&s->board, (size_t)o->arg);
        return;
    }
}

static void control_line(struct simcams *s, const char *line)
{
    struct pvx_diag d = {""};
    struct simcams_order order;
    pvx_err e = simcams_control(&s->rig, line, s->state, &order, &d);
    if (e != PVX_OK) {
        fprintf(stderr, "pyrovox simcams: control: %s\n", pvx_diag_text(&d, e));
        return;
    }
    apply(s);
    simcams_carry_out(s, &order);
}

/* False at the end of the input. */
static bool control_input(struct simcams *s)
{
    char chunk[256];
    ssize_t n = read(STDIN_FILENO, chunk, sizeof chunk);
    if (n <= 0)
        return n < 0 && errno == EINTR;
    for (ssize_t k = 0; k < n; k++) {
        if (chunk[k] != '\n') {
            if (s->line_n < sizeof s->line - 1)
                s->line[s->line_n++] = chunk[k];
            continue;
        }
        s->line[s->line_n] = '\0';
        s->line_n = 0;
        control_line(s, s->line);
    }
    return true;
}

/* Signals come as data from here on.  Call before threads start, so that they all have them blocked.
 * Returns the descriptor or -1. */
static int open_signals(sigset_t *old)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGHUP);
    sigaddset(&set, SIGCHLD);
    sigprocmask(SIG_BLOCK, &set, old);
    return signalfd(-1, &set, SFD_CLOEXEC);
}

/* Run the command; when this process dies, the kernel ends the command too. */
static pid_t spawn(char **command, bool give_stdin, const sigset_t *mask)
{
    pid_t pid = pvx_fork_bound();
    if (pid != 0)
        return pid;
    sigprocmask(SIG_SETMASK, mask, NULL);
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    if (!give_stdin) {
        int null = open("/dev/null", O_RDONLY);
        if (null >= 0)
            dup2(null, STDIN_FILENO);
    }
    execvp(command[0], command);
    dprintf(STDERR_FILENO, "pyrovox simcams: cannot run %s: %s\n", command[0], strerror(errno));
    _exit(errno == ENOENT ? 127 : 126);
}

/* Exit code of the command if it has ended, else -1. */
static int simcams_reap(pid_t child)
{
    int status;
    if (child <= 0 || waitpid(child, &status, WNOHANG) != child)
        return -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/* Every camera that is alive has sent a frame. */
static bool all_send(const struct simcams *s)
{
    struct cap_gvcam_stats st;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        if (s->cam[c] == NULL)
            continue;
        cap_gvcam_stats(s->cam[c], &st);
        if (st.frames == 0)
            return false;
    }
    return true;
}

/* Serve until a signal, or until the command has ended.  Returns the exit code. */
static int simcams_serve(struct simcams *s, int sigfd, pid_t child)
{
    int64_t t0 = pvx_now_mono();
    size_t next = 0;
    double tick_s = 0; /* the next picture of the board */
    bool control = s->a->control;
    for (;;) {
        double now_s = (double)(pvx_now_mono() - t0) * 1e-9;
        for (; next < s->plan.n && s->plan.event[next].at_s <= now_s; next++)
            control_line(s, s->plan.event[next].line);
        if (s->board.n > 0 && now_s >= tick_s) {
            size_t image = simcams_board_tick(&s->board, now_s, all_send(s));
            cap_gvnet_show(s->net, (int64_t)image);
            tick_s = now_s + 1 / s->a->fps;
        }
        double until = s->board.n > 0 ? tick_s : now_s + 60;
        if (next < s->plan.n && s->plan.event[next].at_s < until)
            until = s->plan.event[next].at_s;
        int timeout = until > now_s ? (int)((until - now_s) * 1e3) + 1 : 0;
        struct pollfd p[2] = {{.fd = sigfd, .events = POLLIN},
                              {.fd = control ? STDIN_FILENO : -1, .events = POLLIN}};
        if (poll(p, 2, timeout) < 0 && errno != EINTR)
            return 1;
        struct signalfd_siginfo si;
        if ((p[0].revents & POLLIN) != 0 && read(sigfd, &si, sizeof si) == sizeof si) {
            int code = simcams_reap(child);
            if (code >= 0)
                return code;
            if (si.ssi_signo != SIGCHLD) {
                if (child <= 0)
                    return si.ssi_signo == SIGINT ? 130 : 0;
                if (si.ssi_code != SI_KERNEL) /* a terminal's Ctrl-C reached the command too */
                    kill(child, (int)si.ssi_signo);
            }
        }
        if ((p[1].revents & (POLLIN | POLLHUP | POLLERR)) != 0)
            control = control_input(s);
    }
}

static void simcams_report(const struct simcams *s)
{
    uint64_t frames = 0, dropped = 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        frames += s->total[c].frames;
        dropped += s->total[c].dropped;
    }
    fprintf(stderr, "simcams: %llu frames sent, %llu dropped on request\n",
            (unsigned long long)frames, (unsigned long long)dropped);
}

static int start_and_serve(struct simcams *s)
{
    struct pvx_diag d = {""};
    sigset_t old;
    int sigfd = open_signals(&old);
    int code = sigfd < 0 ? cli_error(NULL, PVX_EIO) : 0;
    pvx_err started = cap_gvnet_new(&s->net, &d);
    if (code == 0 && started != PVX_OK)
        code = cli_error(&d, started);
    for (size_t c = 0; code == 0 && c < s->rig.n_cameras; c++) {
        pvx_err e = s->state[c].alive ? start_camera(s, c, &d) : PVX_OK;
        if (e != PVX_OK)
            code = cli_error(&d, e);
    }
    pid_t child = 0;
    if (code == 0) {
        char last[16];
        pvx_err e = cap_netns_address(s->a->address, (unsigned)s->rig.n_cameras - 1, last);
        printf("serving %zu cameras on %s..%s\n", s->rig.n_cameras, s->a->address,
               e == PVX_OK ? last : s->a->address);
        fflush(stdout);
        if (s->a->private_net && s->a->command == NULL)
            fprintf(stderr, "enter the private network with: nsenter -t %d %s-n COMMAND\n",
                    (int)getpid(), geteuid() == 0 ? "" : "-U --preserve-credentials ");
        if (s->a->command != NULL && (child = spawn(s->a->command, !s->a->control, &old)) < 0)
            code = cli_error(NULL, PVX_ENOMEM);
    }
    if (code == 0) {
        code = simcams_serve(s, sigfd, child);
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            stop_camera(s, c);
        simcams_report(s);
    }
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        stop_camera(s, c);
    cap_gvnet_free(&s->net);
    if (sigfd >= 0)
        close(sigfd);
    return code;
}

static int simcams_run(int argc, char **argv)
{
    struct simcams_args a;
    simcams_options(argc, argv, &a);
    struct simcams *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    s->a = &a;
    cli_catch_stop();
    struct pvx_diag d = {""};
    pvx_err e = get_rig(&a, &s->rig, &d);
    PVX_THEN(e, get_faults(s, &d));
    if (e == PVX_OK && a.private_net)
        e = cap_netns_enter((unsigned)s->rig.n_cameras, &d); /* still one thread */
    PVX_THEN(e, get_ring(s, &d));
    int code = e == PVX_ECANCELED ? 130 : e != PVX_OK ? cli_error(&d, e) : 0;
    if (e == PVX_OK)
        code = a.write_frames != NULL ? write_frames(s) : start_and_serve(s);
    simcams_ring_fini(&s->ring);
    simcams_board_fini(&s->board);
    rec_rig_fini(&s->rig);
    free(s);
    return code;
}

const struct cli_command cmd_simcams = {
    "simcams", "serve simulated GigE Vision cameras that look at a flame", simcams_run};
