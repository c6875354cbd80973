/* mem.h - aligned, checked and reserved memory.
 *
 * pvx_calloc: zeroed, 64-byte aligned (a cache line and an AVX-512 vector), free with free().
 * pvx_reserve: zero-filled address space that costs memory only where it is touched.  It is for
 * work areas whose worst case (every pixel lit) is far above the usual case.  The frame path can
 * grow into it without allocating. */
#ifndef PVX_MEM_H
#define PVX_MEM_H
#include <stddef.h>

#define PVX_ALIGN 64

/* n*size bytes, zeroed; NULL when out of memory or when n*size overflows.  0 bytes give 64. */
void *pvx_calloc(size_t n, size_t size);

/* Reserve `bytes` (rounded up to pages); NULL on failure.  Release with the same size. */
void *pvx_reserve(size_t bytes);
void pvx_unreserve(void *p, size_t bytes);
/* Gives the memory of whole reserved pages back, locked or not.  They stay reserved, and are zero when they are touched
 * again.  p and bytes: multiples of PVX_PAGE. */
#define PVX_PAGE 4096
void pvx_discard(void *p, size_t bytes);

/* free(*p); *p = NULL, for any object pointer. */
#define PVX_FREE(p) \
    do {            \
        free(p);    \
        (p) = NULL; \
    } while (0)

#endif
