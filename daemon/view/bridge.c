#include "daemon/view/bridge.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/view/poses.h"

#define LINK_NS  PVX_NS_PER_S          /* how often a page is told of the link */
#define TURN_NS  (200 * PVX_NS_PER_MS) /* how often `stop` is asked */
#define AGAIN_NS (60 * PVX_NS_PER_S)   /* how often the same trouble is told */
#define TURN_MAX 64                    /* messages taken from the source in one turn */

struct seat {
    view_page *page; /* NULL: free */
    void *handle;
    int fd;
};
struct view_bridge {
    const struct view_gate *gate;
    view_http *http;
    struct view_source source;
    view_orders *orders; /* NULL: none are taken */
    view_shelf *shelf;
    struct seat seat[VIEW_SEATS];
    struct view_bridge_stats stats;
    int64_t link_ns, came_ns; /* came: the last message, 0 none yet */
    uint64_t links;
    char said[PVX_DIAG_MAX]; /* the last trouble that was told, */
    int64_t said_ns;         /* and when, so that it is not told all the time */
    void (*say)(const char *line);
    void (*verdict)(const char *json, size_t len, char out[VIEW_VERDICT_TEXT]);
    char verdict_said[32 + 6 * VIEW_VERDICT_TEXT]; /* ,"verdict":"..."; "": none yet */
};

static void bridge_leave(struct view_bridge *b, struct seat *s);

/* Find a free seat.  If there is none, take that of the page without a token that has waited longest.  A page that
 * was let in keeps its seat. */
static struct seat *seat_for(struct view_bridge *b)
{
    struct seat *oldest = NULL;
    for (struct seat *s = b->seat; s < b->seat + VIEW_SEATS; s++) {
        if (s->page == NULL)
            return s;
        if (!view_page_let_in(s->page) &&
            (oldest == NULL || view_page_since(s->page) < view_page_since(oldest->page)))
            oldest = s;
    }
    if (oldest != NULL)
        bridge_leave(b, oldest);
    return oldest;
}

static void bridge_upgraded(void *ctx, int fd, void *handle, const void *early, size_t n)
{
    struct view_bridge *b = ctx;
    struct seat *s = seat_for(b);
    if (s == NULL || view_page_new(fd, b->gate, early, n, &s->page) != PVX_OK) {
        view_http_drop(handle);
        return;
    }
    s->handle = handle;
    s->fd = fd;
    b->stats.pages_ever++;
}

pvx_err view_bridge_new(const struct view_http_params *p, const struct view_source *source,
                        view_orders *orders, view_bridge **out, struct pvx_diag *d)
{
    struct view_bridge *b = *out = pvx_calloc(1, sizeof *b);
    if (b == NULL) {
        source->ops->free(source->self);
        view_orders_free(&orders);
        return PVX_ENOMEM;
    }
    struct view_http_params mine = *p;
    mine.upgraded = bridge_upgraded;
    mine.ctx = b;
    b->gate = p->gate;
    b->source = *source;
    b->orders = orders;
    pvx_err e = view_shelf_new(&b->shelf);
    PVX_THEN(e, view_http_new(&mine, &b->http, d));
    if (e != PVX_OK)
        view_bridge_free(out);
    return e;
}

static void bridge_leave(struct view_bridge *b, struct seat *s)
{
    const struct view_page_stats *st = view_page_stats(s->page);
    struct view_page_stats *sum = &b->stats.gone;
    b->stats.refused_token += !view_page_let_in(s->page);
    sum->sent += st->sent;
    sum->drawn += st->drawn;
    sum->superseded += st->superseded;
    sum->hidden += st->hidden;
    view_page_free(&s->page);
    view_http_drop(s->handle);
}

void view_bridge_free(view_bridge **b)
{
    if (*b == NULL)
        return;
    for (int i = 0; i < VIEW_SEATS; i++)
        if ((*b)->seat[i].page != NULL)
            bridge_leave(*b, &(*b)->seat[i]);
    view_http_free(&(*b)->http);
    view_shelf_free(&(*b)->shelf);
    (*b)->source.ops->free((*b)->source.self);
    view_orders_free(&(*b)->orders);
    PVX_FREE(*b);
}

const char *view_bridge_at(const view_bridge *b)
{
    return view_http_at(b->http);
}

static void bridge_tell(struct view_bridge *b, pvx_err e, const struct pvx_diag *d)
{
    const char *text = pvx_diag_text(d, e);
    int64_t now = pvx_now_mono();
    if (b->say == NULL || (strcmp(text, b->said) == 0 && now - b->said_ns < AGAIN_NS))
        return;
    b->said_ns = now;
    snprintf(b->said, sizeof b->said, "%s", text);
    b->say(text);
}

