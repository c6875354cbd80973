/* frames_in_impl.h - what frames_in.c, frames_find.c, frames_look.c and frames_background.c share.  Private to them. */
#ifndef FRAMES_IN_IMPL_H
#define FRAMES_IN_IMPL_H
#include "daemon/cli/common/frames_in.h"

/* One set of the recording. */
struct frames_in_set {
    int64_t number;
    const int64_t *row; /* [cameras] */
};
static inline struct frames_in_set frames_in_set_of(const struct frames_in *f, size_t i)
{
    return (struct frames_in_set){f->number[i], f->row + i * f->rig->n_cameras};
}
static inline bool frames_in_there(const struct frames_in *f, size_t i, size_t c)
{
    return f->row[i * f->rig->n_cameras + c] >= 0;
}

/* frames_find.c: writes number, row, t_ns, reel or take. */
bool frames_in_is_list(const char *text);
PVX_MUST_CHECK pvx_err frames_in_find(struct frames_in *f, int64_t first, int64_t last,
                                      struct pvx_diag *d);
/* frames_look.c: sets the number of channels, from pictures of all cameras. */
PVX_MUST_CHECK pvx_err frames_in_look(struct frames_in *f, struct pvx_diag *d);

/* One picture of a set; owner: caller, cap_loaded_free. */
PVX_MUST_CHECK pvx_err frames_in_load_one(const struct frames_in *f, struct frames_in_set s,
                                          size_t c, struct cap_loaded *l, struct pvx_diag *d);
/* Give a loaded image the pixel format that the user wants.  If it does not fit, the image is freed. */
PVX_MUST_CHECK pvx_err frames_in_read_as(const struct frames_in *f, const char *path,
                                         struct cap_loaded *l, struct pvx_diag *d);
/* The pictures of the cameras in `which` end at so many bits: say it, once. */
void frames_in_say_bits(const struct frames_in *f, uint64_t which, int bits, enum cap_pixfmt fmt);

#endif
