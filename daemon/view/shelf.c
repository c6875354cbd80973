#include "daemon/view/shelf.h"

#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"

struct held {
    struct view_msg m;
    void *data;
    size_t room;
};
enum { READABLE, SMALL, FORMS }; /* of a volume and of bars, each made when a page first wants it */

struct view_shelf {
    struct held slot[VIEW_SLOTS];
    struct held form[FORMS], bars_form[FORMS];
    struct held event[VIEW_EVENTS];
    uint64_t events, session;
    pvp_relay *relay;
};

pvx_err view_shelf_new(view_shelf **out)
{
    *out = pvx_calloc(1, sizeof **out);
    PVX_NEED(*out);
    pvx_err e = pvp_relay_new(&(*out)->relay);
    if (e != PVX_OK)
        PVX_FREE(*out);
    return e;
}

void view_shelf_free(view_shelf **s)
{
    if (*s == NULL)
        return;
    for (int i = 0; i < VIEW_SLOTS; i++)
        free((*s)->slot[i].data);
    for (int i = 0; i < FORMS; i++)
        free((*s)->form[i].data);
    for (int i = 0; i < FORMS; i++)
        free((*s)->bars_form[i].data);
    for (int i = 0; i < VIEW_EVENTS; i++)
        free((*s)->event[i].data);
    pvp_relay_free(&(*s)->relay);
    PVX_FREE(*s);
}

static pvx_err shelf_hold(struct held *h, const void *msg, size_t len, struct pvx_diag *d)
{
    if (len > h->room) {
        free(h->data);
        h->m.len = h->room = 0;
        h->data = malloc(len);
        if (h->data == NULL)
            return pvx_fail(d, PVX_ENOMEM, "no memory for a message of %zu bytes", len);
        h->room = len;
    }
    memcpy(h->data, msg, len);
    h->m.data = h->data;
    h->m.len = len;
    h->m.came_ns = pvx_now_mono();
    return PVX_OK;
}

static void shelf_begin_session(view_shelf *s, uint64_t session)
{
    s->session = session;
    for (int i = 0; i < VIEW_SLOTS; i++)
        s->slot[i].m.len = 0;
}

static int shelf_slot_of(enum pvp_type type)
{
    switch (type) {
    case PVP_START: return VIEW_START;
    case PVP_RIG: return VIEW_RIG;
    case PVP_END: return VIEW_END;
    case PVP_STATUS: return VIEW_STATUS;
    case PVP_VOLUME: return VIEW_VOLUME;
    case PVP_PREVIEW: return VIEW_PREVIEW;
    default: return -1;
    }
}

/* Whether the body is what it was.  The header is not compared, as its counts differ. */
static bool repeated(const struct held *h, const struct pvp_header *now, const void *msg)
{
    return h->m.len == now->head + now->body &&
           memcmp((const uint8_t *)h->data + now->head, (const uint8_t *)msg + now->head,
                  now->body) == 0;
}

pvx_err view_shelf_put(view_shelf *s, const struct pvp_header *h, const void *msg, size_t len,
                       struct pvx_diag *d)
{
    struct pvp_view v;
    if (h->session != s->session)
        shelf_begin_session(s, h->session);
    if (h->type == PVP_EVENT) {
        struct held *e = &s->event[s->events % VIEW_EVENTS];
        PVX_TRY(shelf_hold(e, msg, len, d));
        e->m.number = ++s->events;
        return PVX_OK;
    }
    int slot = shelf_slot_of(h->type);
    if (slot < 0)
        return PVX_OK;
    struct held *to = &s->slot[slot];
    if ((slot == VIEW_START || slot == VIEW_RIG) && repeated(to, h, msg))
        return PVX_OK;
    if (slot == VIEW_VOLUME) {
        PVX_TRY(pvp_decode_volume(msg, len, &v, d));
        to->m.set = v.v.set;
        to->m.published_ns = v.v.t_publish_ns;
    }
    PVX_TRY(shelf_hold(to, msg, len, d));
    to->m.number++;
    return PVX_OK;
}

pvx_err view_shelf_put_bars(view_shelf *s, const void *msg, size_t len, struct pvx_diag *d)
{
    struct held *to = &s->slot[VIEW_BARS];
    to->m.len = 0;
    if (msg == NULL)
        return PVX_OK;
    PVX_TRY(shelf_hold(to, msg, len, d));
    to->m.number++;
    return PVX_OK;
}

pvx_err view_shelf_put_text(view_shelf *s, enum view_slot slot, const char *text,
                            struct pvx_diag *d)
{
    PVX_TRY(shelf_hold(&s->slot[slot], text, strlen(text), d));
    s->slot[slot].m.number++;
    return PVX_OK;
}

uint64_t view_shelf_number(const view_shelf *s, enum view_slot slot)
{
    return s->slot[slot].m.len > 0 ? s->slot[slot].m.number : 0;
}

pvx_err view_shelf_get(view_shelf *s, enum view_slot slot, bool small, struct view_msg *out,
                       struct pvx_diag *d)
{
    const struct held *from = &s->slot[slot];
    *out = from->m;
    if (from->m.len == 0) {
        out->number = 0;
        return PVX_OK;
    }
    if (slot != VIEW_VOLUME && slot != VIEW_BARS)
        return PVX_OK;
    struct held *form = (slot == VIEW_BARS ? s->bars_form : s->form) + (small ? SMALL : READABLE);
    if (form->m.number != from->m.number) {
        const void *msg;
        size_t len;
        PVX_TRY(pvp_relay_volume(s->relay, from->data, from->m.len, small, &msg, &len, d));
        PVX_TRY(shelf_hold(form, msg, len, d));
        form->m.number = from->m.number;
    }
    out->data = form->m.data;
    out->len = form->m.len;
    return PVX_OK;
}

bool view_shelf_event(const view_shelf *s, uint64_t after, struct view_msg *out)
{
    if (after >= s->events)
        return false;
    uint64_t first = s->events > VIEW_EVENTS ? s->events - VIEW_EVENTS : 0;
    uint64_t k = after > first ? after : first;
    *out = s->event[k % VIEW_EVENTS].m;
    return true;
}
