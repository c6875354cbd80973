#include "proto/auth.h"

#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

#include "base/log.h"
#include "base/mem.h"

/* A draft in zmq.h, but known to every library of 4.3.  With a library that does not know it, no socket is opened. */
#define ENFORCE_DOMAIN 93
#define ZAP_ENDPOINT   "inproc://zeromq.zap.01"
#define FRAMES \
    7 /* frames of a request for CURVE: version, id, domain, address, identity, mechanism, key */
#define FRAME_MAX   256
#define PATIENCE_MS 100

static const char *const domains[] = {
    [PVP_ROLE_READ] = "pyrovox-read", [PVP_ROLE_CONTROL] = "pyrovox-control"};

struct pvp_auth {
    char server_path[4096], path[4096];
    pthread_mutex_t lock; /* of server, list and next */
    struct pvp_key_pair server;
    struct pvp_client_list list, next;
    _Atomic uint64_t generation, refused;
};

struct pvp_zap {
    pvp_auth *auth;
    void *socket;
    pthread_t thread;
    bool started;
    atomic_bool quit;
};

pvx_err pvp_auth_new(const char *server, const char *clients, pvp_auth **out, struct pvx_diag *d)
{
    *out = NULL;
    pvp_auth *a = pvx_calloc(1, sizeof *a);
    PVX_NEED(a);
    pthread_mutex_init(&a->lock, NULL);
    pvx_err e = pvp_key_read(server, &a->server, d);
    PVX_THEN(e, pvp_clients_read(clients, &a->list, d));
    if (e == PVX_OK && (snprintf(a->path, sizeof a->path, "%s", clients) >= (int)sizeof a->path ||
                        snprintf(a->server_path, sizeof a->server_path, "%s", server) >=
                            (int)sizeof a->server_path))
        e = PVX_EINVAL;
    if (e == PVX_OK)
        *out = a;
    else
        pvp_auth_free(&a);
    return e;
}

void pvp_auth_free(pvp_auth **pa)
{
    if (*pa == NULL)
        return;
    explicit_bzero(&(*pa)->server, sizeof(*pa)->server);
    pthread_mutex_destroy(&(*pa)->lock);
    PVX_FREE(*pa);
}

static const struct pvp_client *auth_find(const struct pvp_client_list *l, const char *key)
{
    for (size_t i = 0; i < l->n; i++)
        if (strcmp(l->client[i].key, key) == 0)
            return &l->client[i];
    return NULL;
}

pvx_err pvp_auth_reload(pvp_auth *a, struct pvx_diag *d)
{
    struct pvp_key_pair server;
    PVX_TRY(pvp_key_read(a->server_path, &server, d));
    pthread_mutex_lock(&a->lock);
    pvx_err e = pvp_clients_read(a->path, &a->next, d);
    bool less = e == PVX_OK && strcmp(server.secret_key, a->server.secret_key) != 0;
    for (size_t i = 0; e == PVX_OK && i < a->list.n; i++) {
        const struct pvp_client *now = auth_find(&a->next, a->list.client[i].key);
        less |= now == NULL || now->role < a->list.client[i].role;
    }
    if (e == PVX_OK) {
        a->list = a->next;
        a->server = server;
    }
    pthread_mutex_unlock(&a->lock);
    explicit_bzero(&server, sizeof server);
    if (less)
        atomic_fetch_add(&a->generation, 1);
    return e;
}

uint64_t pvp_auth_generation(const pvp_auth *a)
{
    return atomic_load(&a->generation);
}

size_t pvp_auth_clients(const pvp_auth *ca)
{
    pvp_auth *a = (pvp_auth *)ca;
    pthread_mutex_lock(&a->lock);
    size_t n = a->list.n;
    pthread_mutex_unlock(&a->lock);
    return n;
}

uint64_t pvp_auth_refused(const pvp_auth *a)
{
    return atomic_load(&a->refused);
}

void pvp_auth_count_failed(pvp_auth *a, uint64_t n)
{
    atomic_fetch_add(&a->refused, n);
}

pvx_err pvp_auth_guard(const pvp_auth *ca, void *socket, enum pvp_role role)
{
    /* Without a domain, libzmq 4.3.4 asks no handler and lets everybody in.  Without the last option it lets
     * everybody in when no handler answers. */
    const int yes = 1;
    pvp_auth *a = (pvp_auth *)ca;
    pthread_mutex_lock(&a->lock);
    bool ok =
        zmq_setsockopt(socket, ZMQ_CURVE_SERVER, &yes, sizeof yes) == 0 &&
        zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, a->server.secret_key, PVP_KEY_TEXT) == 0 &&
        zmq_setsockopt(socket, ZMQ_ZAP_DOMAIN, domains[role], strlen(domains[role])) == 0 &&
        zmq_setsockopt(socket, ENFORCE_DOMAIN, &yes, sizeof yes) == 0;
    pthread_mutex_unlock(&a->lock);
    return ok ? PVX_OK : pvx_err_from_errno(errno);
}

pvx_err pvp_auth_client(void *socket, const char *key_file, struct pvx_diag *d)
{
    struct pvp_key_pair k;
    PVX_TRY(pvp_key_read(key_file, &k, d));
    if (k.server[0] == '\0')
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: does not say the daemon's key; add the line 'server KEY' with the key "
                        "of its .pub file (pyrovox keygen --server FILE.pub writes it)",
                        key_file);
    bool ok = zmq_setsockopt(socket, ZMQ_CURVE_SERVERKEY, k.server, PVP_KEY_TEXT) == 0 &&
              zmq_setsockopt(socket, ZMQ_CURVE_PUBLICKEY, k.public_key, PVP_KEY_TEXT) == 0 &&
              zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, k.secret_key, PVP_KEY_TEXT) == 0;
    pvx_err e = ok ? PVX_OK : pvx_err_from_errno(errno);
    explicit_bzero(&k, sizeof k);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s: libzmq does not take this key", key_file);
}

