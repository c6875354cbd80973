#include "daemon/view/http.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/view/files.h"
#include "daemon/view/tls.h"

#define UNSENT_BYTES 16384 /* beyond what is under way the kernel takes no more */
#define GONE_MS      30000 /* after so long without an acknowledgement the other end is gone */

/* A connection that has not yet made its request. */
struct waiting {
    struct MHD_Connection *c;
    int64_t since;
};
struct view_http {
    struct view_http_params p;
    struct MHD_Daemon *mhd;
    view_tls *tls; /* NULL: none */
    struct waiting waiting[VIEW_HTTP_CLIENTS + 1];
    char at[64];
    struct view_http_stats stats;
};

static const char no_policy[] = "default-src 'none'; script-src 'self'; worker-src 'self'; "
                                "style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
                                "frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

static enum MHD_Result http_queue(struct MHD_Connection *c, unsigned code, struct MHD_Response *r,
                                  const char *type)
{
    static const char *const headers[][2] = {{"Content-Security-Policy", no_policy},
                                             {"X-Content-Type-Options", "nosniff"},
                                             {"Referrer-Policy", "no-referrer"},
                                             {"Cross-Origin-Opener-Policy", "same-origin"},
                                             {"Cross-Origin-Resource-Policy", "same-origin"},
                                             {"Cache-Control", "no-store"},
                                             {"Connection", "close"}};
    if (r == NULL)
        return MHD_NO;
    for (size_t i = 0; i < sizeof headers / sizeof headers[0]; i++)
        MHD_add_response_header(r, headers[i][0], headers[i][1]);
    MHD_add_response_header(r, "Content-Type", type);
    if (code == MHD_HTTP_METHOD_NOT_ALLOWED)
        MHD_add_response_header(r, "Allow", "GET, HEAD");
    enum MHD_Result ok = MHD_queue_response(c, code, r);
    MHD_destroy_response(r);
    return ok;
}

static enum MHD_Result http_say(struct MHD_Connection *c, unsigned code, const char *text)
{
    return http_queue(
        c, code,
        MHD_create_response_from_buffer(strlen(text), (void *)text, MHD_RESPMEM_PERSISTENT),
        "text/plain; charset=utf-8");
}

static const char *header(struct MHD_Connection *c, const char *name)
{
    return MHD_lookup_connection_value(c, MHD_HEADER_KIND, name);
}

static int socket_of(struct MHD_Connection *c)
{
    const union MHD_ConnectionInfo *i =
        MHD_get_connection_info(c, MHD_CONNECTION_INFO_CONNECTION_FD);
    return i != NULL ? i->connect_fd : -1;
}

/* `word` among the comma-separated words of a header. */
static bool has_word(const char *list, const char *word)
{
    size_t n = strlen(word);
    for (const char *p = list; p != NULL && *p != '\0'; p += strcspn(p, ",")) {
        p += strspn(p, ", \t");
        size_t len = strcspn(p, ", \t");
        if (len == n && strncasecmp(p, word, n) == 0)
            return true;
    }
    return false;
}

/* RFC 6455, 4.2.2: base64 of the SHA-1 of the key and a constant. */
static bool accept_key(const char *key, char out[32])
{
    char text[80];
    uint8_t sum[20];
    gnutls_datum_t plain = {sum, sizeof sum}, coded = {0};
    if (key == NULL || strlen(key) != 24)
        return false;
    snprintf(text, sizeof text, "%s258EAFA5-E914-47DA-95CA-C5AB0DC85B11", key);
    if (gnutls_hash_fast(GNUTLS_DIG_SHA1, text, strlen(text), sum) != 0 ||
        gnutls_base64_encode2(&plain, &coded) != 0)
        return false;
    snprintf(out, 32, "%.*s", (int)coded.size, (const char *)coded.data);
    gnutls_free(coded.data);
    return true;
}

