/* instant_file.c - the folder of a snapshot. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/pipeline/instant.h"
#include "daemon/volumes/bricks.h"

#define PART       ".part"
#define SPACE_MORE (32u << 20) /* bytes for the texts and for other programs that write meanwhile */

/* Make the folder that `folder` lies in. */
static pvx_err make_parent(const char *folder, struct pvx_diag *d)
{
    char parent[PATH_MAX];
    snprintf(parent, sizeof parent, "%s", folder);
    char *slash = strrchr(parent, '/');
    if (slash == NULL || slash == parent)
        return PVX_OK;
    *slash = '\0';
    return pvx_mkdirs(parent, d);
}

pvx_err dmn_instant_place(const char *folder, struct pvx_diag *d)
{
    if (strlen(folder) + sizeof PART + 32 > PATH_MAX)
        return pvx_fail(d, PVX_ERANGE, "%s: is too long", folder);
    if (access(folder, F_OK) == 0)
        return pvx_fail(d, PVX_EBUSY, "%s: is there already; name another folder", folder);
    PVX_TRY(make_parent(folder, d));
    char part[PATH_MAX];
    snprintf(part, sizeof part, "%s" PART, folder);
    if (mkdir(part, 0777) != 0)
        return pvx_fail(d, errno == EEXIST ? PVX_EBUSY : pvx_err_from_errno(errno), "%s: %s%s",
                        part, strerror(errno),
                        errno == EEXIST ? ": a snapshot that was cut off; remove it" : "");
    rmdir(part);
    return PVX_OK;
}

static pvx_err pipeline_has_space(const char *folder, const struct dmn_instant_got *got,
                                  uint64_t keep_free_bytes, struct pvx_diag *d)
{
    struct statvfs v;
    uint64_t need = pvp_grid_count(&got->volume.grid) * sizeof(float) + SPACE_MORE;
    for (uint32_t c = 0; c < CAP_MAX_CAMERAS; c++)
        need += got->set->frame[c] != NULL ? got->set->frame[c]->img.size : 0;
    if (statvfs(folder, &v) != 0)
        return PVX_OK;
    uint64_t have = (uint64_t)v.f_bavail * v.f_frsize;
    return have >= need + keep_free_bytes
               ? PVX_OK
               : pvx_fail(d, PVX_ENOSPC,
                          "%s: the disk is full: %.0f MB are left, %.0f are needed and %.0f stay "
                          "free (record.keep_free_gb)",
                          folder, (double)have * 1e-6, (double)need * 1e-6,
                          (double)keep_free_bytes * 1e-6);
}

static pvx_err write_volume(const char *folder, const struct dmn_instant_got *got,
                            const struct dmn_instant_about *about, struct pvx_diag *d)
{
    const struct vol_head head = {about->start, about->head.rig, about->head.config};
    size_t nch = (size_t)got->x.nch;
    float *dense = pvx_calloc(pvp_grid_count(&got->volume.grid), sizeof *dense);
    if (dense == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a volume", folder);
    for (int32_t q = 0; q < got->x.n; q++)
        memcpy(dense + (size_t)got->x.index[q] * nch, got->x.value + (size_t)q * (size_t)got->x.cs,
               nch * sizeof *dense);
    struct vol_store bricks = {0};
    vol_writer *w = NULL;
    pvx_err e = vol_from_dense(&bricks, &got->volume.grid, dense);
    free(dense);
    if (e == PVX_OK)
        e = vol_writer_open(VOL_NPY, folder, &head, &(struct vol_options){0}, &w, d);
    const struct vol_volume v = {.v = got->volume,
                                 .sample = PVP_F32,
                                 .n_bricks = bricks.n,
                                 .ids = bricks.ids,
                                 .brick = bricks.brick};
    PVX_THEN(e, vol_writer_put(w, &v, d));
    if (w != NULL) {
        pvx_err close_error = vol_writer_close(&w, d);
        e = e == PVX_OK ? close_error : e;
    }
    vol_store_free(&bricks);
    return e;
}

static pvx_err sync_it(const char *path, struct pvx_diag *d)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    bool ok = fd >= 0 && fsync(fd) == 0;
    int why = errno;
    if (fd >= 0)
        close(fd);
    return ok ? PVX_OK : pvx_fail(d, pvx_err_from_errno(why), "%s: %s", path, strerror(why));
}

static pvx_err write_take(const char *folder, const struct dmn_instant_got *got,
                          const struct dmn_instant_about *about, struct pvx_diag *d)
{
    char path[PATH_MAX + 16];
    cap_take_writer *w;
    snprintf(path, sizeof path, "%s/raw.h5", folder);
    PVX_TRY(cap_take_create(path, &about->head, &w, d));
    for (uint32_t c = 0; c < about->head.n_cameras; c++) {
        struct cap_health h;
        about->health(about->ctx, c, &h);
        cap_take_about(w, c, h.serial, h.temperature_c);
    }
    pvx_err e = cap_take_put_set(w, got->set, d);
    PVX_THEN(e, cap_take_commit(w, d));
    pvx_err close_error = cap_take_close(&w, d);
    PVX_THEN(e, close_error);
    return e == PVX_OK ? sync_it(path, d) : e;
}

static pvx_err pipeline_write_all(const char *folder, const struct dmn_instant_got *got,
                                  const struct dmn_instant_about *about, struct pvx_diag *d)
{
    char path[PATH_MAX + 16];
    snprintf(path, sizeof path, "%s/status.json", folder);
    PVX_TRY(pipeline_has_space(folder, got, about->keep_free_bytes, d));
    PVX_TRY(write_volume(folder, got, about, d));
    PVX_TRY(write_take(folder, got, about, d));
    PVX_TRY(pvx_file_write(path, about->status, strlen(about->status), d));
    return sync_it(folder, d);
}

/* Remove a folder that holds only files. */
static void remove_it(const char *folder)
{
    DIR *dir = opendir(folder);
    const struct dirent *e;
    while (dir != NULL && (e = readdir(dir)) != NULL)
        unlinkat(dirfd(dir), e->d_name, 0); /* fails for . and .. only */
    if (dir != NULL)
        closedir(dir);
    rmdir(folder);
}

pvx_err dmn_instant_write(const char *folder, const struct dmn_instant_got *got,
                          const struct dmn_instant_about *about, struct pvx_diag *d)
{
    char part[PATH_MAX];
    PVX_TRY(dmn_instant_place(folder, d));
    snprintf(part, sizeof part, "%s" PART, folder);
    if (mkdir(part, 0777) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", part, strerror(errno));
    pvx_err e = pipeline_write_all(part, got, about, d);
    if (e == PVX_OK && rename(part, folder) != 0)
        e = pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", folder, strerror(errno));
    if (e != PVX_OK)
        remove_it(part);
    return e;
}
