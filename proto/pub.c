#include "proto/pub.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "proto/attach.h"
#include "proto/door.h"
#include "proto/fields.h"
#include "proto/ipc.h"

#define LINGER_MS          250
#define LINGER_LOSSLESS_MS 60000

/* One socket: for everybody who can reach it, or for listed keys only. */
struct outlet {
    const char *const *endpoint; /* the publisher's own copy */
    size_t n, subscribers;
    void *socket;   /* NULL: no endpoints, or to be opened anew */
    pvp_door *door; /* of the guarded one */
};
enum { OPEN, GUARDED, N_OUTLETS };

struct pvp_pub {
    void *ctx;
    struct outlet out[N_OUTLETS];
    pvp_encoder *encoder;
    struct pvp_start start;
    uint64_t sequence;
    int64_t start_due; /* mono */
    char *rig;         /* NULL: no such messages */
    bool rig_wanted;   /* there is a new subscriber */
    int64_t rig_next;  /* mono; not sent before */
    bool lossless;
    int hwm;
    pvp_auth *auth;
    pvp_zap *zap;
    uint64_t generation; /* of auth, when GUARDED was opened */
    size_t n_claims;
    char **endpoint;        /* [n_claims] */
    pvp_ipc_claim **claims; /* one per endpoint, NULL where none is needed */
};

static pvx_err set_int(void *socket, int option, int value)
{
    return zmq_setsockopt(socket, option, &value, sizeof value) == 0 ? PVX_OK
                                                                     : pvx_err_from_errno(errno);
}

/* Live: never blocks and reports no drop; an error here is one of the socket itself.  Lossless: waits for the
 * slowest subscriber, but no longer for one that has not read for PVP_PUB_PATIENCE_S. */
static pvx_err send_on(struct pvp_pub *p, void *socket, const void *msg, size_t len)
{
    while (zmq_send(socket, msg, len, p->lossless ? 0 : ZMQ_DONTWAIT) < 0) {
        if (errno == EAGAIN && p->lossless) {
            LOG_W(PROTO,
                  "a subscriber has read nothing for %d s: it is no longer waited for and "
                  "will miss volumes",
                  PVP_PUB_PATIENCE_S);
            p->lossless = false;
            for (int k = 0; k < N_OUTLETS; k++)
                if (p->out[k].socket != NULL)
                    PVX_TRY(set_int(p->out[k].socket, ZMQ_XPUB_NODROP, 0));
        } else if (errno != EINTR) {
            return pvx_err_from_errno(errno);
        }
    }
    return PVX_OK;
}

static pvx_err send_message(struct pvp_pub *p, const void *msg, size_t len)
{
    p->sequence++;
    for (int k = 0; k < N_OUTLETS; k++)
        if (p->out[k].socket != NULL)
            PVX_TRY(send_on(p, p->out[k].socket, msg, len));
    return PVX_OK;
}

/* Subscribers send 1 + prefix to subscribe, 0 + prefix to leave; libzmq does so for a subscriber that dies. */
static void read_subscriptions(struct pvp_pub *p, struct outlet *o)
{
    unsigned char m[64];
    int n;
    while ((n = zmq_recv(o->socket, m, sizeof m, ZMQ_DONTWAIT)) >= 0) {
        if (n > 0 && m[0] == 1) {
            o->subscribers++;
            p->start_due = 0; /* a new subscriber needs it now, not in a second */
            p->rig_wanted = true;
        } else if (n > 0 && m[0] == 0 && o->subscribers > 0)
            o->subscribers--;
    }
}

static pvx_err send_start(struct pvp_pub *p)
{
    const void *msg;
    size_t len;
    p->start_due = pvx_now_mono() + PVX_NS_PER_S;
    PVX_TRY(pvp_encode_start(p->encoder, p->sequence, &p->start, &msg, &len));
    return send_message(p, msg, len);
}

/* Sends the rig to all subscribers, so at most once a second and before each volume, however often clients subscribe. */
static pvx_err send_rig(struct pvp_pub *p, bool volume)
{
    const void *msg;
    size_t len;
    int64_t now = pvx_now_mono();
    if (p->rig == NULL || !p->rig_wanted || (!volume && now < p->rig_next))
        return PVX_OK;
    p->rig_wanted = false;
    p->rig_next = now + PVX_NS_PER_S;
    PVX_TRY(pvp_encode_rig(p->encoder, p->sequence, p->start.rig_hash, p->rig, &msg, &len));
    return send_message(p, msg, len);
}

