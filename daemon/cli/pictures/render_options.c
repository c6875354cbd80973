#include "daemon/cli/pictures/render_options.h"

#include <argp.h>
#include <math.h>
#include <string.h>

#include "base/yaml.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/pictures/film.h"
#include "recon/view/render.h"

enum {
    OPT_RIG = 0x100,
    OPT_CAMERA,
    OPT_EYE,
    OPT_LOOK_AT,
    OPT_UP,
    OPT_FOV,
    OPT_ANGLE,
    OPT_STRIP,
    OPT_ORBIT,
    OPT_ROUNDS,
    OPT_PATH,
    OPT_ELEVATION,
    OPT_ROOM,
    OPT_SIZE,
    OPT_SUB,
    OPT_GAMMA,
    OPT_TONE,
    OPT_DEPTH,
    OPT_VIDEO,
    OPT_EXPOSURE,
    OPT_FORMAT,
    OPT_FPS,
    OPT_ANEW,
    OPT_QUIET,
    OPT_THREADS
};

static const struct argp_option options[] = {
    {NULL, 0, NULL, 0, "Viewpoint, one of:", 1},
    {"camera", OPT_CAMERA, "NAME", 0, "this camera of the rig (--rig), distortion included", 1},
    {"eye", OPT_EYE, "X,Y,Z", 0, "an ideal camera at this place, metres", 1},
    {"angle", OPT_ANGLE, "DEG", 0, "turntable view at this angle (0: from +x, 90: from +y)", 1},
    {"strip", OPT_STRIP, "A0,A1,N", 0, "N turntable views from A0 to A1 degrees side by side", 1},
    {"orbit", OPT_ORBIT, "N", 0,
     "animation: N views to a turn of the turntable; with several volumes picture i shows volume "
     "i, "
     "from the first again after the last, and it turns until all were shown",
     1},
    {"path", OPT_PATH, "FILE", 0, "animation: along key frames (below), --fps pictures a second",
     1},
    {NULL, 0, NULL, 0, "More about it:", 2},
    {"rig", OPT_RIG, "FILE", 0,
     "rig.yaml that has the camera (and the box of a bare .npy, and bodies, which hide what is "
     "behind them)",
     2},
    {"look-at", OPT_LOOK_AT, "X,Y,Z", 0,
     "what --eye and --path look at (default: middle of the volume)", 2},
    {"up", OPT_UP, "X,Y,Z", 0, "what is up for them (default: 0,0,1)", 2},
    {"fov", OPT_FOV, "DEG", 0, "their angle from the image's top to its bottom (default 40)", 2},
    {"rounds", OPT_ROUNDS, "N", 0,
     "turns of --orbit (default: until every volume was shown); each view's rays are kept for the "
     "next",
     2},
    {"elevation", OPT_ELEVATION, "DEG", 0,
     "turntable camera above the horizon (default 5, in a room 20)", 2},
    {"size", OPT_SIZE, "WxH", 0,
     "pixels of a view (default: --eye, --path and --room 640x480, turntable 240x320, a camera its "
     "own)",
     2},
    {"room", OPT_ROOM, NULL, 0,
     "the flame in a virtual room: it lights floor, walls, a pillar on the side of +x and a block, "
     "which throw shadows and hide it",
     2},
    {NULL, 0, NULL, 0, "Pictures:", 3},
    {"sub", OPT_SUB, "N", 0, "N x N rays per pixel (default 2)", 3},
    {"exposure", OPT_EXPOSURE, "F|auto", 0,
     "factor on the values, one for all pictures (default: auto, the brightest frame fills "
     "the range, with a tone curve 4 times that, --room: 5 times, for the room to be seen; "
     "--camera: "
     "1, as recorded)",
     3},
    {"tone", OPT_TONE, "clip|reinhard|filmic", 0,
     "what becomes of what is too bright: cut off (default), held with its colour, or held and "
     "going "
     "white as on film",
     3},
    {"gamma", OPT_GAMMA, "G", 0, "display gamma (default 2.2; --camera: 1, as recorded)", 3},
    {"depth", OPT_DEPTH, "8|16", 0, "bits of a .png's samples (default 8)", 3},
    {"format", OPT_FORMAT, "png|npy|both", 0, "files of an animation in a folder (default png)", 3},
    {"video", OPT_VIDEO, "FILE", 0,
     "an animation into this .mp4, .mov, .mkv or .webm, by ffmpeg; OUT is left out", 3},
    {"fps", OPT_FPS, "N", 0, "pictures a second of an .apng, a video and --path (default 15)", 3},
    {"anew", OPT_ANEW, NULL, 0,
     "trace every picture's rays anew, instead of keeping those of a fixed viewpoint: needs less "
     "memory, takes longer",
     3},
    {"quiet", OPT_QUIET, NULL, 0, "no progress", 3},
    {"threads", OPT_THREADS, "N", 0, "threads to work with (0: one per CPU)", 3},
    {0},
};

