#include "framedir.h"

#include <ctype.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

static const char *const exts[] = {"npy", "png", "tif", "tiff", "jpg"};
#define N_EXT (sizeof exts / sizeof exts[0])

struct found {
    uint32_t number;
    uint16_t camera;
    uint8_t ext; /* + 1 */
};

/* "000012.png" -> 12, type + 1; 0 when the name is not a frame's. */
static uint8_t parse_name(const char *name, uint32_t *number)
{
    size_t digits = strspn(name, "0123456789");
    if (digits != 6 || name[6] != '.')
        return 0;
    for (size_t e = 0; e < N_EXT; e++)
        if (strcmp(name + 7, exts[e]) == 0) {
            *number = (uint32_t)strtoul(name, NULL, 10);
            return (uint8_t)(e + 1);
        }
    return 0;
}

static int by_number(const void *a, const void *b)
{
    const struct found *x = a, *y = b;
    if (x->number != y->number)
        return x->number < y->number ? -1 : 1;
    if (x->camera != y->camera)
        return x->camera < y->camera ? -1 : 1;
    return (int)x->ext - (int)y->ext; /* .npy first */
}

static pvx_err scan_camera(const char *dir, const struct rec_camera *cam, size_t c,
                           struct found **list, size_t *n, size_t *cap)
{
    char path[4200];
    snprintf(path, sizeof path, "%s/%s", dir, cam->name);
    DIR *h = opendir(path);
    if (h == NULL)
        return PVX_OK; /* no folder: no frames of this camera */
    struct dirent *e;
    pvx_err err = PVX_OK;
    while ((e = readdir(h)) != NULL && err == PVX_OK) {
        struct found f = {.camera = (uint16_t)c};
        f.ext = parse_name(e->d_name, &f.number);
        if (f.ext == 0)
            continue;
        if (*n == *cap) {
            size_t bigger = *cap * 2 + 256;
            struct found *grown = realloc(*list, bigger * sizeof *grown);
            if (grown == NULL) {
                err = PVX_ENOMEM;
                break;
            }
            *list = grown;
            *cap = bigger;
        }
        (*list)[(*n)++] = f;
    }
    closedir(h);
    return err;
}

pvx_err dmn_framedir_scan(const char *dir, const struct rec_rig *rig, struct dmn_framedir *out,
                          struct pvx_diag *d)
{
    memset(out, 0, sizeof *out);
    if (strlen(dir) >= sizeof out->dir)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", dir);
    snprintf(out->dir, sizeof out->dir, "%s", dir);
    out->n_cameras = rig->n_cameras;
    struct found *list = NULL;
    size_t n = 0, cap = 0;
    pvx_err e = PVX_OK;
    for (size_t c = 0; c < rig->n_cameras && e == PVX_OK; c++)
        e = scan_camera(dir, &rig->cameras[c], c, &list, &n, &cap);
    if (e == PVX_OK && n == 0)
        e = pvx_fail(d, PVX_ENOENT,
                     "%s: no frames for the rig's cameras; looked for %s/%s/000000.(npy|png|tif)",
                     dir, dir, rig->cameras[0].name);
    if (e == PVX_OK) {
        qsort(list, n, sizeof *list, by_number);
        out->number = pvx_calloc(n, sizeof *out->number);
        out->ext = pvx_calloc(n * rig->n_cameras, 1);
        if (out->number == NULL || out->ext == NULL)
            e = PVX_ENOMEM;
    }
    for (size_t i = 0; i < n && e == PVX_OK; i++) {
        if (out->n_frames == 0 || out->number[out->n_frames - 1] != list[i].number)
            out->number[out->n_frames++] = list[i].number;
        uint8_t *ext = &out->ext[(out->n_frames - 1) * rig->n_cameras + list[i].camera];
        if (*ext == 0)
            *ext = list[i].ext;
    }
    free(list);
    if (e != PVX_OK) {
        dmn_framedir_fini(out);
        return pvx_fail(d, e, "%s: out of memory", dir);
    }
    return PVX_OK;
}

void dmn_framedir_fini(struct dmn_framedir *f)
{
    PVX_FREE(f->number);
    PVX_FREE(f->ext);
    f->n_frames = 0;
}

bool dmn_framedir_path(const struct dmn_framedir *f, const struct rec_rig *rig, size_t i, size_t c,
                       char *buf, size_t size)
{
    uint8_t ext = f->ext[i * f->n_cameras + c];
    if (ext == 0)
        return false;
    int n = snprintf(buf, size, "%s/%s/%06u.%s", f->dir, rig->cameras[c].name, f->number[i],
                     exts[ext - 1]);
    return n > 0 && (size_t)n < size;
}
