#include "capture/take/recorder.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "base/mem.h"

#define N_GAPS     1024
#define STUCK_NS   (10 * PVX_NS_PER_S) /* half of what the service manager waits (TimeoutStopSec) */
#define HURRY_NS   (5 * PVX_NS_PER_S)  /* the capture stops first: both must fit in that */
#define LOOK_NS    (5 * PVX_NS_PER_MS)
#define SPACE_MORE (32u << 20) /* for rows, and for other programs that write meanwhile */

const char *const cap_recorder_state_names[] = {"idle", "recording", "ended", "failed"};

struct item {
    struct cap_set *set;     /* or */
    struct cap_frame *stray; /* this one */
    enum cap_take_why why;
};

struct cap_recorder {
    struct cap_recorder_config cfg;
    pthread_mutex_t lock;
    pthread_cond_t filled, room, wake; /* writer; lossless tap; syncer */
    struct item *ring;                 /* [size] */
    unsigned size, head, len;
    unsigned sets;                  /* waiting sets; at most CAP_RECORDER_QUEUE_MAX */
    unsigned held[CAP_MAX_CAMERAS]; /* waiting frames of each camera; at most cfg.queue */
    int64_t until_ns;               /* lossless: the tap waits for room until then, mono */
    bool stopping;                  /* the ring takes nothing more; the writer empties it */
    bool written;                   /* the writer has finished */
    struct about {
        char serial[CAP_SERIAL_MAX];
        double temperature_c;
    } about[CAP_MAX_CAMERAS];
    struct cap_take_gap run[CAP_MAX_CAMERAS]; /* open gaps: frames > 0 */
    struct cap_take_gap gap[N_GAPS];          /* closed gaps, to be written */
    unsigned n_gaps;
    struct cap_recorder_stats stats;
    int64_t t0_mono_ns, t1_mono_ns;
    pvx_err error;
    int fd;           /* for syncing and free space */
    int old_fd;       /* of the take before, not synced yet; -1 = none */
    bool threads;     /* to be joined */
    bool stuck;       /* the wait for the threads has timed out */
    bool syncer_done; /* the syncer has finished */
    pthread_t writer, syncer;
    /* the writer thread's */
    cap_take_writer *take;
    struct cap_take_head says;
    char first[512];       /* path of the first take */
    int64_t t_roll_ns;     /* mono: the next take begins */
    uint64_t bytes_before; /* of the takes before this one */
};

/* ---- the tap: the assembler's thread ---- */

/* These functions are called under the lock. */
static bool recording(const cap_recorder *r)
{
    return r->stats.state == CAP_REC_RUNNING && !r->stopping;
}

static bool has_camera(const struct item *it, uint32_t c)
{
    return it->set != NULL ? it->set->frame[c] != NULL
                           : it->stray != NULL && it->stray->camera == c;
}

/* A frame without a set takes no room from other cameras.  Sets are limited too: sets of a few cameras each could be
 * more than cfg.queue allows frames of one camera, and the live sets need set structs. */
static bool recorder_fits(const cap_recorder *r, const struct item *it)
{
    if (it->set != NULL && r->sets >= CAP_RECORDER_QUEUE_MAX)
        return false;
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
        if (has_camera(it, c) && r->held[c] >= r->cfg.queue)
            return false;
    return true;
}

static bool recorder_has_room(cap_recorder *r, const struct item *it)
{
    while (r->cfg.lossless && !recorder_fits(r, it) && recording(r)) {
        struct timespec ts = {.tv_sec = r->until_ns / PVX_NS_PER_S,
                              .tv_nsec = r->until_ns % PVX_NS_PER_S};
        if (pthread_cond_timedwait(&r->room, &r->lock, &ts) == ETIMEDOUT)
            break;
    }
    return recorder_fits(r, it) && recording(r);
}

static void recorder_hold(cap_recorder *r, const struct item *it, int by)
{
    r->sets += it->set != NULL ? (unsigned)by : 0;
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
        if (has_camera(it, c))
            r->held[c] += (unsigned)by;
}

static void let_in(cap_recorder *r, struct item it)
{
    r->ring[(r->head + r->len++) % r->size] = it;
    recorder_hold(r, &it, 1);
    pthread_cond_signal(&r->filled);
}

