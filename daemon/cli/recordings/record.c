/* pyrovox record - a subscriber that writes the volumes to disk. */
#include <cjson/cJSON.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/ask.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/verdict.h"
#include "daemon/config/endpoints.h"
#include "daemon/volumes/recorder.h"
#include "proto/clients/sub.h"

enum { KEEP_FREE = 256, ROLL, DAEMON };
#define CONFIG_MAX ((size_t)1 << 20)
#define WAIT_NS    (200 * PVX_NS_PER_MS) /* longest reaction time to Ctrl-C */

struct record {
    const char *endpoint, *key, *control, *raw, *out;
    char default_out[64];
    int64_t parent;  /* process that must be the parent; 0: any */
    int64_t volumes; /* stop after so many; 0 = no limit */
    double seconds;  /* after the first volume; 0 = no limit */
    int quiet;
    /* running */
    pvp_sub *sub;
    pvp_decoder *decoder;
    vol_recorder *rec;
    struct vol_recorder_config config;
    const char *format;
    char path[1200]; /* file or folder of this session's volumes */
    uint64_t session, accepted, unreadable;
    uint64_t next_volume,
        last_set;        /* of the session: number of the next volume message; last known set */
    int64_t begun, told; /* mono: first volume, last status line */
    uint64_t told_written;
    char *daemon_config;
    cJSON *status; /* the daemon's last one, or NULL */
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
    {"format", 'f', "FORMAT", 0,
     "npy: a folder of SET.npy and SET.json; hdf5: one file; vdb, nvdb: a folder of numbered files "
     "for Blender and others (default: as --out ends, .h5 or .hdf5 is hdf5; else npy)",
     0},
    {"raw", 'r', "start|stop", 0, "Let the daemon begin or end a take of the cameras' raw frames",
     0},
    {"control", 'c', "ENDPOINT", 0,
     "The daemon's control socket, for --raw (default: the local daemon)", 0},
    {"volumes", 'n', "N", 0, "Stop after N volumes", 0},
    {"seconds", 's', "S", 0, "Stop S seconds after the first volume", 0},
    {"quiet", 'q', NULL, 0, "No status line", 0},
    {"keep-free", KEEP_FREE, "GB", 0, "End before the disk has less (default: 0)", 0},
    {"roll", ROLL, "S", 0,
     "Go on in another file or folder every S seconds, NAME-0002, NAME-0003, ...: nothing is lost "
     "between them (0: one)",
     0},
    {"daemon", DAEMON, "PID", OPTION_HIDDEN, "End with this process, which began it", 0},
    {0}};

