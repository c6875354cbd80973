/* cmd_simcams.c - `pyrovox simcams`: a rig of GigE Vision cameras that look at a flame. */
#include <argp.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/yaml.h"
#include "capture/netns.h"
#include "cli/arg.h"
#include "cli/cli.h"
#include "cli/simcams_engine.h"
#include "cli/simcams_faults.h"
#include "cli/simcams_ring.h"

#define MAX_FAULT_OPTIONS 64
#define MIB               1048576.0

enum {
    OPT_RIG = 0x100,
    OPT_CAMERAS,
    OPT_SIZE,
    OPT_RADIUS,
    OPT_VOXELS,
    OPT_ADDRESS,
    OPT_FORMAT,
    OPT_FPS,
    OPT_RING,
    OPT_SEED,
    OPT_BLACK,
    OPT_NOISE,
    OPT_SUB,
    OPT_TRIGGER_HZ,
    OPT_MAX_MEMORY,
    OPT_WRITE_RIG,
    OPT_WRITE_FRAMES,
    OPT_FAULT, /* + enum simcams_fault_kind */
    OPT_FAULT_END = OPT_FAULT + SIMCAMS_N_KINDS,
    OPT_KILL,
    OPT_AT,
    OPT_ENGINE,
    OPT_LINE_HZ,
    OPT_LINK,
    OPT_CAMERA_LINK,
    OPT_TICK_HZ,
    OPT_PTP_MS,
    OPT_TAI,
    OPT_BOOT_CLOCK,
    OPT_ZIP,
    OPT_FREEZE,
    OPT_CONTROL,
    OPT_PRIVATE_NET,
};

