/* attach.h: whoever binds an endpoint is found by whoever connects to what means the same. */
#include "proto/attach.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zmq.h>

#include "tests/t.h"

static bool has_six(void)
{
    struct sockaddr_in6 a = {.sin6_family = AF_INET6, .sin6_addr = IN6ADDR_LOOPBACK_INIT};
    int fd = socket(AF_INET6, SOCK_STREAM, 0);
    bool yes = fd >= 0 && bind(fd, (struct sockaddr *)&a, sizeof a) == 0;
    if (fd >= 0)
        close(fd);
    return yes;
}

/* A message goes from a socket that is bound to `host` to one that is connected to `to`. */
static void passes(const char *host, const char *to)
{
    char at[128], text[8] = "";
    size_t size = sizeof at;
    int linger = 0;
    struct pvx_diag d = {""};
    void *zmq = zmq_ctx_new(), *in = zmq_socket(zmq, ZMQ_PULL), *out = zmq_socket(zmq, ZMQ_PUSH);
    zmq_setsockopt(out, ZMQ_LINGER, &linger, sizeof linger);
    snprintf(at, sizeof at, "tcp://%s:*", host);
    T_EQ_I(pvp_bind(in, at, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(zmq_getsockopt(in, ZMQ_LAST_ENDPOINT, at, &size), 0);
    char there[128];
    snprintf(there, sizeof there, "tcp://%s%s", to, strrchr(at, ':'));
    T_EQ_I(pvp_connect(out, there), 0);
    printf("  %s: %s hears %s\n", host, at, there);
    T_EQ_I(zmq_send(out, "hello", 5, 0), 5);
    T_EQ_I(zmq_recv(in, text, sizeof text, 0), 5);
    zmq_close(in);
    zmq_close(out);
    zmq_ctx_term(zmq);
}

T_CASE(ipv4_and_localhost)
{
    passes("127.0.0.1", "127.0.0.1");
    passes("127.0.0.1", "localhost");
    passes("localhost", "127.0.0.1");
    passes("localhost", "localhost");
    passes("lo", "127.0.0.1");
    passes("0.0.0.0", "localhost");
    passes("*", "127.0.0.1");
}

T_CASE(ipv6)
{
    if (!has_six())
        T_SKIP("this host has no ::1");
    passes("[::1]", "[::1]");
    passes("::1", "[::1]");
    passes("[::]", "[::1]");
    passes("[::]", "127.0.0.1"); /* all addresses, of both kinds */
    passes("*", "[::1]");
}

static void bind_refused(const char *endpoint, const char *says)
{
    struct pvx_diag d = {""};
    void *zmq = zmq_ctx_new(), *in = zmq_socket(zmq, ZMQ_PULL);
    T_EQ_I(pvp_bind(in, endpoint, &d), PVX_EINVAL);
    T_CONTAINS(d.text, endpoint);
    T_CONTAINS(d.text, says);
    zmq_close(in);
    zmq_ctx_term(zmq);
}

T_CASE(what_cannot_be_bound_is_said_as_it_is)
{
    bind_refused("tcp://192.0.2.77:5555", "no network interface of this machine has that address");
    bind_refused("tcp://nosuch.example:5555", "no interface of that name, and other names are not");
    bind_refused("tcp://[::1]", "not an endpoint");
    bind_refused("nonsense", "not an endpoint");
    bind_refused("tcp://[2001:db8::77]:5555",
                 has_six() ? "no network interface of this machine has that address"
                           : "IPv6 is switched off");
}
