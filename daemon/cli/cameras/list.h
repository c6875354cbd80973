/* list.h - the cameras that each backend finds, and possible reasons if it finds none. */
#ifndef CAMERAS_LIST_H
#define CAMERAS_LIST_H
#include "capture/source/source.h"

#define CAMERAS_MAX 512
struct cameras_list {
    size_t n_backends;
    struct cameras_backend {
        const struct cap_source_ops *ops;
        bool lists; /* it can list its cameras */
        size_t first, n;
        struct pvx_diag error; /* "" = none; cameras found before the error count */
        char why[400];         /* possible reason if nothing was found */
    } backend[16];
    size_t n;
    struct cameras_item {
        char *uri, *text, *formats; /* formats NULL = not known */
    } item[CAMERAS_MAX];
};

/* Ask all backends, or only the one of this scheme (NULL = all).  An error of one does not stop the others.
 * n_backends is 0 if there is no such scheme.  Owner: caller, cameras_fini. */
void cameras_find(const char *scheme, struct cameras_list *out);
void cameras_fini(struct cameras_list *l);

/* Summarize formats: for each pixel format its largest picture, the rates of that, and the number of other sizes.
 * Equal ones are put together: "YUYV 640x480 15 30 Hz (+3 sizes); Mono8, RGB8 1920x1080 30 Hz".
 * Lines of another shape stay as they are. */
void cameras_formats(const char *formats, char *out, size_t size);
#endif
