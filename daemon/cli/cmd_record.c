/* pyrovox record - subscriber -> DIR/SET.npy and DIR/SET.json. */
#include <argp.h>
#include <errno.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "daemon/cli/arg.h"
#include "daemon/cli/cli.h"
#include "daemon/cli/record_file.h"
#include "daemon/config/endpoints.h"
#include "proto/clients/sub.h"

#define WAIT_NS (200 * PVX_NS_PER_MS) /* how long Ctrl-C may take */

struct record {
    const char *endpoint, *key, *control, *raw, *out;
    char default_out[64];
    int64_t volumes; /* stop after so many; 0 = no limit */
    double seconds;  /* after the first volume; 0 = no limit */
    int quiet;
    /* running */
    pvp_sub *sub;
    pvp_decoder *decoder;
    float *dense;
    size_t dense_count;
    char dir[1024]; /* where this session's volumes go */
    uint64_t session, written, unreadable, bytes;
    int64_t begun, told; /* mono: first volume, last status line */
    uint64_t told_written;
    bool in_session, ended, told_waiting;
};

static const struct argp_option options[] = {
    {"endpoint", 'e', "ENDPOINT", 0, "Where the daemon publishes (default: the local daemon)", 0},
    {"key", 'k', "FILE", 0, "Your .key file of `pyrovox keygen`, for a daemon that asks for one",
     0},
    {"out", 'o', "DIR", 0,
     "Folder to make and fill (default: volumes-DATE-TIME); with --raw start: the take's file "
     "(default: the daemon's record.path)",
     0},
    {"raw", 'r', "start|stop", 0, "Let the daemon begin or end a take of the cameras' raw frames",
     0},
    {"control", 'c', "ENDPOINT", 0,
     "The daemon's control socket, for --raw (default: the local daemon)", 0},
    {"volumes", 'n', "N", 0, "Stop after N volumes", 0},
    {"seconds", 's', "S", 0, "Stop S seconds after the first volume", 0},
    {"quiet", 'q', NULL, 0, "No status line", 0},
    {0}};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct record *r = state->input;
    switch (key) {
    case 'e': r->endpoint = arg; return 0;
    case 'k': r->key = arg; return 0;
    case 'o': r->out = arg; return 0;
    case 'q': r->quiet = 1; return 0;
    case 'c': r->control = arg; return 0;
    case 'r':
        if (strcmp(arg, "start") != 0 && strcmp(arg, "stop") != 0)
            argp_error(state, "--raw %s: should be start or stop", arg);
        r->raw = arg;
        return 0;
    case 'n': cli_arg_int(state, "volumes", arg, 1, INT64_MAX, &r->volumes); return 0;
    case 's': r->seconds = cli_arg_double(state, "seconds", arg, 0.001, 1e9); return 0;
    case ARGP_KEY_ARG: argp_error(state, "'%s' is not expected here", arg); return EINVAL;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = parse,
    .doc = "Write the volumes that a running pyrovoxd publishes to disk, or let it record its raw "
           "frames.\vEach volume becomes DIR/SET.npy, float32 [nz][ny][nx][channels], with SET the "
           "number of its frame set in six digits, and DIR/SET.json with origin, spacing, basis, "
           "units, times and the solver's report.  A file is there whole or not at all.  If the "
           "daemon restarts, its further volumes go to DIR/session-ID, as they count anew.\n\n"
           "Volumes that did not arrive are counted from the gaps in the sequence and reported.\n\n"
           "With --raw nothing is written here: the daemon records the cameras' frames to an HDF5 "
           "file beside the live solve, until --raw stop, and `pyrovox status` counts what it "
           "could not.  `pyrovox replay` plays it back.\n\n"
           "Examples:\n"
           "  pyrovox record --seconds 10 --out flame\n"
           "  pyrovox record --raw start --out take.h5; sleep 10; pyrovox record --raw stop\n"
           "  pyrovox record --endpoint tcp://lab:5555 --volumes 100\n\n"
           "Exit: 0 done or daemon ended, 1 failed, 130 stopped by Ctrl-C; what was recorded until "
           "then is complete in each case.",
};

