/* pyrovox share - the newest volume in shared memory, for programs of this host. */
#include <poll.h>
#include <stdio.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/config/endpoints.h"
#include "daemon/view/source.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/share.h"

#define WAIT_NS (200 * PVX_NS_PER_MS) /* longest reaction time to Ctrl-C */

struct share {
    const char *endpoint, *key, *file;
    struct vol_share_config config;
    bool quiet;
    /* running */
    pvp_sub *sub;
    struct view_source film; /* for a recording instead of a daemon */
    pvp_decoder *decoder;
    struct vol_store store, bars;
    vol_share *out;
    struct pvp_start start;
    uint64_t shared, left_out, unreadable, set;
    uint64_t told_shared;
    int64_t told; /* mono: last status line */
    bool full, told_waiting;
};

enum { OPT_READERS = 256 };

#define AT(field) CLI_AT(struct share, field)

static const struct cli_row rows[] = {
    {"e|endpoint", "ENDPOINT", AT(endpoint), 0, 0,
     "Where the daemon publishes (default: the local daemon)"},
    {"k|key", "FILE", AT(key), 0, 0,
     "Your .key file of `pyrovox keygen`, for a daemon that asks for one"},
    {"readers", "me|group|all", CLI_KEY(OPT_READERS), 0, 0, "Users that may read it (default: me)"},
    {"split", NULL, AT(config.split), 0, 0,
     "Three colours as grids red, green and blue instead of one of vectors, emission"},
    {"q|quiet", NULL, AT(quiet), 0, 0, "No status line"},
    {0}};

static error_t share_parse(int key, char *arg, struct argp_state *st)
{
    static const char *const readers[] = {"me", "group", "all", NULL};
    static const mode_t modes[] = {0600, 0640, 0644};
    struct share *s = st->input;
    switch (key) {
    case OPT_READERS: s->config.mode = modes[cli_arg_choice(st, "readers", arg, readers)]; return 0;
    case ARGP_KEY_ARG:
        if (s->config.name == NULL)
            s->config.name = arg;
        else
            cli_arg_one(st, "recording", arg, &s->file);
        return 0;
    case ARGP_KEY_END:
        if (s->config.name == NULL)
            argp_error(st, "the NAME under which programs find it is missing");
        if (s->file != NULL && (s->endpoint != NULL || s->key != NULL))
            argp_error(st, "a recording has no --endpoint or --key");
        return 0;
    default: return cli_row(rows, key, arg, st, s);
    }
}

static const struct argp argp = {
    .parser = share_parse,
    .args_doc = "NAME [FILE]",
    .doc =
        "Keep the newest volume of a running daemon, or of a recording, in shared memory as "
        "NanoVDB. A renderer on this host maps it or copies it to its GPU without "
        "conversion.\vExamples:\n"
        "  pyrovox share flame\n"
        "  pyrovox share flame --readers all --endpoint tcp://lab:5555 --key me.key\n"
        "  pyrovox share flame recording.h5\n"
        "\n"
        "The grids are those of `pyrovox record --format nvdb`: density, for three colours "
        "emission, and where the volume has error bars emission_sd and rgb_sd. Voxel (i, j, k) is "
        "at index (i, j, k). The world is in metres, z up. The grids "
        "lie in POSIX shared memory /NAME (/dev/shm/NAME). C and C++ programs read them with "
        "pyrovox_share.h, one file that needs only libc, and NanoVDB.h or PNanoVDB.h. PROTOCOL.md "
        "has the layout for other languages.\n"
        "\n"
        "There are three slots: the newest volume and the one before stay whole while the next is "
        "written. Readers never delay this program, and this program never delays the daemon. A "
        "slow reader misses volumes. The program waits for a daemon, and for the next one when the "
        "daemon ends. The last volume stays meanwhile, and its times say how old it is.\n"
        "\n"
        "Only one `pyrovox share` at a time can use a name. One that was killed leaves its last "
        "volume behind. Readers can tell, and the next `pyrovox share` of the same user takes the "
        "name.\n"
        "\n"
        "Exit: 130 stopped by Ctrl-C, 1 failed, 2 wrong usage.",
};

