/* film.c - a recording as a source: it plays at its own rate, over and over, and goes where a page says. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "daemon/view/source.h"
#include "daemon/volumes/voxels.h"

#define PAUSE_MIN_NS PVX_NS_PER_MS
#define PAUSE_MAX_NS (2 * PVX_NS_PER_S) /* a longer gap in a recording is not waited for */

enum step { SEND_START, SEND_RIG, SEND_VOLUMES };
struct film {
    const char *path;
    vol_reader *in;
    vol_reader *temperatures,
        *soot; /* of a recording that has both, `in` is one of them; else NULL */
    vol_voxels *voxels;
    pvp_encoder *encoder, *bars_encoder;
    const void *bars; /* the message of the volume sent last, NULL: it has none */
    size_t bars_len;
    enum step step;
    uint64_t count, at, sequence; /* at: the volume that is sent next */
    uint64_t shown;               /* the one sent last */
    uint64_t bad;                 /* volumes that could not be read */
    bool playing, wanted;         /* wanted: a volume was asked for, playing or not */
    double speed;
    int64_t due, last_exposure;
};

static int film_fds(void *self, struct pollfd out[VIEW_SOURCE_FDS])
{
    (void)self;
    (void)out;
    return 0;
}

static int64_t film_due_ns(void *self)
{
    const struct film *f = self;
    if (f->step != SEND_VOLUMES || f->wanted)
        return 0;
    return f->playing ? f->due : INT64_MAX;
}

/* Set when the volume after the one of this exposure is due. */
static void wait_for_next(struct film *f, int64_t exposure)
{
    int64_t gap = f->last_exposure != 0 ? exposure - f->last_exposure : 0;
    double fps = vol_reader_head(f->in)->start.fps;
    if (gap <= 0 || gap > PAUSE_MAX_NS)
        gap = fps > 0 ? (int64_t)(1e9 / fps) : PVX_NS_PER_S / 20;
    gap = (int64_t)((double)gap / f->speed);
    if (gap < PAUSE_MIN_NS)
        gap = PAUSE_MIN_NS;
    int64_t now = pvx_now_mono();
    f->due = f->due + gap > now - gap ? f->due + gap : now + gap;
    f->last_exposure = exposure;
}

static pvx_err film_volume(struct film *f, const void **msg, size_t *len, struct pvx_diag *d)
{
    struct vol_volume v;
    struct pvp_voxels x, sd;
    f->bars = NULL;
    f->wanted = false;
    f->shown = f->at;
    f->at = (f->at + 1) % f->count;
    pvx_err e = vol_reader_get(f->in, f->shown, &v, d);
    if (e != PVX_OK) {
        f->bad++;
        f->due = pvx_now_mono() + PVX_NS_PER_S / 20;
        return e;
    }
    wait_for_next(f, v.v.t_exposure_ns);
    vol_voxels_bars(f->voxels, &v, &x, &sd);
    v.v.t_publish_ns = pvx_now_real();
    if (v.bars.sd != NULL)
        PVX_TRY(pvp_encode_bars(f->bars_encoder, f->sequence++, &v.v, v.bars.doubt, &sd, &f->bars,
                                &f->bars_len));
    return pvp_encode_volume(f->encoder, f->sequence++, &v.v, &x, msg, len);
}

static pvx_err film_next(void *self, struct pvp_header *h, const void **msg, size_t *len,
                         struct pvx_diag *d)
{
    struct film *f = self;
    const struct vol_head *head = vol_reader_head(f->in);
    if (film_due_ns(f) > pvx_now_mono())
        return PVX_ETIMEDOUT;
    switch (f->step) {
    case SEND_START:
        f->step = head->rig != NULL ? SEND_RIG : SEND_VOLUMES;
        PVX_TRY(pvp_encode_start(f->encoder, f->sequence++, &head->start, msg, len));
        break;
    case SEND_RIG:
        f->step = SEND_VOLUMES;
        PVX_TRY(
            pvp_encode_rig(f->encoder, f->sequence++, head->start.rig_hash, head->rig, msg, len));
        break;
    case SEND_VOLUMES: PVX_TRY(film_volume(f, msg, len, d)); break;
    }
    return pvp_decode_header(*msg, *len, h, d);
}

