/* source.c - take: the frames of a take (take.h) as cameras.
 *
 *     take:FILE            the camera of this name, at the original speed
 *     take:FILE?speed=2    twice as fast
 * Frames carry their sets' numbers and their original times, so the sets are those of the recording (frameset.h) at
 * any speed.  Lossless: as fast as the consumer takes them, and every frame.
 * Live, a frame comes as long after the first set's arrival as in the recording, by the monotonic clock.  A host clock
 * that was set during the recording affects the frames' times, not their pace.
 * Frames without a set are not played.  All cameras of a file share it and one time line, which starts with the first
 * of them.  With `loop`, numbers and times of turn n are later by n times the length of the take. */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/yaml.h"
#include "capture/source/backends.h"
#include "capture/source/player.h"
#include "capture/take/take.h"

#define FAR_NS    (INT64_MAX / 4)
#define LEAD_NS   (100 * PVX_NS_PER_MS) /* from the first start to the first frame */
#define SPEED_MIN 1e-3
#define SPEED_MAX 1e3

/* An open file and its time line. */
struct shared {
    char *path;
    cap_take *take;
    unsigned users;
    bool running;
    int64_t start_mono_ns;    /* the first set is due */
    int64_t came_ns, pace_ns; /* arrival of the first set (mono); from turn to turn, > 0 */
    int64_t length_ns;        /* from turn to turn in exposure times, > 0 */
    uint64_t first, count;    /* number of the first set; numbers of a turn */
    struct shared *next;
};
static pthread_mutex_t shared_lock = PTHREAD_MUTEX_INITIALIZER;
static struct shared *shared_list;

struct source {
    struct cap_source base;
    struct cap_player player;
    struct shared *file;
    int in_take; /* camera's number there */
    char *name;
    double speed;
    bool loop;
    bool said_damaged;
};

/* ---- the file ---- */

/* Length of a turn: the span from its first to its last set, plus one mean interval.  Times are at most
 * INT64_MAX / 2, and so is a span (read.c). */
static int64_t turn_of(int64_t span, uint64_t sets)
{
    return span > 0 ? span + span / (int64_t)(sets - 1) : PVX_NS_PER_S;
}

static pvx_err open_shared(struct shared *s, struct pvx_diag *d)
{
    PVX_TRY(cap_take_open(s->path, &s->take, d));
    const struct cap_take_info *info = cap_take_info(s->take);
    if (info->sets == 0)
        return pvx_fail(d, PVX_EFORMAT, "%s: holds no complete set", s->path);
    const struct cap_take_set *a = cap_take_set(s->take, 0, NULL);
    const struct cap_take_set *b = cap_take_set(s->take, info->sets - 1, NULL);
    s->first = a->number;
    s->count = b->number - a->number + 1;
    s->came_ns = a->t_last_mono_ns;
    s->pace_ns = turn_of(b->t_last_mono_ns - a->t_last_mono_ns, info->sets);
    int64_t span = b->t_exposure_ns - a->t_exposure_ns; /* not > 0: the clock was set back */
    s->length_ns = span > 0 ? turn_of(span, info->sets) : s->pace_ns;
    for (uint64_t k = 0; k < info->notes; k++)
        LOG_W(CAPTURE, "%s", cap_take_note(s->take, k));
    return PVX_OK;
}

static void free_shared(struct shared *s)
{
    cap_take_free(&s->take);
    free(s->path);
    free(s);
}

static pvx_err new_shared(const char *path, struct shared **out, struct pvx_diag *d)
{
    struct shared *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    s->path = strdup(path);
    pvx_err e = s->path != NULL ? open_shared(s, d) : PVX_ENOMEM;
    if (e != PVX_OK) {
        free_shared(s);
        return e;
    }
    *out = s;
    return PVX_OK;
}

static pvx_err join_shared(const char *path, struct shared **out, struct pvx_diag *d)
{
    pvx_err e = PVX_OK;
    pthread_mutex_lock(&shared_lock);
    struct shared *s = shared_list;
    while (s != NULL && strcmp(s->path, path) != 0)
        s = s->next;
    if (s == NULL && (e = new_shared(path, &s, d)) == PVX_OK) {
        s->next = shared_list;
        shared_list = s;
    }
    if (e == PVX_OK)
        s->users++;
    pthread_mutex_unlock(&shared_lock);
    *out = e == PVX_OK ? s : NULL;
    return e;
}

