#include "daemon/cli/simcams/options.h"

#include <string.h>

#include "daemon/cli/common/arg.h"
#include "recon/spectral/soot.h"

enum { OPT_SIZE = 0x100, OPT_FORMAT, OPT_NOISE, OPT_SET, OPT_AT };

#define AT(field) CLI_AT(struct simcams_args, field)

static const struct cli_row rows[] = {
    {.help = "Cameras:"},
    {"rig", "FILE", AT(rig), 0, 0, "serve the cameras of this rig.yaml"},
    {"cameras", "N", AT(cameras), 1, REC_MAX_CAMERAS, "without --rig: N cameras on a ring (8)"},
    {"size", "WxH", CLI_KEY(OPT_SIZE), 0, 0, "without --rig: image size in pixels (640x480)"},
    {"radius", "METRES", AT(radius), 0.8, 100, "without --rig: radius of the ring (2.5)"},
    {"height", "METRES", AT(raise), 0, 100,
     "without --rig: height of the cameras above the middle of the volume (0). To see a board on "
     "the floor, take half the radius or more"},
    {"voxels", "N", AT(voxels), 1, REC_GRID_MAX,
     "without --rig: voxels per side, for --write-rig (64)"},
    {"write-rig", "FILE", AT(write_rig), 0, 0, "write the rig of these cameras as rig.yaml"},
    {"write-frames", "DIR", AT(write_frames), 0, 0,
     "serve nothing; write the images as DIR/<camera>/<6 digits>.png for pyrovox reconstruct"},
    {"address", "IPV4", AT(address), 0, 0,
     "address of the first camera; the others follow (127.0.0.2)"},
    {"private-net", NULL, AT(private_net), 0, 0,
     "make a private network and run COMMAND in it; needs no root"},
    {.help = "Images:"},
    {"format", "FORMAT", CLI_KEY(OPT_FORMAT), 0, 0, "mono8, rgb8 (default) or bayerrg8"},
    {"fps", "HZ", AT(fps), 0.1, 1000,
     "images per second of the flame's motion (15). The client sets the frame rate"},
    {"ring", "N", AT(ring), 1, 100000, "images per camera, rendered first and then repeated (30)"},
    {"seed", "N", AT(seed), 0, UINT32_MAX, "another number is another flame (1)"},
    {"kelvin", "T", AT(kelvin), REC_SOOT_T_LO, REC_SOOT_T_HI,
     "the flame is soot of this temperature everywhere, in the colours that --rig's `spectral:` "
     "gives it"},
    {"black", "PERCENT", AT(black), 0, 50, "black level, share of full scale (2)"},
    {"noise", "PERCENT[,G,B]", CLI_KEY(OPT_NOISE), 0, 0,
     "standard deviation of Gaussian noise, share of full scale (0.5); one number, or one each "
     "for red, green and blue"},
    {"sub", "N", AT(sub), 1, 16, "N x N rays per pixel (1)"},
    {"board", "SPEC", AT(board), 0, 0,
     "show a calibration board instead of the flame; SPEC as for `pyrovox calibrate board`. It "
     "lies on the floor first, then goes from pose to pose through the volume"},
    {"poses", "N", AT(poses), 1, 10000,
     "with --board: number of poses before the first returns (30)"},
    {"hold", "SECONDS", AT(hold_s), 0, 1e6,
     "with --board: time at each pose once all cameras send (2); 0: until a line `pose NUMBER`"},
    {"max-memory", "MIB", AT(max_memory), 1, 1 << 24, "most memory for the images (1024)"},
    {.help = "Clocks and GenICam:"},
    {"tick-hz", "HZ", AT(tick_hz), 1e3, 1e10, "rate of the cameras' clocks without PTP (1e9)"},
    {"boot-clock", NULL, AT(boot_clock), 0, 0, "these clocks count from the start, not from 1970"},
    {"ptp-ms", "MS", AT(ptp_ms), 1, 1e6, "time from PtpEnable to Slave (2000)"},
    {"zip-xml", NULL, AT(zip), 0, 0, "serve the GenICam file zipped"},
    {.help = "Faults and orders (LINE: see below):"},
    {"set", "LINE", CLI_KEY(OPT_SET), 0, 0,
     "from the start, before images are made; may be repeated"},
    {"at", "S:LINE", CLI_KEY(OPT_AT), 0, 0, "S seconds after the start; may be repeated"},
    {"control", NULL, AT(control), 0, 0, "read lines on standard input"},
    {0}};

