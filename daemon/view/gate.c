#include "daemon/view/gate.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

/* HOST or HOST:PORT in its parts; an IPv6 address stands in brackets.  port "" where there is none. */
struct authority {
    char host[256], port[6];
    bool bracketed;
};

static bool gate_digits(const char *s, size_t most)
{
    size_t n = strspn(s, "0123456789");
    return n >= 1 && n <= most && s[n] == '\0';
}

static bool gate_split(const char *text, struct authority *out)
{
    memset(out, 0, sizeof *out);
    out->bracketed = text[0] == '[';
    const char *begin = text + out->bracketed;
    size_t n = out->bracketed ? strcspn(begin, "]") : strcspn(begin, ":");
    const char *rest = begin + n;
    if (n == 0 || n >= sizeof out->host || (out->bracketed && *rest++ != ']'))
        return false;
    memcpy(out->host, begin, n);
    if (*rest == '\0')
        return true;
    if (*rest++ != ':' || !gate_digits(rest, 5))
        return false;
    memcpy(out->port, rest, strlen(rest) + 1);
    return true;
}

/* The host as an address; false: it is a name. */
static bool address(const struct authority *a, struct sockaddr_storage *out)
{
    struct sockaddr_in *four = (void *)out;
    struct sockaddr_in6 *six = (void *)out;
    memset(out, 0, sizeof *out);
    if (a->bracketed) {
        six->sin6_family = AF_INET6;
        return inet_pton(AF_INET6, a->host, &six->sin6_addr) == 1;
    }
    four->sin_family = AF_INET;
    return inet_pton(AF_INET, a->host, &four->sin_addr) == 1;
}

pvx_err view_gate_address(const char *text, struct sockaddr_storage *out, socklen_t *len,
                          struct pvx_diag *d)
{
    struct authority a;
    char whole[300];
    bool local = strncmp(text, "localhost:", 10) == 0;
    snprintf(whole, sizeof whole, "%s%.280s", local || gate_digits(text, 5) ? "127.0.0.1:" : "",
             local ? text + 10 : text);
    unsigned port = 0;
    if (!gate_split(whole, &a) || a.port[0] == '\0' || !address(&a, out) ||
        sscanf(a.port, "%u", &port) != 1 || port > 65535)
        return pvx_fail(d, PVX_EINVAL,
                        "--listen %s: should be an address and a port, as 127.0.0.1:8737 or "
                        "[::1]:8737",
                        text);
    if (out->ss_family == AF_INET6) {
        ((struct sockaddr_in6 *)(void *)out)->sin6_port = htons((uint16_t)port);
        *len = sizeof(struct sockaddr_in6);
    } else {
        ((struct sockaddr_in *)(void *)out)->sin_port = htons((uint16_t)port);
        *len = sizeof(struct sockaddr_in);
    }
    return PVX_OK;
}

pvx_err view_gate_name(const char *text, struct pvx_diag *d)
{
    struct authority a;
    struct sockaddr_storage named;
    if (!gate_split(text, &a) || a.port[0] != '\0' || (a.bracketed && !address(&a, &named)))
        return pvx_fail(d, PVX_EINVAL,
                        "--host %s: should be a name or an address without a port, as lab.example, "
                        "203.0.113.7 or [2001:db8::7]",
                        text);
    return PVX_OK;
}

/* The four bytes of an IPv4 address, also of one mapped into IPv6; NULL: it is none. */
static const uint8_t *as_four(const struct sockaddr_storage *a)
{
    if (a->ss_family == AF_INET)
        return (const uint8_t *)&((const struct sockaddr_in *)(const void *)a)->sin_addr;
    const struct in6_addr *six = &((const struct sockaddr_in6 *)(const void *)a)->sin6_addr;
    return IN6_IS_ADDR_V4MAPPED(six) ? six->s6_addr + 12 : NULL;
}

bool view_gate_loopback(const struct sockaddr_storage *a)
{
    const uint8_t *four = as_four(a);
    if (four != NULL)
        return four[0] == 127;
    return IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)(const void *)a)->sin6_addr);
}

static bool gate_same(const struct sockaddr_storage *a, const struct sockaddr_storage *b)
{
    const uint8_t *fa = as_four(a), *fb = as_four(b);
    if (fa != NULL || fb != NULL)
        return fa != NULL && fb != NULL && memcmp(fa, fb, 4) == 0;
    return memcmp(&((const struct sockaddr_in6 *)(const void *)a)->sin6_addr,
                  &((const struct sockaddr_in6 *)(const void *)b)->sin6_addr, 16) == 0;
}