static void leave_shared(struct shared *s)
{
    if (s == NULL)
        return;
    pthread_mutex_lock(&shared_lock);
    bool last = --s->users == 0;
    for (struct shared **p = &shared_list; last && *p != NULL; p = &(*p)->next)
        if (*p == s) {
            *p = s->next;
            break;
        }
    pthread_mutex_unlock(&shared_lock);
    if (last)
        free_shared(s);
}

static int64_t start_of(struct shared *s)
{
    pthread_mutex_lock(&shared_lock);
    if (!s->running) {
        s->running = true;
        s->start_mono_ns = pvx_now_mono() + LEAD_NS;
    }
    int64_t t = s->start_mono_ns;
    pthread_mutex_unlock(&shared_lock);
    return t;
}

/* ---- thread ---- */

/* Read a frame into a buffer.  NULL: it is left out and counted, or stop. */
static struct cap_frame *source_load(struct source *p, uint64_t row)
{
    struct cap_frame *f = cap_player_get(&p->player);
    if (f == NULL)
        return NULL;
    struct pvx_diag d = {""};
    pvx_err e = cap_take_read(p->file->take, (uint32_t)p->in_take, row, cap_bufpool_memory(f),
                              cap_bufpool_bytes(p->player.pool), &f->img, &d);
    if (e == PVX_OK)
        return f;
    cap_frame_release(f);
    cap_player_count(&p->player, CAP_INCOMPLETE, 1);
    if (!p->said_damaged)
        LOG_W(CAPTURE, "camera %s: %s; it and others like it are left out", p->name,
              pvx_diag_text(&d, e));
    p->said_damaged = true;
    return NULL;
}

/* Mono time when a row is due. */
static int64_t source_due(struct source *p, const struct cap_take_row *r, int64_t turns_ns)
{
    double after = (double)(r->t_arrival_mono_ns - p->file->came_ns + turns_ns) / p->speed;
    int64_t wait = after < 0 ? 0 : after < (double)FAR_NS ? (int64_t)after : FAR_NS;
    return start_of(p->file) + wait;
}

/* Whether the times of turn `turn` do not overflow. */
static bool can_tell(const struct shared *s, uint64_t turn)
{
    int64_t most = s->length_ns > s->pace_ns ? s->length_ns : s->pace_ns;
    return turn <= (uint64_t)(INT64_MAX / 2 / most);
}

/* Play one frame of turn `turn`; false = stop. */
static bool source_play(struct source *p, uint64_t turn, uint64_t row,
                        const struct cap_take_set *set, uint64_t *good)
{
    const struct shared *s = p->file;
    const struct cap_take_row *r = cap_take_row(s->take, (uint32_t)p->in_take, row);
    int64_t shift = (int64_t)turn * s->length_ns;
    if (!p->player.lossless &&
        !cap_player_wait_until(&p->player, source_due(p, r, (int64_t)turn * s->pace_ns)))
        return false;
    struct cap_frame *f = source_load(p, row);
    if (f == NULL)
        return !cap_player_stopped(&p->player);
    f->id = r->id + turn * s->count;
    f->t_device_ns = r->t_device_ns;
    f->t_exposure_ns = r->t_exposure_ns + shift;
    f->exposure_us = r->exposure_us;
    f->gain = r->gain;
    f->set = set->number + turn * s->count + 1;
    f->set_size = set->n;
    f->t_arrival_ns = pvx_now_real();
    f->t_arrival_mono_ns = pvx_now_mono();
    *good += 1;
    p->player.sink.push(p->player.sink.ctx, f);
    return true;
}

/* Play one turn through the sets; false = stop. */
static bool play_all(struct source *p, uint64_t turn, uint64_t *good)
{
    const cap_take *t = p->file->take;
    const struct cap_take_row *last = NULL;
    for (uint64_t k = 0; k < cap_take_info(t)->sets; k++) {
        const int64_t *member;
        const struct cap_take_set *set = cap_take_set(t, k, &member);
        if (member[p->in_take] < 0)
            continue;
        const struct cap_take_row *r =
            cap_take_row(t, (uint32_t)p->in_take, (uint64_t)member[p->in_take]);
        if (last != NULL && r->id > last->id)
            cap_player_count(&p->player, CAP_ID_GAP, r->id - last->id - 1);
        last = r;
        if (!source_play(p, turn, (uint64_t)member[p->in_take], set, good))
            return false;
    }
    return true;
}