#define INTRO                                                                                    \
    "Serve simulated cameras over the real GigE Vision protocol.\v"                              \
    "Each camera shows its own view of a burning flame. All cameras show the same instant, and " \
    "time stamps are exact: image i of a camera is the flame at i/fps of a period of ring/fps. " \
    "The "                                                                                       \
    "daemon receives the same packets as from physical cameras.\n"                               \
    "\n"                                                                                         \
    "Prints one line when the cameras answer: serving 8 cameras on 127.0.0.2..127.0.0.9\n"
#define EXAMPLES                                                                        \
    "\nExamples:\n"                                                                     \
    "  pyrovox simcams --private-net -- pyrovoxd --config my.yaml\n"                    \
    "      eight cameras and a daemon, as an ordinary user\n"                           \
    "  pyrovox simcams --size 320x240 --write-rig rig.yaml --write-frames take\n"       \
    "      a recording to try pyrovox reconstruct on\n"                                 \
    "  pyrovox simcams --private-net --at 10:'cap cam2 on' --at 20:'cap cam2 off' \\\n" \
    "          --set 'shift cam3 64:0' --set 'gain cam1 0.5' \\\n"                      \
    "          -- pyrovoxd --config my.yaml\n"                                          \
    "      how the daemon reacts to a lens cap, a bumped tripod, another gain\n"
