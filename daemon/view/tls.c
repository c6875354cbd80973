#include "daemon/view/tls.h"

#include <errno.h>
#include <gnutls/gnutls.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/view/certificate.h"

#define RECORD     16384
#define PAIR_BYTES 65536 /* the kernel doubles it */
#define ACCEPTS    16    /* at one go */
#define ENDING_NS  (2 * PVX_NS_PER_S)

/* A certificate and its key, for the connections that began with it. */
struct papers {
    gnutls_certificate_credentials_t with;
    unsigned users; /* connections, and the view_tls while it is the one in use */
};
/* Bytes that wait to go one way. */
struct half {
    size_t at, n;
    bool eof; /* nothing comes any more */
    uint8_t bytes[RECORD];
};
struct conn {
    int tcp, pair, its;       /* its: the server's end, as it was handed over */
    gnutls_session_t session; /* NULL: the place is free */
    struct papers *with;
    bool shaken;
    int64_t since, ending_ns; /* ending: all was sent */
    uint32_t want_tcp, want_pair;
    struct half in, out; /* from the browser, to it */
    struct sockaddr_storage here;
};
struct view_tls {
    struct view_tls_params p;
    struct papers *with;     /* NULL: none yet */
    int64_t read[2][3];      /* which files it was read from: number, time of their last change */
    struct pvx_diag trouble; /* with the files that are there now, once it was told */
    gnutls_priority_t priority;
    int epoll;
    bool waiting; /* for the listening socket: there is room */
    struct conn *conn;
    uint64_t late;
};

static void tls_leave(struct papers *p)
{
    if (p == NULL || --p->users > 0)
        return;
    gnutls_certificate_free_credentials(p->with);
    free(p);
}

static void look_at_files(const view_tls *t, int64_t out[2][3])
{
    const char *const file[] = {t->p.cert, t->p.key};
    for (int i = 0; i < 2; i++) {
        struct stat st = {0};
        (void)stat(file[i], &st); /* if it is gone, reading it fails */
        out[i][0] = (int64_t)st.st_ino;
        out[i][1] = st.st_ctim.tv_sec;
        out[i][2] = st.st_ctim.tv_nsec;
    }
}

static pvx_err read_papers(view_tls *t, struct pvx_diag *d)
{
    int64_t files[2][3];
    struct papers *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    look_at_files(t, files); /* before: what changes while it is read is read again */
    pvx_err e = view_certificate(t->p.cert, t->p.key, &p->with, d);
    if (e != PVX_OK) {
        free(p);
        return e;
    }
    p->users = 1;
    tls_leave(t->with);
    t->with = p;
    memcpy(t->read, files, sizeof files);
    return PVX_OK;
}

/* A certificate lasts for weeks, a page for months.  A new connection gets the certificate that is there now.  If
 * that cannot be used, as certificate and key come one after the other, it gets the one before. */
static void tls_renew(view_tls *t)
{
    int64_t files[2][3];
    struct pvx_diag d = {""};
    char line[sizeof d.text + 64];
    look_at_files(t, files);
    if (memcmp(files, t->read, sizeof files) == 0)
        return;
    pvx_err e = read_papers(t, &d);
    if (e == PVX_OK) {
        t->trouble.text[0] = '\0';
        snprintf(line, sizeof line, "%s is used from now on", t->p.cert);
    } else {
        if (strcmp(t->trouble.text, pvx_diag_text(&d, e)) == 0)
            return;
        snprintf(t->trouble.text, sizeof t->trouble.text, "%s", pvx_diag_text(&d, e));
        snprintf(line, sizeof line, "goes on with the certificate that it has: %s",
                 t->trouble.text);
    }
    t->p.say(line);
}

static void tls_watch(view_tls *t, int fd, uint32_t *have, uint32_t want)
{
    struct epoll_event e = {.events = want, .data.fd = fd};
    if (*have == want)
        return;
    epoll_ctl(t->epoll,
              want == 0    ? EPOLL_CTL_DEL
              : *have == 0 ? EPOLL_CTL_ADD
                           : EPOLL_CTL_MOD,
              fd, &e);
    *have = want;
}

static void tls_drop(view_tls *t, struct conn *c)
{
    tls_watch(t, c->tcp, &c->want_tcp, 0);
    if (c->pair >= 0) {
        tls_watch(t, c->pair, &c->want_pair, 0);
        close(c->pair);
    }
    close(c->tcp);
    gnutls_deinit(c->session);
    c->session = NULL;
    tls_leave(c->with);
}