/* ---- the handler ---- */

struct frame {
    uint8_t data[FRAME_MAX];
    size_t len;
};

static bool auth_is(const struct frame *f, const char *text)
{
    return f->len == strlen(text) && memcmp(f->data, text, f->len) == 0;
}

/* Receives one request.  *n: its frames, of which those beyond FRAMES are counted but not kept.  False: none came. */
static bool auth_receive(void *socket, struct frame f[FRAMES], int *n)
{
    *n = 0;
    for (int more = 1; more;) {
        struct frame *to = &f[*n < FRAMES ? *n : FRAMES - 1];
        int len = zmq_recv(socket, to->data, FRAME_MAX, 0);
        size_t size = sizeof more;
        if (len < 0)
            return false;
        to->len = len < FRAME_MAX ? (size_t)len : FRAME_MAX;
        ++*n;
        if (zmq_getsockopt(socket, ZMQ_RCVMORE, &more, &size) != 0)
            return false;
    }
    return true;
}

/* Whether the owner of the key has the role of the domain, and may come in.  name: the owner, "" if not listed. */
static bool admit(pvp_auth *a, const struct frame *domain, const struct frame *key,
                  char name[PVP_KEY_NAME])
{
    char text[PVP_KEY_TEXT];
    enum pvp_role wanted = auth_is(domain, domains[PVP_ROLE_READ])      ? PVP_ROLE_READ
                           : auth_is(domain, domains[PVP_ROLE_CONTROL]) ? PVP_ROLE_CONTROL
                                                                        : PVP_ROLE_NONE;
    name[0] = '\0';
    if (wanted == PVP_ROLE_NONE || key->len != 32 || zmq_z85_encode(text, key->data, 32) == NULL)
        return false;
    pthread_mutex_lock(&a->lock);
    const struct pvp_client *c = auth_find(&a->list, text);
    bool in = c != NULL && c->role >= wanted;
    if (c != NULL)
        memcpy(name, c->name, PVP_KEY_NAME);
    pthread_mutex_unlock(&a->lock);
    return in;
}

static void auth_answer(struct pvp_zap *z, const struct frame f[FRAMES], int n)
{
    char name[PVP_KEY_NAME] = "";
    bool in = n == FRAMES && auth_is(&f[0], "1.0") && auth_is(&f[5], "CURVE") &&
              admit(z->auth, &f[2], &f[6], name);
    if (!in) {
        atomic_fetch_add(&z->auth->refused, 1);
        LOG_EVERY(PVX_LOG_WARN, PROTO, "refused a connection from %.*s: %s%s",
                  n > 3 ? (int)f[3].len : 0, (const char *)f[3].data,
                  name[0] != '\0' ? name : "a key that is not listed",
                  name[0] != '\0' ? " may not do that" : "");
    }
    const char *const out[] = {in ? "200" : "400", in ? "OK" : "refused", in ? name : "", ""};
    zmq_send(z->socket, "1.0", 3, ZMQ_SNDMORE);
    zmq_send(z->socket, f[1].data, n > 1 ? f[1].len : 0, ZMQ_SNDMORE);
    for (int i = 0; i < 4; i++)
        zmq_send(z->socket, out[i], strlen(out[i]), i < 3 ? ZMQ_SNDMORE : 0);
}

static void *auth_run(void *arg)
{
    struct pvp_zap *z = arg;
    struct frame f[FRAMES];
    int n;
    while (!atomic_load(&z->quit))
        if (auth_receive(z->socket, f, &n))
            auth_answer(z, f, n);
    return NULL;
}

pvx_err pvp_zap_new(pvp_auth *a, void *zmq, pvp_zap **out, struct pvx_diag *d)
{
    const int patience = PATIENCE_MS, linger = 0;
    *out = NULL;
    struct pvp_zap *z = pvx_calloc(1, sizeof *z);
    PVX_NEED(z);
    z->auth = a;
    z->socket = zmq_socket(zmq, ZMQ_REP);
    bool ok = z->socket != NULL &&
              zmq_setsockopt(z->socket, ZMQ_RCVTIMEO, &patience, sizeof patience) == 0 &&
              zmq_setsockopt(z->socket, ZMQ_LINGER, &linger, sizeof linger) == 0 &&
              zmq_bind(z->socket, ZAP_ENDPOINT) == 0 &&
              pthread_create(&z->thread, NULL, auth_run, z) == 0;
    if (!ok) {
        pvp_zap_free(&z);
        return pvx_fail(d, PVX_EIO, "keys: no handler to be had: %s", zmq_strerror(errno));
    }
    z->started = true;
    pthread_setname_np(z->thread, "keys");
    *out = z;
    return PVX_OK;
}

void pvp_zap_free(pvp_zap **pz)
{
    struct pvp_zap *z = *pz;
    if (z == NULL)
        return;
    atomic_store(&z->quit, true);
    if (z->started)
        pthread_join(z->thread, NULL);
    if (z->socket != NULL)
        zmq_close(z->socket);
    PVX_FREE(*pz);
}
