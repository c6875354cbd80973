/* test_pipeline_alloc.c - after start-up the frame path allocates nothing.
 *
 * This program interposes malloc and its relatives and counts every call of every thread, except
 * those that libzmq makes (its copy of an outgoing message, its own threads) - told by the caller's
 * address lying in libzmq or in the C++ library, which nothing else here uses.  Calls of the watch's
 * thread are counted apart: it is beside the frame path, and its hypotheses allocate (plausible.h).
 * 1,000 frame sets go from sim: cameras through the whole pipeline to a PUB socket. */
#include "tests/lib/pipebed.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
T_CASE(nothing_is_allocated)
{
    T_SKIP("the sanitizers have an allocator of their own");
}
#else
#include <dlfcn.h>
#include <link.h>
#include <stdatomic.h>
#include <sys/prctl.h>

#define SETS 1000

extern void *__libc_malloc(size_t n);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t n);
extern void *__libc_memalign(size_t align, size_t n);
extern void __libc_free(void *p);

static struct {
    uintptr_t lo, hi;
} apart[32]; /* code of libzmq and libstdc++ */
static int n_apart;
static atomic_int counting;
static atomic_ullong allocations, frees, theirs, beside;
static _Atomic uintptr_t first_caller;

static void count(atomic_ullong *what, void *caller)
{
    if (!atomic_load(&counting))
        return;
    uintptr_t at = (uintptr_t)caller;
    for (int i = 0; i < n_apart; i++)
        if (at >= apart[i].lo && at < apart[i].hi) {
            atomic_fetch_add(&theirs, 1);
            return;
        }
    char thread[16] = "";
    (void)prctl(PR_GET_NAME, thread);
    if (strcmp(thread, "watch") == 0) {
        atomic_fetch_add(&beside, 1);
        return;
    }
    uintptr_t none = 0;
    atomic_compare_exchange_strong(&first_caller, &none, at);
    atomic_fetch_add(what, 1);
}

void *malloc(size_t n)
{
    count(&allocations, __builtin_return_address(0));
    return __libc_malloc(n);
}
void *calloc(size_t n, size_t size)
{
    count(&allocations, __builtin_return_address(0));
    return __libc_calloc(n, size);
}
void *realloc(void *p, size_t n)
{
    count(&allocations, __builtin_return_address(0));
    return __libc_realloc(p, n);
}
void *aligned_alloc(size_t align, size_t n)
{
    count(&allocations, __builtin_return_address(0));
    return __libc_memalign(align, n);
}
int posix_memalign(void **out, size_t align, size_t n)
{
    count(&allocations, __builtin_return_address(0));
    *out = __libc_memalign(align, n);
    return *out == NULL ? 12 : 0;
}
void free(void *p)
{
    if (p != NULL)
        count(&frees, __builtin_return_address(0));
    __libc_free(p);
}

static int find_libraries(struct dl_phdr_info *info, size_t size, void *ctx)
{
    (void)size, (void)ctx;
    if (strstr(info->dlpi_name, "libzmq") == NULL && strstr(info->dlpi_name, "libstdc++") == NULL)
        return 0;
    for (int i = 0; i < info->dlpi_phnum && n_apart < 32; i++)
        if (info->dlpi_phdr[i].p_type == PT_LOAD) {
            apart[n_apart].lo = info->dlpi_addr + info->dlpi_phdr[i].p_vaddr;
            apart[n_apart].hi = apart[n_apart].lo + info->dlpi_phdr[i].p_memsz;
            n_apart++;
        }
    return 0;
}

static uint64_t cameras_lost(void)
{
    uint64_t n = 0;
    for (int c = 0; c < 4; c++)
        n += state.capture.camera[c].count[CAP_LOST_CAMERA];
    return n;
}

T_CASE(nothing_is_allocated)
{
    make_rig(4, 64, 48, 16);
    bed_publish = "compress: lz4";
    dmn_live *p = started("cameras: \"sim:\"\nfps: 60\nsolver: {warm_start: on}\n"
                          "model: {error_bars: true}\n");
    /* cameras are open, the watch has its matrix, first use of everything is over */
    LOOK_UNTIL(p, state.published >= 50 && state.rig[3].looks > 0 && state.checks.n > 0);
    dl_iterate_phdr(find_libraries, NULL);
    T_OK(n_apart >= 2);
    /* A machine so busy that a camera counts as lost opens it anew, and that allocates: then again. */
    uint64_t lost;
    do {
        uint64_t checks = state.checks.n, before = state.published;
        lost = cameras_lost();
        atomic_store(&allocations, 0);
        atomic_store(&frees, 0);
        atomic_store(&first_caller, 0);
        atomic_store(&counting, 1);
        LOOK_UNTIL(p, state.published >= before + SETS && state.checks.n > checks);
        atomic_store(&counting, 0);
    } while (cameras_lost() != lost && t_case_fails == 0);
    T_EQ_I(atomic_load(&allocations), 0);
    T_EQ_I(atomic_load(&frees), 0);
    printf("  beside the frame path: %llu\n", atomic_load(&beside));
    T_OK(atomic_load(&theirs) > 0); /* or the interposition does not work */
    if (atomic_load(&allocations) + atomic_load(&frees) > 0) {
        Dl_info info;
        if (dladdr((void *)atomic_load(&first_caller), &info) != 0)
            printf("  first caller: %s in %s\n", info.dli_sname ? info.dli_sname : "?",
                   info.dli_fname);
    }
    finish(&p);
}
#endif

int main(void)
{
    bed_open();
    t_run();
    return bed_close();
}