#define MORE                                                                                  \
    "  pyrovox simcams --private-net -- arv-tool-0.8\n"                                       \
    "      what Aravis' own tool sees\n"                                                      \
    "  pyrovox simcams --rig rig.yaml --set 'drop cam3 0.05' --at 20:'kill cam1' \\\n"        \
    "          --address 127.0.0.2\n"                                                         \
    "      your own rig, with faults, on addresses of this host\n"                            \
    "  pyrovox simcams --private-net --set 'line 30' --at 10:'miss cam2 0.1' \\\n"            \
    "          -- pyrovoxd --config my.yaml\n"                                                \
    "      a trigger line; after 10 s one camera misses a tenth of the pulses\n"              \
    "  pyrovox simcams --private-net --cameras 4 --radius 1.6 --height 0.9 \\\n"              \
    "          --board charuco:5x6:0.14:0.105:two-sided \\\n"                                 \
    "          -- pyrovox calibrate live --config sim.yaml \\\n"                              \
    "          --board charuco:5x6:0.14:0.105:two-sided \\\n"                                 \
    "          --volume -0.5,-0.5,0,0.5,0.5,1 --out rig.yaml\n"                               \
    "      cameras that see a board; `pyrovox calibrate live --help` makes sim.yaml\n"        \
    "\n"                                                                                      \
    "Lines for --set, --at and --control (CAM is a name, or all):\n"                          \
    " Frames and packets, V a share from 0 to 1:\n"                                           \
    "  drop CAM V              frames that are never sent\n"                                  \
    "  loss CAM V              packets that are lost\n"                                       \
    "  reorder CAM V           packets that another one overtakes\n"                          \
    "  duplicate CAM V         packets that are sent twice\n"                                 \
    "  size CAM V              frames with a wrong width, or cut short\n"                     \
    "  corrupt CAM V           frames with a garbled packet\n"                                \
    "  miss CAM V              triggers that are ignored\n"                                   \
    "  hostile CAM V           frames and answers with malformed packets\n"                   \
    " Times:\n"                                                                               \
    "  delay CAM MS            frames are sent this much later\n"                             \
    "  jitter CAM MS           and by up to this much more\n"                                 \
    "  late CAM N              the image is N frames old, its time stamp is not\n"            \
    "  skew CAM US             the clock is ahead by this\n"                                  \
    "  drift CAM PPM           the clock runs faster by this\n"                               \
    "  ptp-offset CAM US       as a PTP slave it is off by this\n"                            \
    "  jump CAM SECONDS        the clock jumps\n"                                             \
    "  ids CAM [NUMBER]        frame numbers begin again, with 1 or this\n"                   \
    "  freeze CAM on|off       image and time stamp stand still\n"                            \
    "  still CAM on|off        only the image stands still\n"                                 \
    "  stuck CAM on|off        only the clock stands still\n"                                 \
    "  no-ptp CAM on|off       it does not hear the PTP master\n"                             \
    "  ptp-master CAM on|off   it is the PTP master itself\n"                                 \
    " Lens and sensor; light passes them in this order, then come noise and clipping:\n"      \
    "  cap CAM on|off          the lens cap is on\n"                                          \
    "  flood CAM on|off        evenly bright, saturated\n"                                    \
    "  flat CAM N              a diffuse source at half of full scale, at place N;\n"         \
    "                          0: none\n"                                                     \
    "  empty CAM on|off        there is no flame\n"                                           \
    "  shift CAM X:Y           the picture moves by X pixels right, Y down\n"                 \
    "  blur CAM PIXELS         Gaussian, standard deviation\n"                                \
    "  mirrored CAM on|off     left is right\n"                                               \
    "  background CAM V        faint uneven light behind the flame, share of full scale\n"    \
    "  vignetting CAM V        loss of light in the corners, 0 to 0.99\n"                     \
    "  exposure CAM V          factor on the light, for a ladder of exposures (1)\n"          \
    "  gain CAM V              factor on the signal (1)\n"                                    \
    "  response CAM V          exponent of the sensor (1: linear)\n"                          \
    "  pedestal CAM V          black level, share of full scale, instead of --black\n"        \
    "  hot CAM V               share of pixels that are hot, always the same\n"               \
    " Cameras and network:\n"                                                                 \
    "  kill CAM, revive CAM, reboot CAM [SECONDS]\n"                                          \
    "  trigger-mode CAM 0|1    change TriggerMode without telling the client\n"               \
    "  lock-trigger CAM on|off TriggerMode cannot be set during acquisition\n"                \
    "  line HZ, pulse          pulses, or one pulse, on the trigger line of all cameras\n"    \
    "                          (TriggerSource Line1)\n"                                       \
    "  inputs CAM BITS         levels of its lines, the number LineStatusAll: 2 is bit 1\n"   \
    "  link MBIT_S [KIB]       capacity of the network (0: no limit), buffer of the switch\n" \
    "  switch SECONDS          the switch restarts: nothing passes for this time\n"           \
    "  pose NUMBER             the board goes to this pose, counted from 0\n"                 \
    "  stats                   print what was sent, lost and ignored\n"

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

static void keep_line(struct argp_state *st, const char *list[SIMCAMS_MAX_OPTIONS], size_t *n,
                      const char *line)
{
    if (*n == SIMCAMS_MAX_OPTIONS)
        argp_error(st, "'%s': at most %d lines", line, SIMCAMS_MAX_OPTIONS);
    list[(*n)++] = line;
}

static error_t simcams_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct simcams_args *a = st->input;
    switch (key) {
    case OPT_NOISE: parse_noise(st, arg, a->noise); return 0;
    case OPT_SIZE: cli_arg_size(st, "size", arg, 8, 16384, &a->width, &a->height); return 0;
    case OPT_FORMAT: want_format(st, arg, a); return 0;
    case OPT_SET: keep_line(st, a->set, &a->n_set, arg); return 0;
    case OPT_AT: keep_line(st, a->at, &a->n_at, arg); return 0;
    case ARGP_KEY_ARG: /* the command and all words after it are not parsed */
        a->command = &st->argv[st->next - 1];
        st->next = st->argc;
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

void simcams_options(int argc, char **argv, struct simcams_args *a)
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
    bool all = cli_help_all(argc, argv,
                            "rig cameras size fps noise private-net write-rig write-frames set at");
    const struct argp argp = {.parser = simcams_parse_opt,
                              .args_doc = "[-- COMMAND ARGS...]",
                              .doc = all ? INTRO EXAMPLES MORE : INTRO EXAMPLES};
    cli_parse(rows, &argp, ARGP_IN_ORDER, argc, argv, a);
}
