/* pyrovox convert - a recording of volumes in another format. */
#include <stdio.h>

#include "base/file.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/volumes/volumes.h"

struct convert {
    const char *in, *out;
    int format; /* -1: from the name */
    int64_t from, to;
    struct vol_options o;
    uint64_t written, clamped, behind;
    uint64_t session, newest; /* set that was written last */
    bool looked, sums, cold;  /* bars of sums, or temperatures, stay behind */
};

enum { OPT_FROM = 256, OPT_TO, OPT_UP, OPT_UNIT, OPT_SPLIT, OPT_FPS };

static const struct argp_option options[] = {
    {"format", 'f', "NAME", 0, "npy, hdf5, vdb or nvdb (default: what OUT ends in, as in flame.h5)",
     0},
    {"from", OPT_FROM, "SET", 0, "Only this set and later ones", 0},
    {"to", OPT_TO, "SET", 0, "Only this set and earlier ones", 0},
    {"up", OPT_UP, "y|z", 0, "vdb, nvdb: the axis that points up (default: z; Houdini wants y)", 0},
    {"unit", OPT_UNIT, "m|cm", 0, "vdb, nvdb: unit of length (default: m; Unreal wants cm)", 0},
    {"split", OPT_SPLIT, NULL, 0,
     "vdb, nvdb: grids red, green, blue instead of one of vectors, emission", 0},
    {"fps", OPT_FPS, "F", 0,
     "vdb, nvdb: F files a second of the recording (default: a file for every set)", 0},
    {0}};