/* Print the state.  On a terminal it is one line, renewed each second.  Elsewhere it is a line every ten seconds. */
static void share_tell(struct share *s)
{
    const int64_t now = pvx_now_mono();
    const bool tty = isatty(STDERR_FILENO) == 1;
    if (s->quiet || s->shared == 0 || now - s->told < (tty ? 1 : 10) * PVX_NS_PER_S)
        return;
    const double rate = (double)(s->shared - s->told_shared) * 1e9 / (double)(now - s->told);
    fprintf(stderr, "%s%llu volumes, %.1f/s, the newest of set %llu%s", tty ? "\r" : "",
            (unsigned long long)s->shared, rate, (unsigned long long)s->set,
            tty ? "  \x1b[K" : "\n");
    s->told = now;
    s->told_shared = s->shared;
}

static void first_line(struct share *s, const struct pvp_grid *g)
{
    s->told = pvx_now_mono();
    if (s->quiet)
        return;
    fprintf(stderr, "sharing %u x %u x %u x %u from %s (%s) as %s\n", g->n[0], g->n[1], g->n[2],
            g->channels, s->file != NULL ? s->file : s->endpoint, s->start.software,
            s->config.name);
}

static pvx_err share_unreadable(struct share *s, const char *why)
{
    if (s->unreadable++ == 0)
        fprintf(stderr, "pyrovox: %s\n", why);
    return PVX_OK;
}

/* The error bars of volume w.  Bars that cannot be read are left out. */
static struct vol_bars share_bars(struct share *s, const struct pvp_view *w, size_t floats)
{
    struct pvp_view b;
    uint32_t doubt;
    size_t len;
    const void *msg =
        s->file != NULL ? s->film.ops->bars(s->film.self, &len) : pvp_sub_bars(s->sub, &len);
    bool good =
        msg != NULL && pvp_decode_bars(msg, len, &b, &doubt, NULL) == PVX_OK &&
        pvp_bars_fit(&b, w) &&
        vol_store_grow(&s->bars, w->n_bricks, w->v.grid.channels) == PVX_OK &&
        pvp_volume_bricks(s->decoder, &b, s->bars.ids, s->bars.brick, floats, NULL) == PVX_OK;
    for (size_t k = 0; k < floats && good; k++)
        good = s->bars.brick[k] >= 0;
    return good ? (struct vol_bars){.sd = s->bars.brick, .doubt = doubt} : (struct vol_bars){0};
}

/* Count a volume that cannot be read or for which there is no memory.  The next one may work. */
static pvx_err share_volume(struct share *s, const void *msg, size_t len, struct pvx_diag *d)
{
    struct pvp_view w = {.n_bricks = 0};
    struct pvx_diag bad = {""};
    const size_t cells = (size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK;
    pvx_err e = pvp_decode_volume(msg, len, &w, &bad);
    PVX_THEN(e, vol_store_grow(&s->store, w.n_bricks, w.v.grid.channels));
    PVX_THEN(e, pvp_volume_bricks(s->decoder, &w, s->store.ids, s->store.brick,
                                  cells * w.n_bricks * w.v.grid.channels, &bad));
    if (e == PVX_ENOMEM)
        return pvx_fail(d, e, "%s", pvx_diag_text(&bad, e));
    if (e != PVX_OK)
        return share_unreadable(s, pvx_diag_text(&bad, e));
    const struct vol_volume v = {.v = w.v,
                                 .sample = w.sample,
                                 .clamped = w.clamped,
                                 .n_bricks = w.n_bricks,
                                 .ids = s->store.ids,
                                 .brick = s->store.brick,
                                 .bars = share_bars(s, &w, cells * w.n_bricks * w.v.grid.channels)};
    e = vol_share_put(s->out, &s->start, &v, &bad);
    if (e != PVX_OK && e != PVX_ENOSPC)
        return pvx_fail(d, e, "%s", pvx_diag_text(&bad, e));
    if (e == PVX_ENOSPC && !s->full)
        fprintf(stderr, "pyrovox: %s; the volume before stays\n", pvx_diag_text(&bad, e));
    s->full = e == PVX_ENOSPC;
    s->left_out += s->full;
    if (!s->full && s->shared++ == 0)
        first_line(s, &w.v.grid);
    s->set = w.v.set;
    return PVX_OK;
}

static pvx_err share_message(struct share *s, const struct pvp_header *h, const void *msg,
                             size_t len, struct pvx_diag *d)
{
    char reason[PVP_REASON_MAX];
    uint64_t session;
    switch (h->type) {
    case PVP_START: return pvp_decode_start(msg, len, &s->start, d);
    case PVP_VOLUME: return share_volume(s, msg, len, d);
    case PVP_END:
        if (!s->quiet && pvp_decode_end(msg, len, &session, reason, NULL) == PVX_OK)
            fprintf(stderr, "%sthe daemon ended: %s; waiting for the next\n",
                    isatty(STDERR_FILENO) ? "\n" : "", reason);
        return PVX_OK;
    default: return PVX_OK;
    }
}

static pvx_err share_next(struct share *s, struct pvp_header *h, const void **msg, size_t *len,
                          struct pvx_diag *d)
{
    if (s->file == NULL)
        return pvp_sub_next(s->sub, WAIT_NS, h, msg, len, d);
    int64_t wait = s->film.ops->due_ns(s->film.self) - pvx_now_mono();
    wait = wait > WAIT_NS ? WAIT_NS : wait;
    if (wait > 0)
        poll(NULL, 0, (int)((wait + PVX_NS_PER_MS - 1) / PVX_NS_PER_MS));
    return s->film.ops->next(s->film.self, h, msg, len, d);
}

static pvx_err share_run_loop(struct share *s, struct pvx_diag *d)
{
    const int64_t t0 = pvx_now_mono();
    while (cli_stop == 0) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        struct pvx_diag why = {""};
        pvx_err e = share_next(s, &h, &msg, &len, &why);
        if (e == PVX_OK)
            e = share_message(s, &h, msg, len, &why);
        else if (e == PVX_ECORRUPT) /* a volume of a recording */
            e = share_unreadable(s, pvx_diag_text(&why, e));
        if (e != PVX_OK && e != PVX_ETIMEDOUT)
            return pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
        share_tell(s);
        if (s->shared == 0 && !s->told_waiting && pvx_now_mono() - t0 > PVX_NS_PER_S) {
            fprintf(stderr,
                    "waiting for a daemon at %s (`pyrovox status` tells if one runs); Ctrl-C "
                    "stops\n",
                    s->endpoint);
            s->told_waiting = true;
        }
    }
    return PVX_OK;
}