static const struct argp_option options[] = {
    {NULL, 0, NULL, 0, "Cameras:", 1},
    {"rig", OPT_RIG, "FILE", 0, "serve the cameras of this rig.yaml", 1},
    {"cameras", OPT_CAMERAS, "N", 0, "without --rig: N cameras on a ring (8)", 1},
    {"size", OPT_SIZE, "WxH", 0, "without --rig: image size (640x480)", 1},
    {"radius", OPT_RADIUS, "METRES", 0, "without --rig: radius of the ring (2.5)", 1},
    {"voxels", OPT_VOXELS, "N", 0, "without --rig: voxels per side, for --write-rig (64)", 1},
    {"write-rig", OPT_WRITE_RIG, "FILE", 0, "write the rig that is served as rig.yaml", 1},
    {"write-frames", OPT_WRITE_FRAMES, "DIR", 0,
     "write the images as DIR/<camera>/<6 digits>.png, for pyrovox reconstruct, and serve nothing",
     1},
    {"address", OPT_ADDRESS, "IPV4", 0,
     "address of the first camera; the others follow (127.0.0.2)", 1},
    {"private-net", OPT_PRIVATE_NET, NULL, 0,
     "in a private network that an ordinary user may have; COMMAND runs inside it", 1},
    {NULL, 0, NULL, 0, "Images:", 2},
    {"format", OPT_FORMAT, "FORMAT", 0, "mono8, rgb8 (default) or bayerrg8", 2},
    {"fps", OPT_FPS, "HZ", 0,
     "images per second of the flame's motion (15); the frame rate itself is the client's to set",
     2},
    {"ring", OPT_RING, "N", 0, "images per camera, rendered before and repeated (30)", 2},
    {"seed", OPT_SEED, "N", 0, "another flame (1)", 2},
    {"black", OPT_BLACK, "PERCENT", 0, "black level, share of full scale (2)", 2},
    {"noise", OPT_NOISE, "PERCENT", 0, "Gaussian noise, share of full scale (0.5)", 2},
    {"sub", OPT_SUB, "N", 0, "N x N rays per pixel (1)", 2},
    {"max-memory", OPT_MAX_MEMORY, "MIB", 0, "refuse to take more for the images (1024)", 2},
    {NULL, 0, NULL, 0, "Devices:", 3},
    {"engine", OPT_ENGINE, "NAME", 0,
     "own (default), or aravis: libaravis' fake camera, a second implementation that can do less",
     3},
    {"line-hz", OPT_LINE_HZ, "HZ", 0,
     "pulses on the trigger line that all cameras share (TriggerSource Line1)", 3},
    {"link", OPT_LINK, "MBIT_S", 0, "the network carries this much and drops the rest", 3},
    {"camera-link", OPT_CAMERA_LINK, "MBIT_S", 0,
     "each camera's own cable; limits its frame rate too (1000)", 3},
    {"tick-hz", OPT_TICK_HZ, "HZ", 0, "of the cameras' clocks without PTP (1e9)", 3},
    {"boot-clock", OPT_BOOT_CLOCK, NULL, 0, "these clocks count from the start, not from 1970", 3},
    {"ptp-ms", OPT_PTP_MS, "MS", 0, "from PtpEnable to Slave (2000)", 3},
    {"tai", OPT_TAI, "SECONDS", 0, "PTP time is ahead of the host's clock by this (0)", 3},
    {"zip-xml", OPT_ZIP, NULL, 0, "serve the GenICam file zipped", 3},
    {"trigger-hz", OPT_TRIGGER_HZ, "HZ", 0,
     "engine aravis: how often a software trigger is looked for (500)", 3},
    {NULL, 0, NULL, 0, "Faults (V for all cameras, or cam1=V,cam3=V):", 4},
    {"drop", OPT_FAULT + SIMCAMS_DROP, "V", 0, "share of frames never sent, 0 to 1", 4},
    {"packet-loss", OPT_FAULT + SIMCAMS_LOSS, "V", 0, "share of packets lost, 0 to 1", 4},
    {"delay-ms", OPT_FAULT + SIMCAMS_DELAY, "V", 0, "frames are sent this much late", 4},
    {"jitter-ms", OPT_FAULT + SIMCAMS_JITTER, "V", 0, "and by up to this much more", 4},
    {"skew-us", OPT_FAULT + SIMCAMS_SKEW, "V", 0, "the camera's clock is ahead by this", 4},
    {"drift-ppm", OPT_FAULT + SIMCAMS_DRIFT, "V", 0, "the camera's clock runs faster by this", 4},
    {"ptp-offset-us", OPT_FAULT + SIMCAMS_PTP_OFFSET, "V", 0, "a PTP slave is off by this", 4},
    {"reorder", OPT_FAULT + SIMCAMS_REORDER, "V", 0, "share of packets that are overtaken", 4},
    {"duplicate", OPT_FAULT + SIMCAMS_DUPLICATE, "V", 0, "share of packets that come twice", 4},
    {"wrong-size", OPT_FAULT + SIMCAMS_SIZE, "V", 0,
     "share of frames with another width announced, or cut short", 4},
    {"corrupt", OPT_FAULT + SIMCAMS_CORRUPT, "V", 0, "share of frames with a garbled packet", 4},
    {"miss", OPT_FAULT + SIMCAMS_MISS, "V", 0, "share of triggers ignored", 4},
    {"hostile", OPT_FAULT + SIMCAMS_HOSTILE, "V", 0,
     "share of frames and answers that come with malformed packets", 4},
    {"kill", OPT_KILL, "CAM@S", 0, "the camera dies S seconds after the start", 4},
    {"freeze", OPT_FREEZE, "CAM@S[-S]", 0, "image and time stamp stand still from S (until S)", 4},
    {"at", OPT_AT, "S:LINE", 0, "S seconds after the start, what LINE says (see --control)", 4},
    {"control", OPT_CONTROL, NULL, 0, "read lines on standard input, as listed below", 4},
    {0},
};

