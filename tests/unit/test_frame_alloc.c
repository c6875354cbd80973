/* After the work areas are there no stage of a frame set allocates: this program counts every malloc. */
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
T_CASE(nothing_is_allocated)
{
    T_SKIP("the sanitizers have an allocator of their own");
}
#else
#include <stdatomic.h>

extern void *__libc_malloc(size_t n);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t n);
extern void *__libc_memalign(size_t align, size_t n);
static atomic_llong calls;

void *malloc(size_t n)
{
    atomic_fetch_add(&calls, 1);
    return __libc_malloc(n);
}
void *calloc(size_t n, size_t size)
{
    atomic_fetch_add(&calls, 1);
    return __libc_calloc(n, size);
}
void *realloc(void *p, size_t n)
{
    atomic_fetch_add(&calls, 1);
    return __libc_realloc(p, n);
}
void *aligned_alloc(size_t align, size_t n)
{
    atomic_fetch_add(&calls, 1);
    return __libc_memalign(align, n);
}

T_CASE(nothing_is_allocated)
{
    struct scene sc;
    scene_new(&sc, 4, 40, 12, 1, 2);
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        struct rec_frame_params p = rec_frame_defaults;
        p.solve.solver = *name;
        p.temporal = true; /* of the default one */
        rec_frame *f, *g;
        if (rec_frame_alone(sc.S, &sc.rig, &p, sc.pool, &f, NULL) != PVX_OK ||
            rec_frame_new(f->carver, f->solver, &g, NULL) != PVX_OK)
            exit(2);
        long long before = atomic_load(&calls);
        T_OK(before > 0); /* the count works */
        for (int i = 0; i < 20; i++) {
            struct rec_sparse v;
            rec_frame *now = i % 2 == 0 ? f : g, *last = i % 2 == 0 ? g : f;
            rec_frame_volume(last, &v);
            scene_shoot(&sc, now, i % 5 == 4 ? 0.2 : 0.01);
            rec_frame_carve(now);
            T_OK(rec_frame_solve(now, 0, i > 0 ? &v : NULL) == PVX_OK);
        }
        T_EQ_I(atomic_load(&calls), before);
        rec_frame_free(&g);
        rec_frame_free(&f);
    }
    scene_free(&sc);
}
#endif