static void *source_run(void *arg)
{
    struct source *p = arg;
    for (uint64_t turn = 0; can_tell(p->file, turn); turn++) {
        uint64_t good = 0;
        if (!play_all(p, turn, &good))
            return NULL;
        if (!p->loop || good == 0) /* a turn without frames is not repeated */
            break;
    }
    cap_player_event(&p->player, CAP_EV_END);
    return NULL;
}

/* ---- operations ---- */

static void take_close(cap_source **sp)
{
    struct source *p = (struct source *)*sp;
    if (p == NULL)
        return;
    *sp = NULL;
    leave_shared(p->file);
    cap_player_fini(&p->player);
    free(p->name);
    free(p);
}

/* "FILE?speed=X" -> FILE in *path (owner: caller) and X. */
static pvx_err parse_uri(const char *uri, char **path, double *speed, struct pvx_diag *d)
{
    const char *q = strstr(uri, "?speed=");
    *speed = 1;
    *path = strndup(uri, q != NULL ? (size_t)(q - uri) : strlen(uri));
    PVX_NEED(*path);
    if (q != NULL && pvx_parse_double(q + 7, SPEED_MIN, SPEED_MAX, speed) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL, "take:%s: the speed should be a number from %g to %g", uri,
                        SPEED_MIN, SPEED_MAX);
    return PVX_OK;
}

static pvx_err source_set_up(struct source *p, const struct cap_source_config *c, const char *path,
                             struct pvx_diag *d)
{
    PVX_TRY(join_shared(path, &p->file, d));
    p->in_take = cap_take_find(p->file->take, p->name);
    if (p->in_take < 0)
        return pvx_fail(d, PVX_ENOENT, "%s: has no camera %s", path, p->name);
    const struct cap_take_camera *k = &cap_take_info(p->file->take)->head.camera[p->in_take];
    if (k->fmt == CAP_FMT_NONE)
        return cap_player_make_pool(&p->player, c, 1); /* it never sent a frame */
    if ((c->width > 0 && c->width != k->width) || (c->height > 0 && c->height != k->height))
        return pvx_fail(d, PVX_EINVAL, "%s: camera %s has %dx%d pixels there, %dx%d in the rig",
                        path, p->name, k->width, k->height, c->width, c->height);
    if (c->fmt != CAP_FMT_NONE && c->fmt != k->fmt)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: camera %s sent %s, the configuration says pixel_format: %s", path,
                        p->name, cap_pixfmt_name(k->fmt), cap_pixfmt_name(c->fmt));
    size_t bytes = cap_take_frame_max(p->file->take, (uint32_t)p->in_take);
    return cap_player_make_pool(&p->player, c, bytes);
}

static pvx_err take_open(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d)
{
    *out = NULL;
    struct source *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    char *path = NULL;
    p->base.ops = &cap_source_take;
    p->loop = c->loop;
    cap_player_init(&p->player, c, CLOCK_MONOTONIC);
    p->name = strdup(c->name != NULL ? c->name : "");
    pvx_err e = p->name != NULL ? parse_uri(c->uri, &path, &p->speed, d) : PVX_ENOMEM;
    PVX_THEN(e, source_set_up(p, c, path, d));
    free(path);
    cap_source *base = &p->base;
    if (e != PVX_OK)
        take_close(&base);
    *out = base;
    return e;
}

static pvx_err take_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct source *p = (struct source *)base;
    return cap_player_start(&p->player, "take", sink, source_run, p, d);
}

static void take_health(cap_source *base, struct cap_health *out)
{
    const struct source *p = (struct source *)base;
    const struct cap_take_camera *k = &cap_take_info(p->file->take)->head.camera[p->in_take];
    *out = cap_health_unknown;
    out->temperature_c = k->temperature_c;
    if (strlen(k->serial) < sizeof out->serial)
        memcpy(out->serial, k->serial, strlen(k->serial) + 1);
}

static void take_stop(cap_source *base)
{
    cap_player_stop(&((struct source *)base)->player);
}

const struct cap_source_ops cap_source_take = {
    .scheme = "take",
    .help = "a take of raw frames: FILE.h5, or FILE.h5?speed=2 for twice the speed",
    .recorded = true,
    .open = take_open,
    .start = take_start,
    .health = take_health,
    .stop = take_stop,
    .close = take_close,
};
