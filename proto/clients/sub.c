#include "proto/clients/sub.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/mem.h"
#include "proto/attach.h"
#include "proto/auth.h"
#include "proto/door.h"
#include "proto/fields.h"

#define RECEIVE_HWM      16
#define RECONNECT_MS     100
#define RECONNECT_MAX_MS 1000

struct pvp_sub {
    void *ctx, *socket;
    pvp_door *door;
    char *endpoint;
    bool has_key;
    zmq_msg_t msg; /* the last message, which pvp_sub_next lends */
    zmq_msg_t late
        [2]; /* the messages behind the volume that was lent last; they come next: bars, then another */
    int n_late;
    zmq_msg_t bars;      /* the newest error bars */
    bool have_bars, fit; /* fit: they belong to the volume that was lent last */
    bool newest;
    char *rig; /* NULL: none yet */
    uint64_t rig_hash;
    bool in_session, have_start;
    uint64_t session, next_sequence;
    size_t memory;
    struct pvp_start start;
    struct pvp_sub_stats stats;
};

static pvx_err connect_socket(struct pvp_sub *s, const char *endpoint, const char *key,
                              struct pvx_diag *d)
{
    s->ctx = zmq_ctx_new();
    s->socket = s->ctx != NULL ? zmq_socket(s->ctx, ZMQ_SUB) : NULL;
    const int hwm = RECEIVE_HWM, linger = 0, ivl = RECONNECT_MS, ivl_max = RECONNECT_MAX_MS;
    /* Room for uncompressed bricks that extend beyond the grid's sides, and for their ids. */
    const int64_t message = 2 * (int64_t)s->memory + (int64_t)PVP_STATUS_MAX;
    if (s->socket == NULL || zmq_setsockopt(s->socket, ZMQ_RCVHWM, &hwm, sizeof hwm) != 0 ||
        zmq_setsockopt(s->socket, ZMQ_MAXMSGSIZE, &message, sizeof message) != 0 ||
        zmq_setsockopt(s->socket, ZMQ_LINGER, &linger, sizeof linger) != 0 ||
        zmq_setsockopt(s->socket, ZMQ_RECONNECT_IVL, &ivl, sizeof ivl) != 0 ||
        zmq_setsockopt(s->socket, ZMQ_RECONNECT_IVL_MAX, &ivl_max, sizeof ivl_max) != 0 ||
        zmq_setsockopt(s->socket, ZMQ_SUBSCRIBE, PVP_SUBSCRIBE_ALL, strlen(PVP_SUBSCRIBE_ALL)) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "ZeroMQ: %s", zmq_strerror(errno));
    if (key != NULL)
        PVX_TRY(pvp_auth_client(s->socket, key, d));
    s->has_key = key != NULL;
    s->endpoint = strdup(endpoint);
    if (s->endpoint == NULL)
        return PVX_ENOMEM;
    PVX_TRY(pvp_door_new(s->ctx, s->socket, &s->door));
    if (pvp_connect(s->socket, endpoint) != 0)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: not an endpoint (%s); write ipc:///run/pyrovox/volumes or "
                        "tcp://HOST:5555",
                        endpoint, zmq_strerror(errno));
    return PVX_OK;
}

pvx_err pvp_sub_new(const char *endpoint, const struct pvp_sub_options *o, pvp_sub **out,
                    struct pvx_diag *d)
{
    *out = NULL;
    struct pvp_sub *s = calloc(1, sizeof *s);
    PVX_NEED(s);
    s->memory = o != NULL && o->memory > 0 ? o->memory : PVP_SUB_MEMORY;
    s->newest = o != NULL && o->newest;
    zmq_msg_init(&s->msg);
    zmq_msg_init(&s->late[0]);
    zmq_msg_init(&s->late[1]);
    zmq_msg_init(&s->bars);
    pvx_err e = connect_socket(s, endpoint, o != NULL ? o->key : NULL, d);
    if (e != PVX_OK) {
        pvp_sub_free(&s);
        return e;
    }
    *out = s;
    return PVX_OK;
}

void pvp_sub_free(pvp_sub **s)
{
    if (*s == NULL)
        return;
    zmq_msg_close(&(*s)->msg);
    zmq_msg_close(&(*s)->late[0]);
    zmq_msg_close(&(*s)->late[1]);
    zmq_msg_close(&(*s)->bars);
    free((*s)->rig);
    pvp_door_free(&(*s)->door);
    free((*s)->endpoint);
    if ((*s)->socket != NULL)
        zmq_close((*s)->socket);
    if ((*s)->ctx != NULL)
        while (zmq_ctx_term((*s)->ctx) != 0 && errno == EINTR)
            continue;
    PVX_FREE(*s);
}