static pvx_err put_poses(struct view_bridge *b, const void *msg, size_t len, struct pvx_diag *d)
{
    uint64_t hash;
    const char *yaml;
    char *text;
    size_t n;
    PVX_TRY(pvp_decode_rig(msg, len, &hash, &yaml, &n, d));
    PVX_TRY(view_poses(yaml, n, &text, d));
    pvx_err e = view_shelf_put_text(b->shelf, VIEW_POSES, text, d);
    free(text);
    return e;
}

/* Keep a status message's verdict as a piece of JSON. */
static void judge(struct view_bridge *b, const void *msg, size_t len)
{
    char text[VIEW_VERDICT_TEXT] = "";
    const char *json;
    size_t n;
    b->verdict_said[0] = '\0';
    if (b->verdict == NULL || pvp_decode_status(msg, len, &json, &n, NULL) != PVX_OK)
        return;
    b->verdict(json, n, text);
    cJSON *j = text[0] != '\0' ? cJSON_CreateString(text) : NULL;
    char *said = cJSON_PrintUnformatted(j);
    if (said != NULL)
        snprintf(b->verdict_said, sizeof b->verdict_said, ",\"verdict\":%s", said);
    cJSON_free(said);
    cJSON_Delete(j);
}

static pvx_err put_bars(struct view_bridge *b, struct pvx_diag *d)
{
    size_t len = 0;
    const void *bars = b->source.ops->bars(b->source.self, &len);
    return view_shelf_put_bars(b->shelf, bars, len, d);
}

static void take_one(struct view_bridge *b, const struct pvp_header *h, const void *msg, size_t len)
{
    struct pvx_diag d = {""};
    uint64_t before = view_shelf_number(b->shelf, VIEW_VOLUME);
    b->came_ns = pvx_now_mono();
    if (h->type == PVP_VOLUME)
        for (int i = 0; i < VIEW_SEATS; i++)
            if (b->seat[i].page != NULL)
                view_page_count(b->seat[i].page, before);
    pvx_err e = h->type == PVP_VOLUME ? put_bars(b, &d) : PVX_OK;
    PVX_THEN(e, view_shelf_put(b->shelf, h, msg, len, &d));
    if (e == PVX_OK && h->type == PVP_STATUS)
        judge(b, msg, len);
    if (h->type == PVP_END)
        b->verdict_said[0] = '\0';
    if (e == PVX_OK && h->type == PVP_RIG)
        e = put_poses(b, msg, len, &d);
    if (e == PVX_OK)
        return;
    b->stats.unreadable++;
    bridge_tell(b, e, &d);
}

/* Take the messages that are there, up to a limit; true: there may be more. */
static bool bridge_take(struct view_bridge *b)
{
    for (int i = 0; i < TURN_MAX; i++) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        struct pvx_diag d = {""};
        pvx_err e = b->source.ops->next(b->source.self, &h, &msg, &len, &d);
        if (e == PVX_ETIMEDOUT)
            return false;
        if (e == PVX_OK)
            take_one(b, &h, msg, len);
        else
            bridge_tell(b, e, &d);
    }
    return true;
}

/* [median, 95 %] of a way, or [null, null]. */
static const char *bridge_ms(view_page *p, enum view_way way, int64_t now, char out[64])
{
    double half = view_page_recent(p, way, 0.5, now), most = view_page_recent(p, way, 0.95, now);
    if (isnan(half))
        return "[null,null]";
    snprintf(out, 64, "[%.3f,%.3f]", half, most);
    return out;
}

