#include "daemon/volumes/recorder.h"

#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"

#define B3 ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)

enum kind { VOLUME, GAP, SESSION };

/* What waits, in order. */
struct item {
    struct item *next;
    size_t bytes;
    enum kind kind;
    struct vol_volume v; /* its arrays lie behind the item */
    struct vol_gap gap;
    struct vol_head head; /* its texts are the item's own */
    char *path;
};

struct vol_recorder {
    struct vol_recorder_config c;
    char *path;
    bool begun;
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t more;
    struct item *first, **last;
    bool quit;
    struct vol_recorder_stats st;
    struct vol_gap full; /* sets left out since the last that was taken; volumes 0 = none */
    /* the thread's own */
    vol_writer *writer;
    uint64_t bytes_before; /* of recordings that are closed */
    struct item *session;  /* that is being written */
    unsigned part;         /* of the session; 1 = the first */
    int64_t t_roll_ns;     /* mono */
};

static void item_free(struct item *i)
{
    if (i == NULL)
        return;
    free((char *)i->head.rig);
    free((char *)i->head.config);
    free(i->path);
    free(i);
}

static pvx_err close_writer(vol_recorder *r, struct pvx_diag *d)
{
    if (r->writer == NULL)
        return PVX_OK;
    r->bytes_before += vol_writer_bytes(r->writer);
    return vol_writer_close(&r->writer, d);
}

static pvx_err open_writer(vol_recorder *r, const char *path, struct pvx_diag *d)
{
    PVX_TRY(close_writer(r, d));
    r->t_roll_ns = pvx_now_mono() + r->c.roll_ns;
    return vol_writer_open(r->c.format, path, &r->session->head, &r->c.options, &r->writer, d);
}

static pvx_err volumes_roll(vol_recorder *r, struct pvx_diag *d)
{
    char path[PATH_MAX], more[16];
    snprintf(more, sizeof more, "-%04u", ++r->part);
    const char *of = r->session->path;
    int n = snprintf(path, sizeof path, "%s%s", of, more); /* a folder's name has no ending */
    bool fits = r->c.format == VOL_HDF5 ? pvx_path_more(of, more, path, sizeof path) == PVX_OK
                                        : n < (int)sizeof path;
    if (!fits)
        return pvx_fail(d, PVX_ERANGE, "%s: too long a name for the one after it", of);
    PVX_TRY(open_writer(r, path, d));
    pthread_mutex_lock(&r->lock);
    r->st.rolled++;
    pthread_mutex_unlock(&r->lock);
    return PVX_OK;
}

/* Carry out one item.  A session's item is kept, and *i becomes NULL. */
static pvx_err recorder_carry_out(vol_recorder *r, struct item **i, struct pvx_diag *d)
{
    switch ((*i)->kind) {
    case SESSION:
        item_free(r->session);
        r->session = *i;
        *i = NULL;
        r->part = 1;
        return open_writer(r, r->session->path, d);
    case GAP: return r->writer != NULL ? vol_writer_gap(r->writer, &(*i)->gap, d) : PVX_OK;
    case VOLUME:
        if (r->c.roll_ns > 0 && pvx_now_mono() >= r->t_roll_ns)
            PVX_TRY(volumes_roll(r, d));
        return vol_writer_put(r->writer, &(*i)->v, d);
    }
    return PVX_OK;
}

