#include "daemon/control/control.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>
#include <zmq.h>

#include "base/log.h"
#include "base/mem.h"
#include "proto/attach.h"
#include "proto/door.h"
#include "proto/ipc.h"

#define WAY_MAX 8 /* a client, and devices between */

struct dmn_control {
    struct dmn_control_ops ops;
    void *zmq, *socket;
    pvp_ipc_claim *claim;
    int given; /* socket that systemd listens on at the endpoint, and keeps; -1: none */
    char *endpoint;
    pvp_auth *auth;
    pvp_zap *zap;
    pvp_door *door;      /* with auth, of the socket that is open */
    uint64_t generation; /* of auth, when the socket was opened */
    pthread_t thread;
    bool started;
    atomic_bool quit;
    zmq_msg_t way[WAY_MAX]; /* [n_way] of the request at hand, the empty frame last */
    int n_way;
    char request[DMN_REQUEST_MAX];
    char reply[DMN_REPLY_MAX];
};

/* Receive one message: its way back (up to and with the empty frame) and the text after that.  What follows is
 * ignored, and so is a message without an empty frame.  Returns the text's true length, -1 = none (errno).
 *
 * The socket is a ROUTER, not a REP: in zmq 4.3.4 a REP loses its place, and with it the next client's reply, when a
 * message without an empty frame comes from a peer that is gone by then. */
static int control_receive(dmn_control *c)
{
    int length = -1;
    bool more = true, bottom = false;
    for (c->n_way = 0; more;) {
        zmq_msg_t m;
        zmq_msg_init(&m);
        if (zmq_msg_recv(&m, c->socket, 0) < 0)
            return -1; /* once a message has begun, all its frames are there */
        more = zmq_msg_more(&m);
        if (!bottom && c->n_way < WAY_MAX) {
            bottom = zmq_msg_size(&m) == 0;
            zmq_msg_init(&c->way[c->n_way]);
            zmq_msg_move(&c->way[c->n_way++], &m);
        } else if (bottom && length < 0) {
            length = (int)zmq_msg_size(&m);
            memcpy(c->request, zmq_msg_data(&m),
                   (size_t)length < sizeof c->request ? (size_t)length : sizeof c->request);
        }
        zmq_msg_close(&m);
    }
    if (length < 0)
        errno = EAGAIN;
    return length;
}

