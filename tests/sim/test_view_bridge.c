/* A publisher, a bridge and readers of it, each in a thread of its own, over real sockets: for the thread sanitizer, and
 * for what a page is promised whatever the others do. */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/view/bridge.h"
#include "proto/pub.h"
#include "tests/lib/patience.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

enum { N = 24, READERS = 3 };

static atomic_bool done;
static char endpoint[128];
static struct view_gate gate = {.token = "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"};

static bool stop(void *ctx)
{
    (void)ctx;
    return atomic_load(&done);
}

static void *serve(void *bridge)
{
    view_bridge_run(bridge, stop, NULL, NULL);
    return NULL;
}

static void *publish(void *sets)
{
    const struct pvp_grid g = {.n = {N, N, N}, .max = {1, 1, 1}, .channels = 1};
    const struct pvp_start s = {.grid = g, .session = 42, .fps = 100, .units = "1/m"};
    const char *at[] = {endpoint};
    static int32_t index[N * N * N];
    static float value[N * N * N];
    pvp_pub *p;
    T_EQ_I(pvp_pub_new(
               &(struct pvp_pub_params){
                   .endpoints = at, .n_endpoints = 1, .sample = PVP_F16, .comp = PVP_ZSTD},
               &s, &p, NULL),
           PVX_OK);
    for (uint64_t set = 0; !atomic_load(&done); set++) {
        for (int i = 0; i < N * N * N; i++) {
            index[i] = i;
            value[i] = (float)((i + (int)set) % 50);
        }
        const struct pvp_volume v = {
            .session = 42, .set = set, .grid = g, .t_publish_ns = pvx_now_real()};
        if (pvp_pub_volume(p, &v, &(struct pvp_voxels){N * N * N, index, value, 1}, NULL) == PVX_OK)
            atomic_fetch_add((atomic_long *)sets, 1);
        pvp_pub_tick(p);
        pvx_sleep_until_mono(pvx_now_mono() + 5 * PVX_NS_PER_MS);
    }
    (void)!pvp_pub_say(p, PVP_END, "done");
    pvp_pub_free(&p);
    return NULL;
}

struct reader {
    uint16_t port;
    uint32_t pause_ms;
    uint64_t volumes, last;
    bool good;
};

static bool all(int fd, void *to, size_t n)
{
    return recv(fd, to, n, MSG_WAITALL) == (ssize_t)n;
}

static bool say(int fd, const char *text)
{
    uint8_t f[128] = {0x81};
    size_t n = strlen(text);
    f[1] = (uint8_t)(0x80 | n);
    memcpy(f + 6, text, n); /* a mask of zeros */
    return send(fd, f, n + 6, MSG_NOSIGNAL) == (ssize_t)n + 6;
}

/* One message into buf; its length, 0 at the end. */
static size_t message(int fd, uint8_t *buf, size_t room)
{
    uint8_t h[8];
    if (!all(fd, h, 2))
        return 0;
    size_t n = h[1];
    if (n == 126) {
        if (!all(fd, h, 2))
            return 0;
        n = (size_t)h[0] << 8 | h[1];
    } else if (n == 127) {
        if (!all(fd, h, 8))
            return 0;
        n = (size_t)h[4] << 24 | (size_t)h[5] << 16 | (size_t)h[6] << 8 | h[7];
    }
    return n <= room && all(fd, buf, n) ? n : 0;
}

static bool open_up(int fd, uint16_t port)
{
    char text[512];
    struct sockaddr_in a = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int n = snprintf(text, sizeof text,
                     "GET /live HTTP/1.1\r\nHost: 127.0.0.1:%u\r\nConnection: Upgrade\r\nUpgrade: "
                     "websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
                     "dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: pyrovox.1\r\n\r\n",
                     port);
    if (connect(fd, (struct sockaddr *)&a, sizeof a) != 0 || send(fd, text, (size_t)n, 0) != n)
        return false;
    for (n = 0; n < 511 && recv(fd, text + n, 1, 0) == 1;) {
        text[++n] = '\0';
        if (n >= 4 && strcmp(text + n - 4, "\r\n\r\n") == 0)
            /* the answer to this key is RFC 6455's own example */
            return strstr(text, " 101 ") != NULL &&
                   strstr(text, "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=") != NULL;
    }
    return false;
}

static void *read_some(void *ctx)
{
    struct reader *r = ctx;
    static __thread uint8_t buf[1 << 18];
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    r->good = open_up(fd, r->port) &&
              say(fd, "{\"token\":\"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\",\"credits\":1}");
    UNTIL (!r->good || r->volumes >= 40) {
        size_t n = message(fd, buf, sizeof buf);
        struct pvp_header h;
        struct pvp_view v;
        if (n == 0) {
            r->good = false;
        } else if (n > 4 && memcmp(buf, "PVX1", 4) == 0 &&
                   pvp_decode_header(buf, n, &h, NULL) == PVX_OK && h.type == PVP_VOLUME) {
            r->good = pvp_decode_volume(buf, n, &v, NULL) == PVX_OK && v.comp != PVP_ZSTD &&
                      (r->volumes == 0 || v.v.set > r->last);
            r->last = v.v.set;
            r->volumes++;
            char text[96];
            pvx_sleep_until_mono(pvx_now_mono() + r->pause_ms * PVX_NS_PER_MS);
            snprintf(text, sizeof text, "{\"held\":%llu,\"drawn\":%llu,\"credits\":1}",
                     (unsigned long long)v.v.set, (unsigned long long)v.v.set);
            r->good = r->good && say(fd, text);
        }
    }
    close(fd);
    return NULL;
}

T_CASE(readers_of_every_speed)
{
    struct pvx_diag d = {""};
    struct view_source source;
    struct view_bridge_stats st;
    view_bridge *b = NULL;
    pthread_t pub, bridge, thread[READERS];
    struct reader r[READERS];
    atomic_long sets = 0;
    scratch_new();
    snprintf(endpoint, sizeof endpoint, "ipc://%s/volumes", dir);
    T_EQ_I(view_live_new(endpoint, NULL, NULL, &source, &d), PVX_OK);
    const struct view_http_params p = {.gate = &gate, .listen = "127.0.0.1:0"};
    T_EQ_I(view_bridge_new(&p, &source, NULL, &b, &d), PVX_OK);
    const unsigned port = (unsigned)atoi(strrchr(view_bridge_at(b), ':') + 1);
    pthread_create(&pub, NULL, publish, &sets);
    pthread_create(&bridge, NULL, serve, b);
    for (int i = 0; i < READERS; i++) {
        r[i] = (struct reader){.port = (uint16_t)port, .pause_ms = 0};
        r[i].pause_ms = i == 2 ? 50 : 0;
        pthread_create(&thread[i], NULL, read_some, &r[i]);
    }
    for (int i = 0; i < READERS; i++) {
        pthread_join(thread[i], NULL);
        T_OK(r[i].good);
        T_EQ_I(r[i].volumes, 40);
    }
    atomic_store(&done, true);
    pthread_join(bridge, NULL);
    pthread_join(pub, NULL);
    view_bridge_stats(b, &st);
    T_EQ_I(st.pages_ever, READERS);
    T_EQ_I(st.refused_token, 0);
    T_EQ_I(st.unreadable, 0);
    view_bridge_free(&b);
    scratch_remove();
}