/* Frames of a camera that are left out one after the other are one gap. */
static void miss(cap_recorder *r, const struct cap_frame *f, int64_t set)
{
    struct cap_take_gap *g = &r->run[f->camera];
    if (g->frames++ == 0) {
        g->camera = f->camera;
        g->why = CAP_TAKE_QUEUE;
        g->id_first = f->id;
        g->set_first = set;
        g->t_first_ns = f->t_exposure_ns;
    }
    g->id_last = f->id;
    g->set_last = set;
    g->t_last_ns = f->t_exposure_ns;
    r->stats.frames_missed++;
}

/* A frame of the camera is recorded again.  With no room in the list the gap stays open. */
static void end_gap(cap_recorder *r, uint32_t camera)
{
    if (r->run[camera].frames == 0 || r->n_gaps == N_GAPS)
        return;
    r->gap[r->n_gaps++] = r->run[camera];
    r->run[camera] = (struct cap_take_gap){0};
}

/* Called by the tap, not by the writer's thread, which may outlive the source that is asked. */
static void ask_about(cap_recorder *r, const struct cap_set *s)
{
    struct cap_health h;
    for (uint32_t c = 0; c < r->cfg.n_cameras && r->cfg.health != NULL; c++)
        if (s->frame[c] != NULL) {
            r->cfg.health(r->cfg.ctx, c, &h);
            memcpy(r->about[c].serial, h.serial, sizeof h.serial);
            r->about[c].temperature_c = h.temperature_c;
        }
}

static void tap_set(void *ctx, struct cap_set *s)
{
    cap_recorder *r = ctx;
    struct item it = {.set = s};
    bool missed = false;
    pthread_mutex_lock(&r->lock);
    if (recorder_has_room(r, &it)) {
        ask_about(r, s);
        cap_set_ref(s);
        let_in(r, it);
        for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
            if (s->frame[c] != NULL)
                end_gap(r, c);
    } else if (recording(r)) {
        missed = true;
        r->stats.sets_missed++;
        for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
            if (s->frame[c] != NULL)
                miss(r, s->frame[c], (int64_t)s->number);
    }
    pthread_mutex_unlock(&r->lock);
    if (missed)
        LOG_EVERY_ABOUT(PVX_LOG_WARN, CAPTURE,
                        ABOUT(.cause = "not_recorded", .of_set = true, .set = s->number),
                        "set %llu is not recorded: the disk is slower than the cameras",
                        (unsigned long long)s->number);
}

static void tap_stray(void *ctx, struct cap_frame *f, enum cap_count why)
{
    cap_recorder *r = ctx;
    enum cap_take_why w = why == CAP_LATE        ? CAP_TAKE_LATE
                          : why == CAP_UNMATCHED ? CAP_TAKE_UNMATCHED
                                                 : CAP_TAKE_OVERFLOW;
    struct item it = {.stray = f, .why = w};
    pthread_mutex_lock(&r->lock);
    if (recorder_has_room(r, &it)) {
        let_in(r, it);
        end_gap(r, f->camera);
        f = NULL;
    } else if (recording(r)) {
        miss(r, f, -1);
    }
    pthread_mutex_unlock(&r->lock);
    cap_frame_release(f);
}

struct cap_tap cap_recorder_tap(cap_recorder *r)
{
    return (struct cap_tap){.set = tap_set, .stray = tap_stray, .ctx = r};
}

/* ---- the writer's thread ---- */

static void recorder_give_back(struct item it)
{
    cap_set_release(it.set);
    cap_frame_release(it.stray);
}

static size_t recorder_bytes_of(const struct item *it, uint32_t n_cameras)
{
    size_t n = it->stray != NULL ? it->stray->img.size : 0;
    for (uint32_t c = 0; c < n_cameras && it->set != NULL; c++)
        n += it->set->frame[c] != NULL ? it->set->frame[c]->img.size : 0;
    return n;
}