/* PVX_OK: s->msg is the next message. */
static pvx_err sub_receive(struct pvp_sub *s, int64_t timeout_ns, int64_t until, struct pvx_diag *d)
{
    if (s->n_late > 0) {
        zmq_msg_move(&s->msg, &s->late[0]);
        if (--s->n_late > 0)
            zmq_msg_move(&s->late[0], &s->late[1]);
        return PVX_OK;
    }
    for (;;) {
        zmq_msg_close(&s->msg);
        zmq_msg_init(&s->msg);
        if (zmq_msg_recv(&s->msg, s->socket, ZMQ_DONTWAIT) >= 0)
            return PVX_OK;
        if (errno == EINTR)
            return PVX_ETIMEDOUT;
        if (errno != EAGAIN)
            return pvx_err_from_errno(errno);
        PVX_TRY(pvp_door_refused(s->door, s->endpoint, s->has_key, d));
        int64_t left = until - pvx_now_mono();
        if (timeout_ns >= 0 && left <= 0)
            return PVX_ETIMEDOUT;
        /* Round up, so that the last fraction of a millisecond does not spin. */
        long ms = timeout_ns < 0 ? -1 : (long)((left + PVX_NS_PER_MS - 1) / PVX_NS_PER_MS);
        zmq_pollitem_t item[] = {{.socket = s->socket, .events = ZMQ_POLLIN},
                                 {.socket = pvp_door_socket(s->door), .events = ZMQ_POLLIN}};
        if (zmq_poll(item, 2, ms) < 0)
            return errno == EINTR ? PVX_ETIMEDOUT : pvx_err_from_errno(errno);
    }
}

/* Updates sequence and session from a valid header; false for a repetition. */
static bool sub_count(struct pvp_sub *s, const struct pvp_header *h)
{
    if (!s->in_session || h->session != s->session) {
        s->in_session = true;
        s->have_start = s->have_bars = false;
        PVX_FREE(s->rig);
        s->session = h->session;
        s->next_sequence = h->sequence;
        s->stats.sessions++;
    }
    if (h->sequence < s->next_sequence)
        return false;
    s->stats.received++;
    s->stats.lost += h->sequence - s->next_sequence;
    s->next_sequence = h->sequence + 1;
    return true;
}

static pvx_err sub_begin(struct pvp_sub *s, const struct pvp_start *start, struct pvx_diag *d)
{
    size_t bytes = pvp_grid_count(&start->grid) * sizeof(float);
    const uint32_t *n = start->grid.n;
    s->have_start = bytes <= s->memory;
    if (!s->have_start)
        return pvx_fail(
            d, PVX_ERANGE,
            "the daemon's volumes of %u x %u x %u voxels need %zu MiB, this client takes "
            "up to %zu MiB",
            n[0], n[1], n[2], bytes >> 20, s->memory >> 20);
    s->start = *start;
    return PVX_OK;
}

/* A copy of the text, which holds no 0 inside. */
static bool keep_rig(struct pvp_sub *s, const void *msg, size_t len)
{
    const char *yaml;
    size_t n;
    uint64_t hash;
    if (pvp_decode_rig(msg, len, &hash, &yaml, &n, NULL) != PVX_OK || memchr(yaml, 0, n) != NULL)
        return false;
    char *copy = malloc(n + 1);
    if (copy == NULL)
        return false;
    memcpy(copy, yaml, n);
    copy[n] = '\0';
    free(s->rig);
    s->rig = copy;
    s->rig_hash = hash;
    return true;
}

/* Bars in s->msg wait for their volume. */
static bool keep_bars(struct pvp_sub *s, const void *msg, size_t len)
{
    struct pvp_view view;
    uint32_t doubt;
    s->have_bars = false;
    if (!s->have_start)
        return true;
    if (pvp_decode_bars(msg, len, &view, &doubt, NULL) != PVX_OK ||
        !pvp_grid_same(&view.v.grid, &s->start.grid))
        return false;
    zmq_msg_move(&s->bars, &s->msg);
    s->have_bars = true;
    return true;
}

static bool bars_of(struct pvp_sub *s, const struct pvp_view *volume)
{
    struct pvp_view bars;
    uint32_t doubt;
    return s->have_bars &&
           pvp_decode_bars(zmq_msg_data(&s->bars), zmq_msg_size(&s->bars), &bars, &doubt, NULL) ==
               PVX_OK &&
           pvp_bars_fit(&bars, volume);
}

