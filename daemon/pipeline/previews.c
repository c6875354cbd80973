#include "daemon/pipeline/previews.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <turbojpeg.h>

#include "base/bell.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/config/endpoints.h"

#define LEAST   19 /* nice */
#define QUALITY 80
#define LEVELS  4096 /* of the curve's table */
#define EVERY   (PVX_NS_PER_S / DMN_PREVIEWS_HZ)

/* One camera's copies and what is made of them. */
struct view {
    int32_t bw, bh, times, w, h; /* bins; every times-th of them is shown; pixels */
    float *picture;              /* [h][w][4 or 1], as the frame's inputs */
    uint8_t *lit;                /* [bh][bw] */
    uint8_t *pixels, *jpeg, *bits;
    size_t jpeg_size;
};

struct dmn_previews {
    const struct rec_rig *rig;
    pvx_pool *pool;
    pvp_pub *pub;
    int nch;
    struct view view[REC_MAX_CAMERAS];
    const struct dmn_slot *slot; /* while it is copied */
    uint64_t mask;               /* cameras that were copied */
    struct pvp_preview message;
    uint8_t curve[LEVELS + 1];
    tjhandle coder;
    atomic_bool wanted, ending; /* the carve stage owns the copies while wanted, else the thread */
    _Atomic uint64_t made;
    atomic_size_t subscribers;
    struct pvx_bell bell;
    pthread_t thread;
    bool started;
};

/* ---- the carve stage's side ---------------------------------------------------------------------- */

/* The mean of the shown bin and its neighbours (2x2), as a mosaic has each colour in some of four bins only. */
static void previews_shrink(const struct view *k, const float *in, int nch, float *to)
{
    const size_t cs = nch == 3 ? 4 : 1, pitch = (size_t)k->bw * cs;
    if (k->times == 1) {
        memcpy(to, in, (size_t)k->bh * pitch * sizeof *to);
        return;
    }
    for (int32_t y = 0; y < k->h; y++)
        for (int32_t x = 0; x < k->w; x++, to += cs) {
            const float *at = in + (size_t)(y * k->times) * pitch + (size_t)(x * k->times) * cs;
            for (int l = 0; l < nch; l++) {
                float sum = 0, n = 0;
                for (int32_t j = 0; j < 2; j++)
                    for (int32_t i = 0; i < 2; i++) {
                        float v = at[(size_t)j * pitch + (size_t)i * cs + (size_t)l];
                        bool there = v - v == 0; /* NaN: not of this colour */
                        sum += there ? v : 0;
                        n += there;
                    }
                to[l] = n > 0 ? sum / n : 0;
            }
        }
}

static void copy_one(void *ctx, size_t c)
{
    dmn_previews *v = ctx;
    struct view *k = &v->view[c];
    if ((v->mask >> c & 1) == 0)
        return;
    previews_shrink(k, rec_frame_input(v->slot->frame, c), v->nch, k->picture);
    memcpy(k->lit, rec_frame_lit(v->slot->frame, c), (size_t)k->bw * (size_t)k->bh);
}

void dmn_previews_offer(dmn_previews *v, const struct dmn_slot *s)
{
    if (v == NULL || !atomic_load_explicit(&v->wanted, memory_order_acquire))
        return;
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    v->slot = s;
    v->mask = s->mask;
    v->message.set = s->set;
    v->message.t_exposure_ns = s->t_exposure_ns;
    pvx_pool_run(v->pool, v->rig->n_cameras, copy_one, v);
    for (size_t c = 0; c < v->rig->n_cameras; c++) {
        v->message.camera[c].left_out = (r->vote.out >> c & 1) != 0;
        v->message.camera[c].saturated = r->saturated_in[c];
    }
    atomic_store(&v->wanted, false);
    pvx_bell_ring(&v->bell);
}

/* ---- the thread ---------------------------------------------------------------------------------- */

static uint8_t shade(const dmn_previews *v, float x)
{
    return v->curve[x >= 1 ? LEVELS : x > 0 ? (int)(x * LEVELS) : 0];
}

/* Pack the silhouette into bits.  Returns how many are set. */
static uint32_t previews_pack(const struct view *k)
{
    uint32_t lit = 0;
    size_t row = ((size_t)k->bw + 7) / 8;
    memset(k->bits, 0, row * (size_t)k->bh);
    for (size_t y = 0; y < (size_t)k->bh; y++)
        for (size_t x = 0; x < (size_t)k->bw; x++)
            if (k->lit[y * (size_t)k->bw + x] != 0) {
                k->bits[y * row + x / 8] |= (uint8_t)(0x80U >> x % 8);
                lit++;
            }
    return lit;
}

