/* test_bufpool.c - frames come from a fixed pool that outlives its source. */
#include "../t.h"

#include <pthread.h>

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
