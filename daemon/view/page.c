#include "daemon/view/page.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <wslay/wslay.h>

#include "base/clock.h"
#include "base/mem.h"

#define TURN_BYTES  (64u << 10) /* read in one turn, so that one page cannot keep others waiting */
#define REPLIES_MAX 16          /* with more queued answers to pings, nothing more is read */
#define SLOW_NS \
    (30 * PVX_NS_PER_MS) /* a volume that takes longer to leave makes the next ones small */
#define AWAY_MAX   8
#define CLOSING_NS (2 * PVX_NS_PER_S)
#define SANE_NS    (60 * PVX_NS_PER_S) /* beyond it the daemon has another clock */

/* A volume that was sent and not yet drawn. */
struct away {
    uint64_t set;
    bool held;
    int64_t sent_ns, published_ns;
};

struct view_page {
    int fd;
    wslay_event_context_ptr ws;
    const struct view_gate *gate;
    uint8_t *early;
    size_t n_early, at_early, turn;
    int64_t opened_ns, closing_ns, ended_ns; /* ended: all was sent, the other end reads it */
    bool let_in, refused, gone, hidden, previews, bars, slow;
    uint64_t credits, had[VIEW_SLOTS], events, links, session;
    int64_t volume_ns; /* when the volume in the queue was put there; 0: there is none */
    struct away away[AWAY_MAX];
    unsigned n_away;
    struct view_words words; /* received, and not yet taken by view_page_read */
    struct view_page_stats stats;
    struct pvx_hist recent[2][VIEW_WAYS]; /* of these seconds, and of those before */
    int64_t recent_ns;
};