static void share_conclude(const struct share *s)
{
    if (s->quiet)
        return;
    fprintf(stderr, "%s%llu volumes were shared",
            isatty(STDERR_FILENO) && s->shared > 0 ? "\n" : "", (unsigned long long)s->shared);
    if (s->sub != NULL) {
        struct pvp_sub_stats st;
        pvp_sub_stats(s->sub, &st);
        fprintf(stderr, ", %llu passed over for a newer one, %llu messages lost on the way",
                (unsigned long long)st.skipped, (unsigned long long)st.lost);
    }
    if (s->left_out > 0)
        fprintf(stderr, ", %llu left out as there was no room", (unsigned long long)s->left_out);
    if (s->unreadable > 0)
        fprintf(stderr, ", %llu could not be read", (unsigned long long)s->unreadable);
    fputc('\n', stderr);
}

static pvx_err share_begin(struct share *s, struct pvx_diag *d)
{
    PVX_TRY(vol_share_new(&s->config, &s->out, d));
    PVX_TRY(pvp_decoder_new(&s->decoder));
    if (s->file != NULL)
        return view_film_new(s->file, &s->film, d);
    return pvp_sub_new(s->endpoint, &(struct pvp_sub_options){.key = s->key, .newest = true},
                       &s->sub, d);
}

static int share_run(int argc, char **argv)
{
    struct share s = {.config.mode = 0600};
    struct pvx_diag d = {""};
    cli_parse(rows, &argp, 0, argc, argv, &s);
    if (s.endpoint == NULL)
        s.endpoint = dmn_client_endpoint(DMN_VOLUMES);
    cli_catch_stop();
    pvx_err e = share_begin(&s, &d);
    if (e == PVX_OK) {
        e = share_run_loop(&s, &d);
        share_conclude(&s);
    }
    vol_share_free(&s.out);
    if (s.film.self != NULL)
        s.film.ops->free(s.film.self);
    pvp_sub_free(&s.sub);
    pvp_decoder_free(&s.decoder);
    vol_store_free(&s.store);
    vol_store_free(&s.bars);
    return e != PVX_OK ? cli_error(&d, e) : 130;
}

const struct cli_command cmd_share = {
    "share", "the newest volume in shared memory, for a renderer here", share_run};
