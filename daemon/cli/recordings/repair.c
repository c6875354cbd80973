/* pyrovox repair - finish a recording of volumes that was cut off. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/volumes/volumes.h"

struct repair {
    const char *file;
    char made[1200], kept[1200]; /* paths: the unfinished new file; the original */
    struct vol_repaired made_of;
};

static error_t repair_parse(int key, char *arg, struct argp_state *state)
{
    struct repair *r = state->input;
    switch (key) {
    case ARGP_KEY_ARG: cli_arg_one(state, "recording", arg, &r->file); return 0;
    case ARGP_KEY_END:
        if (r->file == NULL)
            argp_error(state, "name a recording of volumes, as in flame.h5");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .parser = repair_parse,
    .args_doc = "RECORDING",
    .doc = "Finish a recording of volumes that was cut off by a kill, a power cut or an incomplete "
           "copy.\vExamples:\n"
           "  pyrovox repair flame.h5\n"
           "\n"
           "The whole volumes of an HDF5 file go into a new file, which replaces FILE when it is "
           "complete. The original stays beside it as FILE.cut-off. In a folder of .npy, .vdb or "
           ".nvdb files, damaged files are renamed to NAME.cut-off. The set before takes their "
           "numbers (vdb, nvdb), and the list of files is made again. Damaged volumes are left out "
           "and counted. Where only the error bars of a volume are damaged (npy, hdf5), it stays "
           "without them, and the count is printed too. A recording that was closed in order and "
           "has no damaged volume is "
           "not changed.\n"
           "\n"
           "Pyrovox reads recordings that were cut off as they are. Other programs (h5py, MATLAB, "
           "ParaView) need finished HDF5 files. `pyrovox replay` reads takes of raw frames as they "
           "are.\n"
           "\n"
           "Exit: 0 whole now, 1 failed, 130 stopped by Ctrl-C with FILE as it was.",
};

/* Read all volumes.  *bad: some are damaged. */
static pvx_err repair_try(vol_reader *in, bool *bad, struct pvx_diag *d)
{
    uint64_t n = vol_reader_count(in);
    *bad = false;
    for (uint64_t k = 0; k < n && !cli_stop && !*bad; k++) {
        struct vol_volume v;
        pvx_err e = vol_reader_get(in, k, &v, d);
        *bad = vol_damaged(e);
        if (e != PVX_OK && !*bad)
            return e;
    }
    return PVX_OK;
}

static pvx_err repair_copy(struct repair *r, vol_reader *in, vol_writer *out, struct pvx_diag *d)
{
    uint64_t n = vol_reader_count(in);
    const struct vol_gap *g;
    for (uint64_t k = 0; k < n && !cli_stop; k++) {
        struct vol_volume v;
        pvx_err e = vol_reader_get(in, k, &v, NULL);
        if (vol_damaged(e)) {
            r->made_of.bad++;
            continue;
        }
        PVX_THEN(e, vol_writer_put(out, &v, d));
        if (e != PVX_OK)
            return e;
        r->made_of.good++;
        r->made_of.bare += v.bars.damaged;
        if (isatty(STDERR_FILENO) && (k % 64 == 63 || k + 1 == n))
            fprintf(stderr, "\r%llu of %llu volumes%s", (unsigned long long)(k + 1),
                    (unsigned long long)n, k + 1 == n ? "\n" : "");
    }
    for (uint64_t k = 0; (g = vol_reader_gap(in, k)) != NULL; k++)
        PVX_TRY(vol_writer_gap(out, g, d));
    return PVX_OK;
}

static pvx_err repair_swap(const struct repair *r, struct pvx_diag *d)
{
    if (access(r->kept, F_OK) == 0)
        return pvx_fail(d, PVX_EBUSY, "%s: is there already, of an earlier repair; move it away",
                        r->kept);
    if (rename(r->file, r->kept) != 0 || rename(r->made, r->file) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", r->file, strerror(errno));
    return PVX_OK;
}

static pvx_err repair_finish(struct repair *r, vol_reader *in, struct pvx_diag *d)
{
    vol_writer *out;
    snprintf(r->made, sizeof r->made, "%s.tmp.%ld", r->file, (long)getpid());
    snprintf(r->kept, sizeof r->kept, "%s.cut-off", r->file);
    vol_reader_spare(in);
    PVX_TRY(vol_writer_open(VOL_HDF5, r->made, vol_reader_head(in), NULL, &out, d));
    pvx_err e = repair_copy(r, in, out, d), closing = vol_writer_close(&out, d);
    PVX_THEN(e, closing);
    if (e == PVX_OK && !cli_stop)
        e = repair_swap(r, d);
    if (e != PVX_OK || cli_stop)
        unlink(r->made);
    return e;
}

static pvx_err repair_hdf5(struct repair *r, vol_reader *in, struct pvx_diag *d)
{
    struct pvx_diag one = {""};
    bool joined = vol_joined_reader.is(r->file), bad = false;
    pvx_err e = PVX_OK;
    if (joined && vol_reader_unsolved(in) > 0)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: is made of parts; `pyrovox reconstruct --resume` makes what is "
                        "missing",
                        r->file);
    if (joined || !vol_reader_cut(in))
        e = repair_try(in, &bad, &one);
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s", pvx_diag_text(&one, e));
    if (joined && bad)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s; remove that part, and `pyrovox reconstruct --resume` makes it again",
                        one.text);
    r->made_of.done = !joined && (bad || vol_reader_cut(in));
    r->made_of.good = vol_reader_count(in);
    if (!r->made_of.done || cli_stop)
        return PVX_OK;
    r->made_of.good = 0;
    return repair_finish(r, in, d);
}

static int repair_conclude(const struct repair *r)
{
    const struct vol_repaired *m = &r->made_of;
    struct stat st;
    bool folder = stat(r->file, &st) == 0 && S_ISDIR(st.st_mode);
    printf("%s: %llu %s, ", r->file, (unsigned long long)m->good, folder ? "files" : "volumes");
    if (!m->done) {
        printf("nothing to repair\n");
        return 0;
    }
    printf("finished; %llu damaged %s", (unsigned long long)m->bad,
           folder ? "files put aside" : "ones left out");
    if (folder && m->bad > 0)
        printf(" as *.cut-off");
    if (m->bare > 0)
        printf("; of %llu only the error bars are damaged, and %s", (unsigned long long)m->bare,
               folder ? "put aside as sd/*.cut-off" : "left out");
    if (!folder)
        printf("; the original is %s", r->kept);
    printf("\n");
    return 0;
}

static int repair_run(int argc, char **argv)
{
    struct repair r = {0};
    struct pvx_diag d = {""};
    vol_reader *in = NULL;
    if (argp_parse(&argp, argc, argv, 0, NULL, &r) != 0)
        return 2;
    cli_catch_stop();
    pvx_err e = strlen(r.file) < 1000
                    ? vol_reader_open(r.file, &in, &d)
                    : pvx_fail(&d, PVX_EINVAL, "the name of the file is too long");
    if (e == PVX_OK)
        vol_reader_modes(in, true);
    PVX_THEN(e, vol_reader_format(in) == VOL_HDF5 ? repair_hdf5(&r, in, &d)
                                                  : vol_repair_folder(r.file, &r.made_of, &d));
    vol_reader_close(&in);
    if (e != PVX_OK)
        return cli_error(&d, e);
    return cli_stop ? 130 : repair_conclude(&r);
}

const struct cli_command cmd_repair = {"repair", "finish a recording of volumes that was cut off",
                                       repair_run};
