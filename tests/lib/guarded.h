/* guarded.h - memory that ends where an inaccessible page begins: who reads or writes beyond it dies. */
#ifndef GUARDED_H
#define GUARDED_H
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

/* `bytes`, zero; aligned to 16 when bytes are a multiple of it.  Never freed. */
static inline void *guarded(size_t bytes)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), room = (bytes + page - 1) / page * page;
    unsigned char *p =
        mmap(NULL, room + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED || mprotect(p + room, page, PROT_NONE) != 0)
        abort();
    return p + room - bytes;
}

#endif