/* An earlier recording is not written over, nor mixed with. */
static pvx_err make_dir(const char *dir, struct pvx_diag *d)
{
    char pattern[1100];
    PVX_TRY(pvx_mkdirs(dir, d));
    snprintf(pattern, sizeof pattern, "%s/[0-9]*.npy", dir);
    glob_t g;
    int found = glob(pattern, GLOB_NOSORT, NULL, &g) == 0;
    globfree(&g);
    if (found)
        return pvx_fail(d, PVX_EBUSY,
                        "%s: holds volumes of an earlier recording; name another folder with --out",
                        dir);
    return PVX_OK;
}

static pvx_err enter_session(struct record *r, const struct pvp_start *s, struct pvx_diag *d)
{
    if (r->in_session && s->session == r->session)
        return PVX_OK;
    if (r->in_session)
        snprintf(r->dir, sizeof r->dir, "%s/session-%016llx", r->out,
                 (unsigned long long)s->session);
    else
        snprintf(r->dir, sizeof r->dir, "%s", r->out);
    if (r->in_session)
        fprintf(stderr, "pyrovox: the daemon restarted; going on in %s\n", r->dir);
    PVX_TRY(make_dir(r->dir, d));
    size_t count = pvp_grid_count(&s->grid);
    if (count != r->dense_count) {
        free(r->dense);
        r->dense_count = 0;
        r->dense = malloc(count * sizeof *r->dense);
        if (r->dense == NULL)
            return pvx_fail(d, PVX_ENOMEM, "no memory for volumes of %u x %u x %u voxels",
                            s->grid.n[0], s->grid.n[1], s->grid.n[2]);
        r->dense_count = count;
    }
    r->in_session = true;
    r->session = s->session;
    if (!r->quiet)
        fprintf(stderr, "recording %u x %u x %u x %u from %s (%s) to %s\n", s->grid.n[0],
                s->grid.n[1], s->grid.n[2], s->grid.channels, r->endpoint, s->software, r->dir);
    return PVX_OK;
}

/* The message's volume into r->dense. */
static pvx_err unpack(struct record *r, const void *msg, size_t len, struct pvp_view *view,
                      struct pvx_diag *d)
{
    PVX_TRY(pvp_decode_volume(msg, len, view, d));
    return pvp_volume_unpack(r->decoder, view, r->dense, r->dense_count, d);
}

/* One message that cannot be read is reported and counted; the recording goes on. */
static pvx_err save(struct record *r, const void *msg, size_t len, struct pvx_diag *d)
{
    struct pvp_view view;
    const struct pvp_start *s = pvp_sub_start(r->sub);
    struct pvx_diag bad = {""};
    pvx_err e = unpack(r, msg, len, &view, &bad);
    if (e != PVX_OK) {
        if (r->unreadable++ == 0)
            fprintf(stderr, "pyrovox: %s\n", pvx_diag_text(&bad, e));
        return PVX_OK;
    }
    PVX_TRY(record_file_save(r->dir, &view, s, r->dense, d));
    r->written++;
    r->bytes += r->dense_count * sizeof *r->dense;
    return PVX_OK;
}

/* Once a second: a line that stays in place on a terminal, every ten seconds one elsewhere. */
static void tell(struct record *r)
{
    int64_t now = pvx_now_mono();
    int tty = isatty(STDERR_FILENO);
    if (r->quiet || now - r->told < (tty ? 1 : 10) * PVX_NS_PER_S)
        return;
    struct pvp_sub_stats st;
    pvp_sub_stats(r->sub, &st);
    double rate = (double)(r->written - r->told_written) * 1e9 / (double)(now - r->told);
    fprintf(stderr, "%s%llu volumes, %.1f/s, %.1f MB, %llu messages lost%s", tty ? "\r" : "",
            (unsigned long long)r->written, rate, (double)r->bytes * 1e-6,
            (unsigned long long)st.lost, tty ? "  \x1b[K" : "\n");
    r->told = now;
    r->told_written = r->written;
}

