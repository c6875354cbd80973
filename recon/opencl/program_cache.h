/* program_cache.h - compiled programs in files opencl-<key>.pvxp of the cache folder (matrix/cache.h).
 *
 * A file has a header and what the driver gave: magic, key, number of bytes, their checksum (XXH3), 8 bytes each in the
 * order of the host.  A file that is damaged, or of another host, counts as not there. */
#ifndef REC_CL_PROGRAM_CACHE_H
#define REC_CL_PROGRAM_CACHE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define REC_CL_KEPT 256 /* files; those not used for longest are removed */

/* Whether a variable names the folder. */
bool rec_cl_cache_is_there(void);
/* NULL: it is not there.  Owner: caller, free(). */
unsigned char *rec_cl_cache_read(uint64_t key, size_t *bytes);
/* Where it cannot be written, it is not. */
void rec_cl_cache_write(uint64_t key, const unsigned char *from, size_t bytes);

#endif