static void code(dmn_previews *v, size_t c, struct pvp_preview_camera *to)
{
    struct view *k = &v->view[c];
    size_t n = (size_t)k->w * (size_t)k->h, nch = (size_t)v->nch, cs = nch == 3 ? 4 : 1;
    unsigned long len = k->jpeg_size;
    bool colours = v->nch == 3;
    for (size_t i = 0; i < n; i++)
        for (size_t l = 0; l < nch; l++)
            k->pixels[i * nch + l] = shade(v, k->picture[i * cs + l]);
    if (tjCompress2(v->coder, k->pixels, k->w, 0, k->h, colours ? TJPF_RGB : TJPF_GRAY, &k->jpeg,
                    &len, colours ? TJSAMP_420 : TJSAMP_GRAY, QUALITY, TJFLAG_NOREALLOC) != 0) {
        LOG_EVERY(PVX_LOG_WARN, DAEMON, "preview: %s", tjGetErrorStr2(v->coder));
        len = 0;
    }
    to->width = len > 0 ? (uint32_t)k->w : 0;
    to->height = len > 0 ? (uint32_t)k->h : 0;
    to->jpeg = k->jpeg;
    to->jpeg_len = len;
    to->across = (uint32_t)k->bw;
    to->down = (uint32_t)k->bh;
    to->lit = previews_pack(k);
    to->lit_bits = k->bits;
}

static void publish(dmn_previews *v)
{
    for (size_t c = 0; c < v->rig->n_cameras; c++) {
        struct pvp_preview_camera *to = &v->message.camera[c];
        if ((v->mask >> c & 1) != 0) {
            code(v, c, to);
            continue;
        }
        *to = (struct pvp_preview_camera){.left_out = to->left_out};
        snprintf(to->name, sizeof to->name, "%s", v->rig->cameras[c].name);
    }
    pvx_err e = pvp_pub_say(v->pub, PVP_PREVIEW, &v->message);
    if (e != PVX_OK)
        LOG_EVERY(PVX_LOG_WARN, DAEMON, "preview not published: %s", pvx_strerror(e));
    atomic_fetch_add(&v->made, 1);
}

static void *previews_run(void *arg)
{
    dmn_previews *v = arg;
    bool asked = false;
    int64_t next = 0;
    setpriority(PRIO_PROCESS, 0, LEAST); /* Linux: of this thread */
    while (!atomic_load(&v->ending)) {
        pvp_pub_tick(v->pub);
        size_t n = pvp_pub_subscribers(v->pub);
        atomic_store(&v->subscribers, n);
        if (asked && !atomic_load(&v->wanted)) {
            asked = false;
            publish(v);
        }
        int64_t now = pvx_now_mono();
        if (!asked && n > 0 && now >= next) {
            next = now + EVERY;
            asked = true;
            atomic_store(&v->wanted, true);
        }
        pvx_bell_wait(&v->bell, asked || next <= now ? now + EVERY : next);
    }
    pvx_err e = pvp_pub_say(v->pub, PVP_END, "the daemon ends");
    if (e != PVX_OK)
        LOG_W(DAEMON, "previews: %s", pvx_strerror(e));
    return NULL;
}

/* ---- life ---------------------------------------------------------------------------------------- */

/* The endpoint as configured, or ".previews" beside the first ipc:// endpoint of the volumes; false: none. */
static bool previews_find_endpoint(const struct dmn_config *c, char *out, size_t size)
{
    const char *beside = c->endpoints.n == 0 ? dmn_default_endpoint(DMN_VOLUMES) : NULL;
    if (strcmp(c->previews, "off") == 0)
        return false;
    if (c->previews[0] != '\0')
        return snprintf(out, size, "%s", c->previews) < (int)size;
    for (size_t i = 0; i < c->endpoints.n && beside == NULL; i++)
        if (strncmp(c->endpoints.v[i], "ipc://", 6) == 0)
            beside = c->endpoints.v[i];
    /* A socket's path has 107 bytes. */
    return beside != NULL && strlen(beside) + strlen(".previews") <= 6 + 107 &&
           snprintf(out, size, "%s.previews", beside) < (int)size;
}

static pvx_err open_pub(dmn_previews *v, const struct dmn_previews_params *p, const char *endpoint,
                        struct pvx_diag *d)
{
    bool guarded = dmn_endpoint_guarded(p->config, endpoint, DMN_VOLUMES);
    struct pvp_pub_params pp = {.auth = p->auth,
                                .rig = p->rig_text,
                                .send_hwm = 4,
                                /* start, rig and the newest two */ .sample = PVP_F16,
                                .comp = PVP_RAW};
    *(guarded ? &pp.guarded : &pp.endpoints) = &endpoint;
    *(guarded ? &pp.n_guarded : &pp.n_endpoints) = 1;
    PVX_TRY(dmn_endpoint_prepare(endpoint, d));
    return pvp_pub_new(&pp, p->start, &v->pub, d);
}