/* Checked before a set is written, so that the take can still be ended in order. */
static pvx_err recorder_has_space(const cap_recorder *r, size_t bytes, struct pvx_diag *d)
{
    if (r->cfg.limit_bytes > 0 && cap_take_bytes(r->take) + bytes > r->cfg.limit_bytes)
        return pvx_fail(d, PVX_ERANGE, "%s: has reached its limit of %.3g GB", r->stats.path,
                        (double)r->cfg.limit_bytes * 1e-9);
    struct statvfs v;
    if (fstatvfs(r->fd, &v) != 0)
        return PVX_OK;
    uint64_t have = (uint64_t)v.f_bavail * v.f_frsize;
    if (have >= bytes + SPACE_MORE + r->cfg.keep_free_bytes)
        return PVX_OK;
    return pvx_fail(d, PVX_ENOSPC, "%s: the disk is full: %.0f MB are left, %.0f stay free",
                    r->stats.path, (double)have * 1e-6,
                    (double)(r->cfg.keep_free_bytes + SPACE_MORE) * 1e-6);
}

static pvx_err write_gaps(cap_recorder *r, struct pvx_diag *d)
{
    for (;;) {
        struct cap_take_gap g;
        pthread_mutex_lock(&r->lock);
        bool any = r->n_gaps > 0;
        if (any) {
            g = r->gap[0];
            memmove(&r->gap[0], &r->gap[1], --r->n_gaps * sizeof g);
        }
        pthread_mutex_unlock(&r->lock);
        if (!any)
            return PVX_OK;
        PVX_TRY(cap_take_put_gap(r->take, &g, d));
    }
}

static pvx_err write_beside(cap_recorder *r, struct pvx_diag *d)
{
    return r->cfg.beside != NULL ? r->cfg.beside(r->cfg.ctx, r->take, d) : PVX_OK;
}

static void tell_about(cap_recorder *r, const struct item *it)
{
    for (uint32_t c = 0; c < r->cfg.n_cameras && r->cfg.health != NULL; c++)
        if (has_camera(it, c)) {
            pthread_mutex_lock(&r->lock);
            struct about a = r->about[c];
            pthread_mutex_unlock(&r->lock);
            cap_take_about(r->take, c, a.serial, a.temperature_c);
        }
}

static pvx_err write_item(cap_recorder *r, const struct item *it, struct pvx_diag *d)
{
    tell_about(r, it);
    PVX_TRY(recorder_has_space(r, recorder_bytes_of(it, r->cfg.n_cameras), d));
    if (it->set != NULL)
        PVX_TRY(cap_take_put_set(r->take, it->set, d));
    else
        PVX_TRY(cap_take_put_stray(r->take, it->stray, it->why, d));
    PVX_TRY(write_gaps(r, d));
    PVX_TRY(write_beside(r, d));
    PVX_TRY(cap_take_commit(r->take, d));
    pthread_mutex_lock(&r->lock);
    r->stats.sets += it->set != NULL;
    r->stats.strays += it->stray != NULL;
    r->stats.frames += it->set != NULL ? it->set->n : 1;
    r->stats.bytes = r->bytes_before + cap_take_bytes(r->take);
    pthread_mutex_unlock(&r->lock);
    return PVX_OK;
}

static void sync_take(const cap_recorder *r, int fd)
{
    if (fdatasync(fd) != 0)
        LOG_EVERY(PVX_LOG_ERROR, CAPTURE, "%s: %s", r->first, strerror(errno));
}

/* Leave syncing and closing of the take before to the syncer, which may wait. */
static void recorder_put_aside(cap_recorder *r, int fd)
{
    pthread_mutex_lock(&r->lock);
    int old = r->fd;
    if (r->cfg.sync_ns > 0)
        r->old_fd = old;
    r->fd = fd;
    pthread_mutex_unlock(&r->lock);
    if (r->cfg.sync_ns == 0)
        close(old);
}

static bool may_roll(cap_recorder *r, int64_t now)
{
    pthread_mutex_lock(&r->lock);
    bool behind = r->old_fd >= 0; /* the take before is still not synced */
    pthread_mutex_unlock(&r->lock);
    return r->cfg.roll_ns > 0 && now >= r->t_roll_ns && !behind && cap_take_bytes(r->take) > 0;
}