static const char doc[] =
    "Serve simulated cameras over the real GigE Vision protocol.\v"
    "Each camera shows its own view of a burning flame; all show the same instant, and what a time "
    "stamp says is exact: image i of a camera is the flame at i/fps of a period of ring/fps.  The "
    "daemon cannot tell them from cameras of metal.\n"
    "\n"
    "Prints one line when they answer: serving 8 cameras on 127.0.0.2..127.0.0.9\n"
    "\n"
    "Control lines (CAM may be all):\n"
    "  drop|loss|delay|skew|drift|jitter|reorder|duplicate|size|corrupt|miss|hostile|ptp-offset "
    "CAM NUMBER\n"
    "  freeze|stuck|no-ptp CAM on|off     image and stamp, or only the clock, stand still; no PTP "
    "master\n"
    "  kill CAM, revive CAM, reboot CAM [SECONDS]\n"
    "  jump CAM SECONDS                   its clock jumps\n"
    "  ids CAM                            its frame numbers begin anew\n"
    "  line HZ, pulse                     trigger line: pulses, or one\n"
    "  link MBIT_S [KIB]                  what the network carries (0: all), and the switch's "
    "buffer\n"
    "  switch SECONDS                     the switch reboots: nothing passes for so long\n"
    "  stats                              prints the counts: what was really sent, lost, ignored\n"
    "\n"
    "Examples:\n"
    "  pyrovox simcams --private-net -- pyrovoxd --config my.yaml\n"
    "      eight cameras and a daemon, as an ordinary user\n"
    "  pyrovox simcams --private-net -- arv-tool-0.8\n"
    "      what Aravis' own tool sees\n"
    "  pyrovox simcams --rig rig.yaml --drop cam3=0.05 --kill cam1@20 --address 127.0.0.2\n"
    "      a rig of your own, with faults, on addresses that this host has\n"
    "  pyrovox simcams --private-net --line-hz 30 --at 10:'miss cam2 0.1' -- pyrovoxd --config "
    "my.yaml\n"
    "      cameras on a trigger line; after 10 s one of them misses a tenth of the pulses\n"
    "  pyrovox simcams --size 320x240 --write-rig rig.yaml --write-frames take\n"
    "      a recording to try pyrovox reconstruct on\n";

struct fault_option {
    enum simcams_fault_kind kind;
    const char *text;
};
struct plan_option {
    int key;
    const char *text;
};

struct args {
    const char *rig, *write_rig, *write_frames, *address;
    int64_t cameras, ring, seed, sub, max_memory, voxels;
    int32_t width, height;
    double radius, fps, black, noise, trigger_hz;
    double line_hz, link_mbit, camera_mbit, tick_hz, ptp_ms, tai_s;
    enum simcams_kind engine;
    bool boot_clock, zip;
    enum cap_pixfmt fmt;
    bool control, private_net;
    char **command; /* NULL = none */
    size_t n_faults, n_plans;
    struct fault_option fault[MAX_FAULT_OPTIONS];
    struct plan_option plan[MAX_FAULT_OPTIONS];
};

struct simcams {
    const struct args *a;
    struct rec_rig rig;
    struct simcams_ring ring;
    struct simcams_engine engine;
    struct simcams_camera cam[REC_MAX_CAMERAS];
    struct simcams_state state[REC_MAX_CAMERAS];
    struct cap_gvcam_stats total[REC_MAX_CAMERAS]; /* of cameras that were killed */
    struct simcams_plan plan;
    char line[256]; /* control input so far */
    size_t line_n;
};

/* ---- arguments -------------------------------------------------------------------------------- */

static void want_format(struct argp_state *st, const char *arg, struct args *a)
{
    static const struct {
        const char *name;
        enum cap_pixfmt fmt;
    } known[] = {{"mono8", CAP_GREY8}, {"rgb8", CAP_RGB8}, {"bayerrg8", CAP_BAYER_RG8}};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcasecmp(arg, known[i].name) == 0) {
            a->fmt = known[i].fmt;
            return;
        }
    argp_error(st, "--format %s: should be mono8, rgb8 or bayerrg8", arg);
}

