#include "recon/matrix/cache.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/yaml.h"
#include "recon/matrix/sysmat.h"

bool rec_cache_dir(char out[PATH_MAX])
{
    static const struct {
        const char *env, *below;
    } places[] = {
        {"PYROVOX_CACHE", ""}, {"XDG_CACHE_HOME", "/pyrovox"}, {"HOME", "/.cache/pyrovox"}};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        const char *v = getenv(places[i].env);
        if (v == NULL || *v == '\0')
            continue;
        int n = snprintf(out, PATH_MAX, "%s%s", v, places[i].below);
        return n > 0 && n < PATH_MAX;
    }
    return false;
}

double rec_cache_max(void)
{
    const char *text = getenv("PYROVOX_CACHE_MAX");
    double gb = 5;
    if (text != NULL && text[0] != '\0' && pvx_parse_double(text, 0, 1e9, &gb) != PVX_OK)
        LOG_W(RECON, "PYROVOX_CACHE_MAX=%s: should be a number of GB; the limit is %g GB", text,
              gb);
    return gb * 1e9;
}

static int cache_older(const void *a, const void *b)
{
    const struct rec_cached *x = a, *y = b;
    return x->used_ns != y->used_ns ? (x->used_ns > y->used_ns) - (x->used_ns < y->used_ns)
                                    : strcmp(x->path, y->path);
}

pvx_err rec_cache_list(struct rec_cached **out, size_t *n)
{
    char dir[PATH_MAX], rest;
    size_t room = 0;
    *out = NULL;
    *n = 0;
    DIR *folder = rec_cache_dir(dir) ? opendir(dir) : NULL;
    for (struct dirent *f; folder != NULL && (f = readdir(folder)) != NULL;) {
        unsigned long long key;
        struct stat st;
        if (strlen(f->d_name) != strlen("sysmat-0123456789abcdef.pvxm") ||
            sscanf(f->d_name, "sysmat-%16llx.pvx%c", &key, &rest) != 2 ||
            fstatat(dirfd(folder), f->d_name, &st, 0) != 0)
            continue;
        if (*n == room) {
            struct rec_cached *more = realloc(*out, (room = 2 * room + 8) * sizeof **out);
            if (more == NULL) {
                free(*out);
                *out = NULL;
                closedir(folder);
                return PVX_ENOMEM;
            }
            *out = more;
        }
        struct rec_cached *c = &(*out)[*n];
        int len = snprintf(c->path, sizeof c->path, "%s/%s", dir, f->d_name);
        c->bytes = (uint64_t)st.st_size;
        c->used_ns = st.st_mtim.tv_sec * PVX_NS_PER_S + st.st_mtim.tv_nsec;
        *n += len > 0 && (size_t)len < sizeof c->path;
    }
    if (folder != NULL)
        closedir(folder);
    if (*n > 0)
        qsort(*out, *n, sizeof **out, cache_older);
    return PVX_OK;
}

/* The file `kept` was just written, and stays. */
static void cache_trim(const char *kept)
{
    struct rec_cached *file;
    size_t n, gone = 0;
    double all = 0, freed = 0, max = rec_cache_max();
    if (rec_cache_list(&file, &n) != PVX_OK)
        return;
    for (size_t i = 0; i < n; i++)
        all += (double)file[i].bytes;
    for (size_t i = 0; i < n && all - freed > max; i++)
        if (strcmp(file[i].path, kept) != 0 && unlink(file[i].path) == 0) {
            freed += (double)file[i].bytes;
            gone++;
        }
    if (gone > 0)
        LOG_I(RECON,
              "the cache of system matrices had %.1f GB, more than %g (PYROVOX_CACHE_MAX); the "
              "files not used for longest are removed, %zu of them",
              all * 1e-9, max * 1e-9, gone);
    free(file);
}

/* The file to use: `path` as given, else a file in the cache's folder, which is created.  "" if there is no such
 * folder: then the matrix lives in memory only. */
static void choose_file(const char *path, uint64_t key, char out[PATH_MAX])
{
    char dir[PATH_MAX];
    struct pvx_diag d = {""};
    out[0] = '\0';
    int n = 0;
    if (path != NULL)
        n = snprintf(out, PATH_MAX, "%s", path);
    else if (!rec_cache_dir(dir))
        LOG_W(RECON, "no place to cache the system matrix: PYROVOX_CACHE, XDG_CACHE_HOME and HOME "
                     "are unset; it is built again every time");
    else if (pvx_mkdirs(dir, &d) != PVX_OK)
        LOG_W(RECON, "the system matrix is not cached: %s", d.text);
    else
        n = snprintf(out, PATH_MAX, "%s/sysmat-%016llx.pvxm", dir, (unsigned long long)key);
    if (n >= PATH_MAX) {
        LOG_W(RECON, "the system matrix is not cached: path too long");
        out[0] = '\0';
    }
}

pvx_err rec_sysmat_open(const struct rec_rig *rig, const struct rec_sysmat_params *p,
                        const char *path, pvx_pool *pool, struct rec_progress progress,
                        rec_sysmat **out, struct pvx_diag *d)
{
    char file[PATH_MAX];
    uint64_t key;
    *out = NULL;
    PVX_TRY(rec_sysmat_key(rig, p, &key, d));
    choose_file(path, key, file);
    if (file[0] != '\0') {
        struct pvx_diag why = {""};
        pvx_err e = rec_sysmat_load(file, key, true, pool, out, &why);
        if (e == PVX_OK) {
            (*out)->cached = true;
            if (path == NULL)
                (void)utimensat(AT_FDCWD, file, NULL,
                                0); /* used now; where it may not, it looks older */
            return PVX_OK;
        }
        if (e == PVX_EFORMAT && path != NULL)
            return pvx_fail(d, e, "%s; it is left alone, name another file", why.text);
        if (e != PVX_ENOENT)
            LOG_W(RECON, "building the system matrix anew: %s", pvx_diag_text(&why, e));
    }
    PVX_TRY(rec_sysmat_build(rig, p, pool, progress.call, progress.ctx, out, d));
    if (file[0] != '\0') {
        struct pvx_diag why = {""};
        pvx_err e = rec_sysmat_save(*out, file, pool, &why);
        if (e != PVX_OK)
            LOG_W(RECON, "the system matrix is not cached: %s", pvx_diag_text(&why, e));
        else if (path == NULL)
            cache_trim(file);
    }
    return PVX_OK;
}