/* NOLINTNEXTLINE(readability-function-size): libmicrohttpd says what it is given */
static void http_upgraded(void *cls, struct MHD_Connection *c, void *con_cls, const char *extra,
                          size_t n_extra, MHD_socket fd, struct MHD_UpgradeResponseHandle *urh)
{
    struct view_http *h = cls;
    (void)c;
    (void)con_cls;
    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
    h->p.upgraded(h->p.ctx, fd, urh, extra, n_extra);
}

static enum MHD_Result http_up(struct view_http *h, struct MHD_Connection *c)
{
    char key[32];
    const char *upgrade = header(c, "Upgrade"), *version = header(c, "Sec-WebSocket-Version");
    if (upgrade == NULL || !has_word(upgrade, "websocket"))
        return http_say(c, MHD_HTTP_UPGRADE_REQUIRED, "a WebSocket is here: PROTOCOL.md\n");
    if (version == NULL || strcmp(version, "13") != 0 ||
        !has_word(header(c, "Sec-WebSocket-Protocol"), VIEW_SUBPROTOCOL) ||
        !accept_key(header(c, "Sec-WebSocket-Key"), key))
        return http_say(c, MHD_HTTP_BAD_REQUEST,
                        "a WebSocket of version 13 and subprotocol " VIEW_SUBPROTOCOL " is here\n");
    struct MHD_Response *r = MHD_create_response_for_upgrade(http_upgraded, h);
    if (r == NULL)
        return MHD_NO;
    MHD_add_response_header(r, "Upgrade", "websocket");
    MHD_add_response_header(r, "Sec-WebSocket-Accept", key);
    MHD_add_response_header(r, "Sec-WebSocket-Protocol", VIEW_SUBPROTOCOL);
    enum MHD_Result ok = MHD_queue_response(c, MHD_HTTP_SWITCHING_PROTOCOLS, r);
    MHD_destroy_response(r);
    return ok;
}

static void served(struct view_http *h, struct MHD_Connection *c)
{
    for (size_t i = 0; i <= VIEW_HTTP_CLIENTS; i++)
        if (h->waiting[i].c == c)
            h->waiting[i].c = NULL;
}

/* The address that a connection came to. */
static bool here(const struct view_http *h, struct MHD_Connection *c, struct sockaddr_storage *out)
{
    socklen_t len = sizeof *out;
    memset(out, 0, sizeof *out);
    return h->tls != NULL ? view_tls_here(h->tls, socket_of(c), out)
                          : getsockname(socket_of(c), (struct sockaddr *)out, &len) == 0;
}

/* NOLINTNEXTLINE(readability-function-size): libmicrohttpd says what it is given */
static enum MHD_Result http_answer(void *ctx, struct MHD_Connection *c, const char *url,
                                   const char *method, const char *version, const char *body,
                                   size_t *body_size, void **own)
{
    struct view_http *h = ctx;
    struct sockaddr_storage to;
    (void)version;
    (void)body;
    (void)own;
    *body_size = 0;
    served(h, c);
    h->stats.requests++;
    const char *host = header(c, "Host");
    if (!here(h, c, &to) || !view_gate_host(h->p.gate, host, &to)) {
        h->stats.refused_host++;
        return http_say(c, MHD_HTTP_MISDIRECTED_REQUEST,
                        "this address is not known by that name: pyrovox view --host NAME\n");
    }
    if (!view_gate_origin(h->p.gate, header(c, "Origin"), host)) {
        h->stats.refused_origin++;
        return http_say(c, MHD_HTTP_FORBIDDEN, "another site's page may not come here\n");
    }
    if (strcmp(method, "GET") != 0 && strcmp(method, "HEAD") != 0)
        return http_say(c, MHD_HTTP_METHOD_NOT_ALLOWED, "GET only\n");
    if (strcmp(url, VIEW_PATH) == 0)
        return http_up(h, c);
    const struct view_file *f = view_file_find(url);
    if (f == NULL)
        return http_say(c, MHD_HTTP_NOT_FOUND, "nothing is here\n");
    return http_queue(c, MHD_HTTP_OK,
                      MHD_create_response_from_buffer((size_t)(f->end - f->begin), (void *)f->begin,
                                                      MHD_RESPMEM_PERSISTENT),
                      f->type);
}