/* Continue the handshake; false: it failed. */
static bool shake(view_tls *t, struct conn *c)
{
    struct sockaddr_storage from;
    socklen_t len = sizeof from;
    int end[2], room = PAIR_BYTES, r = gnutls_handshake(c->session);
    if (r < 0)
        return gnutls_error_is_fatal(r) == 0;
    if (getpeername(c->tcp, (struct sockaddr *)&from, &len) != 0 ||
        socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, end) != 0)
        return false;
    for (int i = 0; i < 2; i++)
        setsockopt(end[i], SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    for (unsigned i = 0; i < t->p.connections;
         i++) /* the server has closed an older one of that number */
        if (t->conn[i].its == end[1])
            t->conn[i].its = -1;
    c->shaken = true;
    c->pair = end[0];
    c->its = end[1];
    return t->p.come(t->p.ctx, end[1], (struct sockaddr *)&from, len);
}

/* From the browser to the server; 1: something moved, 0: it waits, -1: it is over. */
static int inwards(struct conn *c)
{
    struct half *h = &c->in;
    if (h->n == 0 && !h->eof) {
        ssize_t r = gnutls_record_recv(c->session, h->bytes, sizeof h->bytes);
        if (r < 0)
            return gnutls_error_is_fatal((int)r) != 0 ? -1 : 0;
        h->at = 0;
        h->n = (size_t)r;
        h->eof = r == 0;
        if (h->eof)
            shutdown(c->pair, SHUT_WR);
        return 1;
    }
    if (h->n == 0)
        return 0;
    ssize_t w = send(c->pair, h->bytes + h->at, h->n, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (w < 0 && errno != EINTR && errno != EAGAIN) { /* the server has closed: nobody reads this */
        h->n = 0;
        return 1;
    }
    h->at += w > 0 ? (size_t)w : 0;
    h->n -= w > 0 ? (size_t)w : 0;
    return w > 0;
}

/* From the server to the browser. */
static int tls_outwards(struct conn *c)
{
    struct half *h = &c->out;
    if (h->n == 0 && !h->eof) {
        ssize_t r = recv(c->pair, h->bytes, sizeof h->bytes, MSG_DONTWAIT);
        if (r < 0 && (errno == EAGAIN || errno == EINTR))
            return 0;
        h->at = 0;
        h->n = r > 0 ? (size_t)r : 0;
        h->eof = r <= 0;
        if (h->eof) {
            gnutls_bye(c->session, GNUTLS_SHUT_WR);
            shutdown(c->tcp, SHUT_WR);
            c->ending_ns = pvx_now_mono();
        }
        return 1;
    }
    if (h->n == 0)
        return 0;
    ssize_t w = gnutls_record_send(c->session, h->bytes + h->at, h->n);
    if (w < 0)
        return gnutls_error_is_fatal((int)w) != 0 ? -1 : 0;
    h->at += (size_t)w;
    h->n -= (size_t)w;
    return w > 0;
}

/* Move all that can move now; false: the connection is over. */
static bool pump(view_tls *t, struct conn *c)
{
    if (!c->shaken && !shake(t, c))
        return false;
    for (int in = 1, out = 1; c->shaken && (in > 0 || out > 0);) {
        in = inwards(c);
        out = tls_outwards(c);
        if (in < 0 || out < 0 || (c->in.eof && c->out.eof))
            return false;
    }
    if (c->shaken) {
        tls_watch(t, c->tcp, &c->want_tcp,
                  (c->in.n == 0 && !c->in.eof ? EPOLLIN : 0U) | (c->out.n > 0 ? EPOLLOUT : 0U));
        tls_watch(t, c->pair, &c->want_pair,
                  (c->out.n == 0 && !c->out.eof ? EPOLLIN : 0U) | (c->in.n > 0 ? EPOLLOUT : 0U));
    } else {
        tls_watch(t, c->tcp, &c->want_tcp,
                  gnutls_record_get_direction(c->session) == 1 ? EPOLLOUT : EPOLLIN);
    }
    return true;
}

static struct conn *tls_place(view_tls *t)
{
    for (unsigned i = 0; i < t->p.connections; i++)
        if (t->conn[i].session == NULL)
            return &t->conn[i];
    return NULL;
}

/* Accept one connection that waits; false: none does. */
static bool tls_take(view_tls *t, struct conn *c)
{
    int fd = accept4(t->p.listen, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    socklen_t len = sizeof c->here;
    if (fd < 0)
        return false;
    *c = (struct conn){.tcp = fd, .pair = -1, .its = -1, .since = pvx_now_mono()};
    t->p.prepare(fd);
    if (getsockname(fd, (struct sockaddr *)&c->here, &len) != 0 ||
        gnutls_init(&c->session, GNUTLS_SERVER | GNUTLS_NONBLOCK | GNUTLS_NO_SIGNAL) != 0) {
        c->session = NULL;
        close(fd);
        return true;
    }
    tls_renew(t);
    c->with = t->with;
    c->with->users++;
    gnutls_transport_set_int(c->session, fd);
    if (gnutls_priority_set(c->session, t->priority) != 0 ||
        gnutls_credentials_set(c->session, GNUTLS_CRD_CERTIFICATE, c->with->with) != 0 ||
        !pump(t, c))
        tls_drop(t, c);
    return true;
}

static void tls_take_all(view_tls *t)
{
    struct conn *c = NULL;
    for (int i = 0; i < ACCEPTS && (c = tls_place(t)) != NULL; i++)
        if (!tls_take(t, c))
            break;
    /* while all places are taken, a new connection waits in the kernel's queue */
    struct epoll_event e = {.events = EPOLLIN, .data.fd = t->p.listen};
    bool room = tls_place(t) != NULL;
    if (room != t->waiting)
        epoll_ctl(t->epoll, room ? EPOLL_CTL_ADD : EPOLL_CTL_DEL, t->p.listen, &e);
    t->waiting = room;
}

void view_tls_run(view_tls *t)
{
    int64_t now = pvx_now_mono();
    for (unsigned i = 0; i < t->p.connections; i++) {
        struct conn *c = &t->conn[i];
        if (c->session == NULL)
            continue;
        bool late = !c->shaken && now - c->since > t->p.patience_ns;
        t->late += late;
        if (late || (c->ending_ns != 0 && now - c->ending_ns > ENDING_NS) || !pump(t, c))
            tls_drop(t, c);
    }
    tls_take_all(t);
}

int64_t view_tls_due_ns(const view_tls *t)
{
    int64_t due = INT64_MAX;
    for (unsigned i = 0; i < t->p.connections; i++) {
        const struct conn *c = &t->conn[i];
        int64_t at = c->session == NULL  ? INT64_MAX
                     : !c->shaken        ? c->since + t->p.patience_ns
                     : c->ending_ns != 0 ? c->ending_ns + ENDING_NS
                                         : INT64_MAX;
        due = at < due ? at : due;
    }
    return due;
}

pvx_err view_tls_new(const struct view_tls_params *p, view_tls **out, struct pvx_diag *d)
{
    view_tls *t = *out = pvx_calloc(1, sizeof *t);
    if (t == NULL) {
        close(p->listen);
        return PVX_ENOMEM;
    }
    t->p = *p;
    t->epoll = epoll_create1(EPOLL_CLOEXEC);
    t->conn = pvx_calloc(p->connections, sizeof *t->conn);
    pvx_err e = t->conn == NULL ? PVX_ENOMEM : t->epoll < 0 ? PVX_EIO : PVX_OK;
    PVX_THEN(e, read_papers(t, d));
    /* NORMAL alone lets versions in that RFC 8996 forbids */
    if (e == PVX_OK &&
        gnutls_priority_init(&t->priority, "NORMAL:-VERS-TLS1.0:-VERS-TLS1.1:-VERS-DTLS-ALL",
                             NULL) != 0)
        e = pvx_fail(d, PVX_EIO, "GnuTLS has no TLS 1.2 or later");
    if (e != PVX_OK)
        view_tls_free(out);
    else
        tls_take_all(t);
    return e;
}

void view_tls_free(view_tls **t)
{
    if (*t == NULL)
        return;
    for (unsigned i = 0; (*t)->conn != NULL && i < (*t)->p.connections; i++)
        if ((*t)->conn[i].session != NULL)
            tls_drop(*t, &(*t)->conn[i]);
    close((*t)->p.listen);
    if ((*t)->epoll >= 0)
        close((*t)->epoll);
    if ((*t)->priority != NULL)
        gnutls_priority_deinit((*t)->priority);
    tls_leave((*t)->with);
    free((*t)->conn);
    PVX_FREE(*t);
}

int view_tls_fd(const view_tls *t)
{
    return t->epoll;
}

bool view_tls_here(const view_tls *t, int fd, struct sockaddr_storage *out)
{
    for (unsigned i = 0; i < t->p.connections; i++)
        if (t->conn[i].session != NULL && t->conn[i].shaken && t->conn[i].its == fd) {
            *out = t->conn[i].here;
            return true;
        }
    return false;
}

uint64_t view_tls_late(const view_tls *t)
{
    return t->late;
}
