#include "daemon/cli/pictures/render_options.h"

#include <math.h>
#include <string.h>

#include "base/yaml.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/pictures/film.h"
#include "recon/view/render.h"

enum {
    OPT_CAMERA = 0x100,
    OPT_EYE,
    OPT_LOOK_AT,
    OPT_UP,
    OPT_ANGLE,
    OPT_STRIP,
    OPT_ORBIT,
    OPT_SIZE,
    OPT_DEPTH,
    OPT_EXPOSURE
};

#define AT(field) CLI_AT(struct render_options, field)

static const struct cli_row rows[] = {
    {.help = "Viewpoint, one of:"},
    {"camera", "NAME", CLI_KEY(OPT_CAMERA), 0, 0,
     "this camera of the rig (--rig), with its distortion"},
    {"eye", "X,Y,Z", CLI_KEY(OPT_EYE), 0, 0, "an ideal camera at this place, metres"},
    {"angle", "DEG", CLI_KEY(OPT_ANGLE), 0, 0,
     "turntable view at this angle (0: from +x, 90: from +y)"},
    {"strip", "A0,A1,N", CLI_KEY(OPT_STRIP), 0, 0,
     "N turntable views from A0 to A1 degrees, side by side"},
    {"orbit", "N", CLI_KEY(OPT_ORBIT), 0, 0,
     "animation: the turntable turns, N views to a turn. With several volumes picture i shows "
     "volume i; after the last volume the first comes again, until the turn is complete"},
    {.help = "More about the viewpoint:"},
    {"rig", "FILE", AT(rig), 0, 0,
     "rig.yaml with the camera, the box of a .npy without .json, and bodies, which hide what is "
     "behind them"},
    {"look-at", "X,Y,Z", CLI_KEY(OPT_LOOK_AT), 0, 0,
     "the point that --eye looks at (default: the middle of the volume)"},
    {"up", "X,Y,Z", CLI_KEY(OPT_UP), 0, 0, "the direction that is up for --eye (default: 0,0,1)"},
    {"fov", "DEG", AT(fov_deg), 0.01, 175,
     "the angle of --eye from the top of the image to its bottom (default 40)"},
    {"rounds", "N", AT(rounds), 1, 100000,
     "number of turns of --orbit (default: until every volume was shown). The rays of each view "
     "are kept for the next turn"},
    {"size", "WxH", CLI_KEY(OPT_SIZE), 0, 0,
     "pixels of a view (default: 640x480 for --eye, 240x320 for the turntable, "
     "its own size for a camera)"},
    {.help = "Pictures:"},
    {"sub", "N", AT(sub), 1, REC_RENDER_SUB_MAX, "N x N rays per pixel (default 2)"},
    {"exposure", "F|auto", CLI_KEY(OPT_EXPOSURE), 0, 0,
     "factor on the values, one for all pictures. auto (default): the brightest frame fills the "
     "range; with a tone curve 4 times as much. Default with --camera: 1, as "
     "recorded"},
    {"tone", "clip|reinhard|filmic", AT(look.tone), 0, 0,
     "pixels that are too bright are cut off (clip, default), compressed with their colour "
     "(reinhard), or compressed towards white as on film (filmic)"},
    {"gamma", "G", AT(look.gamma), 0.1, 10,
     "display gamma (default 2.2; with --camera 1, as recorded)"},
    {"depth", "8|16", CLI_KEY(OPT_DEPTH), 0, 0, "bits of a sample of a .png (default 8)"},
    {"format", "png|npy|both", AT(format), 0, 0, "files of an animation in a folder (default png)"},
    {"fps", "N", AT(fps), 1, 100, "pictures a second of an .apng and a video (default 15)"},
    {"anew", NULL, AT(anew), 0, 0,
     "trace the rays of every picture anew instead of keeping those of a viewpoint: this needs "
     "less memory and takes longer"},
    {"quiet", NULL, AT(quiet), 0, 0, "no progress"},
    {"threads", "N", AT(threads), 0, 256, "number of threads (0: one per CPU)"},
    {0},
};

