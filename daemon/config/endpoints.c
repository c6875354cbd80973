#include "daemon/config/endpoints.h"

#include <arpa/inet.h>
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* A socket's path has 107 bytes at most; longer ones are refused by bind with a clear message. */
#define ENDPOINT_MAX 256

static const char *const names[] = {[DMN_VOLUMES] = "volumes", [DMN_CONTROL] = "control"};
static char own_dir[64];
static char service[2][ENDPOINT_MAX]; /* $RUNTIME_DIRECTORY, "" when not under systemd */
static char own[2][ENDPOINT_MAX];
static char installed[2][ENDPOINT_MAX];
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void endpoints_fill(void)
{
    snprintf(own_dir, sizeof own_dir, "/tmp/pyrovox-%lu", (unsigned long)geteuid());
    const char *run = getenv("RUNTIME_DIRECTORY"); /* several are separated by colons */
    int n = run != NULL ? (int)strcspn(run, ":") : 0;
    for (int k = 0; k < 2; k++) {
        if (n > 0 && n < 128 && run[0] == '/')
            snprintf(service[k], ENDPOINT_MAX, "ipc://%.*s/%s", n, run, names[k]);
        snprintf(own[k], ENDPOINT_MAX, "ipc://%s/%s", own_dir, names[k]);
        snprintf(installed[k], ENDPOINT_MAX, "ipc:///run/pyrovox/%s", names[k]);
    }
}

const char *dmn_default_endpoint(enum dmn_endpoint kind)
{
    pthread_once(&once, endpoints_fill);
    return service[kind][0] != '\0' ? service[kind] : own[kind];
}

static int endpoints_is_there(const char *endpoint)
{
    struct stat st;
    return stat(endpoint + strlen("ipc://"), &st) == 0 && S_ISSOCK(st.st_mode);
}

const char *dmn_client_endpoint(enum dmn_endpoint kind)
{
    pthread_once(&once, endpoints_fill);
    if (service[kind][0] != '\0')
        return service[kind];
    if (!endpoints_is_there(own[kind]) && endpoints_is_there(installed[kind]))
        return installed[kind];
    return own[kind];
}

pvx_err dmn_endpoint_prepare(const char *endpoint, struct pvx_diag *d)
{
    pthread_once(&once, endpoints_fill);
    size_t n = strlen(own_dir);
    if (strncmp(endpoint, "ipc://", 6) != 0 || strncmp(endpoint + 6, own_dir, n) != 0 ||
        endpoint[6 + n] != '/')
        return PVX_OK;
    if (mkdir(own_dir, 0700) != 0 && errno != EEXIST)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: cannot create directory: %s", own_dir,
                        strerror(errno));
    /* All users may write to /tmp: another one may have made the folder, or a link to elsewhere, first. */
    struct stat st;
    if (lstat(own_dir, &st) != 0 || !S_ISDIR(st.st_mode) || st.st_uid != geteuid() ||
        (st.st_mode & 022) != 0)
        return pvx_fail(d, PVX_EPERM,
                        "%s: not a directory that only this user can write to; remove it or give "
                        "other endpoints",
                        own_dir);
    return PVX_OK;
}

#define HELP                                                                                      \
    "make keys (pyrovox keygen lab; pyrovox keygen me --server lab.pub), list me.pub in a file, " \
    "and name both as keys.server and keys.clients"

/* The address is parsed, not compared by its beginning: 127.0.0.1.example.org is the name of another host. */
static bool endpoints_is_loopback(const char *host, size_t len)
{
    char text[64];
    struct in_addr four;
    struct in6_addr six;
    if (len >= 2 && host[0] == '[' && host[len - 1] == ']') {
        host++;
        len -= 2;
    }
    if (len >= sizeof text)
        return false;
    snprintf(text, sizeof text, "%.*s", (int)len, host);
    if (inet_pton(AF_INET, text, &four) == 1)
        return ntohl(four.s_addr) >> 24 == 127;
    if (inet_pton(AF_INET6, text, &six) == 1)
        return IN6_IS_ADDR_LOOPBACK(&six);
    return strcmp(text, "localhost") == 0 || strcmp(text, "lo") == 0;
}

