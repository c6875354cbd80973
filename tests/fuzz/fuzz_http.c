/* fuzz_http.c - any bytes as a request to the page's server, over TCP as from a browser: an answer or none, and the way up
 * to a WebSocket or a file only for one that says by which name it came. */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <stdbool.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "daemon/view/http.h"
#include "tests/fuzz/fuzz.h"

static view_http *http;
static struct sockaddr_in to = {.sin_family = AF_INET};

/* What came behind the request is a WebSocket's, and another target's. */
static void upgraded(void *ctx, int fd, void *handle, const void *early, size_t n_early)
{
    volatile uint8_t sum = 0;
    (void)ctx, (void)fd;
    for (size_t i = 0; i < n_early; i++)
        sum = (uint8_t)(sum + ((const uint8_t *)early)[i]);
    view_http_drop(handle);
}

static void begin(void)
{
    static const struct view_gate gate = {.host = {"lab.example", "203.0.113.7"}, .n_hosts = 2};
    const struct view_http_params p = {
        .gate = &gate, .listen = "127.0.0.1:0", .upgraded = upgraded};
    unsigned port;
    MUST(view_http_new(&p, &http, NULL) == PVX_OK);
    MUST(sscanf(view_http_at(http), "127.0.0.1:%u", &port) == 1);
    to.sin_port = htons((uint16_t)port);
    MUST(inet_pton(AF_INET, "127.0.0.1", &to.sin_addr) == 1);
}

/* Until the server closes, or has nothing to say to what it has: it would wait for more.  What fits of the answer. */
static size_t answer(int fd, char *out, size_t size)
{
    char more[65536];
    size_t n = 0;
    for (int idle = 0; idle < 8; idle++) {
        view_http_run(http);
        ssize_t got = recv(fd, more, sizeof more, MSG_DONTWAIT);
        if (got == 0 || (got < 0 && errno != EAGAIN))
            return n;
        if (got > 0)
            idle = 0;
        size_t fits = got < 0 ? 0 : (size_t)got < size - n ? (size_t)got : size - n;
        memcpy(out + n, more, fits);
        n += fits;
    }
    return n;
}

/* A name or an address of it is in there somewhere. */
static bool known(const uint8_t *data, size_t size)
{
    static const char *const names[] = {"127.0.0.1", "203.0.113.7", "lab.example", "localhost",
                                        "ffff:"}; /* an IPv4 address in IPv6's clothes */
    for (size_t i = 0; i + 5 <= size; i++)
        for (size_t k = 0; k < sizeof names / sizeof names[0]; k++) {
            size_t n = strlen(names[k]);
            if (n <= size - i && strncasecmp((const char *)data + i, names[k], n) == 0)
                return true;
        }
    return false;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char head[16] = "";
    const struct linger none = {1, 0}; /* no port waits for what may still come */
    if (http == NULL)
        begin();
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    MUST(fd >= 0 && setsockopt(fd, SOL_SOCKET, SO_LINGER, &none, sizeof none) == 0);
    MUST(connect(fd, (struct sockaddr *)&to, sizeof to) == 0);
    (void)!send(fd, data, size, MSG_NOSIGNAL);
    size_t n = answer(fd, head, sizeof head - 1);
    close(fd);
    view_http_run(http); /* so that it is gone there too */
    MUST(n == 0 || strncmp(head, "HTTP/1.", 7) == 0);
    bool in = strncmp(head + 8, " 200", 4) == 0 || strncmp(head + 8, " 101", 4) == 0;
    MUST(!in || known(data, size));
    fuzz_taken += in;
    return 0;
}
