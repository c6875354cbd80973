/* test_cl_alloc.c - once its work areas are there, no stage of a frame set on a device allocates.
 *
 * This program counts every malloc.  What the driver allocates is its own: it is inside of a call of libOpenCL, or in a
 * thread that began in one. */
#include "tests/lib/scene.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
T_CASE(nothing_is_allocated)
{
    T_SKIP("the sanitizers have an allocator of their own");
}
T_MAIN((void)0, (void)0)
#else
#include <pthread.h>
#include <stdatomic.h>

#include "daemon/pipeline/images.h"
#include "recon/frame/impl.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/cl_fault.h"

extern void *__libc_malloc(size_t n);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t n);
extern void *__libc_memalign(size_t align, size_t n);

static _Thread_local int inside;     /* calls of libOpenCL that this thread is in */
static _Thread_local bool is_driver; /* the driver has begun this thread */
static atomic_llong ours, of_drivers;

static void inside_change(int by)
{
    inside += by;
}
static void count(void)
{
    atomic_fetch_add(is_driver || inside > 0 ? &of_drivers : &ours, 1);
}
void *malloc(size_t n)
{
    count();
    return __libc_malloc(n);
}
void *calloc(size_t n, size_t size)
{
    count();
    return __libc_calloc(n, size);
}
void *realloc(void *p, size_t n)
{
    count();
    return __libc_realloc(p, n);
}
void *aligned_alloc(size_t align, size_t n)
{
    count();
    return __libc_memalign(align, n);
}

/* ---- threads of the driver ---- */

struct thread {
    void *(*run)(void *);
    void *arg;
};
static void *driver_run(void *p)
{
    struct thread t = *(struct thread *)p;
    is_driver = true;
    free(p);
    return t.run(t.arg);
}
int pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *), void *arg)
{
    typedef int create(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    union {
        void *object;
        create *function;
    } next = {dlsym(RTLD_NEXT, "pthread_create")};
    if (!is_driver && inside == 0)
        return next.function(thread, attr, run, arg);
    struct thread *t = __libc_malloc(sizeof *t);
    if (t == NULL)
        return ENOMEM;
    *t = (struct thread){run, arg};
    return next.function(thread, attr, driver_run, t);
}

/* ---- frame sets ---- */

enum { CAMERAS = 6, WIDTH = 96, HEIGHT = 72, GRID = 32, SETS = 8 };
enum how { FLOATS, MOSAICS, RAW };

static rec_cl *cl;

struct bed {
    struct scene s;
    dmn_images *images;
    uint8_t *bytes[CAMERAS];
    rec_carver *carver;
    rec_solver *solver;
    rec_frame *slot[2];
};

static void bed_new(struct bed *b, const struct rec_frame_params *p)
{
    const struct dmn_images_params how = {.nch = p->nch, .binning = 1};
    *b = (struct bed){.images = NULL};
    scene_new(&b->s, CAMERAS, WIDTH, GRID, 1, 2);
    if (dmn_images_new(&how, &b->s.rig, b->s.pool, &b->images, NULL) != PVX_OK ||
        rec_carver_new(b->s.S, &b->s.rig, p, b->s.pool, &b->carver, NULL) != PVX_OK ||
        rec_solver_new(b->s.S, p, &b->solver, NULL) != PVX_OK ||
        rec_frame_new(b->carver, b->solver, &b->slot[0], NULL) != PVX_OK ||
        rec_frame_new(b->carver, b->solver, &b->slot[1], NULL) != PVX_OK)
        exit(2);
    for (size_t c = 0; c < CAMERAS; c++)
        b->bytes[c] = calloc((size_t)WIDTH * HEIGHT, 3);
}
static void bed_free(struct bed *b)
{
    for (int k = 0; k < 2; k++)
        rec_frame_free(&b->slot[k]);
    rec_solver_free(&b->solver);
    rec_carver_free(&b->carver);
    dmn_images_free(&b->images);
    for (size_t c = 0; c < CAMERAS; c++)
        free(b->bytes[c]);
    scene_free(&b->s);
}

static void shoot_raw(struct bed *b, rec_frame *f)
{
    struct cap_image image[CAMERAS];
    const struct cap_image *set[CAMERAS];
    uint64_t mask;
    rec_frame_reset(f);
    for (size_t c = 0; c < CAMERAS; c++) {
        const size_t row = (size_t)WIDTH * 3;
        for (size_t i = 0; i < row * HEIGHT; i++) {
            double v = (double)b->s.image[c][i / 3 * 4 + i % 3] + 0.01 * t_normal();
            b->bytes[c][i] = (uint8_t)fmin(fmax(v * 255 + 0.5, 0), 255);
        }
        image[c] = (struct cap_image){b->bytes[c],    row * HEIGHT, WIDTH, HEIGHT,
                                      (ptrdiff_t)row, CAP_RGB8,     0};
        set[c] = &image[c];
    }
    (void)dmn_images_bin_frame(b->images, set, f, &mask);
}

static void shoot(struct bed *b, rec_frame *f, enum how how)
{
    if (how == RAW) {
        shoot_raw(b, f);
        return;
    }
    rec_frame_reset(f);
    for (size_t c = 0; c < CAMERAS; c++) {
        float *in = rec_frame_input(f, c);
        const size_t lanes = (size_t)f->cs;
        for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * lanes; i++)
            in[i] = b->s.image[c][i / lanes * 4 + i % lanes] +
                    (i % 4 < 3 || lanes == 1 ? (float)(0.01 * t_normal()) : 0);
        rec_frame_camera(f, c)->present = true;
    }
    if (how == MOSAICS)
        scene_filter(&b->s, f);
}