static error_t convert_parse(int key, char *arg, struct argp_state *state)
{
    static const char *const ups[] = {"z", "y", NULL}, *const units[] = {"m", "cm", NULL};
    const char *names[VOL_FORMATS + 1] = {NULL};
    struct convert *c = state->input;
    switch (key) {
    case 'f':
        for (int i = 0; i < VOL_FORMATS; i++)
            names[i] = vol_format_names[i];
        c->format = cli_arg_choice(state, "format", arg, names);
        return 0;
    case OPT_FROM: cli_arg_int(state, "from", arg, 0, INT64_MAX, &c->from); return 0;
    case OPT_TO: cli_arg_int(state, "to", arg, 0, INT64_MAX, &c->to); return 0;
    case OPT_UP: c->o.y_up = cli_arg_choice(state, "up", arg, ups) == 1; return 0;
    case OPT_UNIT:
        c->o.unit_m = cli_arg_choice(state, "unit", arg, units) == 1 ? 0.01 : 1;
        return 0;
    case OPT_SPLIT: c->o.split = true; return 0;
    case OPT_FPS: c->o.fps = cli_arg_double(state, "fps", arg, 0.001, 10000); return 0;
    case ARGP_KEY_ARG:
        if (state->arg_num > 1)
            argp_error(state, "'%s': one recording IN and one OUT", arg);
        *(state->arg_num == 0 ? &c->in : &c->out) = arg;
        return 0;
    case ARGP_KEY_END:
        if (c->out == NULL)
            argp_error(state, "name a recording and what to make of it: IN OUT");
        if (c->from > c->to)
            argp_error(state, "--from %lld is after --to %lld", (long long)c->from,
                       (long long)c->to);
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = convert_parse,
    .args_doc = "IN OUT",
    .doc = "Write a recording of volumes in another format.\vExamples:\n"
           "  pyrovox convert flame.h5 flame --format vdb\n"
           "  pyrovox convert flame.h5 flame-houdini --format vdb --up y --fps 24\n"
           "  pyrovox convert flame flame-unreal --format vdb --unit cm --split\n"
           "  pyrovox convert flame.h5 part.h5 --from 100 --to 199\n"
           "\n"
           "IN is a recording of `pyrovox record` or `reconstruct`: a folder of .npy, .vdb or "
           ".nvdb files, an HDF5 file, or one .npy, .vdb or .nvdb. OUT is a file (hdf5) or a new "
           "folder (npy, vdb, nvdb). Nothing is overwritten.\n"
           "\n"
           "vdb and nvdb files are numbered without holes, OUT/NAME_0001.vdb and on, as Blender, "
           "Houdini and Unreal read them. OUT/NAME.json says which set each file shows. Programs "
           "show the grid density by default, and emission has the colours. Values are halves in "
           "vdb, and floats in npy, hdf5 and nvdb. nvdb is for renderers on a GPU.\n"
           "\n"
           "Error bars go along, where IN has them: the grid emission_sd has the deviation of "
           "density and rgb_sd those of three colours (with --split red_sd, green_sd, blue_sd), "
           "sd/NAME.npy for NAME.npy that of each value. Only hdf5 keeps what the bar of a sum "
           "needs, and only vdb keeps the grid temperature. What stays behind is said.\n"
           "\n"
           "Exit: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C. The files written by "
           "then are complete.",
};

static pvx_err choose_format(struct convert *c, struct pvx_diag *d)
{
    static const struct {
        const char *end;
        enum vol_format format;
    } ends[] = {{".npy", VOL_NPY}, {".nvdb", VOL_NVDB}, {".vdb", VOL_VDB}};
    if (c->format < 0 && vol_hdf5_name(c->out))
        c->format = VOL_HDF5;
    for (size_t i = 0; c->format < 0 && i < sizeof ends / sizeof ends[0]; i++)
        if (pvx_path_ends(c->out, ends[i].end))
            c->format = (int)ends[i].format;
    if (c->format < 0)
        return pvx_fail(d, PVX_EINVAL, "%s: of which format?  Say --format npy, hdf5, vdb or nvdb",
                        c->out);
    bool numbered = c->format == VOL_VDB || c->format == VOL_NVDB;
    if (!numbered && (c->o.split || c->o.y_up || c->o.fps > 0 || c->o.unit_m > 0))
        return pvx_fail(d, PVX_EINVAL,
                        "--up, --unit, --split and --fps are for vdb and nvdb, not %s",
                        vol_format_names[c->format]);
    return PVX_OK;
}

/* What --from and --to leave of a gap; false: nothing. */
static bool convert_cut_gap(const struct convert *c, struct vol_gap *g)
{
    const struct vol_gap all = *g;
    if (g->set_first < (uint64_t)c->from)
        g->set_first = (uint64_t)c->from;
    if (g->set_last > (uint64_t)c->to)
        g->set_last = (uint64_t)c->to;
    if (g->set_first > g->set_last)
        return false;
    uint64_t cut = all.set_last - all.set_first - (g->set_last - g->set_first);
    if (cut > 0) /* how many are missing is known where all are */
        g->volumes = all.volumes == all.set_last - all.set_first + 1 ? all.volumes - cut : 0;
    return true;
}

/* Copy the gaps that lie before set `before`, from the k-th on. */
static pvx_err copy_gaps(const struct convert *c, const vol_reader *r, vol_writer *w, uint64_t *k,
                         uint64_t before, struct pvx_diag *d)
{
    const struct vol_gap *g;
    for (; (g = vol_reader_gap(r, *k)) != NULL && g->set_last < before; ++*k) {
        struct vol_gap part = *g;
        if (convert_cut_gap(c, &part))
            PVX_TRY(vol_writer_gap(w, &part, d));
    }
    return PVX_OK;
}

/* --fps chooses files by times of exposure.  Pictures from a folder have none. */
static pvx_err convert_timed(const struct convert *c, vol_reader *r, struct pvx_diag *d)
{
    struct vol_volume v;
    if (!(c->o.fps > 0) || vol_reader_count(r) < 2)
        return PVX_OK;
    PVX_TRY(vol_reader_get(r, 0, &v, d));
    int64_t first_ns = v.v.t_exposure_ns;
    PVX_TRY(vol_reader_get(r, 1, &v, d));
    return v.v.t_exposure_ns != first_ns
               ? PVX_OK
               : pvx_fail(d, PVX_EINVAL,
                          "%s: its volumes have no times, so --fps cannot choose among them; "
                          "without --fps each set is a file",
                          c->in);
}

/* Numbered files show each set of a session once, in order: the writer leaves out what is not after the newest. */
static bool convert_behind(struct convert *c, const struct pvp_volume *v)
{
    bool numbered = c->format == VOL_VDB || c->format == VOL_NVDB;
    if (numbered && !(c->o.fps > 0) && c->written > 0 && v->session == c->session &&
        v->set <= c->newest)
        return true;
    c->session = v->session;
    c->newest = v->set;
    return false;
}

/* Note what of volume k the format cannot hold.  v is read again if it is an hdf5 with bars. */
static pvx_err convert_left(struct convert *c, vol_reader *r, uint64_t k, struct vol_volume *v,
                            struct pvx_diag *d)
{
    c->cold |= v->kelvin != NULL && c->format != VOL_VDB;
    if (c->format == VOL_HDF5 || c->looked || v->bars.sd == NULL)
        return PVX_OK;
    c->looked = true;
    vol_reader_modes(r, true);
    PVX_TRY(vol_reader_get(r, k, v, d));
    c->sums = v->bars.n_modes > 0;
    vol_reader_modes(r, false);
    return vol_reader_get(r, k, v, d);
}

/* Copy the volumes.  *w is opened for the first one: without a volume no file is made. */
static pvx_err convert_copy(struct convert *c, vol_reader *r, vol_writer **w, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "converting"};
    struct vol_volume v;
    uint64_t n = vol_reader_count(r), gap = 0, lo = UINT64_MAX, hi = 0;
    for (uint64_t k = 0; k < n; k++) {
        PVX_TRY(vol_reader_get(r, k, &v, d));
        lo = v.v.set < lo ? v.v.set : lo;
        hi = v.v.set > hi ? v.v.set : hi;
        if (v.v.set >= (uint64_t)c->from && v.v.set <= (uint64_t)c->to) {
            if (*w == NULL)
                PVX_TRY(vol_writer_open((enum vol_format)c->format, c->out, vol_reader_head(r),
                                        &c->o, w, d));
            PVX_TRY(copy_gaps(c, r, *w, &gap, v.v.set, d));
            PVX_TRY(convert_left(c, r, k, &v, d));
            PVX_TRY(vol_writer_put(*w, &v, d));
            bool behind = convert_behind(c, &v.v);
            c->behind += behind;
            c->written += !behind;
            c->clamped += !behind && vol_beyond((enum vol_format)c->format, &v);
        }
        if (!cli_progress(&bar, (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    if (*w == NULL)
        return pvx_fail(d, PVX_ENOENT,
                        "%s: none of its sets, %llu to %llu, is one from --from to --to", c->in,
                        (unsigned long long)lo, (unsigned long long)hi);
    return copy_gaps(c, r, *w, &gap, UINT64_MAX, d);
}

static pvx_err convert_volumes(struct convert *c, struct pvx_diag *d)
{
    vol_reader *r;
    vol_writer *w = NULL;
    struct pvx_diag closing = {""};
    PVX_TRY(vol_reader_open(c->in, &r, d));
    vol_reader_modes(r, c->format == VOL_HDF5); /* no other format has them */
    if (vol_reader_unsolved(r) > 0)
        fprintf(
            stderr,
            "pyrovox: %s: %llu of its sets are not solved, or their part is not there: `pyrovox "
            "reconstruct --join --out FILE` says which; %llu volumes are there\n",
            c->in, (unsigned long long)vol_reader_unsolved(r),
            (unsigned long long)vol_reader_count(r));
    else if (vol_reader_cut(r))
        fprintf(stderr, "pyrovox: %s was cut off, or is being written: %llu volumes are whole\n",
                c->in, (unsigned long long)vol_reader_count(r));
    pvx_err e =
        vol_reader_count(r) > 0 ? PVX_OK : pvx_fail(d, PVX_ENOENT, "%s: no volume in it", c->in);
    PVX_THEN(e, convert_timed(c, r, d));
    PVX_THEN(e, vol_writer_check((enum vol_format)c->format, c->out, d));
    PVX_THEN(e, convert_copy(c, r, &w, d));
    pvx_err e2 = vol_writer_close(&w, &closing);
    vol_reader_close(&r);
    return e != PVX_OK    ? e
           : e2 != PVX_OK ? pvx_fail(d, e2, "%s", pvx_diag_text(&closing, e2))
                          : PVX_OK;
}

static int convert_run(int argc, char **argv)
{
    struct convert c = {.format = -1, .to = INT64_MAX};
    struct pvx_diag d = {""};
    argp_parse(&argp, argc, argv, 0, NULL, &c);
    pvx_err e = choose_format(&c, &d);
    if (e != PVX_OK) {
        cli_error(&d, e);
        return 2;
    }
    cli_catch_stop();
    e = convert_volumes(&c, &d);
    if (e == PVX_OK || e == PVX_ECANCELED)
        printf("%llu volumes in %s\n", (unsigned long long)c.written, c.out);
    if (c.behind > 0)
        fprintf(stderr,
                "pyrovox: %llu volumes are left out: their sets are not after the one before; "
                "hdf5 keeps them\n",
                (unsigned long long)c.behind);
    if (c.sums && e == PVX_OK)
        fprintf(stderr,
                "pyrovox: %s has no bars of sums, heights and volumes: only hdf5 keeps what they "
                "need\n",
                c.out);
    if (c.cold && e == PVX_OK)
        fprintf(stderr, "pyrovox: the grid temperature stays behind: only vdb keeps it\n");
    if (c.clamped > 0)
        fprintf(stderr, VOL_CLAMPED_SAID, (unsigned long long)c.clamped);
    return e == PVX_ECANCELED ? 130 : e != PVX_OK ? cli_error(&d, e) : 0;
}

const struct cli_command cmd_convert = {"convert", "a recording of volumes in another format",
                                        convert_run};