enum dmn_reach dmn_endpoint_reach(const char *endpoint)
{
    const char *at = strstr(endpoint, "://");
    if (at == NULL || strncmp(endpoint, "inproc://", 9) == 0)
        return DMN_REACH_FILE; /* no endpoint at all: binding it fails */
    at += 3;
    if (strncmp(endpoint, "ipc://", 6) == 0)
        return at[0] == '@' ? DMN_REACH_HOST : DMN_REACH_FILE;
    const char *port = strrchr(at, ':');
    if (strncmp(endpoint, "tcp://", 6) == 0 && port != NULL &&
        endpoints_is_loopback(at, (size_t)(port - at)))
        return DMN_REACH_HOST;
    return DMN_REACH_NET;
}

bool dmn_endpoint_guarded(const struct dmn_config *c, const char *endpoint, enum dmn_endpoint kind)
{
    bool asks = kind == DMN_CONTROL ? dmn_endpoint_reach(endpoint) != DMN_REACH_FILE
                                    : dmn_endpoint_reach(endpoint) == DMN_REACH_NET;
    return asks && c->key_server[0] != '\0';
}

enum pvp_compress dmn_endpoint_compress(const struct dmn_config *c, const char *endpoint)
{
    enum { AUTO };
    static const enum pvp_compress said[] = {[AUTO] = PVP_RAW, PVP_RAW, PVP_LZ4, PVP_ZSTD};
    bool far = c->compress == AUTO && dmn_endpoint_reach(endpoint) == DMN_REACH_NET;
    return far ? PVP_LZ4 : said[c->compress];
}

enum pvp_compress dmn_endpoints_compress(const struct dmn_config *c)
{
    enum pvp_compress near = dmn_endpoint_compress(c, "");
    for (size_t i = 0; i < c->endpoints.n; i++)
        if (dmn_endpoint_compress(c, c->endpoints.v[i]) != near)
            return dmn_endpoint_compress(c, c->endpoints.v[i]);
    return near;
}

pvx_err dmn_endpoints_allowed(const struct dmn_config *c, const char **open, struct pvx_diag *d)
{
    *open = NULL;
    if ((c->key_server[0] == '\0') != (c->key_clients[0] == '\0'))
        return pvx_fail(d, PVX_EINVAL, "%s: keys.server and keys.clients go together", c->name);
    if (c->key_server[0] != '\0')
        return PVX_OK;
    for (size_t i = 0; i < c->endpoints.n; i++)
        if (dmn_endpoint_reach(c->endpoints.v[i]) == DMN_REACH_NET)
            *open = c->endpoints.v[i];
    const char *which = "endpoints";
    const struct {
        const char *key, *endpoint;
    } others[] = {{"previews", c->previews}, {"temperature", c->temperature}};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (dmn_endpoint_reach(others[i].endpoint) == DMN_REACH_NET) {
            which = others[i].key;
            *open = others[i].endpoint;
        }
    if (*open != NULL && !c->insecure)
        return pvx_fail(d, PVX_EPERM,
                        "%s: publish.%s: %s lets everybody in who reaches it, unencrypted; " HELP
                        ", or publish on tcp://127.0.0.1:PORT and forward that (ssh -L), or say "
                        "'insecure: true' on a network where all are trusted",
                        c->name, which, *open);
    if (dmn_endpoint_reach(c->control) == DMN_REACH_FILE)
        return PVX_OK;
    *open = c->control;
    if (!c->insecure)
        return pvx_fail(
            d, PVX_EPERM,
            "%s: control.endpoint: on %s everybody could stop the daemon and have it "
            "write files; " HELP
            ", or use ipc:// with a path, or say 'insecure: true' where all are trusted",
            c->name, *open);
    return PVX_OK;
}