static error_t record_parse(int key, char *arg, struct argp_state *state)
{
    struct record *r = state->input;
    switch (key) {
    case 'e': r->endpoint = arg; return 0;
    case 'k': r->key = arg; return 0;
    case 'o': r->out = arg; return 0;
    case 'f':
        for (int f = 0; f < VOL_FORMATS; f++)
            if (strcmp(arg, vol_format_names[f]) == 0) {
                r->format = vol_format_names[f];
                r->config.format = (enum vol_format)f;
                return 0;
            }
        argp_error(state, "--format %s: should be npy, hdf5, vdb or nvdb", arg);
        return EINVAL;
    case 'q': r->quiet = 1; return 0;
    case KEEP_FREE:
        r->config.options.keep_free_bytes =
            (uint64_t)(cli_arg_double(state, "keep-free", arg, 0, 1e6) * 1e9);
        return 0;
    case ROLL:
        r->config.roll_ns = (int64_t)(cli_arg_double(state, "roll", arg, 0, 1e8) * 1e9);
        return 0;
    case DAEMON: cli_arg_int(state, "daemon", arg, 1, INT32_MAX, &r->parent); return 0;
    case 'c': r->control = arg; return 0;
    case 'r':
        if (strcmp(arg, "start") != 0 && strcmp(arg, "stop") != 0)
            argp_error(state, "--raw %s: should be start or stop", arg);
        r->raw = arg;
        return 0;
    case 'n': cli_arg_int(state, "volumes", arg, 1, INT64_MAX, &r->volumes); return 0;
    case 's': r->seconds = cli_arg_double(state, "seconds", arg, 0.001, 1e9); return 0;
    case ARGP_KEY_END:
        if (r->raw != NULL && (r->format != NULL || r->volumes > 0 || r->seconds > 0 ||
                               r->config.roll_ns > 0 || r->config.options.keep_free_bytes > 0))
            argp_error(state, "--raw: --format, --volumes, --seconds, --keep-free and --roll are "
                              "for volumes; the daemon's takes roll over by its record.roll_s");
        return 0;
    case ARGP_KEY_ARG: argp_error(state, "'%s' is not expected here", arg); return EINVAL;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = record_parse,
    .doc = "Write the volumes of a running pyrovoxd to disk, or let the daemon record its raw "
           "frames.\vExamples:\n"
           "  pyrovox record --seconds 10 --out flame\n"
           "  pyrovox record --raw start --out take.h5; sleep 10\n"
           "  pyrovox record --raw stop\n"
           "  pyrovox record --endpoint tcp://lab:5555 --volumes 100\n"
           "\n"
           "Each volume becomes DIR/SET.npy, float32 [nz][ny][nx][channels]. SET is the number of "
           "its frame set in six digits. DIR/SET.json has origin, spacing, basis, units, times and "
           "the report of the solver. A file is there whole or not at all. If the daemon restarts, "
           "sets are numbered again, and its volumes go to DIR/session-ID (hdf5: "
           "NAME-session-ID.h5). `pyrovox repair` finishes what a killed recorder leaves.\n"
           "\n"
           "Volumes that did not arrive are counted from gaps in the sequence and reported.\n"
           "\n"
           "The last line is the daemon's verdict, as in `pyrovox status`, if the recording is "
           "longer than a "
           "second.\n"
           "\n"
           "With --raw this program writes nothing. The daemon records the frames of the cameras "
           "to an HDF5 file beside the live solve, until --raw stop. `pyrovox status` counts the "
           "frames that it could not record. `pyrovox replay` plays the file.\n"
           "\n"
           "Exit: 0 done or daemon ended, 1 failed, 130 stopped by Ctrl-C. In each case the "
           "recording is complete up to that moment.",
};

/* Begin a session with its first volume: by then the daemon has sent all of its description. */
static pvx_err enter_session(struct record *r, const struct pvp_header *h, uint64_t set,
                             struct pvx_diag *d)
{
    const struct pvp_start *s = pvp_sub_start(r->sub);
    if (r->in_session && s->session == r->session)
        return PVX_OK;
    struct vol_head head = {
        .start = *s, .rig = pvp_sub_rig(r->sub, NULL), .config = r->daemon_config};
    PVX_TRY(vol_recorder_session(r->rec, &head, r->path, sizeof r->path, d));
    if (r->in_session)
        fprintf(stderr, "pyrovox: the daemon restarted; going on in %s\n", r->path);
    r->in_session = true;
    r->session = s->session;
    r->next_volume = h->type_sequence;
    r->last_set = set > 0 ? set - 1 : 0;
    if (!r->quiet)
        fprintf(stderr, "recording %u x %u x %u x %u from %s (%s) to %s\n", s->grid.n[0],
                s->grid.n[1], s->grid.n[2], s->grid.channels, r->endpoint, s->software, r->path);
    return PVX_OK;
}

/* Record that the sets after the last known one, up to `last`, are missing. */
static pvx_err record_gap(struct record *r, enum vol_gap_why why, uint64_t last, uint64_t volumes)
{
    struct vol_gap g = {why, r->last_set + 1, last, volumes};
    if (g.set_first > last)
        return PVX_OK;
    r->last_set = last;
    return vol_recorder_gap(r->rec, &g);
}

/* Record the sets between the last known one and this one as missing, whatever the cause.  The number of this message
 * tells how many volumes were lost on the way. */
static pvx_err record_note_missing(struct record *r, const struct pvp_header *h, uint64_t set)
{
    uint64_t came = h->type_sequence, due = r->next_volume;
    if (set > 0)
        PVX_TRY(record_gap(r, VOL_GAP_LOST, set - 1, came > due ? came - due : 0));
    r->next_volume = came + 1;
    r->last_set = set;
    return PVX_OK;
}

static uint64_t record_number(const cJSON *o, const char *key)
{
    double v = cJSON_GetNumberValue(cJSON_GetObjectItemCaseSensitive(o, key));
    return v >= 1 && v < 0x1p53 ? (uint64_t)v : 0; /* 0: none; NaN too */
}

/* `pyrovox play` publishes which sets of its recording were not solved.  These sets are not lost. */
static pvx_err record_event(struct record *r, const void *msg, size_t len)
{
    const char *json;
    size_t n;
    pvx_err e = PVX_OK;
    if (!r->in_session || pvp_decode_event(msg, len, &json, &n, NULL) != PVX_OK)
        return PVX_OK;
    cJSON *o = cJSON_ParseWithLength(json, n);
    const char *kind = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "kind"));
    const char *why = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "why"));
    uint64_t first = record_number(o, "set_first"), last = record_number(o, "set_last");
    if (kind != NULL && strcmp(kind, "sets_missing") == 0 && why != NULL &&
        strcmp(why, vol_gap_names[VOL_GAP_UNSOLVED]) == 0 && first > r->last_set && last >= first) {
        e = record_gap(r, VOL_GAP_LOST, first - 1, 0);
        PVX_THEN(e, record_gap(r, VOL_GAP_UNSOLVED, last, record_number(o, "volumes")));
    }
    cJSON_Delete(o);
    return e;
}

