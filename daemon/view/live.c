/* live.c - the daemon as a source.  Previews are subscribed to only while a page wants them. */
#include <stdlib.h>
#include <string.h>

#include "daemon/view/source.h"

struct live {
    pvp_sub *volumes, *previews;
    char *previews_at, *key;
};

static int live_fds(void *self, struct pollfd out[VIEW_SOURCE_FDS])
{
    struct live *l = self;
    int n = 0;
    out[n++] = (struct pollfd){.fd = pvp_sub_fd(l->volumes), .events = POLLIN};
    if (l->previews != NULL)
        out[n++] = (struct pollfd){.fd = pvp_sub_fd(l->previews), .events = POLLIN};
    return n;
}

static int64_t live_due_ns(void *self)
{
    (void)self;
    return INT64_MAX;
}

static pvx_err live_next(void *self, struct pvp_header *h, const void **msg, size_t *len,
                         struct pvx_diag *d)
{
    struct live *l = self;
    pvx_err e = pvp_sub_next(l->volumes, 0, h, msg, len, d);
    if (e != PVX_ETIMEDOUT || l->previews == NULL)
        return e;
    do /* of its messages only previews: the others come with the volumes */
        e = pvp_sub_next(l->previews, 0, h, msg, len, d);
    while (e == PVX_OK && h->type != PVP_PREVIEW);
    return e;
}

static const void *live_bars(void *self, size_t *len)
{
    return pvp_sub_bars(((struct live *)self)->volumes, len);
}

static void live_said(void *self, const struct view_words *w)
{
    (void)self;
    (void)w;
}

static void live_previews(void *self, bool wanted)
{
    struct live *l = self;
    if (!wanted || l->previews_at == NULL)
        pvp_sub_free(&l->previews);
    else if (l->previews == NULL &&
             pvp_sub_new(l->previews_at, &(struct pvp_sub_options){.key = l->key}, &l->previews,
                         NULL) != PVX_OK)
        l->previews = NULL; /* the page says that none come */
}

static void live_stats(void *self, struct view_source_stats *out)
{
    const struct live *l = self;
    struct pvp_sub_stats st;
    pvp_sub_stats(l->volumes, &st);
    *out = (struct view_source_stats){
        .received = st.received, .lost = st.lost, .malformed = st.malformed};
}

static void live_free(void *self)
{
    struct live *l = self;
    pvp_sub_free(&l->volumes);
    pvp_sub_free(&l->previews);
    free(l->previews_at);
    free(l->key);
    free(l);
}

static const struct view_source_ops ops = {live_fds,  live_due_ns,   live_next,  live_bars,
                                           live_said, live_previews, live_stats, live_free};

pvx_err view_live_new(const char *endpoint, const char *previews_at, const char *key,
                      struct view_source *out, struct pvx_diag *d)
{
    struct live *l = calloc(1, sizeof *l);
    PVX_NEED(l);
    *out = (struct view_source){&ops, l};
    l->previews_at = previews_at != NULL ? strdup(previews_at) : NULL;
    l->key = key != NULL ? strdup(key) : NULL;
    pvx_err e = (previews_at != NULL && l->previews_at == NULL) || (key != NULL && l->key == NULL)
                    ? PVX_ENOMEM
                    : pvp_sub_new(endpoint, &(struct pvp_sub_options){.key = key}, &l->volumes, d);
    if (e != PVX_OK) {
        live_free(l);
        out->self = NULL;
    }
    return e;
}