/* Sets in two slots, each begun with the one before it; a camera is missing in some. */
static void take_all(struct bed *b, enum how how)
{
    for (int i = 0; i < SETS; i++) {
        rec_frame *now = b->slot[i % 2], *last = b->slot[1 - i % 2];
        struct rec_sparse v;
        shoot(b, now, how);
        rec_frame_camera(now, 3)->present = how == RAW || i % 3 != 2;
        rec_frame_volume(last, &v);
        rec_frame_carve(now);
        T_EQ_I(rec_frame_solve(now, 0, i > 0 ? &v : NULL), PVX_OK);
        T_OK(now->report.on_card && now->report.active_voxels > 500);
        T_EQ_I(now->report.raw_on_card, how == RAW);
    }
}

T_CASE(what_is_counted)
{
    struct pvx_diag d = {""};
    struct rec_cl_buffer b;
    long long here = atomic_load(&ours), there = atomic_load(&of_drivers);
    void *volatile some = malloc(10);
    free(some);
    T_EQ_I(atomic_load(&ours), here + 1);
    T_EQ_I(atomic_load(&of_drivers), there);
    T_EQ_I(rec_cl_buffer_new(cl, 100, &b, &d), PVX_OK);
    T_EQ_I(atomic_load(&ours), here + 1);
    T_OK(atomic_load(&of_drivers) > there);
    rec_cl_buffer_free(cl, &b);
}

T_CASE(nothing_is_allocated)
{
    static const struct {
        const char *name;
        enum how how;
        int nch;
        enum rec_blend blend;
        float absorption;
    } of[] = {{"colours", FLOATS, 3, REC_BLEND_AUTO, 0},
              {"grey", FLOATS, 1, REC_BLEND_AUTO, 0},
              {"mosaics", MOSAICS, 3, REC_BLEND_AUTO, 0},
              {"raw", RAW, 3, REC_BLEND_AUTO, 0},
              {"blended", FLOATS, 3, REC_BLEND_ON, 0},
              {"absorption", FLOATS, 3, REC_BLEND_AUTO, 0.3F}};
    for (size_t k = 0; k < sizeof of / sizeof *of; k++) {
        struct bed b;
        struct rec_frame_params p = rec_frame_defaults;
        p.card = cl;
        p.nch = of[k].nch;
        p.solve.blend = of[k].blend;
        p.absorption = of[k].absorption;
        bed_new(&b, &p);
        long long here = atomic_load(&ours), there = atomic_load(&of_drivers);
        take_all(&b, of[k].how);
        T_EQ_I(atomic_load(&ours), here);
        T_OK(atomic_load(&of_drivers) > there);
        printf("  %s: %lld here, %lld by the driver\n", of[k].name, atomic_load(&ours) - here,
               atomic_load(&of_drivers) - there);
        bed_free(&b);
    }
}

T_MAIN((cl_fault_begin(), cl_watch(inside_change), cl_bed_begin(), cl = cl_bed_open()),
       rec_cl_close(&cl))
#endif