static void want_engine(struct argp_state *st, const char *arg, struct args *a)
{
    if (strcmp(arg, "own") != 0 && strcmp(arg, "aravis") != 0)
        argp_error(st, "--engine %s: should be own or aravis", arg);
    a->engine = arg[0] == 'a' ? SIMCAMS_ARAVIS : SIMCAMS_OWN;
}

static void add_fault(struct argp_state *st, int key, const char *arg, struct args *a)
{
    if (a->n_faults == MAX_FAULT_OPTIONS)
        argp_error(st, "too many fault options");
    a->fault[a->n_faults++] =
        (struct fault_option){(enum simcams_fault_kind)(key - OPT_FAULT), arg};
}

static error_t parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case OPT_RIG: a->rig = arg; return 0;
    case OPT_WRITE_RIG: a->write_rig = arg; return 0;
    case OPT_WRITE_FRAMES: a->write_frames = arg; return 0;
    case OPT_ADDRESS: a->address = arg; return 0;
    case OPT_CONTROL: a->control = true; return 0;
    case OPT_PRIVATE_NET: a->private_net = true; return 0;
    case OPT_CAMERAS: cli_arg_int(st, "cameras", arg, 1, REC_MAX_CAMERAS, &a->cameras); return 0;
    case OPT_VOXELS: cli_arg_int(st, "voxels", arg, 1, REC_GRID_MAX, &a->voxels); return 0;
    case OPT_RING: cli_arg_int(st, "ring", arg, 1, 100000, &a->ring); return 0;
    case OPT_SEED: cli_arg_int(st, "seed", arg, 0, UINT32_MAX, &a->seed); return 0;
    case OPT_SUB: cli_arg_int(st, "sub", arg, 1, 16, &a->sub); return 0;
    case OPT_MAX_MEMORY: cli_arg_int(st, "max-memory", arg, 1, 1 << 24, &a->max_memory); return 0;
    case OPT_RADIUS: cli_arg_double(st, "radius", arg, 0.8, 100, &a->radius); return 0;
    case OPT_FPS: cli_arg_double(st, "fps", arg, 0.1, 1000, &a->fps); return 0;
    case OPT_BLACK: cli_arg_double(st, "black", arg, 0, 50, &a->black); return 0;
    case OPT_NOISE: cli_arg_double(st, "noise", arg, 0, 100, &a->noise); return 0;
    case OPT_TRIGGER_HZ: cli_arg_double(st, "trigger-hz", arg, 1, 1000, &a->trigger_hz); return 0;
    case OPT_SIZE: cli_arg_size(st, "size", arg, 8, 16384, &a->width, &a->height); return 0;
    case OPT_FORMAT: want_format(st, arg, a); return 0;
    case OPT_ENGINE: want_engine(st, arg, a); return 0;
    case OPT_BOOT_CLOCK: a->boot_clock = true; return 0;
    case OPT_ZIP: a->zip = true; return 0;
    case OPT_LINE_HZ: cli_arg_double(st, "line-hz", arg, 0, 1000, &a->line_hz); return 0;
    case OPT_LINK: cli_arg_double(st, "link", arg, 0, 1e6, &a->link_mbit); return 0;
    case OPT_CAMERA_LINK: cli_arg_double(st, "camera-link", arg, 1, 1e6, &a->camera_mbit); return 0;
    case OPT_TICK_HZ: cli_arg_double(st, "tick-hz", arg, 1e3, 1e10, &a->tick_hz); return 0;
    case OPT_PTP_MS: cli_arg_double(st, "ptp-ms", arg, 1, 1e6, &a->ptp_ms); return 0;
    case OPT_TAI: cli_arg_double(st, "tai", arg, -1e6, 1e6, &a->tai_s); return 0;
    case OPT_AT:
    case OPT_KILL:
    case OPT_FREEZE:
        if (a->n_plans == MAX_FAULT_OPTIONS)
            argp_error(st, "too many timed faults");
        a->plan[a->n_plans++] = (struct plan_option){key, arg};
        return 0;
    case ARGP_KEY_ARG: /* the command and all that follows is not ours to parse */
        a->command = &st->argv[st->next - 1];
        st->next = st->argc;
        return 0;
    default: break;
    }
    if (key < OPT_FAULT || key >= OPT_FAULT_END)
        return ARGP_ERR_UNKNOWN;
    add_fault(st, key, arg, a);
    return 0;
}