static pvx_err set_socket(struct pvp_pub *p, void *socket)
{
    const int linger = p->lossless ? LINGER_LOSSLESS_MS : LINGER_MS;
    const int64_t max_in = 4096; /* subscribers send only subscriptions, nothing larger */
    PVX_TRY(set_int(socket, ZMQ_SNDHWM, p->hwm));
    PVX_TRY(set_int(socket, ZMQ_LINGER, linger));
    PVX_TRY(set_int(socket, ZMQ_TCP_KEEPALIVE, 1));
    PVX_TRY(set_int(socket, ZMQ_XPUB_VERBOSER, 1)); /* every subscription, not only the first */
    if (zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &max_in, sizeof max_in) != 0)
        return pvx_err_from_errno(errno);
    if (!p->lossless)
        return PVX_OK;
    PVX_TRY(set_int(socket, ZMQ_XPUB_NODROP, 1));
    return set_int(socket, ZMQ_SNDTIMEO, PVP_PUB_PATIENCE_S * 1000);
}

static pvx_err open_outlet(struct pvp_pub *p, struct outlet *o, struct pvx_diag *d)
{
    if (o->n == 0)
        return PVX_OK;
    o->subscribers = 0;
    o->socket = zmq_socket(p->ctx, ZMQ_XPUB);
    if (o->socket == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "ZeroMQ: %s", zmq_strerror(errno));
    pvx_err e = set_socket(p, o->socket);
    if (e == PVX_OK && o == &p->out[GUARDED])
        e = pvp_auth_guard(p->auth, o->socket, PVP_ROLE_READ);
    if (e == PVX_OK && o == &p->out[GUARDED])
        e = pvp_door_new(p->ctx, o->socket, &o->door);
    if (e != PVX_OK)
        return pvx_fail(d, e, "ZeroMQ: %s", zmq_strerror(errno));
    for (size_t i = 0; i < o->n; i++)
        PVX_TRY(pvp_bind(o->socket, o->endpoint[i], d));
    return PVX_OK;
}

static void close_outlet(struct outlet *o)
{
    pvp_door_free(&o->door);
    if (o->socket != NULL)
        zmq_close(o->socket);
    o->socket = NULL;
    o->subscribers = 0;
}

/* After a client lost rights, all have to come in again.  The port is free only some time after its socket was
 * closed, so this is tried until it succeeds. */
static void pub_guard_again(struct pvp_pub *p)
{
    struct outlet *o = &p->out[GUARDED];
    struct pvx_diag d = {""};
    if (o->n == 0)
        return;
    if (o->door != NULL)
        pvp_auth_count_failed(p->auth, pvp_door_failed(o->door));
    uint64_t now = pvp_auth_generation(p->auth);
    if (now != p->generation && o->socket != NULL) {
        if (set_int(o->socket, ZMQ_LINGER, 0) != PVX_OK)
            LOG_EVERY(PVX_LOG_WARN, PROTO, "ZeroMQ: %s", zmq_strerror(errno));
        close_outlet(o);
    }
    p->generation = now;
    if (o->socket == NULL && open_outlet(p, o, &d) != PVX_OK) {
        LOG_EVERY(PVX_LOG_INFO, PROTO, "opening anew: %s", d.text);
        close_outlet(o);
    }
}

static pvx_err copy_endpoints(struct pvp_pub *p, const struct pvp_pub_params *params,
                              struct pvx_diag *d)
{
    size_t n = p->n_claims = params->n_endpoints + params->n_guarded;
    if (n == 0)
        return pvx_fail(d, PVX_EINVAL, "no endpoint to publish on");
    p->claims = calloc(n, sizeof *p->claims);
    p->endpoint = calloc(n, sizeof *p->endpoint);
    if (p->claims == NULL || p->endpoint == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        bool open = i < params->n_endpoints;
        p->endpoint[i] =
            strdup(open ? params->endpoints[i] : params->guarded[i - params->n_endpoints]);
        if (p->endpoint[i] == NULL)
            return PVX_ENOMEM;
        PVX_TRY(pvp_ipc_claim_new(p->endpoint[i], &p->claims[i], d));
    }
    const char *const *all = (const char *const *)p->endpoint;
    p->out[OPEN] = (struct outlet){.endpoint = all, .n = params->n_endpoints};
    p->out[GUARDED] =
        (struct outlet){.endpoint = all + params->n_endpoints, .n = params->n_guarded};
    return PVX_OK;
}

static pvx_err pub_open_all(struct pvp_pub *p, struct pvx_diag *d)
{
    p->ctx = zmq_ctx_new();
    if (p->ctx == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "ZeroMQ: %s", zmq_strerror(errno));
    if (p->out[GUARDED].n > 0) {
        if (p->auth == NULL)
            return pvx_fail(d, PVX_EINVAL, "guarded endpoints without keys");
        p->generation = pvp_auth_generation(p->auth);
        PVX_TRY(pvp_zap_new(p->auth, p->ctx, &p->zap, d));
    }
    PVX_TRY(open_outlet(p, &p->out[OPEN], d));
    return open_outlet(p, &p->out[GUARDED], d);
}