/* What a page is told once a second about the link to it. */
static void link_text(struct view_bridge *b, view_page *p, char *out, size_t size)
{
    char drawn[64], held[64], whole[64];
    int64_t now = pvx_now_mono();
    const struct view_page_stats *st = view_page_stats(p);
    const struct view_source_stats *s = &b->stats.source;
    double silent = b->came_ns != 0 ? (double)(now - b->came_ns) * 1e-9 : -1;
    snprintf(out, size,
             "{\"link\":{\"received\":%llu,\"lost\":%llu,\"malformed\":%llu,\"unreadable\":%llu,"
             "\"silent_s\":%.1f,\"pages\":%llu,\"volumes_sent\":%llu,\"volumes_drawn\":%llu,"
             "\"superseded\":%llu,\"hidden\":%llu,\"drawn_ms\":%s,\"held_ms\":%s,"
             "\"whole_ms\":%s,\"bars\":%s}%s%s%s%s%s}",
             (unsigned long long)s->received, (unsigned long long)s->lost,
             (unsigned long long)s->malformed, (unsigned long long)b->stats.unreadable, silent,
             (unsigned long long)b->stats.pages_now, (unsigned long long)st->sent,
             (unsigned long long)st->drawn, (unsigned long long)st->superseded,
             (unsigned long long)st->hidden, bridge_ms(p, VIEW_DRAWN, now, drawn),
             bridge_ms(p, VIEW_HELD, now, held), bridge_ms(p, VIEW_WHOLE, now, whole),
             view_shelf_number(b->shelf, VIEW_BARS) > 0 ? "true" : "false",
             s->words[0] != '\0' ? "," : "", s->words, b->orders != NULL ? "," : "",
             b->orders != NULL ? view_orders_text(b->orders) : "", b->verdict_said);
}

/* A page beyond the limit has the right token too, so it is told why it is closed. */
static void no_more(struct view_bridge *b, view_page *p, uint64_t let_in)
{
    if (let_in <= VIEW_PAGES_MAX || view_page_closing(p))
        return;
    b->stats.refused_full++;
    view_page_close(p, VIEW_CLOSE_FULL, "as many pages are open as there is room for");
}

static void serve_pages(struct view_bridge *b)
{
    int64_t now = pvx_now_mono();
    bool previews = false;
    uint64_t let_in = 0;
    b->source.ops->stats(b->source.self, &b->stats.source);
    if (now >= b->link_ns || (b->orders != NULL && view_orders_run(b->orders))) {
        b->link_ns = now + LINK_NS;
        b->links++;
    }
    for (int i = 0; i < VIEW_SEATS; i++) {
        struct seat *s = &b->seat[i];
        struct view_words w;
        char link[1024 + VIEW_ORDER_TEXT + sizeof b->verdict_said];
        if (s->page == NULL)
            continue;
        if (view_page_read(s->page, &w)) {
            b->source.ops->said(b->source.self, &w);
            if ((w.said & VIEW_SAID_ORDER) != 0 && b->orders != NULL)
                view_orders_give(b->orders, w.order);
            b->link_ns = 0; /* the others see at once where the film is */
        }
        let_in += view_page_let_in(s->page) && !view_page_closing(s->page);
        no_more(b, s->page, let_in);
        link_text(b, s->page, link, sizeof link);
        view_page_write(s->page, b->shelf, link, b->links);
        if (view_page_over(s->page, now)) {
            bridge_leave(b, s);
            continue;
        }
        previews |= view_page_wants_previews(s->page);
    }
    b->stats.pages_now = let_in < VIEW_PAGES_MAX ? let_in : VIEW_PAGES_MAX;
    b->source.ops->previews(b->source.self, previews);
}

static void wait_for_more(struct view_bridge *b, bool more)
{
    struct pollfd p[VIEW_SOURCE_FDS + VIEW_SEATS + VIEW_HTTP_FDS];
    nfds_t n = (nfds_t)b->source.ops->fds(b->source.self, p);
    n += (nfds_t)view_http_fds(b->http, p + n);
    for (int i = 0; i < VIEW_SEATS; i++)
        if (b->seat[i].page != NULL)
            p[n++] =
                (struct pollfd){.fd = b->seat[i].fd, .events = view_page_wants(b->seat[i].page)};
    int64_t now = pvx_now_mono(), until = now + TURN_NS;
    int64_t film = b->source.ops->due_ns(b->source.self), http = view_http_due_ns(b->http);
    if (film < until)
        until = film;
    if (http < until)
        until = http;
    int64_t left = until > now && !more ? until - now : 0;
    poll(p, n, (int)((left + PVX_NS_PER_MS - 1) / PVX_NS_PER_MS));
}

void view_bridge_run(view_bridge *b, bool (*stop)(void *ctx), void (*say)(const char *line),
                     void *ctx)
{
    b->say = say;
    while (!stop(ctx)) {
        /* ZeroMQ's handle is edge-triggered: everything is taken before waiting */
        bool more = bridge_take(b);
        view_http_run(b->http);
        serve_pages(b);
        wait_for_more(b, more);
    }
}

void view_bridge_verdict(view_bridge *b,
                         void (*verdict)(const char *json, size_t len, char out[VIEW_VERDICT_TEXT]))
{
    b->verdict = verdict;
}

void view_bridge_stats(const view_bridge *b, struct view_bridge_stats *out)
{
    *out = b->stats;
    view_http_stats(b->http, &out->http);
}
