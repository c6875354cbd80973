#include "proto/pub.h"

#include <errno.h>
#include <stdlib.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "proto/ipc.h"

#define LINGER_MS          250
#define LINGER_LOSSLESS_MS 60000

struct pvp_pub {
    void *ctx, *socket;
    pvp_encoder *encoder;
    struct pvp_start start;
    uint64_t sequence;
    int64_t start_due; /* mono */
    size_t subscribers;
    bool lossless;
    size_t n_claims;
    pvp_ipc_claim **claims; /* one per endpoint, NULL where none is needed */
};

static pvx_err set_int(void *socket, int option, int value)
{
    return zmq_setsockopt(socket, option, &value, sizeof value) == 0 ? PVX_OK
                                                                     : pvx_err_from_errno(errno);
}

/* Live: never blocks and reports no drop, what fails here is the socket itself.  Lossless: waits for
 * the slowest subscriber; one that has not read for PVP_PUB_PATIENCE_S is no longer waited for. */
static pvx_err send_message(struct pvp_pub *p, const void *msg, size_t len)
{
    p->sequence++;
    while (zmq_send(p->socket, msg, len, p->lossless ? 0 : ZMQ_DONTWAIT) < 0) {
        if (errno == EAGAIN && p->lossless) {
            LOG_W(PROTO,
                  "a subscriber has read nothing for %d s: it is no longer waited for and "
                  "will miss volumes",
                  PVP_PUB_PATIENCE_S);
            p->lossless = false;
            PVX_TRY(set_int(p->socket, ZMQ_XPUB_NODROP, 0));
        } else if (errno != EINTR) {
            return pvx_err_from_errno(errno);
        }
    }
    return PVX_OK;
}

/* Subscribers send 1 + prefix to subscribe, 0 + prefix to leave; libzmq does so for one that dies. */
static void read_subscriptions(struct pvp_pub *p)
{
    unsigned char m[64];
    int n;
    while ((n = zmq_recv(p->socket, m, sizeof m, ZMQ_DONTWAIT)) >= 0) {
        if (n > 0 && m[0] == 1) {
            p->subscribers++;
            p->start_due = 0; /* who has just come needs it now, not in a second */
        } else if (n > 0 && m[0] == 0 && p->subscribers > 0)
            p->subscribers--;
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

static pvx_err bind_all(struct pvp_pub *p, const struct pvp_pub_params *params, struct pvx_diag *d)
{
    for (size_t i = 0; i < params->n_endpoints; i++) {
        const char *endpoint = params->endpoints[i];
        PVX_TRY(pvp_ipc_claim_new(endpoint, &p->claims[i], d));
        if (zmq_bind(p->socket, endpoint) != 0)
            return pvp_bind_fail(endpoint, errno, d);
    }
    return PVX_OK;
}

static pvx_err open_socket(struct pvp_pub *p, int hwm, struct pvx_diag *d)
{
    p->ctx = zmq_ctx_new();
    p->socket = p->ctx != NULL ? zmq_socket(p->ctx, ZMQ_XPUB) : NULL;
    if (p->socket == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "ZeroMQ: %s", zmq_strerror(errno));
    if (hwm <= 0)
        hwm = 8;
    const int linger = p->lossless ? LINGER_LOSSLESS_MS : LINGER_MS, keepalive = 1;
    const int64_t max_in = 4096; /* subscribers send us subscriptions, nothing bigger */
    if (zmq_setsockopt(p->socket, ZMQ_SNDHWM, &hwm, sizeof hwm) != 0 ||
        zmq_setsockopt(p->socket, ZMQ_LINGER, &linger, sizeof linger) != 0 ||
        zmq_setsockopt(p->socket, ZMQ_TCP_KEEPALIVE, &keepalive, sizeof keepalive) != 0 ||
        zmq_setsockopt(p->socket, ZMQ_MAXMSGSIZE, &max_in, sizeof max_in) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "ZeroMQ: %s", zmq_strerror(errno));
    PVX_TRY(set_int(p->socket, ZMQ_XPUB_VERBOSER, 1)); /* every subscriber's, not only the first */
    if (!p->lossless)
        return PVX_OK;
    PVX_TRY(set_int(p->socket, ZMQ_XPUB_NODROP, 1));
    return set_int(p->socket, ZMQ_SNDTIMEO, PVP_PUB_PATIENCE_S * 1000);
}

pvx_err pvp_pub_new(const struct pvp_pub_params *params, const struct pvp_start *start,
                    pvp_pub **out, struct pvx_diag *d)
{
    *out = NULL;
    struct pvp_pub *p = calloc(1, sizeof *p);
    if (p == NULL)
        return PVX_ENOMEM;
    p->start = *start;
    p->lossless = params->lossless;
    p->n_claims = params->n_endpoints;
    p->claims = calloc(params->n_endpoints + 1, sizeof(pvp_ipc_claim *));
    pvx_err e = p->claims != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK && params->n_endpoints == 0)
        e = pvx_fail(d, PVX_EINVAL, "no endpoint to publish on");
    if (e == PVX_OK)
        e = pvp_encoder_new(&start->grid, params->sample, params->comp, &p->encoder);
    if (e == PVX_OK)
        e = open_socket(p, params->send_hwm, d);
    if (e == PVX_OK)
        e = bind_all(p, params, d);
    if (e == PVX_OK)
        e = send_start(p);
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
    if (p->socket != NULL)
        zmq_close(p->socket);
    if (p->ctx != NULL)
        while (zmq_ctx_term(p->ctx) != 0 && errno == EINTR)
            continue;
    /* Only now is nobody listening any more: the next owner may come. */
    for (size_t i = 0; p->claims != NULL && i < p->n_claims; i++)
        pvp_ipc_claim_free(&p->claims[i]);
    free(p->claims);
    pvp_encoder_free(&p->encoder);
    PVX_FREE(*pp);
}

void pvp_pub_tick(pvp_pub *p)
{
    read_subscriptions(p);
    /* A start that cannot be encoded was refused in pvp_pub_new; a socket that fails shows in the
     * next volume. */
    if (pvx_now_mono() >= p->start_due && send_start(p) != PVX_OK)
        return;
}

pvx_err pvp_pub_volume(pvp_pub *p, const struct pvp_volume *v, const struct pvp_voxels *x,
                       size_t *bytes)
{
    const void *msg;
    size_t len;
    struct pvp_volume mine = *v;
    mine.session = p->start.session;
    pvp_pub_tick(p);
    PVX_TRY(pvp_encode_volume(p->encoder, p->sequence, &mine, x, &msg, &len));
    if (bytes != NULL)
        *bytes = len;
    return send_message(p, msg, len);
}

pvx_err pvp_pub_status(pvp_pub *p, const char *json)
{
    const void *msg;
    size_t len;
    PVX_TRY(pvp_encode_status(p->encoder, p->sequence, json, &msg, &len));
    return send_message(p, msg, len);
}

pvx_err pvp_pub_end(pvp_pub *p, const char *reason)
{
    const void *msg;
    size_t len;
    PVX_TRY(pvp_encode_end(p->encoder, p->sequence, p->start.session, reason, &msg, &len));
    return send_message(p, msg, len);
}

size_t pvp_pub_subscribers(const pvp_pub *p)
{
    return p->subscribers;
}

uint64_t pvp_pub_sequence(const pvp_pub *p)
{
    return p->sequence;
}