pvx_err pvp_pub_new(const struct pvp_pub_params *params, const struct pvp_start *start,
                    pvp_pub **out, struct pvx_diag *d)
{
    *out = NULL;
    struct pvp_pub *p = calloc(1, sizeof *p);
    PVX_NEED(p);
    p->start = *start;
    p->lossless = params->lossless;
    p->hwm = params->send_hwm > 0 ? params->send_hwm : 8;
    p->auth = params->auth;
    if (params->rig != NULL && (p->rig = strdup(params->rig)) == NULL) {
        pvp_pub_free(&p);
        return PVX_ENOMEM;
    }
    pvx_err e = copy_endpoints(p, params, d);
    if (e == PVX_OK && p->rig != NULL && strlen(p->rig) > PVP_RIG_MAX)
        e = pvx_fail(d, PVX_ERANGE, "a rig of %zu bytes", strlen(p->rig));
    PVX_THEN(e, pvp_encoder_new(&start->grid, params->sample, params->comp, &p->encoder));
    PVX_THEN(e, pub_open_all(p, d));
    PVX_THEN(e, send_start(p));
    if (e != PVX_OK) {
        pvp_pub_free(&p);
        return pvx_fail(d, e, "cannot publish: %s", pvx_strerror(e));
    }
    *out = p;
    return PVX_OK;
}

void pvp_pub_free(pvp_pub **pp)
{
    struct pvp_pub *p = *pp;
    if (p == NULL)
        return;
    for (int k = 0; k < N_OUTLETS; k++)
        close_outlet(&p->out[k]);
    pvp_zap_free(&p->zap);
    if (p->ctx != NULL)
        while (zmq_ctx_term(p->ctx) != 0 && errno == EINTR)
            continue;
    /* Only now is the endpoint free for its next owner. */
    for (size_t i = 0; p->claims != NULL && i < p->n_claims; i++)
        pvp_ipc_claim_free(&p->claims[i]);
    for (size_t i = 0; p->endpoint != NULL && i < p->n_claims; i++)
        free(p->endpoint[i]);
    free(p->rig);
    free(p->claims);
    free(p->endpoint);
    pvp_encoder_free(&p->encoder);
    PVX_FREE(*pp);
}

static void pub_tick(struct pvp_pub *p, bool volume)
{
    pub_guard_again(p);
    for (int k = 0; k < N_OUTLETS; k++)
        if (p->out[k].socket != NULL)
            read_subscriptions(p, &p->out[k]);
    /* A start that cannot be encoded was refused in pvp_pub_new; a socket that fails shows in the
     * next volume. */
    if ((pvx_now_mono() >= p->start_due && send_start(p) != PVX_OK) ||
        send_rig(p, volume) != PVX_OK)
        return;
}

void pvp_pub_tick(pvp_pub *p)
{
    pub_tick(p, false);
}

pvx_err pvp_pub_volume(pvp_pub *p, const struct pvp_volume *v, const struct pvp_voxels *x,
                       size_t *bytes)
{
    const void *msg;
    size_t len;
    struct pvp_volume mine = *v;
    mine.session = p->start.session;
    pub_tick(p, true);
    PVX_TRY(pvp_encode_volume(p->encoder, p->sequence, &mine, x, &msg, &len));
    if (bytes != NULL)
        *bytes = len;
    return send_message(p, msg, len);
}

pvx_err pvp_pub_bars(pvp_pub *p, const struct pvp_volume *v, uint32_t doubt,
                     const struct pvp_voxels *sd, size_t *bytes)
{
    const void *msg;
    size_t len;
    struct pvp_volume mine = *v;
    mine.session = p->start.session;
    pub_tick(p, true);
    PVX_TRY(pvp_encode_bars(p->encoder, p->sequence, &mine, doubt, sd, &msg, &len));
    if (bytes != NULL)
        *bytes = len;
    return send_message(p, msg, len);
}

void pvp_pub_compress(pvp_pub *p, enum pvp_compress comp)
{
    pvp_encoder_compress(p->encoder, comp);
}

pvx_err pvp_pub_say(pvp_pub *p, enum pvp_type type, const void *what)
{
    const void *msg;
    size_t len;
    PVX_TRY(pvp_encode(p->encoder, p->sequence, type, what, &msg, &len));
    return send_message(p, msg, len);
}

size_t pvp_pub_subscribers(const pvp_pub *p)
{
    return p->out[OPEN].subscribers + p->out[GUARDED].subscribers;
}

uint64_t pvp_pub_sequence(const pvp_pub *p)
{
    return p->sequence;
}
