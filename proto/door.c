#include "proto/door.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/mem.h"

#define BROKEN_OFF 3 /* handshakes in a row: no daemon that is just ending */
#define FAILED                                                                    \
    (ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | \
     ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)

struct pvp_door {
    void *watched, *news;
    int broken; /* handshakes that the other side broke off, since one that went well */
};

pvx_err pvp_door_new(void *zmq, void *socket, pvp_door **out)
{
    static atomic_uint made;
    char at[64];
    const int linger = 0;
    *out = NULL;
    pvp_door *p = pvx_calloc(1, sizeof *p);
    if (p == NULL)
        return PVX_ENOMEM;
    snprintf(at, sizeof at, "inproc://pyrovox-door-%u", atomic_fetch_add(&made, 1));
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

void pvp_door_free(pvp_door **pp)
{
    pvp_door *p = *pp;
    if (p == NULL)
        return;
    zmq_socket_monitor(p->watched, NULL, 0);
    if (p->news != NULL)
        zmq_close(p->news);
    PVX_FREE(*pp);
}

void *pvp_door_socket(const pvp_door *p)
{
    return p->news;
}

/* The next event, a frame of its number and one of where; 0: none. */
static unsigned next_event(pvp_door *p)
{
    unsigned char what[6], where[256];
    int n = zmq_recv(p->news, what, sizeof what, ZMQ_DONTWAIT);
    if (n < 0)
        return 0;
    zmq_recv(p->news, where, sizeof where, ZMQ_DONTWAIT);
    uint16_t event;
    memcpy(&event, what, sizeof event); /* the host's own order, as libzmq writes it */
    return n == sizeof what ? event : 0;
}

uint64_t pvp_door_failed(pvp_door *p)
{
    uint64_t n = 0;
    for (unsigned e; (e = next_event(p)) != 0;)
        n += e == ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL || e == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL;
    return n;
}

pvx_err pvp_door_refused(pvp_door *p, const char *endpoint, bool has_key, struct pvx_diag *d)
{
    for (unsigned e; (e = next_event(p)) != 0;) {
        if (e == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
            return pvx_fail(d, PVX_EPERM,
                            "the daemon at %s refuses this key: it is not in its keys.clients, or "
                            "may not do that",
                            endpoint);
        if (e == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL)
            return pvx_fail(d, PVX_EPERM,
                            has_key ? "the daemon at %s asks for no key, or is none: try without"
                                    : "the daemon at %s asks for a key: --key FILE, made by "
                                      "pyrovox keygen",
                            endpoint);
        p->broken = e == ZMQ_EVENT_HANDSHAKE_SUCCEEDED ? 0 : p->broken + 1;
        if (p->broken >= BROKEN_OFF) {
            p->broken = 0;
            return pvx_fail(d, PVX_EPERM,
                            has_key ? "the daemon at %s breaks off: it has another key than the "
                                      "file says (its 'server' line)"
                                    : "the daemon at %s breaks off: it asks for a key (--key FILE, "
                                      "made by pyrovox keygen)",
                            endpoint);
        }
    }
    return PVX_OK;
}
