/* pool.h - fixed pool of worker threads for data-parallel loops.
 *
 * Several callers (pipeline stages) may run loops at the same time.  Each caller works on its own loop too, so a pool
 * of T threads in all keeps T cores busy, and a pool of 1 starts no thread.
 * The caller splits the work into tasks.  The split must not depend on the number of threads, so that the results
 * do not depend on it either. */
#ifndef PVX_POOL_H
#define PVX_POOL_H
#include <stddef.h>
#include "base/err.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pvx_pool pvx_pool;
typedef void (*pvx_task_fn)(void *ctx, size_t task);

/* `threads` in all, counting the caller of pvx_pool_run: 1..256; 0 = one per CPU that it may run on.
 * `name` prefixes the thread names.  Errors: PVX_EINVAL, PVX_ENOMEM, PVX_EIO. */
PVX_MUST_CHECK pvx_err pvx_pool_new(unsigned threads, const char *name, pvx_pool **out);
void pvx_pool_free(pvx_pool **p);
unsigned pvx_pool_threads(const pvx_pool *p);

/* fn(ctx, 0..n-1), in any order and on any thread; returns when all are done.  `p` may be NULL:
 * then serial on the caller.  Allocates nothing.  Do not call it from inside a task. */
void pvx_pool_run(pvx_pool *p, size_t n, pvx_task_fn fn, void *ctx);

#ifdef __cplusplus
}
#endif
#endif
