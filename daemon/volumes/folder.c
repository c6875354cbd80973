#include "daemon/volumes/folder.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/file.h"

/* As strcmp, but digits that follow each other count as one number.  0: the names differ in leading zeros at most. */
static int folder_compare(const char *a, const char *b)
{
    while (*a != '\0' && *b != '\0') {
        if (!isdigit((unsigned char)*a) || !isdigit((unsigned char)*b)) {
            if (*a != *b)
                break;
            a++;
            b++;
            continue;
        }
        a += strspn(a, "0");
        b += strspn(b, "0");
        size_t n = strspn(a, "0123456789"), m = strspn(b, "0123456789");
        int by = n != m ? (n < m ? -1 : 1) : strncmp(a, b, n);
        if (by != 0)
            return by;
        a += n;
        b += n;
    }
    return (unsigned char)*a - (unsigned char)*b;
}

static int folder_order(const struct dirent **a, const struct dirent **b)
{
    return folder_compare((*a)->d_name, (*b)->d_name);
}

pvx_err vol_folder_list(const char *dir, const char *end, struct vol_folder *out,
                        struct pvx_diag *d)
{
    struct dirent **entry;
    *out = (struct vol_folder){0};
    int n = scandir(dir, &entry, NULL, folder_order);
    if (n < 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    out->name = calloc((size_t)n + 1, sizeof *out->name);
    pvx_err e = out->name != NULL ? PVX_OK : PVX_ENOMEM;
    for (int i = 0; i < n; i++) {
        const char *name = entry[i]->d_name;
        if (e == PVX_OK && name[0] != '.' && pvx_path_ends(name, end)) {
            out->name[out->n] = strdup(name);
            e = out->name[out->n] != NULL ? PVX_OK : PVX_ENOMEM;
            out->n += e == PVX_OK;
        }
        free(entry[i]);
    }
    free(entry);
    for (size_t i = 1; i < out->n && e == PVX_OK; i++)
        if (folder_compare(out->name[i - 1], out->name[i]) == 0)
            e = pvx_fail(d, PVX_EFORMAT, "%s: %s and %s have one number; move one of them away",
                         dir, out->name[i - 1], out->name[i]);
    return e;
}

bool vol_sd_path(const char *npy, char *out, size_t size)
{
    const char *slash = strrchr(npy, '/'), *name = slash != NULL ? slash + 1 : npy;
    return snprintf(out, size, "%.*s" VOL_SD "/%s", (int)(name - npy), npy, name) < (int)size;
}

void vol_folder_free(struct vol_folder *f)
{
    for (size_t i = 0; i < f->n; i++)
        free(f->name[i]);
    free(f->name);
    *f = (struct vol_folder){0};
}

bool vol_folder_has(const char *path, const char *end)
{
    struct stat st;
    struct vol_folder f;
    if (stat(path, &st) != 0)
        return false;
    if (!S_ISDIR(st.st_mode))
        return pvx_path_ends(path, end);
    pvx_err e = vol_folder_list(path, end, &f, NULL);
    bool has = f.n > 0 && (e == PVX_OK || e == PVX_EFORMAT);
    vol_folder_free(&f);
    return has;
}