static void *recorder_write_all(void *ctx)
{
    vol_recorder *r = ctx;
    pthread_mutex_lock(&r->lock);
    for (;;) {
        while (r->first == NULL && !r->quit)
            pthread_cond_wait(&r->more, &r->lock);
        struct item *i = r->first;
        if (i == NULL)
            break;
        r->first = i->next;
        if (r->first == NULL)
            r->last = &r->first;
        enum kind kind = i->kind;
        size_t taken = i->bytes;
        bool hurry = r->st.queued > r->c.queue_bytes / 2, skip = r->st.error != PVX_OK;
        pthread_mutex_unlock(&r->lock);
        struct pvx_diag d = {""};
        pvx_err e = PVX_OK;
        if (!skip && r->writer != NULL)
            vol_writer_hurry(r->writer, hurry);
        bool beyond = kind == VOLUME && vol_beyond(r->c.format, &i->v);
        if (!skip)
            e = recorder_carry_out(r, &i, &d);
        uint64_t bytes = r->bytes_before + (r->writer != NULL ? vol_writer_bytes(r->writer) : 0);
        pthread_mutex_lock(&r->lock);
        r->st.queued -= taken;
        r->st.bytes = bytes;
        r->st.written += !skip && e == PVX_OK && kind == VOLUME;
        r->st.clamped += !skip && e == PVX_OK && beyond;
        if (e != PVX_OK && r->st.error == PVX_OK) {
            r->st.error = e;
            r->st.why = d;
        }
        item_free(i);
    }
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

static void recorder_queue(vol_recorder *r, struct item *i)
{
    pthread_mutex_lock(&r->lock);
    r->st.queued += i->bytes;
    *r->last = i;
    r->last = &i->next;
    pthread_cond_signal(&r->more);
    pthread_mutex_unlock(&r->lock);
}

pvx_err vol_recorder_new(const struct vol_recorder_config *c, vol_recorder **out,
                         struct pvx_diag *d)
{
    *out = NULL;
    PVX_TRY(vol_writer_check(c->format, c->path, d));
    vol_recorder *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->c = *c;
    if (r->c.queue_bytes == 0)
        r->c.queue_bytes = VOL_QUEUE_BYTES;
    r->path = strdup(c->path);
    r->last = &r->first;
    pthread_mutex_init(&r->lock, NULL);
    pthread_cond_init(&r->more, NULL);
    int err = r->path != NULL ? pthread_create(&r->thread, NULL, recorder_write_all, r) : 12;
    if (err != 0) {
        pthread_mutex_destroy(&r->lock);
        pthread_cond_destroy(&r->more);
        free(r->path);
        free(r);
        return pvx_fail(d, pvx_err_from_errno(err), "no thread to write with");
    }
    *out = r;
    return PVX_OK;
}

/* The first session's place is the one asked for; the others get their number. */
static char *recorder_place(const vol_recorder *r, uint64_t session)
{
    char *out = NULL, more[32], path[PATH_MAX];
    if (!r->begun)
        return strdup(r->path);
    snprintf(more, sizeof more, "-session-%016llx", (unsigned long long)session);
    if (r->c.format == VOL_HDF5)
        return pvx_path_more(r->path, more, path, sizeof path) == PVX_OK ? strdup(path) : NULL;
    return asprintf(&out, "%s/%s", r->path, more + 1) >= 0 ? out : NULL;
}

pvx_err vol_recorder_session(vol_recorder *r, const struct vol_head *head, char *where, size_t size,
                             struct pvx_diag *d)
{
    struct item *i = pvx_calloc(1, sizeof *i);
    PVX_NEED(i);
    i->kind = SESSION;
    i->head = *head;
    i->head.rig = head->rig != NULL ? strdup(head->rig) : NULL;
    i->head.config = head->config != NULL ? strdup(head->config) : NULL;
    i->path = recorder_place(r, head->start.session);
    pvx_err e = i->path == NULL || (head->rig != NULL && i->head.rig == NULL) ||
                        (head->config != NULL && i->head.config == NULL)
                    ? PVX_ENOMEM
                    : vol_writer_check(r->c.format, i->path, d);
    if (e != PVX_OK) {
        item_free(i);
        return e;
    }
    snprintf(where, size, "%s", i->path);
    r->begun = true;
    r->full = (struct vol_gap){0};
    recorder_queue(r, i);
    return PVX_OK;
}

pvx_err vol_recorder_gap(vol_recorder *r, const struct vol_gap *g)
{
    struct item *i = pvx_calloc(1, sizeof *i);
    PVX_NEED(i);
    i->kind = GAP;
    i->gap = *g;
    recorder_queue(r, i);
    return PVX_OK;
}

static bool is_full(vol_recorder *r, size_t bytes)
{
    pthread_mutex_lock(&r->lock);
    /* one volume always has room, however large */
    bool full = r->st.queued > 0 && r->st.queued + bytes > r->c.queue_bytes;
    r->st.left_out += full;
    pthread_mutex_unlock(&r->lock);
    return full;
}

/* Bars that cannot be read, or are none, are left out: the volume is worth more. */
static bool read_bars(pvp_decoder *dec, const struct pvp_view *bars, uint32_t *ids, float *sd,
                      size_t floats)
{
    bool good = pvp_volume_bricks(dec, bars, ids, sd, floats, NULL) == PVX_OK;
    for (size_t k = 0; k < floats && good; k++)
        good = sd[k] >= 0;
    return good;
}

pvx_err vol_recorder_put(vol_recorder *r, pvp_decoder *dec, const struct pvp_view *view,
                         const struct pvp_view *bars, uint32_t doubt, struct pvx_diag *d)
{
    size_t floats = view->n_bricks * B3 * view->v.grid.channels, planes = bars != NULL ? 2 : 1;
    size_t bytes =
        sizeof(struct item) + view->n_bricks * sizeof(uint32_t) + planes * floats * sizeof(float);
    if (is_full(r, bytes)) {
        if (r->full.volumes++ == 0)
            r->full.set_first = view->v.set;
        r->full.why = VOL_GAP_QUEUE;
        r->full.set_last = view->v.set;
        return PVX_OK;
    }
    if (r->full.volumes > 0) {
        PVX_TRY(vol_recorder_gap(r, &r->full));
        r->full = (struct vol_gap){0};
    }
    struct item *i = malloc(bytes);
    if (i == NULL)
        return pvx_fail(d, PVX_ENOMEM, "no memory for a volume of %zu bytes", bytes);
    float *brick = (float *)(i + 1);
    uint32_t *ids = (uint32_t *)(brick + planes * floats);
    *i = (struct item){.bytes = bytes,
                       .kind = VOLUME,
                       .v = {.v = view->v,
                             .sample = view->sample,
                             .clamped = view->clamped,
                             .n_bricks = view->n_bricks,
                             .ids = ids,
                             .brick = brick}};
    if (bars != NULL && read_bars(dec, bars, ids, brick + floats, floats))
        i->v.bars = (struct vol_bars){.sd = brick + floats, .doubt = doubt};
    pvx_err e = pvp_volume_bricks(dec, view, ids, brick, floats, d);
    if (e != PVX_OK)
        free(i);
    else
        recorder_queue(r, i);
    return e;
}

void vol_recorder_stats(vol_recorder *r, struct vol_recorder_stats *out)
{
    pthread_mutex_lock(&r->lock);
    *out = r->st;
    pthread_mutex_unlock(&r->lock);
}

pvx_err vol_recorder_finish(vol_recorder **rp, struct vol_recorder_stats *last, struct pvx_diag *d)
{
    vol_recorder *r = *rp;
    if (r == NULL)
        return PVX_OK;
    *rp = NULL;
    if (r->full.volumes > 0 && vol_recorder_gap(r, &r->full) != PVX_OK)
        r->full.volumes = 0; /* no memory for it: the count stays in the statistics */
    pthread_mutex_lock(&r->lock);
    r->quit = true;
    pthread_cond_signal(&r->more);
    pthread_mutex_unlock(&r->lock);
    pthread_join(r->thread, NULL);
    struct pvx_diag closing = {""};
    pvx_err e = close_writer(r, &closing);
    if (r->st.error != PVX_OK)
        e = pvx_fail(d, r->st.error, "%s", pvx_diag_text(&r->st.why, r->st.error));
    else if (e != PVX_OK)
        e = pvx_fail(d, e, "%s", pvx_diag_text(&closing, e));
    r->st.bytes = r->bytes_before;
    if (last != NULL)
        *last = r->st;
    pthread_mutex_destroy(&r->lock);
    pthread_cond_destroy(&r->more);
    item_free(r->session);
    free(r->path);
    free(r);
    return e;
}