/* The volume with its error bars, if it has some that can be read. */
static pvx_err record_put(struct record *r, const struct pvp_view *view, struct pvx_diag *d)
{
    size_t len;
    struct pvp_view bars;
    uint32_t doubt = 0;
    const void *msg = pvp_sub_bars(r->sub, &len);
    bool any = msg != NULL && pvp_decode_bars(msg, len, &bars, &doubt, NULL) == PVX_OK;
    return vol_recorder_put(r->rec, r->decoder, view, any ? &bars : NULL, doubt, d);
}

/* Record a volume.  A message that cannot be read is counted and the first one reported.  The recording goes on. */
static pvx_err record_save(struct record *r, const struct pvp_header *h, const void *msg,
                           size_t len, struct pvx_diag *d)
{
    struct pvp_view view;
    struct pvx_diag bad = {""};
    pvx_err e = pvp_decode_volume(msg, len, &view, &bad);
    if (e == PVX_OK) {
        PVX_TRY(enter_session(r, h, view.v.set, d));
        PVX_TRY(record_note_missing(r, h, view.v.set));
        e = record_put(r, &view, &bad);
        r->accepted += e == PVX_OK;
    }
    if (e == PVX_ENOMEM)
        return pvx_fail(d, e, "%s", pvx_diag_text(&bad, e));
    if (e != PVX_OK && r->unreadable++ == 0)
        fprintf(stderr, "pyrovox: %s\n", pvx_diag_text(&bad, e));
    if (e != PVX_OK && r->in_session && view.v.set > 0)
        return vol_recorder_gap(r->rec,
                                &(struct vol_gap){VOL_GAP_UNREADABLE, view.v.set, view.v.set, 1});
    return PVX_OK;
}

/* Print the state.  On a terminal it is one line, renewed each second.  Elsewhere it is a line every ten seconds, but
 * each second for the daemon that began the recording: it counts by these lines. */
static void record_tell(struct record *r)
{
    int64_t now = pvx_now_mono();
    int tty = isatty(STDERR_FILENO), often = tty || r->parent != 0;
    if (r->quiet || now - r->told < (often ? 1 : 10) * PVX_NS_PER_S)
        return;
    struct pvp_sub_stats st;
    struct vol_recorder_stats rec;
    pvp_sub_stats(r->sub, &st);
    vol_recorder_stats(r->rec, &rec);
    double rate = (double)(rec.written - r->told_written) * 1e9 / (double)(now - r->told);
    fprintf(stderr, "%s%llu volumes, %.1f/s, %.1f MB, %llu messages lost%s", tty ? "\r" : "",
            (unsigned long long)rec.written, rate, (double)rec.bytes * 1e-6,
            (unsigned long long)(st.lost + rec.left_out), tty ? "  \x1b[K" : "\n");
    r->told = now;
    r->told_written = rec.written;
}

