#include "proto/attach.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zmq.h>

/* "tcp://HOST:PORT" into HOST and ":PORT".  False: an endpoint of another kind. */
static bool attach_split(const char *endpoint, char *host, size_t size, const char **port)
{
    const char *at = endpoint + strlen("tcp://");
    if (strncmp(endpoint, "tcp://", 6) != 0 || (*port = strrchr(at, ':')) == NULL ||
        (size_t)(*port - at) >= size)
        return false;
    snprintf(host, size, "%.*s", (int)(*port - at), at);
    return true;
}

static bool only_six(const char *name)
{
    struct addrinfo *four = NULL, *six = NULL;
    struct addrinfo want = {.ai_family = AF_INET, .ai_socktype = SOCK_STREAM};
    bool has4 = getaddrinfo(name, NULL, &want, &four) == 0;
    want.ai_family = AF_INET6;
    bool only = !has4 && getaddrinfo(name, NULL, &want, &six) == 0;
    if (four != NULL)
        freeaddrinfo(four);
    if (six != NULL)
        freeaddrinfo(six);
    return only;
}

static void use_six(void *socket, bool six)
{
    int on = six;
    zmq_setsockopt(socket, ZMQ_IPV6, &on, sizeof on);
}

int pvp_connect(void *socket, const char *endpoint)
{
    char host[256];
    const char *port;
    if (attach_split(endpoint, host, sizeof host, &port))
        use_six(socket, strchr(host, ':') != NULL || only_six(host));
    return zmq_connect(socket, endpoint);
}

static bool host_has_six(void)
{
    int fd = socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd >= 0)
        close(fd);
    return fd >= 0;
}

static pvx_err bind_failed(const char *endpoint, bool six, int en, struct pvx_diag *d)
{
    switch (en == ENODEV && six ? EINVAL : en) { /* "[::1]" without a port is no name */
    case EADDRINUSE:
        return pvx_fail(d, PVX_EBUSY,
                        "%s: in use by another program (`ss -ltnp` shows which); stop it or "
                        "configure another endpoint",
                        endpoint);
    case EAFNOSUPPORT:
        return pvx_fail(d, PVX_EINVAL,
                        "%s: IPv6 is switched off on this machine; use an IPv4 address", endpoint);
    case EADDRNOTAVAIL:
        return pvx_fail(d, PVX_EINVAL,
                        "%s: no network interface of this machine has that address; `ip address` "
                        "lists them%s",
                        endpoint, six ? " (none with inet6: IPv6 is switched off)" : "");
    case ENODEV:
        return pvx_fail(d, PVX_EINVAL,
                        "%s: this machine has no interface of that name, and other names are not "
                        "looked up; write an address that `ip address` lists, or localhost",
                        endpoint);
    case EINVAL:
    case EPROTONOSUPPORT:
    case ENOCOMPATPROTO:
    case ENAMETOOLONG:
        return pvx_fail(d, PVX_EINVAL,
                        "%s: not an endpoint; write ipc:///run/pyrovox/volumes or "
                        "tcp://127.0.0.1:5555",
                        endpoint);
    default:
        return pvx_fail(d, pvx_err_from_errno(en), "%s: cannot listen: %s", endpoint,
                        zmq_strerror(en));
    }
}

pvx_err pvp_bind(void *socket, const char *endpoint, struct pvx_diag *d)
{
    char host[256], here[64];
    const char *port, *at = endpoint;
    bool six = false;
    if (attach_split(endpoint, host, sizeof host, &port)) {
        six = strchr(host, ':') != NULL;
        if (six && !host_has_six())
            return bind_failed(endpoint, true, EAFNOSUPPORT, d);
        use_six(socket, six || (strcmp(host, "*") == 0 && host_has_six()));
        if (strcmp(host, "localhost") == 0) {
            snprintf(here, sizeof here, "tcp://127.0.0.1%.32s", port);
            at = here;
        }
    }
    return zmq_bind(socket, at) == 0 ? PVX_OK : bind_failed(endpoint, six, errno, d);
}
