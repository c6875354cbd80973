/* test_bufpool.c - frames come from a fixed pool that outlives its source. */
#include "../t.h"

#include <pthread.h>
#include <sys/mman.h>

#include "capture/rig/backends.h"
#include "capture/source/bufpool.h"
#include "tests/lib/free_frames.h"

T_CASE(gives_all_then_none)
{
    cap_bufpool *p;
    T_EQ_I(cap_bufpool_new(3, 100, 5, &p), PVX_OK);
    struct cap_frame *f[3];
    for (int i = 0; i < 3; i++) {
        f[i] = cap_bufpool_get(p);
        T_OK(f[i] != NULL);
        T_EQ_I(f[i]->camera, 5);
        T_OK(f[i]->img.data == cap_bufpool_memory(f[i]));
        T_EQ_I((uintptr_t)f[i]->img.data % 64, 0);
        memset(cap_bufpool_memory(f[i]), i, 100);
    }
    T_EQ_I(((const unsigned char *)f[2]->img.data)[99], 2);
    T_EQ_I(((const unsigned char *)f[0]->img.data)[99], 0);
    T_EQ_I(((const unsigned char *)f[1]->img.data)[0], 1);
    T_OK(cap_bufpool_get(p) == NULL);
    f[1]->id = 77;
    cap_frame_release(f[1]);
    T_EQ_I(free_frames(p), 1);
    f[1] = cap_bufpool_get(p);
    T_OK(f[1] != NULL);
    T_EQ_I(f[1]->id, 0);
    cap_frame_release(NULL);
    for (int i = 0; i < 3; i++)
        cap_frame_release(f[i]);
    cap_bufpool_unref(&p);
    T_OK(p == NULL);
}

/* A leak or a use after free here is AddressSanitizer's to find. */
T_CASE(outlives_its_source)
{
    cap_bufpool *p;
    T_EQ_I(cap_bufpool_new(2, 64, 0, &p), PVX_OK);
    struct cap_frame *a = cap_bufpool_get(p), *b = cap_bufpool_get(p);
    cap_bufpool_unref(&p);
    memset(cap_bufpool_memory(a), 1, 64);
    cap_frame_release(a);
    memset(cap_bufpool_memory(b), 2, 64);
    T_EQ_I(((const unsigned char *)b->img.data)[63], 2);
    cap_frame_release(b);
}

static void *release_one(void *f)
{
    cap_frame_release(f);
    return NULL;
}
static void *cancel(void *p)
{
    cap_bufpool_cancel(p);
    return NULL;
}
T_CASE(waits_for_room_or_cancel)
{
    cap_bufpool *p;
    pthread_t th;
    T_EQ_I(cap_bufpool_new(1, 64, 0, &p), PVX_OK);
    struct cap_frame *f = cap_bufpool_get_wait(p);
    pthread_create(&th, NULL, release_one, f);
    f = cap_bufpool_get_wait(p);
    T_OK(f != NULL);
    pthread_join(th, NULL);
    pthread_create(&th, NULL, cancel, p);
    T_OK(cap_bufpool_get_wait(p) == NULL);
    pthread_join(th, NULL);
    T_OK(cap_bufpool_get_wait(p) == NULL);
    cap_bufpool_resume(p);
    cap_frame_release(f);
    f = cap_bufpool_get_wait(p);
    T_OK(f != NULL);
    cap_frame_release(f);
    cap_bufpool_unref(&p);
}

T_CASE(refuses_nonsense)
{
    cap_bufpool *p;
    T_EQ_I(cap_bufpool_new(0, 64, 0, &p), PVX_EINVAL);
    T_EQ_I(cap_bufpool_new(4, 0, 0, &p), PVX_EINVAL);
    T_OK(p == NULL);
}

T_CASE(every_counter_is_described)
{
    for (int i = 0; i < CAP_N_COUNT; i++) {
        T_OK(cap_count_defs[i].name != NULL && cap_count_defs[i].unit != NULL);
        T_OK(cap_count_defs[i].help != NULL);
    }
}

T_CASE(backends_are_found_by_scheme)
{
    const char *rest = NULL;
    for (const struct cap_source_ops *const *b = cap_backends(); *b != NULL; b++) {
        char uri[64];
        snprintf(uri, sizeof uri, "%s:a:b", (*b)->scheme);
        T_OK(cap_backend_find(uri, &rest) == *b);
        T_EQ_S(rest, "a:b");
        T_OK(strchr((*b)->scheme, ':') == NULL && (*b)->help != NULL);
    }
    T_OK(cap_backend_find("nosuch:x", &rest) == NULL);
    T_OK(cap_backend_find("simx", &rest) == NULL);
    T_OK(cap_backend_find("", &rest) == NULL);
}

/* How many frames' pages are in memory. */
static int resident(unsigned char *const mem[], int n)
{
    int is = 0;
    for (int i = 0; i < n; i++) {
        unsigned char page = 0;
        T_EQ_I(mincore(mem[i], 4096, &page), 0);
        is += page & 1;
    }
    return is;
}

/* A camera that is opened again while its frames are kept: of its earlier memory only that of these frames stays, and the
 * new memory comes as it is used. */
T_CASE(what_is_kept_for_long_is_all_that_stays)
{
    if (T_SANITIZED)
        T_SKIP("with a sanitizer munlock does nothing, so locked pages stay");
    enum { N = 8 };
    struct cap_source_config c = {.name = "cam0", .camera = 3, .held = 4};
    struct cap_frame *f[N];
    unsigned char *mem[N];
    cap_bufpool *p, *next;
    T_EQ_I(cap_bufpool_of(&c, N, 5000, &p), PVX_OK);
    for (int i = 0; i < N; i++) {
        f[i] = cap_bufpool_get(p);
        T_OK(f[i] != NULL);
        T_EQ_I(f[i]->camera, 3);
        mem[i] = cap_bufpool_memory(f[i]);
        T_EQ_I((uintptr_t)mem[i] % 4096, 0);
    }
    T_EQ_I(resident(mem, N), N); /* touched at the start */
    for (int i = 0; i < N; i++)
        memset(mem[i], 7, 5000);
    for (int i = 4; i < N; i++)
        cap_frame_release(f[i]);
    cap_bufpool_unref(&p);
    T_EQ_I(resident(mem, N), 4);
    cap_frame_release(f[3]);
    T_EQ_I(resident(mem, N), 3);
    T_EQ_I(mem[0][4999], 7);
    c.again = true;
    T_EQ_I(cap_bufpool_of(&c, N, 5000, &next), PVX_OK);
    struct cap_frame *g = cap_bufpool_get(next);
    unsigned char *fresh = cap_bufpool_memory(g);
    T_EQ_I(resident(&fresh, 1), 0);
    fresh[0] = 1;
    T_EQ_I(resident(&fresh, 1), 1);
    cap_frame_release(g);
    cap_bufpool_unref(&next);
    for (int i = 0; i < 3; i++)
        cap_frame_release(f[i]);
}