/* Called before each item: begin the next take if it is time. */
static pvx_err recorder_roll(cap_recorder *r, struct pvx_diag *d)
{
    int64_t now = pvx_now_mono();
    if (!may_roll(r, now))
        return PVX_OK;
    char path[sizeof r->stats.path], more[16];
    snprintf(more, sizeof more, "-%04u", r->stats.takes + 1);
    if (pvx_path_more(r->first, more, path, sizeof path) != PVX_OK)
        return pvx_fail(d, PVX_ERANGE, "%s: too long a name for the take after it", r->first);
    PVX_TRY(write_gaps(r, d));
    r->bytes_before += cap_take_bytes(r->take);
    cap_take_writer *next;
    r->says.t_created_ns = pvx_now_real();
    PVX_TRY(cap_take_create(path, &r->says, &next, d));
    cap_take_goes_on(r->take);
    pvx_err e = cap_take_close(&r->take, d);
    r->take = next;
    if (e != PVX_OK)
        return e;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    recorder_put_aside(r, fd);
    r->t_roll_ns += ((now - r->t_roll_ns) / r->cfg.roll_ns + 1) * r->cfg.roll_ns;
    pthread_mutex_lock(&r->lock);
    r->stats.takes++;
    snprintf(r->stats.path, sizeof r->stats.path, "%s", path);
    pthread_mutex_unlock(&r->lock);
    LOG_I(CAPTURE, "recording goes on in %s", path);
    return PVX_OK;
}

/* Wait for the next item.  False: there will be none. */
static bool recorder_next(cap_recorder *r, struct item *it)
{
    pthread_mutex_lock(&r->lock);
    while (r->len == 0 && !r->stopping)
        pthread_cond_wait(&r->filled, &r->lock);
    bool any = r->len > 0;
    if (any)
        *it =
            r->ring[r->head]; /* it keeps its place until it is written: that bounds the buffers */
    pthread_mutex_unlock(&r->lock);
    return any;
}

static void done_with(cap_recorder *r, struct item it)
{
    pthread_mutex_lock(&r->lock);
    r->head = (r->head + 1) % r->size;
    r->len--;
    recorder_hold(r, &it, -1);
    pthread_cond_signal(&r->room);
    pthread_mutex_unlock(&r->lock);
    recorder_give_back(it);
}

/* Let nothing more in, and end the gaps that are still open. */
static void shut(cap_recorder *r)
{
    pthread_mutex_lock(&r->lock);
    r->stopping = true;
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
        end_gap(r, c);
    pthread_cond_broadcast(&r->filled);
    pthread_cond_broadcast(&r->room);
    pthread_mutex_unlock(&r->lock);
}

static void recorder_finish(cap_recorder *r, pvx_err e, struct pvx_diag *d)
{
    pvx_err gap_error = r->take != NULL ? write_gaps(r, d) : PVX_OK;
    PVX_THEN(e, gap_error);
    pvx_err beside_error = r->take != NULL ? write_beside(r, d) : PVX_OK;
    PVX_THEN(e, beside_error);
    pvx_err close_error = cap_take_close(&r->take, d); /* text of the first cause stays */
    PVX_THEN(e, close_error);
    pthread_mutex_lock(&r->lock);
    r->t1_mono_ns = pvx_now_mono();
    r->error = e;
    r->stats.state = e == PVX_OK || e == PVX_ERANGE ? CAP_REC_ENDED : CAP_REC_FAILED;
    snprintf(r->stats.error, sizeof r->stats.error, "%.*s", (int)sizeof r->stats.error - 1,
             e == PVX_OK ? "" : pvx_diag_text(d, e));
    r->written = true;
    pthread_cond_broadcast(&r->wake);
    pthread_mutex_unlock(&r->lock);
    if (e != PVX_OK)
        LOG_E(CAPTURE, "recording ends: %s; the take holds what was recorded before",
              pvx_diag_text(d, e));
}

/* The frames of an item that waited when the recording ended by itself become gaps, as far as the take can still
 * list them. */
static void lose(cap_recorder *r, const struct item *it)
{
    pthread_mutex_lock(&r->lock);
    r->stats.sets_missed += it->set != NULL;
    if (it->stray != NULL)
        miss(r, it->stray, -1);
    for (uint32_t c = 0; c < r->cfg.n_cameras && it->set != NULL; c++)
        if (it->set->frame[c] != NULL)
            miss(r, it->set->frame[c], (int64_t)it->set->number);
    pthread_mutex_unlock(&r->lock);
}