/* Up to `max` numbers separated by `sep`; how many, 0 when one is not a number. */
static int render_options_split(const char *s, char sep, double *v, int max)
{
    char copy[96];
    if (strlen(s) >= sizeof copy)
        return 0;
    memcpy(copy, s, strlen(s) + 1);
    const char stop[2] = {sep, '\0'};
    char *rest = copy, *item;
    int n = 0;
    while ((item = strsep(&rest, stop)) != NULL)
        if (n == max || pvx_parse_double(item, -1e6, 1e6, &v[n++]) != PVX_OK)
            return 0;
    return n;
}

static void render_options_point(struct argp_state *state, const char *what, const char *s,
                                 double out[3])
{
    if (render_options_split(s, ',', out, 3) != 3)
        argp_error(state, "%s %s: should be X,Y,Z, three numbers", what, s);
}

static void seen_from(struct argp_state *state, enum render_from from)
{
    struct render_options *o = state->input;
    if (o->from != RENDER_NOTHING)
        argp_error(state, "only one of --camera, --eye, --angle, --strip, --orbit and --path can "
                          "be the viewpoint");
    o->from = from;
}

static void parse_strip(struct argp_state *state, const char *arg)
{
    struct render_options *o = state->input;
    double v[3] = {0};
    if (render_options_split(arg, ',', v, 3) != 3 || v[2] < 1 || v[2] > 64 || v[2] != floor(v[2]))
        argp_error(state, "--strip %s: should be A0,A1,N: degrees, degrees, 1 to 64 views", arg);
    o->deg0 = v[0];
    o->deg1 = v[1];
    o->views = (int)v[2];
}

static void parse_format(struct argp_state *state, const char *arg)
{
    struct render_options *o = state->input;
    o->png = strcmp(arg, "png") == 0 || strcmp(arg, "both") == 0;
    o->npy = strcmp(arg, "npy") == 0 || strcmp(arg, "both") == 0;
    if (!o->png && !o->npy)
        argp_error(state, "--format %s: should be png, npy or both", arg);
}

static void parse_tone(struct argp_state *state, const char *arg)
{
    static const char *const name[] = {"clip", "reinhard", "filmic"};
    struct render_options *o = state->input;
    for (int i = 0; i < 3; i++)
        if (strcmp(arg, name[i]) == 0) {
            o->look.tone = (enum look_tone)i;
            return;
        }
    argp_error(state, "--tone %s: should be clip, reinhard or filmic", arg);
}

static void check_film(struct argp_state *state, const struct render_options *o)
{
    if (o->npy)
        argp_error(state,
                   "%s: an animation in one file is for looking at; --format npy and both "
                   "need a folder",
                   o->out);
    if (o->look.depth == 16)
        argp_error(state, "%s: --depth 16 is for .png; a film has 8 bits", o->out);
}

