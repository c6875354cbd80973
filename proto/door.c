#include "proto/door.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/mem.h"
#include "proto/attach.h"

#define BROKEN_OFF 3 /* failed handshakes in a row: not just a daemon that is ending */
#define FAILED                                                                    \
    (ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | \
     ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)

struct pvp_door {
    void *zmq, *watched, *news;
    int broken; /* failed handshakes since the last successful one */
    /* A second connection, without a key, that sends nothing.  If it is let in, the daemon does not ask for keys. */
    void *keyless;
    pvp_door *keyless_door;
};

pvx_err pvp_door_new(void *zmq, void *socket, pvp_door **out)
{
    static atomic_uint made;
    char at[64];
    const int linger = 0;
    *out = NULL;
    pvp_door *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    snprintf(at, sizeof at, "inproc://pyrovox-door-%u", atomic_fetch_add(&made, 1));
    p->zmq = zmq;
    p->watched = socket;
    p->news = zmq_socket(zmq, ZMQ_PAIR);
    bool ok = p->news != NULL && zmq_setsockopt(p->news, ZMQ_LINGER, &linger, sizeof linger) == 0 &&
              zmq_socket_monitor(socket, at, FAILED | ZMQ_EVENT_HANDSHAKE_SUCCEEDED) == 0 &&
              zmq_connect(p->news, at) == 0;
    if (!ok) {
        pvx_err e = pvx_err_from_errno(errno);
        pvp_door_free(&p);
        return e;
    }
    *out = p;
    return PVX_OK;
}

static void stop_trying(pvp_door *p)
{
    pvp_door_free(&p->keyless_door);
    if (p->keyless != NULL)
        zmq_close(p->keyless);
    p->keyless = NULL;
}

void pvp_door_free(pvp_door **pp)
{
    pvp_door *p = *pp;
    if (p == NULL)
        return;
    stop_trying(p);
    zmq_socket_monitor(p->watched, NULL, 0);
    if (p->news != NULL)
        zmq_close(p->news);
    PVX_FREE(*pp);
}

void *pvp_door_socket(const pvp_door *p)
{
    return p->news;
}

struct event {
    uint16_t what; /* 0: none */
    uint32_t value;
};

/* The next event.  It has one frame with the event, and one with its endpoint. */
static struct event next_event(pvp_door *p)
{
    unsigned char frame[6], where[256];
    struct event e = {0};
    int n = zmq_recv(p->news, frame, sizeof frame, ZMQ_DONTWAIT);
    if (n < 0)
        return e;
    zmq_recv(p->news, where, sizeof where, ZMQ_DONTWAIT);
    if (n == sizeof frame) { /* the host's own order, as libzmq writes it */
        memcpy(&e.what, frame, sizeof e.what);
        memcpy(&e.value, frame + sizeof e.what, sizeof e.value);
    }
    return e;
}

uint64_t pvp_door_failed(pvp_door *p)
{
    uint64_t n = 0;
    for (struct event e; (e = next_event(p)).what != 0;)
        n += e.what == ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL ||
             e.what == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL;
    return n;
}

static void try_without_key(pvp_door *p, const char *endpoint)
{
    const int linger = 0;
    int type;
    size_t size = sizeof type;
    if (p->keyless != NULL || zmq_getsockopt(p->watched, ZMQ_TYPE, &type, &size) != 0)
        return;
    p->keyless = zmq_socket(p->zmq, type);
    if (p->keyless == NULL || zmq_setsockopt(p->keyless, ZMQ_LINGER, &linger, sizeof linger) != 0 ||
        pvp_door_new(p->zmq, p->keyless, &p->keyless_door) != PVX_OK ||
        pvp_connect(p->keyless, endpoint) != 0)
        stop_trying(p); /* tried again later */
}

static pvx_err no_key(const char *endpoint, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_EPERM,
                    "the daemon at %s asks for no key: leave --key out; nothing is encrypted there",
                    endpoint);
}

/* Several broken handshakes of a client with a key.  Either end may be the first to notice that the other has no
 * key, and libzmq then reports the same as for a wrong key.  PVX_OK: not known yet; the next try also ends in an
 * event. */
static pvx_err broken_off(pvp_door *p, const char *endpoint, struct pvx_diag *d)
{
    struct event e = {0};
    try_without_key(p, endpoint);
    if (p->keyless_door != NULL && p->broken >= BROKEN_OFF)
        e = next_event(p->keyless_door);
    if (e.what == 0)
        return PVX_OK;
    stop_trying(p);
    p->broken = 0;
    if (e.what == ZMQ_EVENT_HANDSHAKE_SUCCEEDED)
        return no_key(endpoint, d);
    return pvx_fail(d, PVX_EPERM,
                    "the daemon at %s breaks off: it has another key than the file says (its "
                    "'server' line)",
                    endpoint);
}

pvx_err pvp_door_refused(pvp_door *p, const char *endpoint, bool has_key, struct pvx_diag *d)
{
    for (struct event e; (e = next_event(p)).what != 0;) {
        p->broken = e.what == ZMQ_EVENT_HANDSHAKE_SUCCEEDED ? 0 : p->broken + 1;
        if (p->broken == 0) {
            stop_trying(p);
            continue;
        }
        if (e.what == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
            return pvx_fail(d, PVX_EPERM,
                            "the daemon at %s refuses this key: it is not in its keys.clients, or "
                            "may not do that",
                            endpoint);
        if (e.what == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL &&
            e.value != ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH)
            return pvx_fail(d, PVX_EPERM, "what listens at %s is no pyrovoxd", endpoint);
        if (e.what == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL && has_key)
            return no_key(endpoint, d);
        if (has_key)
            PVX_TRY(broken_off(p, endpoint, d));
        else if (e.what == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL || p->broken >= BROKEN_OFF) {
            p->broken = 0;
            return pvx_fail(d, PVX_EPERM,
                            "the daemon at %s asks for a key: --key FILE, made by pyrovox keygen",
                            endpoint);
        }
    }
    return PVX_OK;
}