static void *write_loop(void *arg)
{
    cap_recorder *r = arg;
    struct pvx_diag d = {""};
    pvx_err e = PVX_OK;
    struct item it;
    while (recorder_next(r, &it)) {
        if (e == PVX_OK &&
            ((e = recorder_roll(r, &d)) != PVX_OK || (e = write_item(r, &it, &d)) != PVX_OK))
            shut(r);
        if (e != PVX_OK)
            lose(r, &it);
        done_with(r, it);
    }
    shut(r);
    recorder_finish(r, e, &d);
    return NULL;
}

/* Syncs the take every sync_ns, so that the disk is never far behind, and once more when the take is closed.  It has
 * its own thread because it may wait. */
static void *sync_loop(void *arg)
{
    cap_recorder *r = arg;
    pthread_mutex_lock(&r->lock);
    for (bool last = false; !last;) {
        int64_t t = pvx_now_mono() + r->cfg.sync_ns;
        struct timespec ts = {.tv_sec = t / PVX_NS_PER_S, .tv_nsec = t % PVX_NS_PER_S};
        if (!r->written && pthread_cond_timedwait(&r->wake, &r->lock, &ts) != ETIMEDOUT)
            continue;
        last = r->written;
        int fd = r->fd, old = r->old_fd; /* no other thread closes r->fd while this runs */
        r->old_fd = -1;
        pthread_mutex_unlock(&r->lock);
        if (old >= 0) {
            sync_take(r, old);
            close(old);
        }
        sync_take(r, fd);
        pthread_mutex_lock(&r->lock);
    }
    r->syncer_done = true;
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

/* ---- from outside ---- */

pvx_err cap_recorder_new(const struct cap_recorder_config *c, cap_recorder **out)
{
    *out = NULL;
    if (c->queue < 1 || c->queue > CAP_RECORDER_QUEUE_MAX || c->n_cameras < 1 ||
        c->n_cameras > CAP_MAX_CAMERAS || c->sync_ns < 0)
        return PVX_EINVAL;
    cap_recorder *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->cfg = *c;
    r->until_ns = INT64_MAX;
    r->fd = r->old_fd = -1;
    r->size = c->queue * c->n_cameras; /* as many as held[] allows */
    r->ring = pvx_calloc(r->size, sizeof *r->ring);
    if (r->ring == NULL) {
        free(r);
        return PVX_ENOMEM;
    }
    pthread_mutex_init(&r->lock, NULL);
    pvx_cond_init(&r->filled, CLOCK_MONOTONIC);
    pvx_cond_init(&r->room, CLOCK_MONOTONIC);
    pvx_cond_init(&r->wake, CLOCK_MONOTONIC);
    *out = r;
    return PVX_OK;
}

/* Wait until both threads have finished; false: they have not.  As long as sets are written, the wait goes on. */
static bool come_home(cap_recorder *r, int64_t wait_ns)
{
    pthread_mutex_lock(&r->lock);
    unsigned len = r->len;
    int64_t until = pvx_now_mono() + wait_ns;
    while (!(r->written && r->syncer_done) && pvx_now_mono() < until) {
        pthread_mutex_unlock(&r->lock);
        struct timespec ts = {.tv_nsec = LOOK_NS};
        nanosleep(&ts, NULL);
        pthread_mutex_lock(&r->lock);
        if (r->len != len)
            until = pvx_now_mono() + wait_ns;
        len = r->len;
    }
    bool home = r->written && r->syncer_done;
    pthread_mutex_unlock(&r->lock);
    return home;
}

/* Join the threads, which a recording that ended by itself still needs.  False: a disk that does not answer holds a
 * thread in the kernel, where it cannot be stopped.  That thread keeps the memory that it uses. */
static bool recorder_join(cap_recorder *r)
{
    if (!r->threads)
        return true;
    r->stuck = !come_home(r, STUCK_NS);
    if (r->stuck)
        return false;
    pthread_join(r->writer, NULL);
    if (r->cfg.sync_ns > 0)
        pthread_join(r->syncer, NULL);
    r->threads = false;
    close(r->fd);
    r->fd = -1;
    return true;
}

/* Check the disk of the take's folder, which may not exist yet, before anything is made.  A take that could hold
 * nothing would end at once, and it is not checked again once it has begun. */
static pvx_err may_begin(const cap_recorder *r, const char *path, struct pvx_diag *d)
{
    char dir[sizeof r->stats.path];
    struct statvfs v;
    snprintf(dir, sizeof dir, "%s", path);
    char *slash;
    do {
        slash = strrchr(dir, '/');
        if (slash == NULL)
            snprintf(dir, sizeof dir, ".");
        else
            slash[slash == dir] = '\0'; /* "/" stays */
    } while (statvfs(dir, &v) != 0 && errno == ENOENT && slash != NULL && slash != dir);
    if (statvfs(dir, &v) != 0)
        return PVX_OK; /* the reason comes when the file is made */
    uint64_t have = (uint64_t)v.f_bavail * v.f_frsize, want = SPACE_MORE + r->cfg.keep_free_bytes;
    if (have >= want)
        return PVX_OK;
    return pvx_fail(d, PVX_ENOSPC,
                    "%s: the disk is too full to record: %.2f GB are free, %.2f needed; make room "
                    "there, name another place, or lower record.keep_free_gb",
                    path, (double)have * 1e-9, (double)want * 1e-9);
}

static pvx_err start_threads(cap_recorder *r, struct pvx_diag *d)
{
    if (pthread_create(&r->writer, NULL, write_loop, r) != 0)
        return pvx_fail(d, PVX_EIO, "recording: no thread to be had");
    pthread_setname_np(r->writer, "record");
    if (r->cfg.sync_ns > 0 && pthread_create(&r->syncer, NULL, sync_loop, r) != 0) {
        shut(r);
        pthread_join(r->writer, NULL);
        return pvx_fail(d, PVX_EIO, "recording: no thread to be had");
    }
    if (r->cfg.sync_ns > 0)
        pthread_setname_np(r->syncer, "record-sync");
    r->threads = true;
    return PVX_OK;
}

/* Undo a start that failed: release what the tap has put in meanwhile, and remove the file. */
static void undo_start(cap_recorder *r, pvx_err e, const struct pvx_diag *d)
{
    shut(r);
    cap_take_close(&r->take, NULL);
    unlink(r->stats.path);
    while (r->len > 0) { /* no other thread takes out, and nothing comes in */
        struct item it = r->ring[r->head];
        done_with(r, it);
    }
    pthread_mutex_lock(&r->lock);
    r->stats.state = CAP_REC_FAILED;
    snprintf(r->stats.error, sizeof r->stats.error, "%.*s", (int)sizeof r->stats.error - 1,
             pvx_diag_text(d, e));
    r->t1_mono_ns = pvx_now_mono();
    r->written = true;
    pthread_mutex_unlock(&r->lock);
    if (r->fd >= 0)
        close(r->fd);
    r->fd = -1;
}

pvx_err cap_recorder_start(cap_recorder *r, const char *path, const struct cap_take_head *head,
                           struct pvx_diag *d)
{
    pthread_mutex_lock(&r->lock);
    bool busy = r->stats.state == CAP_REC_RUNNING;
    pthread_mutex_unlock(&r->lock);
    if (busy)
        return pvx_fail(d, PVX_EBUSY, "%s is being recorded; stop that first", r->first);
    if (strlen(path) >= sizeof r->stats.path || head->n_cameras != r->cfg.n_cameras)
        return pvx_fail(d, PVX_EINVAL, "%.100s: too long a name for a take", path);
    if (!recorder_join(r))
        return pvx_fail(d, PVX_EBUSY,
                        "%s: its disk does not answer; nothing else is recorded before", r->first);
    PVX_TRY(may_begin(r, path, d));
    PVX_TRY(cap_take_create(path, head, &r->take, d));
    r->fd = open(path, O_RDONLY | O_CLOEXEC);
    pthread_mutex_lock(&r->lock);
    r->stopping = r->written = false;
    r->syncer_done = r->cfg.sync_ns == 0;
    r->n_gaps = 0;
    memset(r->run, 0, sizeof r->run);
    for (uint32_t c = 0; c < CAP_MAX_CAMERAS; c++)
        r->about[c] = (struct about){.temperature_c = NAN};
    r->stats = (struct cap_recorder_stats){.state = CAP_REC_RUNNING, .takes = 1};
    snprintf(r->stats.path, sizeof r->stats.path, "%s", path);
    memcpy(r->first, r->stats.path, sizeof r->first);
    r->says = *head;
    r->says.t_began_ns = head->t_created_ns;
    r->bytes_before = 0;
    r->t0_mono_ns = pvx_now_mono();
    r->t_roll_ns = r->t0_mono_ns + r->cfg.roll_ns;
    r->error = PVX_OK;
    pthread_mutex_unlock(&r->lock);
    pvx_err e = r->fd < 0 ? pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno))
                          : start_threads(r, d);
    if (e != PVX_OK) {
        undo_start(r, e, d);
        return e;
    }
    LOG_I(CAPTURE, "recording raw frames to %s", path);
    return PVX_OK;
}

