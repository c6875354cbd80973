#include "daemon/doctor/host.h"

#include <ctype.h>
#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "base/yaml.h"

#define MAX_FILE ((size_t)4 << 20)

/* root + formatted path; "", which no file has, when it does not fit. */
PVX_PRINTF(3, 0)
static void full_path(const struct doc_host *h, char out[PATH_MAX], const char *fmt, va_list ap)
{
    int n = snprintf(out, PATH_MAX, "%s", h->root);
    int m = n < PATH_MAX ? vsnprintf(out + n, PATH_MAX - (size_t)n, fmt, ap) : PATH_MAX;
    if (n + m >= PATH_MAX)
        out[0] = '\0';
}

/* The same in a function with the arguments (h, ..., fmt, ...). */
#define FULL_PATH(path)               \
    do {                              \
        va_list ap_;                  \
        va_start(ap_, fmt);           \
        full_path(h, path, fmt, ap_); \
        va_end(ap_);                  \
    } while (0)

static void host_trim(char *s)
{
    size_t n = strlen(s);
    while (n > 0 && isspace((unsigned char)s[n - 1]))
        s[--n] = '\0';
}

static bool read_text(const char *path, char *out, size_t size)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    out[0] = '\0';
    if (fd < 0)
        return false;
    size_t n = 0;
    ssize_t r = 1;
    while (n < size - 1 && r > 0) {
        r = read(fd, out + n, size - 1 - n);
        if (r > 0)
            n += (size_t)r;
    }
    close(fd);
    out[n] = '\0';
    host_trim(out);
    return r >= 0;
}

bool doc_text(struct doc_host *h, char *out, size_t size, const char *fmt, ...)
{
    char path[PATH_MAX];
    FULL_PATH(path);
    return read_text(path, out, size);
}

char *doc_file(struct doc_host *h, const char *fmt, ...)
{
    char path[PATH_MAX], *text = NULL;
    FULL_PATH(path);
    size_t len;
    if (pvx_file_read(path, MAX_FILE, &text, &len, NULL) != PVX_OK)
        return NULL;
    return text;
}

bool doc_int(struct doc_host *h, int64_t *out, const char *fmt, ...)
{
    char path[PATH_MAX], text[64];
    FULL_PATH(path);
    return read_text(path, text, sizeof text) &&
           pvx_parse_int(text, INT64_MIN / 2, INT64_MAX / 2, out) == PVX_OK;
}

bool doc_access(struct doc_host *h, int mode, const char *fmt, ...)
{
    char path[PATH_MAX];
    FULL_PATH(path);
    return access(path, mode) == 0;
}

static int host_by_name(const void *a, const void *b)
{
    return strcmp(a, b);
}

struct doc_names *doc_names(struct doc_host *h, const char *fmt, ...)
{
    char path[PATH_MAX];
    FULL_PATH(path);
    struct doc_names *out = malloc(sizeof *out);
    DIR *dir = out != NULL ? opendir(path) : NULL;
    if (out != NULL)
        out->n = 0;
    if (dir == NULL)
        return out;
    struct dirent *e;
    while ((e = readdir(dir)) != NULL && out->n < DOC_MAX_NAMES)
        if (e->d_name[0] != '.' && strlen(e->d_name) < sizeof out->v[0])
            snprintf(out->v[out->n++], sizeof out->v[0], "%s", e->d_name);
    closedir(dir);
    qsort(out->v, out->n, sizeof out->v[0], host_by_name);
    return out;
}

bool doc_process(struct doc_host *h, const char *comm, int *pid)
{
    char path[PATH_MAX], name[64];
    snprintf(path, sizeof path, "%s/proc", h->root);
    DIR *dir = opendir(path);
    struct dirent *e;
    bool found = false;
    while (dir != NULL && !found && (e = readdir(dir)) != NULL) {
        if (!isdigit((unsigned char)e->d_name[0]) ||
            !doc_text(h, name, sizeof name, "/proc/%.20s/comm", e->d_name))
            continue;
        found = strcmp(name, comm) == 0;
        if (found && pid != NULL)
            *pid = atoi(e->d_name);
    }
    if (dir != NULL)
        closedir(dir);
    return found;
}