/* Send the reply to the client that sent the request, if it is still there. */
static void control_answer(dmn_control *c, size_t length)
{
    bool sent = true;
    for (int k = 0; sent && k < c->n_way; k++)
        sent = zmq_msg_send(&c->way[k], c->socket, ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0;
    if (!sent || zmq_send(c->socket, c->reply, length, ZMQ_DONTWAIT) < 0)
        LOG_EVERY(PVX_LOG_WARN, DAEMON, "control reply not sent: %s", zmq_strerror(errno));
}

/* Socket activation: of the sockets that systemd passes, the one whose path is the endpoint's; -1: none. */
static int given_socket(const char *endpoint)
{
    int n = strncmp(endpoint, "ipc://", 6) == 0 ? sd_listen_fds(0) : 0;
    for (int fd = SD_LISTEN_FDS_START; fd < SD_LISTEN_FDS_START + n; fd++)
        if (sd_is_socket_unix(fd, SOCK_STREAM, 1, endpoint + 6, 0) > 0)
            return fd;
    return -1;
}

static pvx_err bind_socket(dmn_control *c, struct pvx_diag *d)
{
    int64_t max = DMN_REQUEST_MAX * 4; /* above this libzmq closes the connection */
    int wait_ms = 100, linger = 200;
    c->socket = zmq_socket(c->zmq, ZMQ_ROUTER);
    if (c->socket == NULL)
        return pvx_fail(d, PVX_EIO, "control socket: %s", zmq_strerror(errno));
    zmq_setsockopt(c->socket, ZMQ_MAXMSGSIZE, &max, sizeof max);
    zmq_setsockopt(c->socket, ZMQ_RCVTIMEO, &wait_ms, sizeof wait_ms);
    zmq_setsockopt(c->socket, ZMQ_LINGER, &linger, sizeof linger);
    if (c->auth != NULL) {
        PVX_TRY(pvp_auth_guard(c->auth, c->socket, PVP_ROLE_CONTROL));
        PVX_TRY(pvp_door_new(c->zmq, c->socket, &c->door));
    }
    /* libzmq closes what it is given, and leaves its file alone */
    int fd = c->given >= 0 ? fcntl(c->given, F_DUPFD_CLOEXEC, 0) : -1;
    if (fd >= 0)
        zmq_setsockopt(c->socket, ZMQ_USE_FD, &fd, sizeof fd);
    return pvp_bind(c->socket, c->endpoint, d);
}

static void close_socket(dmn_control *c)
{
    pvp_door_free(&c->door);
    if (c->socket != NULL)
        zmq_close(c->socket);
    c->socket = NULL;
}

/* When the keys have changed, a client may have lost a right: bind anew, so that all are checked again (pub.c). */
static void control_guard_again(dmn_control *c)
{
    struct pvx_diag d = {""};
    if (c->auth == NULL)
        return;
    uint64_t now = pvp_auth_generation(c->auth);
    if (c->door != NULL)
        pvp_auth_count_failed(c->auth, pvp_door_failed(c->door));
    if (now != c->generation)
        close_socket(c);
    c->generation = now;
    if (c->socket == NULL && bind_socket(c, &d) != PVX_OK) {
        close_socket(c);
        usleep(100000);
    }
}

static void *control_run(void *arg)
{
    dmn_control *c = arg;
    while (!atomic_load(&c->quit)) {
        control_guard_again(c);
        if (c->socket == NULL)
            continue;
        int n = control_receive(c);
        if (n >= 0) {
            control_answer(
                c, dmn_control_handle(&c->ops, c->request, (size_t)n, c->reply, sizeof c->reply));
        } else if (errno != EAGAIN && errno != EINTR) {
            LOG_E(DAEMON, "control socket: %s; it is closed now", zmq_strerror(errno));
            break;
        }
        for (int k = 0; k < c->n_way; k++)
            zmq_msg_close(&c->way[k]);
    }
    return NULL;
}

pvx_err dmn_control_new(const char *endpoint, pvp_auth *auth, const struct dmn_control_ops *ops,
                        dmn_control **out, struct pvx_diag *d)
{
    *out = NULL;
    dmn_control *c = pvx_calloc(1, sizeof *c);
    PVX_NEED(c);
    c->ops = *ops;
    c->ops.remote = auth != NULL;
    c->auth = auth;
    c->endpoint = strdup(endpoint);
    c->zmq = zmq_ctx_new();
    c->given = given_socket(endpoint);
    pvx_err e = c->endpoint != NULL && c->zmq != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK && c->given < 0) /* no other daemon can have systemd's socket */
        e = pvp_ipc_claim_new(endpoint, &c->claim, d);
    if (e == PVX_OK && auth != NULL) {
        c->generation = pvp_auth_generation(auth);
        e = pvp_zap_new(auth, c->zmq, &c->zap, d);
    }
    PVX_THEN(e, bind_socket(c, d));
    if (e == PVX_OK && pthread_create(&c->thread, NULL, control_run, c) != 0)
        e = pvx_fail(d, PVX_EIO, "control: no thread to be had");
    if (e != PVX_OK) {
        dmn_control_free(&c);
        return e;
    }
    c->started = true;
    pthread_setname_np(c->thread, "control");
    *out = c;
    return PVX_OK;
}

void dmn_control_free(dmn_control **pc)
{
    dmn_control *c = *pc;
    if (c == NULL)
        return;
    atomic_store(&c->quit, true);
    if (c->started)
        pthread_join(c->thread, NULL);
    close_socket(c);
    pvp_zap_free(&c->zap);
    if (c->zmq != NULL)
        zmq_ctx_term(c->zmq);
    pvp_ipc_claim_free(&c->claim);
    free(c->endpoint);
    PVX_FREE(*pc);
}