static pvx_err record_message(struct record *r, const struct pvp_header *h, const void *msg,
                              size_t len, struct pvx_diag *d)
{
    char reason[PVP_REASON_MAX];
    uint64_t session;
    const char *json;
    size_t n;
    switch (h->type) {
    case PVP_START: return PVX_OK;
    case PVP_VOLUME:
        if (r->begun == 0)
            r->begun = pvx_now_mono();
        return record_save(r, h, msg, len, d);
    case PVP_EVENT: return record_event(r, msg, len);
    case PVP_STATUS:
        if (pvp_decode_status(msg, len, &json, &n, NULL) == PVX_OK) {
            cJSON_Delete(r->status);
            r->status = cJSON_ParseWithLength(json, n);
        }
        return PVX_OK;
    case PVP_END:
        if (!r->quiet && pvp_decode_end(msg, len, &session, reason, NULL) == PVX_OK)
            fprintf(stderr, "%sthe daemon ended: %s\n", isatty(STDERR_FILENO) ? "\n" : "", reason);
        r->ended = true;
        return PVX_OK;
    default: return PVX_OK;
    }
}

static bool record_finished(const struct record *r)
{
    return cli_stop || r->ended || (r->volumes > 0 && r->accepted >= (uint64_t)r->volumes) ||
           (r->seconds > 0 && r->begun != 0 &&
            (double)(pvx_now_mono() - r->begun) * 1e-9 >= r->seconds);
}

static pvx_err record_run_loop(struct record *r, struct pvx_diag *d)
{
    int64_t t0 = pvx_now_mono();
    struct vol_recorder_stats st;
    while (!record_finished(r)) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        pvx_err e = pvp_sub_next(r->sub, WAIT_NS, &h, &msg, &len, d);
        if (e == PVX_OK)
            e = record_message(r, &h, msg, len, d);
        else if (e == PVX_ETIMEDOUT)
            e = PVX_OK;
        PVX_TRY(e);
        vol_recorder_stats(r->rec, &st);
        if (st.error != PVX_OK)
            return PVX_OK; /* vol_recorder_finish returns the error */
        if (r->in_session)
            record_tell(r);
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

static void record_conclude(const struct record *r, const struct vol_recorder_stats *rec)
{
    struct pvp_sub_stats st;
    pvp_sub_stats(r->sub, &st);
    if (isatty(STDERR_FILENO) && r->in_session && !r->quiet)
        fputc('\n', stderr);
    if (st.lost > 0)
        fprintf(stderr,
                "pyrovox: %llu messages were lost on the way: this machine or the way to it is too "
                "slow for the daemon's rate\n",
                (unsigned long long)st.lost);
    if (rec->left_out > 0)
        fprintf(
            stderr,
            "pyrovox: %llu volumes were left out: this disk is too slow for the daemon's rate\n",
            (unsigned long long)rec->left_out);
    if (st.malformed + r->unreadable > 0)
        fprintf(stderr, "pyrovox: %llu messages could not be read (another wire version?)\n",
                (unsigned long long)st.malformed + r->unreadable);
    if (rec->clamped > 0)
        fprintf(stderr, VOL_CLAMPED_SAID, (unsigned long long)rec->clamped);
    char more[40] = "";
    if (rec->rolled > 0)
        snprintf(more, sizeof more, " and %u after it", rec->rolled);
    printf("%llu volumes in %s%s, %llu messages lost\n", (unsigned long long)rec->written, r->out,
           more, (unsigned long long)(st.lost + rec->left_out));
    fflush(stdout);
    char line[STATUS_LINE]; /* of the daemon, when it last said so */
    if (r->parent == 0 && r->status != NULL && (!verdict_line(r->status, line) || !r->quiet))
        fprintf(stderr, "%s\n", line);
}

/* The default of --out. */
static void name_out(struct record *r)
{
    time_t now = time(NULL);
    struct tm tm;
    size_t n = strftime(r->default_out, sizeof r->default_out, "volumes-%Y%m%d-%H%M%S",
                        localtime_r(&now, &tm));
    if (r->config.format == VOL_HDF5)
        snprintf(r->default_out + n, sizeof r->default_out - n, ".h5");
    r->out = r->default_out;
}

/* Read from stdin the configuration of the daemon that began this recording. */
static char *read_config(void)
{
    char *text = NULL;
    size_t len = 0, room = 0;
    for (ssize_t n = 1; n > 0; len += (size_t)n) {
        if (room - len < 4096 && len < CONFIG_MAX) {
            char *more = realloc(text, room += 65536);
            if (more == NULL)
                break;
            text = more;
        }
        n = read(STDIN_FILENO, text + len, room - len - 1);
        n = n < 0 ? 0 : n;
    }
    if (text != NULL)
        text[len] = '\0';
    return text;
}

/* Make a path absolute for the daemon, which runs in another folder. */
static pvx_err record_absolute(const char *path, char *out, size_t size, struct pvx_diag *d)
{
    char here[PATH_MAX];
    int n = path[0] == '/'                      ? snprintf(out, size, "%s", path)
            : getcwd(here, sizeof here) != NULL ? snprintf(out, size, "%s/%s", here, path)
                                                : -1;
    return n >= 0 && n < (int)size
               ? PVX_OK
               : pvx_fail(d, PVX_EINVAL, "--out %s: is not a name for a file", path);
}

/* --raw: the daemon begins or ends a take of raw frames.  out NULL: as the daemon is configured.  Exit code. */
static int record_raw(const char *control, const char *key, const char *action, const char *out)
{
    char path[PATH_MAX + 256];
    struct pvx_diag d = {""};
    cJSON *reply = NULL;
    const char *const words[] = {"record", action, "raw", out == NULL ? NULL : path, NULL};
    pvx_err e = out == NULL ? PVX_OK : record_absolute(out, path, sizeof path, &d);
    PVX_THEN(e, ask_words(control, key, words, 0, &reply, &d));
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%s %s\n", strcmp(action, "start") == 0 ? "recording raw frames to" : "recorded",
           ask_text(reply, "path", NULL));
    cJSON_Delete(reply);
    return 0;
}

