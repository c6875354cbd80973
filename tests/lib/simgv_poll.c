#include "tests/lib/simgv_poll.h"

#include <arpa/inet.h>
#include <glib.h>
#include <poll.h>
#include <pthread.h>
#include <stdbool.h>
#include <sys/socket.h>
#include <time.h>

#include "base/clock.h"

#define GVCP_PORT 3956
#define CLAMP_MS  100 /* the fake's longest wait, and what the wrapped timeout becomes */

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct simgv_pacer *pacers;

void simgv_poll_add(struct simgv_pacer *p)
{
    pthread_mutex_lock(&lock);
    p->next = pacers;
    pacers = p;
    pthread_mutex_unlock(&lock);
}

void simgv_poll_remove(struct simgv_pacer *p)
{
    pthread_mutex_lock(&lock);
    for (struct simgv_pacer **at = &pacers; *at != NULL; at = &(*at)->next)
        if (*at == p) {
            *at = p->next;
            break;
        }
    pthread_mutex_unlock(&lock);
}

/* Asked once per thread: a camera's thread polls its own control socket first. */
static struct simgv_pacer *pacer_of_socket(int fd)
{
    struct sockaddr_in sa = {0};
    socklen_t len = sizeof sa;
    if (getsockname(fd, (struct sockaddr *)&sa, &len) != 0 || sa.sin_family != AF_INET ||
        sa.sin_port != htons(GVCP_PORT))
        return NULL;
    pthread_mutex_lock(&lock);
    struct simgv_pacer *p = pacers;
    while (p != NULL && p->address_be != sa.sin_addr.s_addr)
        p = p->next;
    pthread_mutex_unlock(&lock);
    return p;
}

/* How long to wait, ns, when the fake camera asked for `asked` ms.  Its deadline is a multiple of
 * the period, either the one ahead or one that has just passed. */
static int64_t wait_ns(int64_t period_us, int asked)
{
    int64_t since_us = pvx_now_real() / 1000 % period_us;
    int64_t left_us = period_us - since_us;
    int64_t honest_ms = left_us / 1000 < CLAMP_MS ? left_us / 1000 : CLAMP_MS;
    if (asked >= CLAMP_MS && honest_ms < CLAMP_MS - 1)
        return 0; /* wrapped: the frame is due now */
    if (asked >= CLAMP_MS && since_us < 10000)
        return 2 * PVX_NS_PER_MS; /* long period just after a tick: cannot tell, look again soon */
    if (left_us > 1000 * CLAMP_MS)
        left_us = 1000 * CLAMP_MS;
    if (asked == 0 && honest_ms > 0)
        return 0;
    return left_us * 1000;
}

gint g_poll(GPollFD *fds, guint n, gint timeout)
{
    static _Thread_local struct {
        bool asked;
        struct simgv_pacer *pacer;
    } self;
    if (!self.asked && n > 0) {
        self.asked = true;
        self.pacer = pacer_of_socket(fds[0].fd);
    }
    int64_t period_us = self.pacer != NULL ? self.pacer->period_us(self.pacer->ctx) : 0;
    if (period_us <= 0 || timeout < 0)
        return poll((struct pollfd *)fds, n, timeout);
    int64_t ns = wait_ns(period_us, timeout);
    struct timespec ts = {.tv_sec = ns / PVX_NS_PER_S, .tv_nsec = ns % PVX_NS_PER_S};
    return ppoll((struct pollfd *)fds, n, &ts, NULL);
}
