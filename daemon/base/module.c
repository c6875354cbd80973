#include "base/module.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"

struct wanted {
    const char *file, *entry;
    int version;
    char *why;
    size_t size;
};

static const void *try_folder(const struct wanted *w, const char *dir, const char *below)
{
    char path[PATH_MAX];
    int n = snprintf(path, sizeof path, "%s%s/%s", dir, below, w->file);
    if (n < 0 || (size_t)n >= sizeof path || access(path, R_OK) != 0)
        return NULL;
    void *so = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (so == NULL) {
        const char *text = dlerror();
        snprintf(w->why, w->size, "%.700s", text != NULL ? text : path);
        return NULL;
    }
    const void *(*entry)(void);
    *(void **)&entry = dlsym(so, w->entry);
    const int *module = entry != NULL ? entry() : NULL;
    if (module == NULL || *module != w->version) {
        snprintf(w->why, w->size, "%.700s is of another version of pyrovox", path);
        dlclose(so);
        return NULL;
    }
    return module;
}

const void *pvx_module_load(const char *file, const char *entry, int version, char *why,
                            size_t size)
{
    struct wanted w = {file, entry, version, why, size};
    char exe[PATH_MAX] = "";
    const char *env = getenv("PYROVOX_LIBDIR");
    const void *m = NULL;
    why[0] = '\0';
    if (env != NULL && *env != '\0') {
        m = try_folder(&w, env, "");
    } else if (pvx_exe_dir(exe, sizeof exe) == PVX_OK) {
        m = try_folder(&w, exe, "/../lib/pyrovox");
        if (m == NULL)
            m = try_folder(&w, exe, "/../lib/" PVX_MULTIARCH "/pyrovox");
    }
    if (m == NULL && why[0] == '\0')
        snprintf(why, size,
                 "%s not found in %.600s (package %.*s, or PYROVOX_LIBDIR names its folder)", file,
                 env != NULL && *env != '\0' ? env : "../lib/pyrovox of the program",
                 (int)strcspn(file, "."), file);
    return m;
}