static pvx_err record_message(struct record *r, const struct pvp_header *h, const void *msg,
                              size_t len, struct pvx_diag *d)
{
    char reason[PVP_REASON_MAX];
    uint64_t session;
    switch (h->type) {
    case PVP_START: return enter_session(r, pvp_sub_start(r->sub), d);
    case PVP_VOLUME:
        if (r->begun == 0)
            r->begun = pvx_now_mono();
        return save(r, msg, len, d);
    case PVP_END:
        if (!r->quiet && pvp_decode_end(msg, len, &session, reason, NULL) == PVX_OK)
            fprintf(stderr, "%sthe daemon ended: %s\n", isatty(STDERR_FILENO) ? "\n" : "", reason);
        r->ended = true;
        return PVX_OK;
    case PVP_STATUS: return PVX_OK;
    }
    return PVX_OK;
}

static bool finished(const struct record *r)
{
    return cli_stop || r->ended || (r->volumes > 0 && r->written >= (uint64_t)r->volumes) ||
           (r->seconds > 0 && r->begun != 0 &&
            (double)(pvx_now_mono() - r->begun) * 1e-9 >= r->seconds);
}

static pvx_err run_loop(struct record *r, struct pvx_diag *d)
{
    int64_t t0 = pvx_now_mono();
    while (!finished(r)) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        pvx_err e = pvp_sub_next(r->sub, WAIT_NS, &h, &msg, &len, d);
        if (e == PVX_OK)
            e = record_message(r, &h, msg, len, d);
        else if (e == PVX_ETIMEDOUT)
            e = PVX_OK;
        PVX_TRY(e);
        if (r->in_session)
            tell(r);
        else if (!r->told_waiting && pvx_now_mono() - t0 > PVX_NS_PER_S) {
            fprintf(
                stderr,
                "waiting for a daemon at %s (`pyrovox status` tells if one runs); Ctrl-C stops\n",
                r->endpoint);
            r->told_waiting = true;
        }
    }
    return PVX_OK;
}

static void conclude(const struct record *r)
{
    struct pvp_sub_stats st;
    pvp_sub_stats(r->sub, &st);
    if (isatty(STDERR_FILENO) && r->in_session && !r->quiet)
        fputc('\n', stderr);
    if (st.lost > 0)
        fprintf(stderr,
                "pyrovox: %llu messages were lost on the way: this disk or this machine is too "
                "slow for the daemon's rate\n",
                (unsigned long long)st.lost);
    if (st.malformed + r->unreadable > 0)
        fprintf(stderr, "pyrovox: %llu messages could not be read (another wire version?)\n",
                (unsigned long long)st.malformed + r->unreadable);
    printf("%llu volumes in %s, %llu messages lost\n", (unsigned long long)r->written, r->out,
           (unsigned long long)st.lost);
}

static int run(int argc, char **argv)
{
    struct record r = {.endpoint = dmn_client_endpoint(DMN_VOLUMES)};
    struct pvx_diag d = {""};
    if (argp_parse(&argp, argc, argv, 0, NULL, &r) != 0)
        return 2;
    if (r.raw != NULL)
        return record_raw(r.control != NULL ? r.control : dmn_client_endpoint(DMN_CONTROL), r.key,
                          r.raw, r.out);
    if (r.out == NULL) {
        time_t now = time(NULL);
        struct tm tm;
        strftime(r.default_out, sizeof r.default_out, "volumes-%Y%m%d-%H%M%S",
                 localtime_r(&now, &tm));
        r.out = r.default_out;
    }
    cli_catch_stop();
    pvx_err e = make_dir(r.out, &d); /* now, not after an hour of waiting */
    if (e == PVX_OK)
        e = pvp_decoder_new(&r.decoder);
    if (e == PVX_OK)
        e = pvp_sub_new(r.endpoint, &(struct pvp_sub_options){.key = r.key}, &r.sub, &d);
    if (e == PVX_OK)
        e = run_loop(&r, &d);
    if (r.sub != NULL)
        conclude(&r);
    if (r.written == 0 && r.out == r.default_out)
        rmdir(r.out); /* fails, rightly, when something is in it */
    if (e == PVX_ENOSPC)
        fprintf(stderr, "pyrovox: the disk is full; the volumes recorded before are complete\n");
    int rc = e != PVX_OK ? cli_error(&d, e) : cli_stop ? 130 : 0;
    pvp_sub_free(&r.sub);
    pvp_decoder_free(&r.decoder);
    free(r.dense);
    return rc;
}

const struct cli_command cmd_record = {"record",
                                       "write a daemon's volumes to disk, or its raw frames", run};