/* ---- setting up ------------------------------------------------------------------------------- */

static pvx_err get_rig(const struct args *a, struct rec_rig *rig, struct pvx_diag *d)
{
    if (a->rig != NULL)
        PVX_TRY(rec_rig_load(a->rig, rig, d));
    else
        PVX_TRY(rec_rig_ring((size_t)a->cameras, a->radius, a->width, a->height, (int32_t)a->voxels,
                             rig));
    if (a->write_rig == NULL)
        return PVX_OK;
    char *text;
    size_t len;
    PVX_TRY(rec_rig_format(rig, &text, &len));
    pvx_err e = pvx_file_write(a->write_rig, text, len, d);
    free(text);
    return e;
}

static pvx_err get_faults(struct simcams *s, struct pvx_diag *d)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        s->state[c].alive = true;
    for (size_t k = 0; k < s->a->n_faults; k++)
        PVX_TRY(
            simcams_fault_option(&s->rig, s->a->fault[k].kind, s->a->fault[k].text, s->state, d));
    for (size_t k = 0; k < s->a->n_plans; k++) {
        const struct plan_option *p = &s->a->plan[k];
        PVX_TRY(p->key == OPT_AT
                    ? simcams_plan_line(&s->rig, p->text, &s->plan, d)
                    : simcams_plan_option(&s->rig, p->key == OPT_FREEZE, p->text, &s->plan, d));
    }
    return PVX_OK;
}

static pvx_err get_ring(struct simcams *s, struct pvx_diag *d)
{
    const struct args *a = s->a;
    struct simcams_ring_params p = {.fmt = a->fmt,
                                    .n = (size_t)a->ring,
                                    .fps = a->fps,
                                    .seed = (uint32_t)a->seed,
                                    .black = a->black / 100,
                                    .noise = a->noise / 100,
                                    .sub = (int)a->sub};
    double mib = (double)simcams_ring_bytes(&s->rig, &p) / MIB;
    if (mib > (double)a->max_memory)
        return pvx_fail(d, PVX_ENOMEM,
                        "%zu cameras x %lld images take %.0f MiB, more than "
                        "--max-memory %lld: take fewer images (--ring), smaller ones, mono8 or "
                        "bayerrg8, or allow more",
                        s->rig.n_cameras, (long long)a->ring, mib, (long long)a->max_memory);
    fprintf(stderr, "rendering %zu cameras x %lld images, %.0f MiB\n", s->rig.n_cameras,
            (long long)a->ring, mib);
    struct cli_progress bar = {.label = "flame"};
    return simcams_ring_init(&s->rig, &p, cli_progress, &bar, &s->ring);
}

/* The ring on disk instead of on the network. */
static int write_frames(const struct simcams *s)
{
    struct pvx_diag d = {""};
    struct cli_progress bar = {.label = "frames"};
    const char *dir = s->a->write_frames;
    pvx_err e = PVX_OK;
    for (size_t i = 0; e == PVX_OK && i < s->ring.n; i++) {
        e = simcams_ring_save(&s->ring, &s->rig, s->a->fmt, i, dir, &d);
        if (!cli_progress(&bar, (double)(i + 1) / (double)s->ring.n))
            return 130;
    }
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%zu frame sets in %s; they have a black level: reconstruct them with --black %g\n",
           s->ring.n, dir, s->a->black / 100);
    return 0;
}

