/* Action commands: the bytes that the GigE Vision document gives, and answers over real sockets. */
#include "../t.h"

#include <arpa/inet.h>
#include <poll.h>
#include <stdbool.h>
#include <sys/socket.h>
#include <unistd.h>

#include "capture/wire/action.h"
#include "capture/wire/gvcp.h"
#include "tests/lib/patience.h"

static const struct cap_action_keys keys = {0x01020304, 0xA1B2C3D4, 0x00000081};

T_CASE(bytes_of_a_command)
{
    static const uint8_t want[20] = {0x42, 0x01, 0x01, 0x00, 0,    12,   0x12, 0x34, 1, 2,
                                     3,    4,    0xA1, 0xB2, 0xC3, 0xD4, 0,    0,    0, 0x81};
    uint8_t got[CAP_ACTION_BYTES];
    T_EQ_I(cap_action_encode(&keys, 0x1234, 0, true, got), 20);
    T_OK(memcmp(got, want, 20) == 0);
    T_EQ_I(cap_action_encode(&keys, 0x1234, 0, false, got), 20);
    T_EQ_I(got[1], 0);
}

T_CASE(bytes_of_a_scheduled_command)
{
    static const uint8_t want[28] = {0x42, 0x81, 0x01, 0x00, 0,    20,   0,    7,   1, 2,
                                     3,    4,    0xA1, 0xB2, 0xC3, 0xD4, 0,    0,   0, 0x81,
                                     0x18, 0x7A, 0x0C, 0xD2, 0x5F, 0x91, 0xE2, 0x03};
    uint8_t got[CAP_ACTION_BYTES];
    T_EQ_I(cap_action_encode(&keys, 7, 0x187A0CD25F91E203LL, true, got), 28);
    T_OK(memcmp(got, want, 28) == 0);
    T_EQ_I(cap_action_encode(&keys, 7, 1, false, got), 28);
    T_EQ_I(got[1], 0x80);
}

T_CASE(answers_are_read_strictly)
{
    static const uint8_t ok[8] = {0, 0, 0x01, 0x01, 0, 0, 0x12, 0x34};
    struct cap_action_ack a;
    T_OK(cap_action_decode(ok, 8, &a));
    T_EQ_I(a.status, 0);
    T_EQ_I(a.number, 0x1234);
    for (size_t n = 0; n < 8; n++)
        T_OK(!cap_action_decode(ok, n, &a));
    uint8_t p[8];
    memcpy(p, ok, 8);
    p[0] = 0x80;
    p[1] = 0x16;
    T_OK(cap_action_decode(p, 8, &a));
    T_EQ_I(a.status, CAP_GVCP_ACTION_LATE);
    p[3] = 0x03; /* answers to other commands */
    T_OK(!cap_action_decode(p, 8, &a));
    memcpy(p, ok, 8);
    p[6] = p[7] = 0; /* number 0 is never sent */
    T_OK(!cap_action_decode(p, 8, &a));
}

/* A camera's side, on the loopback network: what came and from where. */
static int listener(const char *address)
{
    int on = 1, fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)};
    inet_pton(AF_INET, address, &sa.sin_addr);
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(fd, (const struct sockaddr *)&sa, sizeof sa) == 0)
        return fd;
    close(fd);
    return -1;
}

T_CASE(a_command_and_its_answer)
{
    int fd = listener("127.0.0.93");
    if (fd < 0)
        T_SKIP("UDP port 3956 of 127.0.0.93 is taken");
    cap_action_sender *s = NULL;
    struct pvx_diag d = {""};
    uint8_t p[CAP_ACTION_BYTES], got[64];
    T_EQ_I(cap_action_sender_new(&s, &d), PVX_OK);
    size_t n = cap_action_encode(&keys, 99, 0, true, p);
    T_EQ_I(cap_action_send(s, 0x7F00005D, p, n), PVX_OK);
    struct sockaddr_in from;
    socklen_t len = sizeof from;
    T_EQ_I(recvfrom(fd, got, sizeof got, 0, (struct sockaddr *)&from, &len), n);
    T_OK(memcmp(got, p, n) == 0);
    uint32_t who = 0;
    struct cap_action_ack a = {0, 0};
    T_OK(!cap_action_answer(s, &who, &a));
    static const uint8_t noise[3] = {1, 2, 3}, ack[8] = {0x80, 0x13, 1, 1, 0, 0, 0, 99};
    sendto(fd, noise, sizeof noise, 0, (const struct sockaddr *)&from, len);
    sendto(fd, ack, sizeof ack, 0, (const struct sockaddr *)&from, len);
    struct pollfd pfd = {.fd = cap_action_sender_fd(s), .events = POLLIN};
    T_EQ_I(poll(&pfd, 1, PATIENCE_NS / PVX_NS_PER_MS), 1);
    T_OK(cap_action_answer(s, &who, &a)); /* the noise is passed over */
    T_EQ_I(who, 0x7F00005D);
    T_EQ_I(a.status, CAP_GVCP_NO_REFERENCE_TIME);
    T_EQ_I(a.number, 99);
    T_OK(!cap_action_answer(s, &who, &a));
    cap_action_sender_free(&s);
    T_OK(s == NULL);
    close(fd);
}