static void recorder_tell(const struct cap_recorder_stats *s)
{
    enum pvx_log_level level = s->frames_missed > 0 ? PVX_LOG_WARN : PVX_LOG_INFO;
    char takes[40] = "";
    if (s->takes > 1)
        snprintf(takes, sizeof takes, "the last of %u takes, ", s->takes);
    pvx_log(
        level, TOPIC_CAPTURE, NULL,
        "%s: %.1f s, %s%llu sets, %llu frames (%llu in no set), %.1f MB, %.1f MB/s; %llu sets and "
        "%llu frames could not be recorded%s",
        s->path, s->seconds, takes, (unsigned long long)s->sets, (unsigned long long)s->frames,
        (unsigned long long)s->strays, (double)s->bytes * 1e-6,
        s->seconds > 0 ? (double)s->bytes * 1e-6 / s->seconds : 0,
        (unsigned long long)s->sets_missed, (unsigned long long)s->frames_missed,
        s->frames_missed == 0 ? ""
        : s->error[0] != '\0' ? ", from the moment that it ended by itself"
                              : ": the disk was too slow (`pyrovox replay --info` lists them)");
}

void cap_recorder_hurry(cap_recorder *r)
{
    pthread_mutex_lock(&r->lock);
    r->until_ns = pvx_now_mono() + HURRY_NS;
    pthread_cond_broadcast(&r->room);
    pthread_mutex_unlock(&r->lock);
}

