/* Answers to action commands: anything may come in on the port. */
#include <netinet/in.h>
#include <sys/socket.h>

#include "capture/wire/action.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static cap_action_sender *s;
    static struct sockaddr_in at = {.sin_family = AF_INET};
    socklen_t len = sizeof at;
    struct cap_action_ack a, came;
    uint32_t from;
    if (s == NULL) {
        MUST(cap_action_sender_new(&s, NULL) == PVX_OK);
        at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        MUST(bind(cap_action_sender_fd(s), (struct sockaddr *)&at, len) == 0);
        MUST(getsockname(cap_action_sender_fd(s), (struct sockaddr *)&at, &len) == 0);
    }
    bool good = cap_action_decode(data, size, &a);
    MUST(!good || (a.number != 0 && size >= 8));
    ssize_t sent = sendto(cap_action_sender_fd(s), data, size, 0, (struct sockaddr *)&at, len);
    MUST(sent == (ssize_t)size);
    bool answered = cap_action_answer(s, &from, &came);
    MUST(answered == good || size > 64); /* of more it looks at the beginning */
    MUST(!answered || (from == INADDR_LOOPBACK && came.number != 0));
    fuzz_taken += answered;
    return 0;
}