static ssize_t page_receive(wslay_event_context_ptr ws, uint8_t *buf, size_t len, int flags,
                            void *user)
{
    view_page *p = user;
    (void)flags;
    ssize_t n = -1;
    if (p->at_early < p->n_early) {
        size_t left = p->n_early - p->at_early;
        n = (ssize_t)(left < len ? left : len);
        memcpy(buf, p->early + p->at_early, (size_t)n);
        p->at_early += (size_t)n;
        return n;
    }
    if (p->turn >= TURN_BYTES || wslay_event_get_queued_msg_count(ws) > REPLIES_MAX) {
        wslay_event_set_error(ws, WSLAY_ERR_WOULDBLOCK);
        return -1;
    }
    do
        n = recv(p->fd, buf, len, MSG_DONTWAIT);
    while (n < 0 && errno == EINTR);
    if (n > 0) {
        p->turn += (size_t)n;
        return n;
    }
    bool wait = n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
    wslay_event_set_error(ws, wait ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
    p->gone |= !wait;
    return -1;
}

static ssize_t transmit(wslay_event_context_ptr ws, const uint8_t *data, size_t len, int flags,
                        void *user)
{
    view_page *p = user;
    ssize_t n;
    do
        n = send(p->fd, data, len,
                 MSG_NOSIGNAL | MSG_DONTWAIT | (flags & WSLAY_MSG_MORE ? MSG_MORE : 0));
    while (n < 0 && errno == EINTR);
    if (n >= 0)
        return n;
    bool wait = errno == EAGAIN || errno == EWOULDBLOCK;
    wslay_event_set_error(ws, wait ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
    p->gone |= !wait;
    return -1;
}

/* Add the time since it was published, if that was by this host's clock. */
static void since_published(view_page *p, enum view_way way, const struct away *a)
{
    int64_t whole = pvx_now_real() - a->published_ns;
    if (whole >= 0 && whole < SANE_NS)
        pvx_hist_add(&p->recent[0][way], whole);
}

static void page_held(view_page *p, uint64_t set)
{
    for (unsigned i = 0; i < p->n_away; i++)
        if (p->away[i].set == set && !p->away[i].held) {
            p->away[i].held = true;
            since_published(p, VIEW_HELD, &p->away[i]);
            return;
        }
}

static void page_drawn(view_page *p, uint64_t set)
{
    for (unsigned i = 0; i < p->n_away; i++) {
        if (p->away[i].set != set)
            continue;
        p->stats.drawn++;
        pvx_hist_add(&p->recent[0][VIEW_DRAWN], pvx_now_mono() - p->away[i].sent_ns);
        since_published(p, VIEW_WHOLE, &p->away[i]);
        /* the page has skipped those before it */
        p->n_away -= i + 1;
        memmove(p->away, p->away + i + 1, p->n_away * sizeof *p->away);
        return;
    }
}

static void heed(view_page *p, const struct view_words *w)
{
    if (w->said & VIEW_SAID_TOKEN) {
        p->let_in = view_gate_token(p->gate, w->token);
        p->refused = !p->let_in;
    }
    if (!p->let_in) {
        p->refused = true;
        view_page_close(p, VIEW_CLOSE_TOKEN, "the token is not this bridge's");
        return;
    }
    if (w->said & VIEW_SAID_CREDITS) {
        p->credits += w->credits < VIEW_CREDITS_MAX ? w->credits : VIEW_CREDITS_MAX;
        if (p->credits > VIEW_CREDITS_MAX)
            p->credits = VIEW_CREDITS_MAX;
    }
    if (w->said & VIEW_SAID_HELD)
        page_held(p, w->held);
    if (w->said & VIEW_SAID_DRAWN)
        page_drawn(p, w->drawn);
    if (w->said & VIEW_SAID_HIDDEN)
        p->hidden = w->hidden;
    if (w->said & VIEW_SAID_PREVIEWS)
        p->previews = w->previews;
    if (w->said & VIEW_SAID_BARS)
        p->bars = w->bars;
    unsigned film = w->said & (VIEW_SAID_PLAY | VIEW_SAID_SEEK | VIEW_SAID_SPEED | VIEW_SAID_SOOT);
    unsigned order = w->said & VIEW_SAID_ORDER;
    if (order != 0)
        p->words.order = w->order;
    if (film & VIEW_SAID_PLAY)
        p->words.play = w->play;
    if (film & VIEW_SAID_SEEK)
        p->words.seek = w->seek;
    if (film & VIEW_SAID_SPEED)
        p->words.speed = w->speed;
    if (film & VIEW_SAID_SOOT)
        p->words.soot = w->soot;
    p->words.said |= film | order;
}

static void page_message(wslay_event_context_ptr ws, const struct wslay_event_on_msg_recv_arg *m,
                         void *user)
{
    view_page *p = user;
    struct view_words w;
    (void)ws;
    if (wslay_is_ctrl_frame(m->opcode) || p->closing_ns != 0)
        return;
    if (m->opcode == WSLAY_TEXT_FRAME && view_words_read((const char *)m->msg, m->msg_length, &w)) {
        heed(p, &w);
        return;
    }
    p->refused |= !p->let_in;
    view_page_close(p, VIEW_CLOSE_WORDS, "a message that is not understood");
}

pvx_err view_page_new(int fd, const struct view_gate *gate, const void *early, size_t n_early,
                      view_page **out)
{
    static const struct wslay_event_callbacks calls = {.recv_callback = page_receive,
                                                       .send_callback = transmit,
                                                       .on_msg_recv_callback = page_message};
    view_page *p = pvx_calloc(1, sizeof *p);
    *out = p;
    PVX_NEED(p);
    p->fd = fd;
    p->gate = gate;
    p->opened_ns = p->recent_ns = pvx_now_mono();
    p->early = malloc(n_early + 1);
    if (p->early == NULL || wslay_event_context_server_init(&p->ws, &calls, p) != 0) {
        view_page_free(out);
        return PVX_ENOMEM;
    }
    if (n_early > 0)
        memcpy(p->early, early, n_early);
    p->n_early = n_early;
    wslay_event_config_set_max_recv_msg_length(p->ws, VIEW_WORDS_MAX);
    return PVX_OK;
}

void view_page_free(view_page **p)
{
    if (*p == NULL)
        return;
    if ((*p)->ws != NULL)
        wslay_event_context_free((*p)->ws);
    free((*p)->early);
    PVX_FREE(*p);
}

short view_page_wants(const view_page *p)
{
    if (p->ended_ns != 0)
        return POLLIN;
    short wants = wslay_event_want_write(p->ws) ? POLLOUT : 0;
    if (wslay_event_want_read(p->ws) && wslay_event_get_queued_msg_count(p->ws) <= REPLIES_MAX)
        wants |= POLLIN;
    return wants;
}

/* Read what still comes, as closing with unread data would discard what was sent last. */
static void page_drain(view_page *p)
{
    char nothing[4096];
    ssize_t n;
    do
        n = recv(p->fd, nothing, sizeof nothing, MSG_DONTWAIT);
    while (n > 0 || (n < 0 && errno == EINTR));
    p->gone |= n == 0 || (errno != EAGAIN && errno != EWOULDBLOCK);
}

bool view_page_read(view_page *p, struct view_words *out)
{
    p->turn = 0;
    if (p->ended_ns != 0)
        page_drain(p);
    else if (wslay_event_recv(p->ws) != 0)
        p->gone = true;
    *out = p->words;
    p->words.said = 0;
    return out->said != 0;
}

static void page_queue(view_page *p, uint8_t opcode, const void *data, size_t len)
{
    const struct wslay_event_msg m = {opcode, data, len};
    if (wslay_event_queue_msg(p->ws, &m) != 0)
        p->gone = true;
}

static void page_push(view_page *p)
{
    if (!p->gone && wslay_event_want_write(p->ws) && wslay_event_send(p->ws) != 0)
        p->gone = true;
    if (p->volume_ns != 0 && wslay_event_get_queued_msg_count(p->ws) == 0) {
        p->slow |= pvx_now_mono() - p->volume_ns > SLOW_NS;
        p->volume_ns = 0;
    }
}

static void page_remember(view_page *p, const struct view_msg *m)
{
    if (p->n_away == AWAY_MAX)
        memmove(p->away, p->away + 1, --p->n_away * sizeof *p->away);
    p->volume_ns = pvx_now_mono();
    p->away[p->n_away++] =
        (struct away){.set = m->set, .sent_ns = p->volume_ns, .published_ns = m->published_ns};
    p->credits--;
    p->stats.sent++;
}

static bool may_have_volume(const view_page *p)
{
    return p->credits > 0 && !p->hidden && p->had[VIEW_START] > 0;
}

static bool page_due(const view_page *p, const view_shelf *shelf, enum view_slot slot)
{
    uint64_t now = view_shelf_number(shelf, slot);
    if (now == 0 || now == p->had[slot])
        return false;
    if (slot == VIEW_BARS) /* before their volume, or after it where they are asked for later */
        return p->bars && !p->hidden &&
               (view_shelf_number(shelf, VIEW_VOLUME) == p->had[VIEW_VOLUME] || may_have_volume(p));
    if (slot == VIEW_VOLUME)
        return may_have_volume(p);
    return slot != VIEW_PREVIEW || (p->previews && !p->hidden);
}

/* Put the next message into the queue, which is empty; false: there is none. */
static bool page_fill(view_page *p, view_shelf *shelf, const char *link, uint64_t link_number)
{
    struct view_msg m;
    if (p->had[VIEW_START] > 0 && view_shelf_event(shelf, p->events, &m)) {
        p->events = m.number;
        page_queue(p, WSLAY_BINARY_FRAME, m.data, m.len);
        return true;
    }
    for (enum view_slot slot = 0; slot < VIEW_SLOTS; slot++) {
        if (slot == VIEW_VOLUME && link_number != p->links) {
            p->links = link_number;
            page_queue(p, WSLAY_TEXT_FRAME, link, strlen(link));
            return true;
        }
        if (!page_due(p, shelf, slot))
            continue;
        bool good = view_shelf_get(shelf, slot, p->slow, &m, NULL) == PVX_OK;
        p->had[slot] = view_shelf_number(shelf, slot);
        if (!good)
            continue; /* damaged: the source counts it */
        if (slot == VIEW_VOLUME)
            page_remember(p, &m);
        page_queue(p, slot == VIEW_POSES ? WSLAY_TEXT_FRAME : WSLAY_BINARY_FRAME, m.data, m.len);
        return true;
    }
    return false;
}

void view_page_write(view_page *p, view_shelf *shelf, const char *link, uint64_t link_number)
{
    page_push(p);
    while (p->let_in && !p->gone && p->closing_ns == 0 && wslay_event_get_write_enabled(p->ws) &&
           !wslay_event_get_close_sent(p->ws) && !wslay_event_get_close_received(p->ws) &&
           wslay_event_get_queued_msg_count(p->ws) == 0 && page_fill(p, shelf, link, link_number))
        page_push(p);
}

void view_page_close(view_page *p, unsigned code, const char *why)
{
    if (p->closing_ns != 0)
        return;
    p->closing_ns = pvx_now_mono();
    if (wslay_event_queue_close(p->ws, (uint16_t)code, (const uint8_t *)why, strlen(why)) != 0)
        p->gone = true;
    page_push(p);
}

bool view_page_over(view_page *p, int64_t now)
{
    if (!p->let_in && !p->refused && now - p->opened_ns > VIEW_HELLO_NS) {
        p->refused = true;
        view_page_close(p, VIEW_CLOSE_SILENT, "no token came");
    }
    bool done = !wslay_event_want_read(p->ws) && !wslay_event_want_write(p->ws);
    if (done && p->ended_ns == 0) {
        p->ended_ns = now;
        shutdown(p->fd, SHUT_WR);
    }
    return p->gone || (p->ended_ns != 0 && now - p->ended_ns > CLOSING_NS) ||
           (p->closing_ns != 0 && now - p->closing_ns > 2 * CLOSING_NS);
}

double view_page_recent(view_page *p, enum view_way way, double q, int64_t now)
{
    if (now - p->recent_ns > VIEW_RECENT_NS) {
        memcpy(p->recent[1], p->recent[0], sizeof p->recent[1]);
        memset(p->recent[0], 0, sizeof p->recent[0]);
        p->recent_ns = now;
    }
    struct pvx_hist both = p->recent[0][way];
    const struct pvx_hist *before = &p->recent[1][way];
    for (int i = 0; i < PVX_HIST_BUCKETS; i++)
        both.bucket[i] += before->bucket[i];
    both.count += before->count;
    both.max_ns = both.max_ns > before->max_ns ? both.max_ns : before->max_ns;
    return both.count > 0 ? (double)pvx_hist_quantile(&both, q) * 1e-6 : NAN;
}

int64_t view_page_since(const view_page *p)
{
    return p->opened_ns;
}
bool view_page_closing(const view_page *p)
{
    return p->closing_ns != 0 || p->gone;
}
bool view_page_let_in(const view_page *p)
{
    return p->let_in;
}
bool view_page_refused(const view_page *p)
{
    return p->refused;
}
bool view_page_wants_previews(const view_page *p)
{
    return p->let_in && p->previews && !p->hidden;
}
bool view_page_looks(const view_page *p)
{
    return p->let_in && !p->hidden;
}
const struct view_page_stats *view_page_stats(const view_page *p)
{
    return &p->stats;
}

void view_page_count(view_page *p, uint64_t volume_before)
{
    if (!p->let_in || volume_before == 0 || p->had[VIEW_VOLUME] == volume_before)
        return;
    if (p->hidden)
        p->stats.hidden++;
    else
        p->stats.superseded++;
}
