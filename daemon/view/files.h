/* files.h - the page's files, compiled in: no folder is read, so no path can lead out of it. */
#ifndef VIEW_FILES_H
#define VIEW_FILES_H
#include <stddef.h>

struct view_file {
    const char *name, *type; /* "main.js", "text/javascript; charset=utf-8" */
    const unsigned char *begin, *end;
};
/* path: of a request; "/" is the page itself.  NULL: no such file. */
const struct view_file *view_file_find(const char *path);
const struct view_file *view_files(size_t *n);
#endif