bool view_gate_host(const struct view_gate *g, const char *host,
                    const struct sockaddr_storage *here)
{
    struct authority a;
    struct sockaddr_storage named;
    if (host == NULL || !gate_split(host, &a))
        return false;
    bool numbers = address(&a, &named);
    if (numbers && gate_same(&named, here))
        return true;
    for (size_t i = 0; i < g->n_hosts; i++) {
        struct authority allowed;
        struct sockaddr_storage its;
        if (!gate_split(g->host[i], &allowed))
            continue;
        if (address(&allowed, &its)
                ? numbers && gate_same(&named, &its)
                : !numbers && !a.bracketed && strcasecmp(a.host, allowed.host) == 0)
            return true;
    }
    return !numbers && !a.bracketed && strcasecmp(a.host, "localhost") == 0 &&
           view_gate_loopback(here);
}

bool view_gate_origin(const struct view_gate *g, const char *origin, const char *host)
{
    const char *scheme = g->tls ? "https://" : "http://", *usual = g->tls ? "443" : "80";
    struct authority from, to;
    if (origin == NULL)
        return true;
    if (strncmp(origin, scheme, strlen(scheme)) != 0 || host == NULL ||
        !gate_split(origin + strlen(scheme), &from) || !gate_split(host, &to))
        return false;
    const char *port = from.port[0] != '\0' ? from.port : usual;
    return from.bracketed == to.bracketed && strcasecmp(from.host, to.host) == 0 &&
           strcmp(port, to.port[0] != '\0' ? to.port : usual) == 0;
}

bool view_gate_token(const struct view_gate *g, const char *token)
{
    return strlen(token) == VIEW_TOKEN_DIGITS &&
           gnutls_memcmp(token, g->token, VIEW_TOKEN_DIGITS) == 0;
}

pvx_err view_gate_make_token(char out[VIEW_TOKEN_DIGITS + 1], struct pvx_diag *d)
{
    uint8_t bytes[VIEW_TOKEN_DIGITS / 2];
    if (gnutls_rnd(GNUTLS_RND_KEY, bytes, sizeof bytes) != 0)
        return pvx_fail(d, PVX_EIO, "no random numbers to be had for a token");
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(out + 2 * i, 3, "%02x", bytes[i]);
    return PVX_OK;
}

static pvx_err write_token(int fd, const char *path, char out[VIEW_TOKEN_DIGITS + 1],
                           struct pvx_diag *d)
{
    PVX_TRY(view_gate_make_token(out, d));
    if (dprintf(fd, "%s\n", out) == VIEW_TOKEN_DIGITS + 1)
        return PVX_OK;
    unlink(path);
    return pvx_fail(d, PVX_EIO, "%s: the token cannot be written: %s", path, strerror(errno));
}

static pvx_err read_token(int fd, const char *path, char out[VIEW_TOKEN_DIGITS + 1],
                          struct pvx_diag *d)
{
    struct stat st;
    char text[VIEW_TOKEN_DIGITS + 3] = "";
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))
        return pvx_fail(d, PVX_EFORMAT, "%s: not a file", path);
    if ((st.st_mode & 0007) != 0)
        return pvx_fail(d, PVX_EPERM, "%s: others may read the token; chmod o= %s", path, path);
    ssize_t n = read(fd, text, sizeof text - 1);
    if (n < 0)
        return pvx_fail(d, PVX_EIO, "%s: %s", path, strerror(errno));
    text[strcspn(text, "\n")] = '\0';
    if (strlen(text) != VIEW_TOKEN_DIGITS || strspn(text, "0123456789abcdef") != VIEW_TOKEN_DIGITS)
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: not a token of %d digits 0-9 a-f; remove it, and one is made", path,
                        VIEW_TOKEN_DIGITS);
    memcpy(out, text, VIEW_TOKEN_DIGITS + 1);
    return PVX_OK;
}

pvx_err view_gate_read_token(const char *path, char out[VIEW_TOKEN_DIGITS + 1], struct pvx_diag *d)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    bool fresh = fd >= 0;
    if (!fresh && errno == EEXIST)
        fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    pvx_err e = fresh ? write_token(fd, path, out, d) : read_token(fd, path, out, d);
    close(fd);
    return e;
}