/* *mine: whether the message is for the caller. */
static pvx_err sub_sort(struct pvp_sub *s, const struct pvp_header *h, const void *msg, size_t len,
                        bool *mine, struct pvx_diag *d)
{
    struct pvp_start start;
    struct pvp_view view;
    pvx_err e;
    bool readable = true;
    *mine = false;
    switch (h->type) {
    case PVP_START:
        *mine = readable = pvp_decode_start(msg, len, &start, NULL) == PVX_OK;
        if (readable)
            PVX_TRY(sub_begin(s, &start, d));
        break;
    case PVP_VOLUME:
        if (s->have_start)
            *mine = readable = pvp_decode_volume(msg, len, &view, NULL) == PVX_OK &&
                               pvp_grid_same(&view.v.grid, &s->start.grid);
        s->fit = *mine && bars_of(s, &view);
        break;
    case PVP_BARS: readable = keep_bars(s, msg, len); break;
    case PVP_RIG: *mine = readable = keep_rig(s, msg, len); break;
    default:
        e = pvp_check(h->type, msg, len);
        *mine = e == PVX_OK;
        readable = e == PVX_OK || e == PVX_EUNSUP; /* EUNSUP: a type of a later minor version */
    }
    s->stats.malformed += !readable;
    return PVX_OK;
}

/* Receives the next message behind the volume in s->msg, if one has come, and tells its type, else 0. */
static enum pvp_type look_behind(struct pvp_sub *s)
{
    struct pvp_header h;
    zmq_msg_t *late = &s->late[s->n_late];
    if (zmq_msg_recv(late, s->socket, ZMQ_DONTWAIT) < 0)
        return (enum pvp_type)0;
    s->n_late++;
    bool known = !zmq_msg_more(late) &&
                 pvp_decode_header(zmq_msg_data(late), zmq_msg_size(late), &h, NULL) == PVX_OK &&
                 h.session == s->session;
    return known ? h.type : (enum pvp_type)0;
}

/* Whether another volume has come behind the one in s->msg, perhaps with bars before it.  Any message that has come
 * waits in s->late for its turn; if it is neither, the one in s->msg is the newest for this call. */
static bool passed_over(struct pvp_sub *s)
{
    enum pvp_type next = look_behind(s);
    if (next == PVP_BARS)
        next = look_behind(s);
    return next == PVP_VOLUME;
}

pvx_err pvp_sub_next(pvp_sub *s, int64_t timeout_ns, struct pvp_header *h, const void **msg,
                     size_t *len, struct pvx_diag *d)
{
    int64_t until = timeout_ns >= 0 ? pvx_now_mono() + timeout_ns : 0;
    for (;;) {
        s->fit = false;
        PVX_TRY(sub_receive(s, timeout_ns, until, d));
        *msg = zmq_msg_data(&s->msg);
        *len = zmq_msg_size(&s->msg);
        bool mine = false;
        if (zmq_msg_more(&s->msg) || pvp_decode_header(*msg, *len, h, NULL) != PVX_OK)
            s->stats.malformed++;
        else if (sub_count(s, h))
            PVX_TRY(sub_sort(s, h, *msg, *len, &mine, d));
        if (mine && s->newest && h->type == PVP_VOLUME && passed_over(s)) {
            s->stats.skipped++;
            continue;
        }
        if (mine)
            return PVX_OK;
        /* A stream of useless messages must not hold the caller for ever. */
        if (timeout_ns >= 0 && pvx_now_mono() >= until)
            return PVX_ETIMEDOUT;
    }
}

const struct pvp_start *pvp_sub_start(const pvp_sub *s)
{
    return s->have_start ? &s->start : NULL;
}

const char *pvp_sub_rig(const pvp_sub *s, uint64_t *rig_hash)
{
    if (rig_hash != NULL)
        *rig_hash = s->rig_hash;
    return s->rig;
}

const void *pvp_sub_bars(const pvp_sub *s, size_t *len)
{
    zmq_msg_t *bars = (zmq_msg_t *)&s->bars; /* zmq_msg_data takes no const */
    *len = s->fit ? zmq_msg_size(bars) : 0;
    return s->fit ? zmq_msg_data(bars) : NULL;
}

int pvp_sub_fd(const pvp_sub *s)
{
    int fd = -1;
    size_t size = sizeof fd;
    return zmq_getsockopt(s->socket, ZMQ_FD, &fd, &size) == 0 ? fd : -1;
}

void pvp_sub_stats(const pvp_sub *s, struct pvp_sub_stats *out)
{
    *out = s->stats;
}
