#include "base/module.h"

#include <dlfcn.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"

static const void *try_folder(struct pvx_module *w, const char *dir, const char *below)
{
    char path[PATH_MAX];
    int n = snprintf(path, sizeof path, "%s%s/%s", dir, below, w->file);
    if (n < 0 || (size_t)n >= sizeof path || access(path, R_OK) != 0)
        return NULL;
    void *so = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (so == NULL) {
        const char *text = dlerror();
        snprintf(w->why, sizeof w->why, "%.700s", text != NULL ? text : path);
        return NULL;
    }
    const void *(*entry)(void);
    *(void **)&entry = dlsym(so, w->entry);
    const int *module = entry != NULL ? entry() : NULL;
    if (module == NULL || *module != w->version) {
        snprintf(w->why, sizeof w->why, "%.700s is of another version of pyrovox", path);
        dlclose(so);
        return NULL;
    }
    return module;
}

static void module_load(struct pvx_module *m)
{
    char exe[PATH_MAX] = "";
    const char *env = getenv("PYROVOX_LIBDIR");
    if (env != NULL && *env != '\0') {
        m->is = try_folder(m, env, "");
    } else if (pvx_exe_dir(exe, sizeof exe) == PVX_OK) {
        m->is = try_folder(m, exe, "/../lib/pyrovox");
        if (m->is == NULL)
            m->is = try_folder(m, exe, "/../lib/" PVX_MULTIARCH "/pyrovox");
    }
    if (m->is == NULL && m->why[0] == '\0')
        snprintf(m->why, sizeof m->why,
                 "%s not found in %.600s (package %.*s, or PYROVOX_LIBDIR names its folder)",
                 m->file, env != NULL && *env != '\0' ? env : "../lib/pyrovox of the program",
                 (int)strcspn(m->file, "."), m->file);
}

const void *pvx_module(struct pvx_module *m)
{
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&lock);
    if (!m->tried)
        module_load(m);
    m->tried = true;
    pthread_mutex_unlock(&lock);
    return m->is;
}