static pvx_err view_new(struct view *k, const struct rec_sysmat_block *b, int nch)
{
    int32_t longer = b->bw > b->bh ? b->bw : b->bh;
    *k = (struct view){.bw = b->bw, .bh = b->bh};
    k->times = (longer + PVP_PREVIEW_SIDE - 1) / PVP_PREVIEW_SIDE;
    k->w = b->bw / k->times > 0 ? b->bw / k->times : 1;
    k->h = b->bh / k->times > 0 ? b->bh / k->times : 1;
    if (k->times > 1) { /* a thin picture has no second row to look at */
        k->w -= k->w * k->times > b->bw - 1 && k->w > 1;
        k->h -= k->h * k->times > b->bh - 1 && k->h > 1;
    }
    size_t n = (size_t)k->w * (size_t)k->h * (size_t)nch, bins = (size_t)b->bw * (size_t)b->bh;
    k->jpeg_size = tjBufSize(k->w, k->h, nch == 3 ? TJSAMP_420 : TJSAMP_GRAY);
    k->picture = pvx_calloc(n / (size_t)nch * (nch == 3 ? 4 : 1), sizeof *k->picture);
    k->lit = pvx_calloc(bins, 1);
    k->pixels = pvx_calloc(n, 1);
    k->jpeg = pvx_calloc(k->jpeg_size, 1);
    k->bits = pvx_calloc((((size_t)b->bw + 7) / 8) * (size_t)b->bh, 1);
    return k->picture != NULL && k->lit != NULL && k->pixels != NULL && k->jpeg != NULL &&
                   k->bits != NULL
               ? PVX_OK
               : PVX_ENOMEM;
}

static pvx_err previews_begin(dmn_previews *v, const struct dmn_previews_params *p,
                              const char *endpoint, struct pvx_diag *d)
{
    v->rig = p->rig;
    v->pool = p->pool;
    v->nch = dmn_config_channels(p->config);
    pvx_bell_init(&v->bell);
    v->message.n_cameras = (uint32_t)p->rig->n_cameras;
    for (int i = 0; i <= LEVELS; i++) {
        double x = (double)i / LEVELS;
        double y = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055; /* IEC 61966-2-1 */
        v->curve[i] = (uint8_t)lrint(255 * y);
    }
    for (size_t c = 0; c < p->rig->n_cameras; c++) {
        snprintf(v->message.camera[c].name, sizeof v->message.camera[c].name, "%s",
                 p->rig->cameras[c].name);
        PVX_TRY(view_new(&v->view[c], &p->S->block[c], v->nch));
    }
    v->coder = tjInitCompress();
    if (v->coder == NULL)
        return PVX_ENOMEM;
    PVX_TRY(open_pub(v, p, endpoint, d));
    if (pthread_create(&v->thread, NULL, previews_run, v) != 0)
        return PVX_EIO;
    v->started = true;
    pthread_setname_np(v->thread, "previews");
    return PVX_OK;
}

pvx_err dmn_previews_new(const struct dmn_previews_params *p, dmn_previews **out,
                         struct pvx_diag *d)
{
    char endpoint[DMN_WORD_MAX + 16];
    *out = NULL;
    if (!previews_find_endpoint(p->config, endpoint, sizeof endpoint))
        return PVX_OK;
    dmn_previews *v = *out = pvx_calloc(1, sizeof *v);
    PVX_NEED(v);
    pvx_err e = previews_begin(v, p, endpoint, d);
    if (e == PVX_OK)
        return e;
    dmn_previews_free(out);
    return pvx_fail(d, e, "publish.previews: %s", pvx_strerror(e));
}

void dmn_previews_free(dmn_previews **vp)
{
    dmn_previews *v = *vp;
    if (v == NULL)
        return;
    atomic_store(&v->ending, true);
    pvx_bell_ring(&v->bell);
    if (v->started)
        pthread_join(v->thread, NULL);
    pvp_pub_free(&v->pub);
    if (v->coder != NULL)
        tjDestroy(v->coder);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++) {
        struct view *k = &v->view[c];
        free(k->picture);
        free(k->lit);
        free(k->pixels);
        free(k->jpeg);
        free(k->bits);
    }
    pvx_bell_fini(&v->bell);
    PVX_FREE(*vp);
}

void dmn_previews_state(dmn_previews *v, struct dmn_state *out)
{
    if (v == NULL)
        return;
    out->previews_made = atomic_load(&v->made);
    out->previews_subscribers = atomic_load(&v->subscribers);
}