/* Set the options of a TCP connection. */
static void http_prepare(int fd)
{
    int on = 1, unsent = UNSENT_BYTES, gone = GONE_MS;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
    setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &gone, sizeof gone);
    setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
}

static void connection(void *ctx, struct MHD_Connection *c, void **own,
                       enum MHD_ConnectionNotificationCode what)
{
    struct view_http *h = ctx;
    (void)own;
    served(h, c);
    if (what != MHD_CONNECTION_NOTIFY_STARTED)
        return;
    if (h->tls == NULL)
        http_prepare(socket_of(c));
    for (size_t i = 0; i <= VIEW_HTTP_CLIENTS; i++)
        if (h->waiting[i].c == NULL) {
            h->waiting[i] = (struct waiting){c, pvx_now_mono()};
            return;
        }
}

static pvx_err http_listen_at(struct view_http *h, int *fd, struct pvx_diag *d)
{
    struct sockaddr_storage a;
    socklen_t len;
    int on = 1;
    PVX_TRY(view_gate_address(h->p.listen, &a, &len, d));
    if (h->p.cert == NULL && !view_gate_loopback(&a))
        return pvx_fail(d, PVX_EINVAL,
                        "--listen %s: other hosts reach it, so it takes --cert and --cert-key; or "
                        "listen on 127.0.0.1 and use ssh -L",
                        h->p.listen);
    *fd = socket(a.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (*fd < 0)
        return pvx_fail(d, PVX_EIO, "--listen %s: %s", h->p.listen, strerror(errno));
    setsockopt(*fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (a.ss_family == AF_INET6)
        setsockopt(*fd, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on);
    if (bind(*fd, (struct sockaddr *)&a, len) == 0 && listen(*fd, 32) == 0) {
        char host[INET6_ADDRSTRLEN] = "";
        len = sizeof a;
        getsockname(*fd, (struct sockaddr *)&a, &len);
        const struct sockaddr_in *four = (void *)&a;
        const struct sockaddr_in6 *six = (void *)&a;
        bool is6 = a.ss_family == AF_INET6;
        inet_ntop(a.ss_family, is6 ? (const void *)&six->sin6_addr : &four->sin_addr, host,
                  sizeof host);
        snprintf(h->at, sizeof h->at, is6 ? "[%s]:%u" : "%s:%u", host,
                 ntohs(is6 ? six->sin6_port : four->sin_port));
        return PVX_OK;
    }
    int why = errno;
    close(*fd);
    *fd = -1;
    return why == EADDRINUSE
               ? pvx_fail(d, PVX_EBUSY,
                          "--listen %s is in use, by another `pyrovox view`? give each a port of "
                          "its own",
                          h->p.listen)
               : pvx_fail(d, pvx_err_from_errno(why), "--listen %s: %s", h->p.listen,
                          strerror(why));
}

static bool come(void *ctx, int fd, const struct sockaddr *from, socklen_t len)
{
    struct view_http *h = ctx;
    return MHD_add_connection(h->mhd, fd, from, len) == MHD_YES;
}

/* It owns fd, on error too. */
static pvx_err http_start(struct view_http *h, int fd, struct pvx_diag *d)
{
    bool tls = h->p.cert != NULL;
    struct MHD_OptionItem listen[] = {{MHD_OPTION_LISTEN_SOCKET, fd, NULL},
                                      {MHD_OPTION_END, 0, NULL}};
    h->mhd = MHD_start_daemon(
        MHD_USE_EPOLL | MHD_ALLOW_UPGRADE | (tls ? MHD_USE_NO_LISTEN_SOCKET : 0), 0, NULL, NULL,
        http_answer, h, MHD_OPTION_CONNECTION_LIMIT, (unsigned)VIEW_HTTP_CLIENTS,
        MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)(VIEW_HTTP_PATIENCE_NS / PVX_NS_PER_S),
        MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)VIEW_HTTP_HEADERS, MHD_OPTION_NOTIFY_CONNECTION,
        connection, h, MHD_OPTION_ARRAY, tls ? listen + 1 : listen, MHD_OPTION_END);
    if (h->mhd == NULL) {
        close(fd);
        return pvx_fail(d, PVX_EIO, "--listen %s: no HTTP server to be had", h->p.listen);
    }
    const struct view_tls_params p = {.listen = fd,
                                      .cert = h->p.cert,
                                      .key = h->p.key,
                                      .connections = VIEW_HTTP_CLIENTS,
                                      .patience_ns = VIEW_HTTP_PATIENCE_NS,
                                      .prepare = http_prepare,
                                      .come = come,
                                      .ctx = h,
                                      .say = h->p.say};
    return tls ? view_tls_new(&p, &h->tls, d) : PVX_OK;
}