static const void *film_bars(void *self, size_t *len)
{
    const struct film *f = self;
    *len = f->bars_len;
    return f->bars;
}

/* Another quantity is another session. */
static void film_exchange(struct film *f, bool soot)
{
    vol_reader *to = soot ? f->soot : f->temperatures;
    if (to == NULL || to == f->in)
        return;
    f->in = to;
    f->step = SEND_START;
    f->bars = NULL;
    f->at = f->shown;
    f->wanted = true;
}

static void film_said(void *self, const struct view_words *w)
{
    struct film *f = self;
    if (w->said & VIEW_SAID_SOOT)
        film_exchange(f, w->soot);
    if (w->said & VIEW_SAID_SPEED)
        f->speed = w->speed;
    if (w->said & VIEW_SAID_SEEK) {
        f->at = w->seek < f->count ? w->seek : f->count - 1;
        f->wanted = true;
        f->last_exposure = 0;
        f->due = pvx_now_mono();
    }
    if (w->said & VIEW_SAID_PLAY) {
        if (w->play && !f->playing)
            f->due = pvx_now_mono();
        f->playing = w->play;
    }
}

static void film_previews(void *self, bool wanted)
{
    (void)self;
    (void)wanted;
}

static void film_stats(void *self, struct view_source_stats *out)
{
    const struct film *f = self;
    *out = (struct view_source_stats){.received = f->sequence, .malformed = f->bad};
    snprintf(out->words, sizeof out->words,
             "\"film\":{\"count\":%llu,\"at\":%llu,\"playing\":%s,\"speed\":%g,\"cut\":%s,"
             "\"unsolved\":%llu}",
             (unsigned long long)f->count, (unsigned long long)f->shown,
             f->playing ? "true" : "false", f->speed, vol_reader_cut(f->in) ? "true" : "false",
             (unsigned long long)vol_reader_unsolved(f->in));
    size_t n = strlen(out->words);
    if (f->soot != NULL && n > 0) /* in place of the last brace */
        snprintf(out->words + n - 1, sizeof out->words - n + 1, ",\"soot\":%s}",
                 f->in == f->soot ? "true" : "false");
}

static void film_free(void *self)
{
    struct film *f = self;
    vol_voxels_free(&f->voxels);
    pvp_encoder_free(&f->encoder);
    pvp_encoder_free(&f->bars_encoder);
    if (f->in != f->soot)
        vol_reader_close(&f->in);
    else
        vol_reader_close(&f->temperatures);
    vol_reader_close(&f->soot);
    free(f);
}

static const struct view_source_ops ops = {film_fds,  film_due_ns,   film_next,  film_bars,
                                           film_said, film_previews, film_stats, film_free};

static pvx_err open_film(struct film *f, struct pvx_diag *d)
{
    struct vol_volume first;
    PVX_TRY(vol_reader_open(f->path, &f->in, d));
    f->count = vol_reader_count(f->in);
    if (f->count == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no volume in it", f->path);
    if (strcmp(vol_reader_head(f->in)->start.units, VOL_UNITS_KELVIN) == 0 &&
        vol_reader_open_soot(f->path, &f->soot, NULL) == PVX_OK)
        f->temperatures = f->in;
    PVX_TRY(vol_reader_get(f->in, 0, &first, d));
    const struct pvp_grid *g = &vol_reader_head(f->in)->start.grid;
    PVX_TRY(vol_voxels_new(g, &f->voxels));
    PVX_TRY(pvp_encoder_new(g, PVP_F16, PVP_LZ4, &f->bars_encoder));
    return pvp_encoder_new(g, PVP_F16, PVP_LZ4, &f->encoder);
}

pvx_err view_film_new(const char *path, struct view_source *out, struct pvx_diag *d)
{
    struct film *f = calloc(1, sizeof *f);
    PVX_NEED(f);
    *f = (struct film){.path = path, .playing = true, .speed = 1, .due = pvx_now_mono()};
    *out = (struct view_source){&ops, f};
    pvx_err e = open_film(f, d);
    if (e != PVX_OK) {
        film_free(f);
        out->self = NULL;
    }
    return e;
}
