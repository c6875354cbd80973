#include "daemon/control/metrics.h"

#include <errno.h>
#include <microhttpd.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/mem.h"

struct dmn_metrics {
    struct MHD_Daemon *http;
    bool (*state)(void *ctx, struct dmn_state *out);
    void *ctx;
    bool humble;          /* the thread has the lowest priority */
    struct dmn_state now; /* the thread's */
};

static enum MHD_Result send_text(struct MHD_Connection *to, unsigned code, const char *text,
                                 enum MHD_ResponseMemoryMode mode)
{
    struct MHD_Response *r = MHD_create_response_from_buffer(strlen(text), (void *)text, mode);
    if (r == NULL)
        return MHD_NO;
    MHD_add_response_header(r, "Content-Type", "text/plain; version=0.0.4; charset=utf-8");
    if (code == MHD_HTTP_METHOD_NOT_ALLOWED)
        MHD_add_response_header(r, "Allow", "GET");
    enum MHD_Result ok = MHD_queue_response(to, code, r);
    MHD_destroy_response(r);
    return ok;
}

/* NOLINTNEXTLINE(readability-function-size): libmicrohttpd says what it is given */
static enum MHD_Result metrics_answer(void *ctx, struct MHD_Connection *to, const char *url,
                                      const char *method, const char *version, const char *body,
                                      size_t *body_size, void **own)
{
    struct dmn_metrics *m = ctx;
    (void)version;
    (void)body;
    (void)own;
    *body_size = 0;
    if (!m->humble)
        m->humble = setpriority(PRIO_PROCESS, (id_t)gettid(), 19) == 0;
    if (strcmp(method, "GET") != 0)
        return send_text(to, MHD_HTTP_METHOD_NOT_ALLOWED, "GET only\n", MHD_RESPMEM_PERSISTENT);
    if (strcmp(url, "/metrics") != 0)
        return send_text(to, MHD_HTTP_NOT_FOUND, "only /metrics is here\n", MHD_RESPMEM_PERSISTENT);
    if (!m->state(m->ctx, &m->now))
        return send_text(to, MHD_HTTP_SERVICE_UNAVAILABLE, "the daemon is still starting\n",
                         MHD_RESPMEM_PERSISTENT);
    char *text = dmn_metrics_text(&m->now);
    return text != NULL ? send_text(to, MHD_HTTP_OK, text, MHD_RESPMEM_MUST_FREE) : MHD_NO;
}

static bool metrics_is_loopback(const struct sockaddr *a)
{
    if (a->sa_family == AF_INET6)
        return IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)(const void *)a)->sin6_addr);
    return ntohl(((const struct sockaddr_in *)(const void *)a)->sin_addr.s_addr) >> 24 == 127;
}

/* ADDRESS:PORT, [ADDRESS]:PORT; localhost is 127.0.0.1, and no other name is looked up. */
static pvx_err resolve(const char *endpoint, struct addrinfo **out, struct pvx_diag *d)
{
    char host[DMN_WORD_MAX];
    const struct addrinfo want = {.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV,
                                  .ai_socktype = SOCK_STREAM};
    snprintf(host, sizeof host, "%s", endpoint);
    char *port = strrchr(host, ':');
    const char *at = host;
    if (port != NULL && port > host) {
        *port++ = '\0';
        if (*at == '[' && port[-2] == ']') {
            port[-2] = '\0';
            at++;
        }
        if (strcmp(at, "localhost") == 0)
            at = "127.0.0.1";
        if (*port != '\0' && getaddrinfo(at, port, &want, out) == 0)
            return PVX_OK;
    }
    return pvx_fail(d, PVX_EINVAL,
                    "metrics.endpoint: '%s' should be an address and a port, as 127.0.0.1:9464",
                    endpoint);
}

static pvx_err metrics_listen_at(const char *endpoint, const struct addrinfo *a, int *fd,
                                 struct pvx_diag *d)
{
    int on = 1;
    *fd = socket(a->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (*fd < 0)
        return pvx_fail(d, PVX_EIO, "metrics.endpoint: %s", strerror(errno));
    setsockopt(*fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(*fd, a->ai_addr, a->ai_addrlen) == 0 && listen(*fd, 32) == 0)
        return PVX_OK;
    int why = errno;
    close(*fd);
    *fd = -1;
    return why == EADDRINUSE
               ? pvx_fail(d, PVX_EBUSY,
                          "metrics.endpoint: %s is in use; another daemon? give each a port of its "
                          "own",
                          endpoint)
               : pvx_fail(d, PVX_EIO, "metrics.endpoint: %s: %s", endpoint, strerror(why));
}

pvx_err dmn_metrics_new(const char *endpoint, bool insecure,
                        bool (*state)(void *ctx, struct dmn_state *out), void *ctx,
                        dmn_metrics **out, struct pvx_diag *d)
{
    struct addrinfo *a = NULL;
    int fd = -1;
    *out = NULL;
    PVX_TRY(resolve(endpoint, &a, d));
    pvx_err e = insecure || metrics_is_loopback(a->ai_addr)
                    ? metrics_listen_at(endpoint, a, &fd, d)
                    : pvx_fail(d, PVX_EINVAL,
                               "metrics.endpoint: other hosts reach %s, and nothing guards it: use "
                               "127.0.0.1 and ssh -L, or say insecure: true",
                               endpoint);
    freeaddrinfo(a);
    PVX_TRY(e);
    dmn_metrics *m = pvx_calloc(1, sizeof *m);
    if (m != NULL) {
        m->state = state;
        m->ctx = ctx;
        m->http =
            MHD_start_daemon(MHD_USE_INTERNAL_POLLING_THREAD, 0, NULL, NULL, metrics_answer, m,
                             MHD_OPTION_LISTEN_SOCKET, fd, MHD_OPTION_CONNECTION_LIMIT,
                             (unsigned)DMN_METRICS_CLIENTS, MHD_OPTION_CONNECTION_TIMEOUT,
                             (unsigned)DMN_METRICS_PATIENCE_S, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
                             (size_t)8192, MHD_OPTION_END);
    }
    if (m == NULL || m->http == NULL) {
        close(fd);
        free(m);
        return pvx_fail(d, PVX_EIO, "metrics.endpoint: no thread to be had");
    }
    *out = m;
    return PVX_OK;
}

void dmn_metrics_free(dmn_metrics **m)
{
    if (*m == NULL)
        return;
    MHD_stop_daemon((*m)->http); /* and closes its socket */
    PVX_FREE(*m);
}