pvx_err view_http_new(const struct view_http_params *p, view_http **out, struct pvx_diag *d)
{
    int fd = -1;
    struct view_http *h = *out = pvx_calloc(1, sizeof *h);
    PVX_NEED(h);
    h->p = *p;
    pvx_err e = http_listen_at(h, &fd, d);
    PVX_THEN(e, http_start(h, fd, d));
    if (e != PVX_OK)
        view_http_free(out);
    return e;
}

void view_http_free(view_http **h)
{
    if (*h == NULL)
        return;
    if ((*h)->mhd != NULL)
        MHD_stop_daemon((*h)->mhd);
    view_tls_free(&(*h)->tls);
    PVX_FREE(*h);
}

const char *view_http_at(const view_http *h)
{
    return h->at;
}

int view_http_fds(const view_http *h, struct pollfd out[VIEW_HTTP_FDS])
{
    const union MHD_DaemonInfo *i = MHD_get_daemon_info(h->mhd, MHD_DAEMON_INFO_EPOLL_FD);
    int n = 0;
    if (i != NULL)
        out[n++] = (struct pollfd){.fd = i->epoll_fd, .events = POLLIN};
    if (h->tls != NULL)
        out[n++] = (struct pollfd){.fd = view_tls_fd(h->tls), .events = POLLIN};
    return n;
}

int64_t view_http_due_ns(const view_http *h)
{
    MHD_UNSIGNED_LONG_LONG ms;
    int64_t due = h->tls != NULL ? view_tls_due_ns(h->tls) : INT64_MAX;
    if (MHD_get_timeout(h->mhd, &ms) != MHD_YES)
        return due;
    int64_t its = pvx_now_mono() + (int64_t)(ms < 1000 ? ms : 1000) * PVX_NS_PER_MS;
    return its < due ? its : due;
}

void view_http_run(view_http *h)
{
    if (h->tls != NULL)
        view_tls_run(h->tls);
    MHD_run(h->mhd);
    int64_t now = pvx_now_mono();
    for (size_t i = 0; i <= VIEW_HTTP_CLIENTS; i++)
        if (h->waiting[i].c != NULL && now - h->waiting[i].since > VIEW_HTTP_PATIENCE_NS) {
            /* libmicrohttpd's own limit starts again with every byte */
            shutdown(socket_of(h->waiting[i].c), SHUT_RDWR);
            h->waiting[i].c = NULL;
            h->stats.late++;
        }
}

void view_http_drop(void *handle)
{
    MHD_upgrade_action(handle, MHD_UPGRADE_ACTION_CLOSE);
}

void view_http_stats(const view_http *h, struct view_http_stats *out)
{
    *out = h->stats;
    out->late += h->tls != NULL ? view_tls_late(h->tls) : 0;
}
