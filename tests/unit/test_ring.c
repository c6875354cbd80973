/* test_ring.c - hand-over without locks: ring, bell and board, by one thread and by two at full speed. */
#include "../t.h"

#include <pthread.h>
#include <stdatomic.h>

#include "base/bell.h"
#include "base/board.h"
#include "base/ring.h"

#define ITEMS 300000
#define READS 300000

static int items[ITEMS];

T_CASE(drops_the_oldest_when_pushed)
{
    pvx_ring *r;
    T_EQ_I(pvx_ring_new(0, &r), PVX_EINVAL);
    T_EQ_I(pvx_ring_new(3, &r), PVX_OK);
    T_OK(pvx_ring_pop(r) == NULL);
    for (int round = 0; round < 5; round++) { /* also where places come round */
        for (int i = 0; i < 3; i++)
            T_OK(pvx_ring_push(r, &items[i]) == NULL);
        T_OK(pvx_ring_push(r, &items[3]) == &items[0]);
        T_OK(pvx_ring_push(r, &items[4]) == &items[1]);
        T_EQ_I(pvx_ring_length(r), 3);
        for (int i = 2; i < 5; i++)
            T_OK(pvx_ring_pop(r) == &items[i]);
        T_OK(pvx_ring_pop(r) == NULL);
        T_EQ_I(pvx_ring_length(r), 0);
    }
    pvx_ring_free(&r);
    T_OK(r == NULL);
}

T_CASE(says_that_it_is_full_when_put)
{
    pvx_ring *r;
    T_EQ_I(pvx_ring_new(2, &r), PVX_OK);
    T_OK(pvx_ring_put(r, &items[0]));
    T_OK(pvx_ring_put(r, &items[1]));
    T_OK(!pvx_ring_put(r, &items[2]));
    T_OK(pvx_ring_pop(r) == &items[0]);
    T_OK(pvx_ring_put(r, &items[2]));
    T_OK(pvx_ring_pop(r) == &items[1]);
    T_OK(pvx_ring_pop(r) == &items[2]);
    pvx_ring_free(&r);
}

struct traffic {
    pvx_ring *ring;
    struct pvx_bell work, room;
    atomic_bool done, lossless;
    size_t displaced, twice, disorder;
    char seen[ITEMS]; /* by whoever got it */
};

/* Each item is its place, written before it is handed over. */
static void *produce(void *arg)
{
    struct traffic *t = arg;
    for (int i = 0; i < ITEMS; i++) {
        items[i] = i;
        int *gone = NULL;
        if (!t->lossless)
            gone = pvx_ring_push(t->ring, &items[i]);
        else
            while (!pvx_ring_put(t->ring, &items[i]))
                pvx_bell_wait(&t->room, INT64_MAX);
        pvx_bell_ring(&t->work);
        t->displaced += gone != NULL;
        t->twice += gone != NULL && t->seen[*gone]++ != 0;
    }
    t->done = true;
    pvx_bell_ring(&t->work);
    return NULL;
}

static void passes_everything_once(size_t capacity, bool lossless)
{
    static struct traffic t;
    t = (struct traffic){.lossless = lossless};
    T_EQ_I(pvx_ring_new(capacity, &t.ring), PVX_OK);
    pvx_bell_init(&t.work);
    pvx_bell_init(&t.room);
    pthread_t thread;
    pthread_create(&thread, NULL, produce, &t);
    size_t popped = 0;
    for (int last = -1;;) {
        bool done = t.done; /* before the ring is looked into */
        int *item = pvx_ring_pop(t.ring);
        if (item == NULL && done)
            break;
        if (item == NULL) {
            if (lossless) /* else both at full speed */
                pvx_bell_wait(&t.work, INT64_MAX);
            continue;
        }
        pvx_bell_ring(&t.room);
        t.disorder += *item <= last;
        last = *item;
        popped++;
        T_OK(t.seen[*item]++ == 0);
    }
    pthread_join(thread, NULL);
    T_EQ_I(popped + t.displaced, ITEMS);
    T_EQ_I(t.twice + t.disorder, 0);
    T_OK(!lossless || t.displaced == 0);
    for (int i = 0; i < ITEMS; i++)
        T_OK(t.seen[i] == 1);
    pvx_bell_fini(&t.work);
    pvx_bell_fini(&t.room);
    pvx_ring_free(&t.ring);
}
T_CASE(two_threads_live)
{
    passes_everything_once(1, false);
    passes_everything_once(6, false);
}
T_CASE(two_threads_lossless)
{
    passes_everything_once(6, true);
}

struct notice {
    struct pvx_board board;
    atomic_bool enough;
};
static void *write_alike(void *arg)
{
    struct notice *n = arg;
    for (int32_t i = 1; !n->enough; i++) {
        int32_t v[27]; /* not whole words */
        for (int k = 0; k < 27; k++)
            v[k] = i;
        pvx_board_write(&n->board, v, sizeof v);
    }
    return NULL;
}
T_CASE(board_is_read_whole)
{
    static struct notice n;
    pthread_t thread;
    pthread_create(&thread, NULL, write_alike, &n);
    int32_t v[27] = {0}, last = 0;
    size_t torn = 0, back = 0, changes = 0;
    for (int i = 0; i < READS || changes < 100; i++) {
        pvx_board_read(&n.board, v, sizeof v);
        for (int k = 1; k < 27; k++)
            torn += v[k] != v[0];
        back += v[0] < last;
        changes += v[0] != last;
        last = v[0];
    }
    n.enough = true;
    pthread_join(thread, NULL);
    T_EQ_I(torn, 0);
    T_EQ_I(back, 0);
}
