#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/file.h"
#include "base/log.h"
#include "recon/matrix/sysmat.h"

/* Folder for caches, by the first variable that is set; NULL when none is. */
static bool cache_dir(char *out, size_t size)
{
    static const struct {
        const char *env, *below;
    } places[] = {
        {"PYROVOX_CACHE", ""}, {"XDG_CACHE_HOME", "/pyrovox"}, {"HOME", "/.cache/pyrovox"}};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        const char *v = getenv(places[i].env);
        if (v == NULL || *v == '\0')
            continue;
        int n = snprintf(out, size, "%s%s", v, places[i].below);
        return n > 0 && (size_t)n < size;
    }
    return false;
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
    else if (!cache_dir(dir, sizeof dir))
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
    }
    return PVX_OK;
}