pvx_err cap_recorder_stop(cap_recorder *r, struct pvx_diag *d)
{
    if (!r->threads)
        return pvx_fail(d, PVX_ENOENT, "nothing is being recorded");
    shut(r);
    bool home = recorder_join(r);
    struct cap_recorder_stats s;
    cap_recorder_stats(r, &s);
    recorder_tell(&s);
    if (!home)
        return pvx_fail(d, PVX_ETIMEDOUT,
                        "%s: the disk does not answer; the take holds what it took before", s.path);
    return r->error == PVX_OK ? PVX_OK : pvx_fail(d, r->error, "%s", s.error);
}

void cap_recorder_stats(cap_recorder *r, struct cap_recorder_stats *out)
{
    pthread_mutex_lock(&r->lock);
    *out = r->stats;
    out->queued = r->len;
    int64_t end = r->written ? r->t1_mono_ns : pvx_now_mono();
    out->seconds = r->stats.state == CAP_REC_IDLE ? 0 : (double)(end - r->t0_mono_ns) * 1e-9;
    pthread_mutex_unlock(&r->lock);
}

void cap_recorder_free(cap_recorder **rp)
{
    cap_recorder *r = *rp;
    if (r == NULL)
        return;
    *rp = NULL;
    if (r->threads && (!r->stuck || come_home(r, 0))) /* do not wait twice */
        cap_recorder_stop(r, NULL);
    if (r->threads) {
        LOG_W(CAPTURE, "%s: the disk does not answer; what records is left behind", r->first);
        return;
    }
    pthread_mutex_destroy(&r->lock);
    pthread_cond_destroy(&r->filled);
    pthread_cond_destroy(&r->room);
    pthread_cond_destroy(&r->wake);
    free(r->ring);
    free(r);
}