static int record_run(int argc, char **argv)
{
    struct record r = {.endpoint = dmn_client_endpoint(DMN_VOLUMES)};
    struct pvx_diag d = {""};
    if (argp_parse(&argp, argc, argv, 0, NULL, &r) != 0)
        return 2;
    if (r.raw != NULL)
        return record_raw(r.control != NULL ? r.control : dmn_client_endpoint(DMN_CONTROL), r.key,
                          r.raw, r.out);
    if (r.format == NULL && r.out != NULL && vol_hdf5_name(r.out))
        r.config.format = VOL_HDF5;
    if (r.out == NULL)
        name_out(&r);
    r.config.path = r.out;
    bool there = access(r.out, F_OK) == 0;
    cli_catch_stop();
    /* If the daemon ends, this recorder must end too: the next daemon starts its own. */
    if (r.parent != 0 && (prctl(PR_SET_PDEATHSIG, SIGTERM) != 0 || getppid() != (pid_t)r.parent))
        return 130;
    if (r.parent != 0)
        r.daemon_config = read_config();
    pvx_err e = vol_recorder_new(&r.config, &r.rec, &d); /* errors show before a long wait */
    PVX_THEN(e, pvp_decoder_new(&r.decoder));
    if (e == PVX_OK)
        e = pvp_sub_new(r.endpoint, &(struct pvp_sub_options){.key = r.key}, &r.sub, &d);
    PVX_THEN(e, record_run_loop(&r, &d));
    struct vol_recorder_stats st = {0};
    pvx_err closing = vol_recorder_finish(&r.rec, &st, &d);
    PVX_THEN(e, closing);
    if (r.sub != NULL)
        record_conclude(&r, &st);
    if (st.written == 0 && !there)
        rmdir(r.out); /* fails if something is in it, as it should */
    if (e == PVX_ENOSPC)
        fprintf(stderr, "pyrovox: the disk is full; the volumes recorded before are complete\n");
    int rc = e != PVX_OK ? cli_error(&d, e) : cli_stop ? 130 : 0;
    pvp_sub_free(&r.sub);
    pvp_decoder_free(&r.decoder);
    cJSON_Delete(r.status);
    free(r.daemon_config);
    return rc;
}

const struct cli_command cmd_record = {
    "record", "write a daemon's volumes to disk, or its raw frames", record_run};
