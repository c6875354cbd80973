#include "base/mem.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

void *pvx_calloc(size_t n, size_t size)
{
    size_t bytes;
    if (__builtin_mul_overflow(n, size, &bytes))
        return NULL;
    if (bytes == 0)
        bytes = 1;
    if (bytes > (size_t)-1 - PVX_ALIGN)
        return NULL;
    bytes = (bytes + PVX_ALIGN - 1) & ~(size_t)(PVX_ALIGN - 1);
    void *p = aligned_alloc(PVX_ALIGN, bytes);
    if (p != NULL)
        memset(p, 0, bytes);
    return p;
}

void *pvx_reserve(size_t bytes)
{
    if (bytes == 0)
        bytes = 1;
    void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE,
                   -1, 0);
    return p == MAP_FAILED ? NULL : p;
}

void pvx_discard(void *p, size_t bytes)
{
    munlock(p, bytes); /* locked pages cannot be given back */
    madvise(p, bytes, MADV_DONTNEED);
}

void pvx_unreserve(void *p, size_t bytes)
{
    if (p != NULL)
        munmap(p, bytes == 0 ? 1 : bytes);
}
