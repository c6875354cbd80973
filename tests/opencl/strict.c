#include "tests/opencl/strict.h"

#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* That are not released.  A device that is lost keeps what it has. */
#define QUEUES  4096
#define EVENTS  4096
#define KERNELS 65536 /* places: those that meet there are not watched at once */

/* Commands have numbers, from 1 on. */
struct queue {
    cl_command_queue q;
    uint64_t last, flushed;
};
struct event {
    cl_event event;
    cl_command_queue q;
    uint64_t number;
};
struct transfer {
    cl_command_queue q;
    uint64_t number, sum;
    unsigned char *here, *through;
    size_t bytes;
};
static struct {
    pthread_mutex_t lock;
    uint64_t number;
    struct queue queue[QUEUES];
    struct event event[EVENTS];
    struct transfer *transfer;
    size_t transfers, room;
    struct {
        cl_kernel k;
        pthread_t thread;
    } argument[KERNELS];
} now = {.lock = PTHREAD_MUTEX_INITIALIZER};

static void strict_fail(const char *what)
{
    fprintf(stderr, "the shim of OpenCL: %s\n", what);
    _exit(99);
}

static struct queue *queue_of(cl_command_queue q)
{
    size_t i = 0, empty = QUEUES;
    for (; i < QUEUES && now.queue[i].q != q; i++)
        if (now.queue[i].q == NULL && empty == QUEUES)
            empty = i;
    i = i < QUEUES ? i : empty;
    if (i == QUEUES)
        strict_fail("too many queues");
    now.queue[i].q = q;
    return &now.queue[i];
}
/* NULL: it is not there. */
static struct event *event_of(cl_event event)
{
    for (size_t i = 0; i < EVENTS; i++)
        if (now.event[i].event == event)
            return &now.event[i];
    return NULL;
}

static uint64_t sum_of(const unsigned char *from, size_t bytes)
{
    uint64_t sum = bytes;
    for (size_t i = 0; i < bytes; i++)
        sum = sum * 1099511628211U ^ from[i];
    return sum;
}

void strict_enqueued(cl_command_queue q, cl_event event)
{
    pthread_mutex_lock(&now.lock);
    struct event *to = event_of(NULL);
    if (to == NULL)
        strict_fail("too many events");
    *to = (struct event){event, q, ++now.number};
    queue_of(q)->last = now.number;
    pthread_mutex_unlock(&now.lock);
}

void strict_transfer(cl_command_queue q, void *here, void *through, size_t bytes)
{
    pthread_mutex_lock(&now.lock);
    if (now.transfers == now.room) {
        now.room = now.room * 2 + 64;
        now.transfer = realloc(now.transfer, now.room * sizeof *now.transfer);
        if (now.transfer == NULL)
            strict_fail("out of memory");
    }
    now.transfer[now.transfers++] = (struct transfer){
        q, queue_of(q)->last, through == NULL ? sum_of(here, bytes) : 0, here, through, bytes};
    pthread_mutex_unlock(&now.lock);
}

void strict_flushed(cl_command_queue q)
{
    pthread_mutex_lock(&now.lock);
    queue_of(q)->flushed = queue_of(q)->last;
    pthread_mutex_unlock(&now.lock);
}

bool strict_may_begin(cl_event event)
{
    pthread_mutex_lock(&now.lock);
    const struct event *e = event_of(event);
    bool may = e == NULL || e->number <= queue_of(e->q)->flushed;
    pthread_mutex_unlock(&now.lock);
    return may;
}

static void transfer_end(struct transfer *t)
{
    if (t->through != NULL)
        memcpy(t->here, t->through, t->bytes);
    else if (sum_of(t->here, t->bytes) != t->sum)
        strict_fail("memory has changed while it was on its way to the device");
    free(t->through);
}

void strict_waited(cl_event event)
{
    pthread_mutex_lock(&now.lock);
    const struct event *e = event_of(event);
    size_t left = 0;
    for (size_t i = 0; i < now.transfers && e != NULL; i++)
        if (now.transfer[i].q == e->q && now.transfer[i].number <= e->number)
            transfer_end(&now.transfer[i]);
        else
            now.transfer[left++] = now.transfer[i];
    now.transfers = e != NULL ? left : now.transfers;
    pthread_mutex_unlock(&now.lock);
}

void strict_released(cl_event event)
{
    pthread_mutex_lock(&now.lock);
    struct event *e = event_of(event);
    if (e != NULL)
        e->event = NULL;
    pthread_mutex_unlock(&now.lock);
}

static size_t place_of(cl_kernel k)
{
    return (size_t)((uintptr_t)k / 16 % KERNELS);
}
void strict_argument(cl_kernel k)
{
    size_t i = place_of(k);
    pthread_mutex_lock(&now.lock);
    if (now.argument[i].k == k && !pthread_equal(now.argument[i].thread, pthread_self()))
        strict_fail("two threads set the arguments of a kernel");
    now.argument[i].k = k;
    now.argument[i].thread = pthread_self();
    pthread_mutex_unlock(&now.lock);
}
void strict_kernel(cl_kernel k)
{
    size_t i = place_of(k);
    pthread_mutex_lock(&now.lock);
    if (now.argument[i].k == k)
        now.argument[i].k = NULL;
    pthread_mutex_unlock(&now.lock);
}

void strict_forget(cl_command_queue q)
{
    pthread_mutex_lock(&now.lock);
    size_t left = 0;
    for (size_t i = 0; i < now.transfers; i++)
        if (now.transfer[i].q != q)
            now.transfer[left++] = now.transfer[i];
        else
            free(now.transfer[i].through);
    now.transfers = left;
    *queue_of(q) = (struct queue){NULL, 0, 0};
    pthread_mutex_unlock(&now.lock);
}
