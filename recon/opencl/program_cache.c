#include "recon/opencl/program_cache.h"

#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/file.h"
#include "base/log.h"
#include "recon/matrix/cache.h"

struct header {
    char magic[8];
    uint64_t key, bytes, check;
};
static const char magic[8] = "PVXCLP1";
#define MOST_BYTES (256u << 20)

static bool cached_name(uint64_t key, char out[PATH_MAX])
{
    char dir[PATH_MAX];
    int n = rec_cache_dir(dir)
                ? snprintf(out, PATH_MAX, "%s/opencl-%016llx.pvxp", dir, (unsigned long long)key)
                : -1;
    return n > 0 && n < PATH_MAX;
}

bool rec_cl_cache_is_there(void)
{
    char dir[PATH_MAX];
    return rec_cache_dir(dir);
}

unsigned char *rec_cl_cache_read(uint64_t key, size_t *bytes)
{
    char path[PATH_MAX], *file;
    size_t n;
    struct header h;
    struct pvx_diag d = {""};
    if (!cached_name(key, path) || pvx_file_read(path, MOST_BYTES, &file, &n, &d) != PVX_OK)
        return NULL;
    if (n >= sizeof h)
        memcpy(&h, file, sizeof h);
    if (n < sizeof h || memcmp(h.magic, magic, sizeof magic) != 0 || h.key != key ||
        h.bytes != n - sizeof h || h.check != XXH3_64bits(file + sizeof h, n - sizeof h)) {
        free(file);
        return NULL;
    }
    (void)utimensat(AT_FDCWD, path, NULL, 0); /* used now; where it may not, it looks older */
    *bytes = n - sizeof h;
    memmove(file, file + sizeof h, *bytes);
    return (unsigned char *)file;
}

struct used {
    char name[NAME_MAX + 1];
    struct timespec at;
};

static int used_later(const void *a, const void *b)
{
    const struct used *x = a, *y = b;
    if (x->at.tv_sec != y->at.tv_sec)
        return x->at.tv_sec < y->at.tv_sec ? 1 : -1;
    return (x->at.tv_nsec < y->at.tv_nsec) - (x->at.tv_nsec > y->at.tv_nsec);
}

static int is_program(const struct dirent *f)
{
    unsigned long long key;
    char rest;
    return strlen(f->d_name) == strlen("opencl-0123456789abcdef.pvxp") &&
           sscanf(f->d_name, "opencl-%16llx.pvx%c", &key, &rest) == 2;
}

/* Of each update of a driver some files stay behind. */
static void cache_trim_programs(void)
{
    char dir[PATH_MAX];
    struct dirent **file;
    int n = rec_cache_dir(dir) ? scandir(dir, &file, is_program, NULL) : -1;
    if (n < 0)
        return;
    struct used *used = n > REC_CL_KEPT ? calloc((size_t)n, sizeof *used) : NULL;
    int at = used != NULL ? open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    for (int i = 0; i < n; i++) {
        struct stat st;
        if (at >= 0 && fstatat(at, file[i]->d_name, &st, 0) == 0) {
            snprintf(used[i].name, sizeof used[i].name, "%s", file[i]->d_name);
            used[i].at = st.st_mtim;
        }
        free(file[i]);
    }
    free(file);
    if (at >= 0) {
        qsort(used, (size_t)n, sizeof *used, used_later);
        for (int i = REC_CL_KEPT; i < n; i++)
            (void)unlinkat(at, used[i].name, 0);
        close(at);
    }
    free(used);
}

void rec_cl_cache_write(uint64_t key, const unsigned char *from, size_t bytes)
{
    char dir[PATH_MAX], path[PATH_MAX];
    struct pvx_diag d = {""};
    if (bytes == 0 || bytes > MOST_BYTES - sizeof(struct header) || !rec_cache_dir(dir) ||
        !cached_name(key, path))
        return;
    struct header h = {.key = key, .bytes = bytes, .check = XXH3_64bits(from, bytes)};
    memcpy(h.magic, magic, sizeof magic);
    unsigned char *file = malloc(sizeof h + bytes);
    if (file == NULL)
        return;
    memcpy(file, &h, sizeof h);
    memcpy(file + sizeof h, from, bytes);
    pvx_err e = pvx_mkdirs(dir, &d);
    PVX_THEN(e, pvx_file_write(path, file, sizeof h + bytes, &d));
    if (e == PVX_OK)
        cache_trim_programs();
    else
        LOG_D(RECON, "a program is not cached: %s", pvx_diag_text(&d, e));
    free(file);
}