/* Read up to `max` numbers separated by `sep`.  Returns how many; 0: one is not a number. */
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
        argp_error(state, "only one of --camera, --eye, --angle, --strip and --orbit can "
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

static void check_film(struct argp_state *state, const struct render_options *o)
{
    if (o->format != RENDER_PNG)
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
        argp_error(state, "needs a volume and an output: VOL.npy OUT.(png|npy), or VOLDIR OUTDIR");
    if (o->from == RENDER_NOTHING)
        argp_error(state,
                   "needs a viewpoint: one of --camera NAME, --eye X,Y,Z, --angle DEG, --strip "
                   "A0,A1,N and --orbit N");
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
    case OPT_EXPOSURE:
        o->look.exposure =
            strcmp(arg, "auto") == 0 ? 0 : cli_arg_double(state, "exposure", arg, 1e-9, 1e9);
        return 0;
    case OPT_DEPTH:
        o->look.depth = cli_arg_word(state, "depth", arg, "8|16") == 0 ? 8 : 16;
        return 0;
    case ARGP_KEY_ARGS: /* all words after the options: sources, then the output */
        o->source = state->argv + state->next;
        o->n_sources = state->argc - state->next;
        o->out = o->source[--o->n_sources];
        o->film = film_named(o->out);
        state->next = state->argc;
        return 0;
    case ARGP_KEY_END: render_options_check(state); return 0;
    default: return cli_row(rows, key, arg, state, o);
    }
}

void render_parse(int argc, char **argv, struct render_options *o)
{
    const struct argp parser = {
        .parser = render_options_parse,
        .args_doc = "VOL.npy OUT.(png|npy)\nVOLDIR|VOL.npy... OUTDIR|OUT.(apng|mp4|mov|mkv|webm)",
        .doc = "Render views of reconstructed volumes by forward projection, for example\n\n"
               "  pyrovox render --orbit 120 vol movie"
               "\vBox and basis come from the .json beside each .npy, or else from the rig. A .npy "
               "without .json beside others that have one is refused. A .npy "
               "picture is float32 [h][w][channels]: linear, unclipped, in the units of the input "
               "images. --exposure, --tone and --gamma change only .png pictures and films. The "
               "rays of "
               "a viewpoint that returns are kept: each further picture is one matrix product.\n\n"
               "More examples:\n"
               "  pyrovox render --rig rig.yaml --camera cam7 vol/000000.npy cam7.npy\n"
               "      the picture that cam7 should have taken, for comparison\n"
               "  pyrovox render --strip 0,120,5 vol/000000.npy turn.png\n"
               "      five sides of one volume in one picture\n"
               "  pyrovox render --eye 2,-1,0.8 --size 480x640 vol movie\n"
               "      all volumes of a folder from one place: movie/000000.png ...\n"
               "  pyrovox render --orbit 120 vol/000000.npy turn.apng\n"
               "      once round the flame, in one file that browsers play\n"
               "  pyrovox render --orbit 120 --tone filmic --fps 30 vol flame.mp4\n"
               "      a video in which bright parts of the flame keep their detail\n"};
    *o = (struct render_options){.up = {0, 0, 1},
                                 .fov_deg = 40,
                                 .sub = 2,
                                 .fps = 15,
                                 .look = {.exposure = -1, .gamma = -1, .depth = 8}};
    cli_parse(rows, &parser, 0, argc, argv, o);
    bool recorded = o->from == RENDER_CAMERA;
    if (o->look.gamma < 0)
        o->look.gamma = recorded ? 1 : 2.2;
    if (o->look.exposure < 0)
        o->look.exposure = recorded ? 1 : 0;
    if (o->width == 0) {
        o->width = o->from == RENDER_EYE ? 640 : 240;
        o->height = o->from == RENDER_EYE ? 480 : 320;
    }
}