static void render_options_check(struct argp_state *state)
{
    const struct render_options *o = state->input;
    if (o->out == NULL || o->n_sources == 0)
        argp_error(state, "which volume, and where to?  VOL.npy OUT.(png|npy), or VOLDIR OUTDIR");
    if (o->from == RENDER_NOTHING)
        argp_error(state, "from where?  One of --camera NAME, --eye X,Y,Z, --angle DEG, --strip "
                          "A0,A1,N, --orbit N and --path FILE");
    if (o->from == RENDER_CAMERA && o->rig == NULL)
        argp_error(state, "--camera needs --rig FILE, which has the camera");
    if (o->from == RENDER_CAMERA && o->width != 0)
        argp_error(state, "--size is for ideal cameras; a camera of the rig has its own");
    if (o->film)
        check_film(state, o);
    if (o->rounds > 0 && o->from != RENDER_ORBIT)
        argp_error(state, "--rounds are turns of --orbit N");
    if (o->from == RENDER_STRIP && o->n_sources > 1)
        argp_error(state, "--strip shows one volume; --orbit N steps through several");
}

static error_t render_options_parse(int key, char *arg, struct argp_state *state)
{
    struct render_options *o = state->input;
    switch (key) {
    case OPT_RIG: o->rig = arg; return 0;
    case OPT_CAMERA:
        seen_from(state, RENDER_CAMERA);
        o->camera = arg;
        return 0;
    case OPT_EYE:
        seen_from(state, RENDER_EYE);
        render_options_point(state, "--eye", arg, o->eye);
        return 0;
    case OPT_LOOK_AT:
        o->target_given = true;
        render_options_point(state, "--look-at", arg, o->target);
        return 0;
    case OPT_UP: render_options_point(state, "--up", arg, o->up); return 0;
    case OPT_FOV: o->fov_deg = cli_arg_double(state, "fov", arg, 0.01, 175); return 0;
    case OPT_ANGLE:
        seen_from(state, RENDER_ANGLE);
        o->deg0 = cli_arg_double(state, "angle", arg, -3600, 3600);
        o->deg1 = o->deg0;
        return 0;
    case OPT_STRIP:
        seen_from(state, RENDER_STRIP);
        parse_strip(state, arg);
        return 0;
    case OPT_ORBIT:
        seen_from(state, RENDER_ORBIT);
        o->views = (int)cli_arg_whole(state, "orbit", arg, 1, 100000);
        return 0;
    case OPT_SIZE: cli_arg_size(state, "size", arg, 1, 8192, &o->width, &o->height); return 0;
    case OPT_ELEVATION:
        o->elevation_deg = cli_arg_double(state, "elevation", arg, -85, 85);
        return 0;
    case OPT_ROOM: o->room = true; return 0;
    case OPT_SUB: o->sub = (int)cli_arg_whole(state, "sub", arg, 1, REC_RENDER_SUB_MAX); return 0;
    case OPT_EXPOSURE:
        o->look.exposure = 0;
        if (strcmp(arg, "auto") != 0)
            o->look.exposure = cli_arg_double(state, "exposure", arg, 1e-9, 1e9);
        return 0;
    case OPT_GAMMA: o->look.gamma = cli_arg_double(state, "gamma", arg, 0.1, 10); return 0;
    case OPT_TONE: parse_tone(state, arg); return 0;
    case OPT_DEPTH:
        o->look.depth = (int)cli_arg_whole(state, "depth", arg, 8, 16);
        if (o->look.depth != 8 && o->look.depth != 16)
            argp_error(state, "--depth %s: should be 8 or 16", arg);
        return 0;
    case OPT_VIDEO:
        o->out = arg;
        if (film_kind(arg) != FILM_VIDEO)
            argp_error(state, "--video %s: a video is a .mp4, .mov, .mkv or .webm", arg);
        return 0;
    case OPT_ROUNDS: o->rounds = (int)cli_arg_whole(state, "rounds", arg, 1, 100000); return 0;
    case OPT_PATH:
        seen_from(state, RENDER_PATH);
        o->path = arg;
        return 0;
    case OPT_FORMAT: parse_format(state, arg); return 0;
    case OPT_FPS: o->fps = (int)cli_arg_whole(state, "fps", arg, 1, 100); return 0;
    case OPT_ANEW: o->anew = true; return 0;
    case OPT_QUIET: o->quiet = true; return 0;
    case OPT_THREADS: o->threads = (unsigned)cli_arg_whole(state, "threads", arg, 0, 256); return 0;
    case ARGP_KEY_ARGS: /* all that are left, after all options: sources, then where to */
        o->source = state->argv + state->next;
        o->n_sources = state->argc - state->next;
        if (o->out == NULL)
            o->out = o->source[--o->n_sources];
        o->film = film_kind(o->out) != FILM_NONE;
        state->next = state->argc;
        return 0;
    case ARGP_KEY_END: render_options_check(state); return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

void render_parse(int argc, char **argv, struct render_options *o)
{
    static const struct argp parser = {
        .options = options,
        .parser = render_options_parse,
        .args_doc = "VOL.npy OUT.(png|npy)\nVOLDIR|VOL.npy... OUTDIR|OUT.(apng|mp4)\n"
                    "--video FILE VOLDIR|VOL.npy...",
        .doc =
            "Render views of reconstructed volumes by forward projection.\vBox and basis come "
            "from the .json beside each .npy, else from the rig.  A .npy picture is float32 "
            "[h][w][channels], linear, unclipped, in the units of the input images; --exposure, "
            "--tone and --gamma are for what is looked at.  A viewpoint that comes again keeps its "
            "rays: each picture after the first is one matrix product.\n\n"
            "Key frames of --path, in YAML; between them the camera's way is smooth:\n"
            "  version: 1\n"
            "  keys:\n"
            "    - { t: 0, eye: [2, -1, 0.8] }                     # seconds, metres\n"
            "    - { t: 3, eye: [0, -2, 1.5], look_at: [0, 0, 0.4], up: [0, 0, 1], fov: 25 }\n"
            "    - { t: 5, camera: cam3 }                          # as that of --rig stands\n\n"
            "Examples:\n"
            "  pyrovox render --rig rig.yaml --camera cam7 vol/000000.npy cam7.npy\n"
            "      what cam7 should have seen, to compare with what it saw\n"
            "  pyrovox render --strip 0,120,5 vol/000000.npy turn.png\n"
            "      five sides of one volume in one picture\n"
            "  pyrovox render --eye 2,-1,0.8 --size 480x640 vol movie\n"
            "      all volumes of a folder from one place: movie/000000.png ...\n"
            "  pyrovox render --orbit 120 vol movie\n"
            "      the flame burns while the camera goes round it\n"
            "  pyrovox render --room --angle 0 vol/000000.npy room.png\n"
            "      the flame lights a room, half hidden by a pillar\n"
            "  pyrovox render --room --orbit 120 vol/000000.npy room.apng\n"
            "      once round it, one file that browsers play\n"
            "  pyrovox render --orbit 120 --tone filmic --fps 30 vol --video flame.mp4\n"
            "      the same as a video, the core of the flame not cut off\n"};
    *o = (struct render_options){.up = {0, 0, 1},
                                 .fov_deg = 40,
                                 .elevation_deg = NAN,
                                 .sub = 2,
                                 .fps = 15,
                                 .look = {.exposure = -1, .gamma = -1, .depth = 8},
                                 .png = true};
    argp_parse(&parser, argc, argv, 0, NULL, o);
    bool recorded = o->from == RENDER_CAMERA && !o->room;
    if (isnan(o->elevation_deg))
        o->elevation_deg = o->room ? 20 : 5;
    if (o->look.gamma < 0)
        o->look.gamma = recorded ? 1 : 2.2;
    if (o->look.exposure < 0)
        o->look.exposure = recorded ? 1 : 0;
    if (o->width == 0) {
        bool wide = o->from == RENDER_EYE || o->from == RENDER_PATH || o->room;
        o->width = wide ? 640 : 240;
        o->height = wide ? 480 : 320;
    }
}
