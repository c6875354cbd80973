/* fuzz_zmq.h - for targets that talk to a socket. */
#ifndef TESTS_FUZZ_ZMQ_H
#define TESTS_FUZZ_ZMQ_H
#include <errno.h>
#include <zmq.h>

/* As zmq_recv, whatever signals libFuzzer sends itself meanwhile. */
static inline int fuzz_recv(void *socket, void *out, size_t size)
{
    int n;
    do
        n = zmq_recv(socket, out, size, 0);
    while (n < 0 && errno == EINTR);
    return n;
}
#endif
