/* source.h - where a bridge's messages come from: a daemon (live.c) or a recording (film.c).
 *
 * Threads: one. */
#ifndef VIEW_SOURCE_H
#define VIEW_SOURCE_H
#include <poll.h>
#include "daemon/view/words.h"
#include "proto/clients/sub.h"

#define VIEW_SOURCE_FDS 2

struct view_source_stats {
    uint64_t received, lost, malformed; /* messages; lost on the way from the daemon */
    char words[192]; /* of a film: the members "film":{...}, JSON without braces around; "" live */
};
struct view_source_ops {
    /* Handles to wait for; returns their number. */
    int (*fds)(void *self, struct pollfd out[VIEW_SOURCE_FDS]);
    /* Mono clock: call `next` then, whatever the handles say. */
    int64_t (*due_ns)(void *self);
    /* The next message that is there already, borrowed until the next call.  PVX_ETIMEDOUT: none.  Other errors are
     * returned once and go away by themselves where they can: PVX_EPERM (refused), PVX_ERANGE (too large). */
    pvx_err (*next)(void *self, struct pvp_header *h, const void **msg, size_t *len,
                    struct pvx_diag *d);
    /* Error bars of the volume that `next` gave last, as a message; NULL: it has none.  Borrowed until `next`. */
    const void *(*bars)(void *self, size_t *len);
    void (*said)(void *self, const struct view_words *w); /* by a page that was let in */
    void (*previews)(void *self, bool wanted);            /* wanted: by any page */
    void (*stats)(void *self, struct view_source_stats *out);
    void (*free)(void *self);
};
struct view_source {
    const struct view_source_ops *ops;
    void *self;
};
/* previews, key: may be NULL.  Errors: those of pvp_sub_new. */
PVX_MUST_CHECK pvx_err view_live_new(const char *endpoint, const char *previews, const char *key,
                                     struct view_source *out, struct pvx_diag *d);
/* Errors: those of vol_reader_open; PVX_ENOENT: no volume in it. */
PVX_MUST_CHECK pvx_err view_film_new(const char *path, struct view_source *out, struct pvx_diag *d);
#endif
