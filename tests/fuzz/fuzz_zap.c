/* Any frames as a request to the handler of keys: each is answered as ZAP wants it, and only the request of a client of
 * the list is let in.  Input: frames, each after a byte of its length; no more than 9. */
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "base/log.h"
#include "proto/auth.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/fuzz_zmq.h"

/* The list's two: their keys are as good as any. */
static const uint8_t reader[32] = {1, 2, 3}, controller[32] = {4, 5, 6};
static void *socket_to_it;

static void begin(void)
{
    char folder[] = "/tmp/pyrovox-fuzz-zap-XXXXXX", server[64], clients[64], text[256], a[41],
         b[41];
    struct pvp_key_pair k;
    struct pvx_diag d = {""};
    pvp_auth *auth;
    pvp_zap *zap;
    void *zmq = zmq_ctx_new();
    const int patience = 60000;
    pvx_log_set_level(PVX_LOG_ERROR);
    MUST(mkdtemp(folder) != NULL && pvp_key_make(&k, &d) == PVX_OK);
    snprintf(text, sizeof text, "%s/lab", folder);
    MUST(pvp_key_write(text, PVP_ROLE_READ, &k, &d) == PVX_OK);
    snprintf(server, sizeof server, "%s/lab.key", folder);
    snprintf(clients, sizeof clients, "%s/clients.keys", folder);
    MUST(zmq_z85_encode(a, reader, 32) != NULL && zmq_z85_encode(b, controller, 32) != NULL);
    int n = snprintf(text, sizeof text, "anna read %s\nbert control %s\n", a, b);
    MUST(pvx_file_write(clients, text, (size_t)n, &d) == PVX_OK);
    MUST(pvp_auth_new(server, clients, &auth, &d) == PVX_OK);
    unlink(server);
    unlink(clients);
    snprintf(text, sizeof text, "%s/lab.pub", folder);
    unlink(text);
    rmdir(folder);
    MUST(pvp_zap_new(auth, zmq, &zap, &d) == PVX_OK);
    socket_to_it = zmq_socket(zmq, ZMQ_REQ);
    MUST(zmq_setsockopt(socket_to_it, ZMQ_RCVTIMEO, &patience, sizeof patience) == 0);
    MUST(zmq_connect(socket_to_it, "inproc://zeromq.zap.01") == 0);
}

struct part {
    const uint8_t *data;
    size_t len;
};

static int is(struct part p, const void *text, size_t len)
{
    return p.len == len && memcmp(p.data, text, len) == 0;
}

static int may_come_in(const struct part *p, int n)
{
    if (n != 7 || !is(p[0], "1.0", 3) || !is(p[5], "CURVE", 5))
        return 0;
    return (is(p[2], "pyrovox-read", 12) && (is(p[6], reader, 32) || is(p[6], controller, 32))) ||
           (is(p[2], "pyrovox-control", 15) && is(p[6], controller, 32));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct part p[9];
    int n = 0;
    char reply[6][256];
    int len[6];
    if (socket_to_it == NULL)
        begin();
    for (size_t at = 0; at < size && n < 9; n++) {
        size_t l = data[at++];
        p[n] = (struct part){data + at, l < size - at ? l : size - at};
        at += p[n].len;
    }
    if (n == 0)
        return 0;
    for (int i = 0; i < n; i++)
        MUST(zmq_send(socket_to_it, p[i].data, p[i].len, i < n - 1 ? ZMQ_SNDMORE : 0) >= 0);
    for (int i = 0; i < 6; i++) {
        int more;
        size_t s = sizeof more;
        len[i] = fuzz_recv(socket_to_it, reply[i], sizeof reply[i]);
        MUST(len[i] >= 0 && len[i] <= (int)sizeof reply[i]);
        MUST(zmq_getsockopt(socket_to_it, ZMQ_RCVMORE, &more, &s) == 0 && more == (i < 5));
    }
    MUST(len[0] == 3 && memcmp(reply[0], "1.0", 3) == 0);
    MUST(n == 1 || (len[1] == (int)p[1].len && memcmp(reply[1], p[1].data, p[1].len) == 0));
    fuzz_taken += may_come_in(p, n) != 0;
    MUST(len[2] == 3 && memcmp(reply[2], may_come_in(p, n) ? "200" : "400", 3) == 0);
    return 0;
}
