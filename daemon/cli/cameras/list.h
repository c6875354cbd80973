/* list.h - what every backend sees, and why one that sees nothing may not. */
#ifndef CAMERAS_LIST_H
#define CAMERAS_LIST_H
#include "capture/source/source.h"

#define CAMERAS_MAX 512
struct cameras_list {
    size_t n_backends;
    struct cameras_backend {
        const struct cap_source_ops *ops;
        bool lists; /* it can say what there is */
        size_t first, n;
        struct pvx_diag error; /* "" = none; cameras found before it count all the same */
        char why[400];         /* nothing was found: what the reason may be */
    } backend[16];
    size_t n;
    struct cameras_item {
        char *uri, *text, *formats; /* formats NULL = not known */
    } item[CAMERAS_MAX];
};

/* Ask all backends, or the one of this scheme (NULL = all); the error of one hides no other.
 * n_backends is 0 when there is no such scheme.  Owner: caller, cameras_fini. */
void cameras_find(const char *scheme, struct cameras_list *out);
void cameras_fini(struct cameras_list *l);

/* Formats in few words: of each pixel format the largest picture, its rates and how many sizes more, and
 * those that are alike together: "YUYV 640x480 15 30 Hz (+3 sizes); Mono8, RGB8 1920x1080 30 Hz".
 * Lines of another shape stay as they are. */
void cameras_formats(const char *formats, char *out, size_t size);
#endif