static pvx_err start_camera(struct simcams *s, size_t c, struct pvx_diag *d)
{
    char address[16], serial[16];
    if (cap_netns_address(s->a->address, (unsigned)c, address) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL, "--address %s: %zu cameras from there on go past the end",
                        s->a->address, s->rig.n_cameras);
    snprintf(serial, sizeof serial, "SIM%02zu", c);
    const struct rec_camera *cam = &s->rig.cameras[c];
    struct cap_gvcam_config config = {
        .address = address,
        .serial = serial,
        .user_name = strlen(cam->name) <= CAP_GVCAM_NAME_MAX ? cam->name : NULL,
        .fmt = s->a->fmt,
        .width = cam->width,
        .height = cam->height,
        .ring = (const void *const *)(s->ring.image + c * s->ring.n),
        .n_ring = s->ring.n,
        .ring_fps = s->a->fps,
        .tick_hz = s->a->tick_hz,
        .link_mbit = s->a->camera_mbit,
        .ptp_settle_ms = s->a->ptp_ms,
        .tai_offset_s = s->a->tai_s,
        .boot_clock = s->a->boot_clock,
        .zip = s->a->zip};
    PVX_TRY(simcams_camera_start(&s->engine, &config, &s->cam[c], d));
    return simcams_camera_fault(&s->cam[c], &s->state[c].fault, d);
}

/* Make the cameras what the state says. */
static void apply(struct simcams *s)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        struct pvx_diag d = {""};
        pvx_err e = PVX_OK;
        if (!s->state[c].alive)
            simcams_camera_stop(&s->cam[c], &s->total[c]);
        else if (simcams_camera_alive(&s->cam[c]))
            e = simcams_camera_fault(&s->cam[c], &s->state[c].fault, &d);
        else if ((e = start_camera(s, c, &d)) != PVX_OK)
            s->state[c].alive = false;
        if (e != PVX_OK)
            LOG_E(SIM, "%s: %s", s->rig.cameras[c].name, pvx_diag_text(&d, e));
    }
}

/* ---- serving ---------------------------------------------------------------------------------- */

