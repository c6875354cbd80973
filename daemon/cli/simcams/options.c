#include "daemon/cli/simcams/options.h"

#include <argp.h>
#include <string.h>

#include "daemon/cli/common/arg.h"

enum {
    OPT_RIG = 0x100,
    OPT_CAMERAS,
    OPT_SIZE,
    OPT_RADIUS,
    OPT_HEIGHT,
    OPT_VOXELS,
    OPT_ADDRESS,
    OPT_FORMAT,
    OPT_FPS,
    OPT_RING,
    OPT_SEED,
    OPT_BLACK,
    OPT_NOISE,
    OPT_SUB,
    OPT_MAX_MEMORY,
    OPT_BOARD,
    OPT_POSES,
    OPT_HOLD,
    OPT_WRITE_RIG,
    OPT_WRITE_FRAMES,
    OPT_FAULT, /* + enum simcams_fault_kind */
    OPT_FAULT_END = OPT_FAULT + SIMCAMS_N_KINDS,
    OPT_KILL,
    OPT_AT,
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
    {"height", OPT_HEIGHT, "METRES", 0,
     "without --rig: how high above the volume's middle the cameras stand (0); a board on the "
     "floor "
     "is seen from about half the radius on",
     1},
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
    {"noise", OPT_NOISE, "PERCENT[,G,B]", 0,
     "Gaussian noise, share of full scale (0.5); of red, green and blue, where they differ", 2},
    {"sub", OPT_SUB, "N", 0, "N x N rays per pixel (1)", 2},
    {"board", OPT_BOARD, "SPEC", 0,
     "a calibration board instead of the flame, as for `pyrovox calibrate board`: flat on the "
     "floor "
     "at first, then from pose to pose all through the volume",
     2},
    {"poses", OPT_POSES, "N", 0, "with --board: so many, then again from the first (30)", 2},
    {"hold", OPT_HOLD, "SECONDS", 0,
     "with --board: it stands still for so long at each, once all cameras send (2); 0: until it is "
     "told `pose NUMBER`",
     2},
    {"max-memory", OPT_MAX_MEMORY, "MIB", 0,
     "refuse to take more for the images, and for what they are made of where orders can come "
     "(1024)",
     2},
    {NULL, 0, NULL, 0, "Devices:", 3},
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
    {"late", OPT_FAULT + SIMCAMS_LATE, "V", 0,
     "its image is that of so many frames before, its time stamp is not", 4},
    {"kill", OPT_KILL, "CAM@S", 0, "the camera dies S seconds after the start", 4},
    {"still", OPT_FAULT + SIMCAMS_STILL, "V", 0, "on: the image stands still, its stamps go on", 4},
    {"freeze", OPT_FREEZE, "CAM@S[-S]", 0, "image and time stamp stand still from S (until S)", 4},
    {"at", OPT_AT, "S:LINE", 0, "S seconds after the start, what LINE says (see --control)", 4},
    {"control", OPT_CONTROL, NULL, 0, "read lines on standard input, as listed below", 4},
    {NULL, 0, NULL, 0, "Lens and sensor (likewise):", 5},
    {"cap", OPT_FAULT + SIMCAMS_CAP, "V", 0, "on: the lens cap is on", 5},
    {"flood", OPT_FAULT + SIMCAMS_FLOOD, "V", 0, "on: evenly bright, saturated", 5},
    {"flat", OPT_FAULT + SIMCAMS_FLAT, "V", 0,
     "a diffuse source of half full scale fills the view, at place 1, 2 ...; 0: none", 5},
    {"empty", OPT_FAULT + SIMCAMS_EMPTY, "V", 0, "on: there is no flame", 5},
    {"shift", OPT_FAULT + SIMCAMS_SHIFT, "X:Y", 0,
     "the picture is displaced by so many pixels, to the right and down", 5},
    {"blur", OPT_FAULT + SIMCAMS_BLUR, "V", 0, "Gaussian of this many pixels (standard deviation)",
     5},
    {"mirrored", OPT_FAULT + SIMCAMS_MIRRORED, "V", 0, "on: left is right", 5},
    {"background", OPT_FAULT + SIMCAMS_BACKGROUND, "V", 0,
     "faint light behind the flame, uneven, share of full scale", 5},
    {"vignetting", OPT_FAULT + SIMCAMS_VIGNETTING, "V", 0,
     "the corners get so much less light, 0 to 0.99; cos^4 between", 5},
    {"gain", OPT_FAULT + SIMCAMS_GAIN, "V", 0, "factor on the signal (1)", 5},
    {"exposure", OPT_FAULT + SIMCAMS_EXPOSURE, "V", 0, "another, for an exposure ladder (1)", 5},
    {"response", OPT_FAULT + SIMCAMS_RESPONSE, "V", 0, "the sensor's exponent (1: linear)", 5},
    {"pedestal", OPT_FAULT + SIMCAMS_PEDESTAL, "V", 0, "share of full scale, instead of --black's",
     5},
    {"hot", OPT_FAULT + SIMCAMS_HOT, "V", 0, "share of pixels that are hot, always the same", 5},
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
    "  WHAT CAM NUMBER         WHAT is drop, loss, delay, skew, drift, jitter,\n"
    "                          reorder, duplicate, size, corrupt, miss, hostile,\n"
    "                          ptp-offset or late\n"
    "  WHAT CAM VALUE          lens and sensor, as the options above; light goes\n"
    "                          through cap, flood, flat, empty, shift, blur,\n"
    "                          mirrored, background, vignetting, exposure, gain,\n"
    "                          response, pedestal, hot in this order; then noise,\n"
    "                          clipping\n"
    "  freeze CAM on|off       image and stamp stand still\n"
    "  still CAM on|off        only the image does\n"
    "  stuck CAM on|off        only its clock stands still\n"
    "  no-ptp CAM on|off       it hears no PTP master\n"
    "  ptp-master CAM on|off   it is PTP master itself\n"
    "  trigger-mode CAM 0|1    TriggerMode is changed behind the client's back\n"
    "  lock-trigger CAM on|off and cannot be set during acquisition\n"
    "  kill CAM, revive CAM, reboot CAM [SECONDS]\n"
    "  jump CAM SECONDS        its clock jumps\n"
    "  ids CAM [NUMBER]        its frame numbers begin anew, with 1 or this\n"
    "  line HZ, pulse          trigger line: pulses, or one\n"
    "  link MBIT_S [KIB]       what the network carries (0: all), the switch's buffer\n"
    "  pose NUMBER             the board goes on to that pose, counted from 0\n"
    "  switch SECONDS          the switch reboots: nothing passes for so long\n"
    "  stats                   prints what was really sent, lost, ignored\n"
    "\n"
    "Examples:\n"
    "  pyrovox simcams --private-net -- pyrovoxd --config my.yaml\n"
    "      eight cameras and a daemon, as an ordinary user\n"
    "  pyrovox simcams --private-net -- arv-tool-0.8\n"
    "      what Aravis' own tool sees\n"
    "  pyrovox simcams --rig rig.yaml --drop cam3=0.05 --kill cam1@20 \\\n"
    "          --address 127.0.0.2\n"
    "      a rig of your own, with faults, on addresses that this host has\n"
    "  pyrovox simcams --private-net --line-hz 30 --at 10:'miss cam2 0.1' \\\n"
    "          -- pyrovoxd --config my.yaml\n"
    "      cameras on a trigger line; after 10 s one of them misses a tenth of the pulses\n"
    "  pyrovox simcams --private-net --at 10:'cap cam2 on' --at 20:'cap cam2 off' \\\n"
    "          --shift cam3=64:0 --gain cam1=0.5 -- pyrovoxd --config my.yaml\n"
    "      what the daemon makes of a lens cap, a bumped tripod, another gain\n"
    "  pyrovox simcams --size 320x240 --write-rig rig.yaml --write-frames take\n"
    "      a recording to try pyrovox reconstruct on\n"
    "  pyrovox simcams --private-net --cameras 4 --radius 1.6 --height 0.9 \\\n"
    "          --board charuco:5x6:0.14:0.105:two-sided -- pyrovox calibrate live ...\n"
    "      cameras that are shown a board: pyrovox calibrate live --help goes on from here\n";

static void want_format(struct argp_state *st, const char *arg, struct simcams_args *a)
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

/* One for all channels, or three. */
static void parse_noise(struct argp_state *st, const char *arg, double noise[3])
{
    char text[64], *save = NULL;
    size_t n = 0;
    if (snprintf(text, sizeof text, "%s", arg) >= (int)sizeof text)
        argp_error(st, "--noise %s: too long", arg);
    for (char *s = strtok_r(text, ",", &save); s != NULL && n < 4; s = strtok_r(NULL, ",", &save))
        if (n++ < 3)
            noise[n - 1] = cli_arg_double(st, "noise", s, 0, 100);
    if (n != 1 && n != 3)
        argp_error(st, "--noise %s: should be one number, or three: of red, green and blue", arg);
    if (n == 1)
        noise[1] = noise[2] = noise[0];
}

static void add_fault(struct argp_state *st, int key, const char *arg, struct simcams_args *a)
{
    if (a->n_faults == SIMCAMS_MAX_OPTIONS)
        argp_error(st, "too many fault options");
    a->fault[a->n_faults++] =
        (struct simcams_fault_option){(enum simcams_fault_kind)(key - OPT_FAULT), arg};
}

static error_t simcams_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct simcams_args *a = st->input;
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
    case OPT_RADIUS: a->radius = cli_arg_double(st, "radius", arg, 0.8, 100); return 0;
    case OPT_HEIGHT: a->raise = cli_arg_double(st, "height", arg, 0, 100); return 0;
    case OPT_BOARD: a->board = arg; return 0;
    case OPT_POSES: cli_arg_int(st, "poses", arg, 1, 10000, &a->poses); return 0;
    case OPT_HOLD: a->hold_s = cli_arg_double(st, "hold", arg, 0, 1e6); return 0;
    case OPT_FPS: a->fps = cli_arg_double(st, "fps", arg, 0.1, 1000); return 0;
    case OPT_BLACK: a->black = cli_arg_double(st, "black", arg, 0, 50); return 0;
    case OPT_NOISE: parse_noise(st, arg, a->noise); return 0;
    case OPT_SIZE: cli_arg_size(st, "size", arg, 8, 16384, &a->width, &a->height); return 0;
    case OPT_FORMAT: want_format(st, arg, a); return 0;
    case OPT_BOOT_CLOCK: a->boot_clock = true; return 0;
    case OPT_ZIP: a->zip = true; return 0;
    case OPT_LINE_HZ: a->line_hz = cli_arg_double(st, "line-hz", arg, 0, 1000); return 0;
    case OPT_LINK: a->link_mbit = cli_arg_double(st, "link", arg, 0, 1e6); return 0;
    case OPT_CAMERA_LINK: a->camera_mbit = cli_arg_double(st, "camera-link", arg, 1, 1e6); return 0;
    case OPT_TICK_HZ: a->tick_hz = cli_arg_double(st, "tick-hz", arg, 1e3, 1e10); return 0;
    case OPT_PTP_MS: a->ptp_ms = cli_arg_double(st, "ptp-ms", arg, 1, 1e6); return 0;
    case OPT_TAI: a->tai_s = cli_arg_double(st, "tai", arg, -1e6, 1e6); return 0;
    case OPT_AT:
    case OPT_KILL:
    case OPT_FREEZE:
        if (a->n_plans == SIMCAMS_MAX_OPTIONS)
            argp_error(st, "too many timed faults");
        a->plan[a->n_plans++] =
            (struct simcams_plan_option){key == OPT_AT       ? SIMCAMS_OPT_AT
                                         : key == OPT_FREEZE ? SIMCAMS_OPT_FREEZE
                                                             : SIMCAMS_OPT_KILL,
                                         arg};
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

bool simcams_options(int argc, char **argv, struct simcams_args *a)
{
    *a = (struct simcams_args){.address = "127.0.0.2",
                               .cameras = 8,
                               .ring = 30,
                               .seed = 1,
                               .sub = 1,
                               .max_memory = 1024,
                               .voxels = 64,
                               .width = 640,
                               .height = 480,
                               .radius = 2.5,
                               .poses = 30,
                               .hold_s = 2,
                               .fps = 15,
                               .black = 2,
                               .noise = {0.5, 0.5, 0.5},
                               .fmt = CAP_RGB8};
    const struct argp argp = {.options = options,
                              .parser = simcams_parse_opt,
                              .args_doc = "[-- COMMAND ARGS...]",
                              .doc = doc};
    return argp_parse(&argp, argc, argv, ARGP_IN_ORDER, NULL, a) == 0;
}