static void print_stats(const struct simcams *s)
{
    printf("stats {");
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        struct cap_gvcam_stats st = s->total[c];
        simcams_camera_stats(&s->cam[c], &st);
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

static void carry_out(struct simcams *s, const struct simcams_order *o)
{
    static const enum cap_gvcam_act act[] = {[SIMCAMS_REBOOT] = CAP_GVCAM_REBOOT,
                                             [SIMCAMS_JUMP] = CAP_GVCAM_CLOCK_JUMP,
                                             [SIMCAMS_IDS] = CAP_GVCAM_RESTART_IDS};
    if (s->engine.net == NULL && o->what != SIMCAMS_NOTHING && o->what != SIMCAMS_STATS) {
        fprintf(stderr, "pyrovox simcams: control: not with --engine aravis\n");
        return;
    }
    switch (o->what) {
    case SIMCAMS_NOTHING: return;
    case SIMCAMS_REBOOT:
    case SIMCAMS_JUMP:
    case SIMCAMS_IDS:
        for (size_t c = o->lo; c < o->hi; c++)
            if (s->cam[c].own != NULL)
                cap_gvcam_do(s->cam[c].own, act[o->what], o->arg);
        return;
    case SIMCAMS_LINE: cap_gvnet_line(s->engine.net, o->arg); return;
    case SIMCAMS_PULSE: cap_gvnet_pulse(s->engine.net); return;
    case SIMCAMS_LINK: cap_gvnet_link(s->engine.net, o->arg, (size_t)(o->arg2 * 1024)); return;
    case SIMCAMS_SWITCH: cap_gvnet_reboot(s->engine.net, o->arg); return;
    case SIMCAMS_STATS: print_stats(s); return;
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
    carry_out(s, &order);
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
    pid_t parent = getpid(), pid = fork();
    if (pid != 0)
        return pid;
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent)
        _exit(125);
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
static int reap(pid_t child)
{
    int status;
    if (child <= 0 || waitpid(child, &status, WNOHANG) != child)
        return -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/* Serve until a signal, or until the command has ended.  Returns the exit code. */
static int serve(struct simcams *s, int sigfd, pid_t child)
{
    int64_t t0 = pvx_now_mono();
    size_t next = 0;
    bool control = s->a->control;
    for (;;) {
        double now_s = (double)(pvx_now_mono() - t0) * 1e-9;
        for (; next < s->plan.n && s->plan.event[next].at_s <= now_s; next++)
            control_line(s, s->plan.event[next].line);
        int timeout = -1;
        if (next < s->plan.n) {
            double left_ms = (s->plan.event[next].at_s - now_s) * 1e3 + 1;
            timeout = left_ms < 60000 ? (int)left_ms : 60000;
        }
        struct pollfd p[2] = {{.fd = sigfd, .events = POLLIN},
                              {.fd = control ? STDIN_FILENO : -1, .events = POLLIN}};
        if (poll(p, 2, timeout) < 0 && errno != EINTR)
            return 1;
        struct signalfd_siginfo si;
        if ((p[0].revents & POLLIN) != 0 && read(sigfd, &si, sizeof si) == sizeof si) {
            int code = reap(child);
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

static void report(const struct simcams *s)
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
    pvx_err started = simcams_engine_start(&s->engine, s->a->engine, &d);
    if (code == 0 && started != PVX_OK)
        code = cli_error(&d, started);
    s->engine.trigger_hz = s->a->trigger_hz;
    if (code == 0 && s->engine.net != NULL) {
        cap_gvnet_line(s->engine.net, s->a->line_hz);
        cap_gvnet_link(s->engine.net, s->a->link_mbit, 0);
    }
    for (size_t c = 0; code == 0 && c < s->rig.n_cameras; c++) {
        pvx_err e = start_camera(s, c, &d);
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
        code = serve(s, sigfd, child);
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            simcams_camera_stop(&s->cam[c], &s->total[c]);
        report(s);
    }
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        simcams_camera_stop(&s->cam[c], &s->total[c]);
    simcams_engine_stop(&s->engine);
    if (sigfd >= 0)
        close(sigfd);
    return code;
}

static int run(int argc, char **argv)
{
    struct args a = {.address = "127.0.0.2",
                     .cameras = 8,
                     .ring = 30,
                     .seed = 1,
                     .sub = 1,
                     .max_memory = 1024,
                     .voxels = 64,
                     .width = 640,
                     .height = 480,
                     .radius = 2.5,
                     .fps = 15,
                     .black = 2,
                     .noise = 0.5,
                     .trigger_hz = 500,
                     .fmt = CAP_RGB8};
    const struct argp argp = {
        .options = options, .parser = parse_opt, .args_doc = "[-- COMMAND ARGS...]", .doc = doc};
    argp_err_exit_status = 2;
    if (argp_parse(&argp, argc, argv, ARGP_IN_ORDER, NULL, &a) != 0)
        return 2;
    struct simcams *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    s->a = &a;
    cli_catch_stop();
    struct pvx_diag d = {""};
    pvx_err e = get_rig(&a, &s->rig, &d);
    if (e == PVX_OK)
        e = get_faults(s, &d);
    if (e == PVX_OK && a.private_net)
        e = cap_netns_enter((unsigned)s->rig.n_cameras, &d); /* still one thread */
    if (e == PVX_OK)
        e = get_ring(s, &d);
    int code = e == PVX_ECANCELED ? 130 : e != PVX_OK ? cli_error(&d, e) : 0;
    if (e == PVX_OK)
        code = a.write_frames != NULL ? write_frames(s) : start_and_serve(s);
    simcams_ring_fini(&s->ring);
    rec_rig_fini(&s->rig);
    free(s);
    return code;
}

const struct cli_command cmd_simcams = {
    "simcams", "serve simulated GigE Vision cameras that look at a flame", run};
