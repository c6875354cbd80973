/* images_impl.h - what images.c and images_judge.c share.  Private to daemon/pipeline. */
#ifndef DMN_IMAGES_IMPL_H
#define DMN_IMAGES_IMPL_H
#include <stdatomic.h>
#include "capture/pixel/jpeg.h"
#include "daemon/pipeline/images.h"

#define DMN_IMAGES_BANDS 4 /* an image is converted in so many pieces */

struct dmn_images {
    struct dmn_images_params p;
    const struct rec_rig *rig;
    pvx_pool *pool;
    cap_jpeg *decoder[REC_MAX_CAMERAS]; /* NULL: no JPEG will come */
    struct cap_maps *maps[REC_MAX_CAMERAS];
    enum cap_pixfmt maps_for[REC_MAX_CAMERAS]; /* NONE: not made, nor tried */
    bool coloured[REC_MAX_CAMERAS];            /* the camera's last picture was */
    _Atomic float black;                       /* that is subtracted later */
    struct pvx_diag maps_why[REC_MAX_CAMERAS];
    /* one set: */
    struct cap_image image[REC_MAX_CAMERAS]; /* data NULL = missing or bad */
    struct pvx_diag why[REC_MAX_CAMERAS];
    float saturated[REC_MAX_CAMERAS]; /* value of saturated bins, 0: 1 */
    int fault[REC_MAX_CAMERAS];       /* enum dmn_image_fault, DMN_N_IMAGE = none */
    _Atomic int bad[REC_MAX_CAMERAS];
    struct cap_depth depth[REC_MAX_CAMERAS][DMN_IMAGES_BANDS];
    int32_t row; /* the first that is looked at */
    /* all sets: */
    struct cap_depth all[REC_MAX_CAMERAS]; /* words of 16 bits */
    int bits[REC_MAX_CAMERAS];
    float *const *out; /* NULL: the pictures stay raw */
    struct cap_convert_params how[REC_MAX_CAMERAS];
    uint64_t number; /* of the set */

    atomic_uint_fast64_t count[REC_MAX_CAMERAS][DMN_N_IMAGE];
};

/* Before binning: pictures that do not fit the others, or the black level, are not used. */
void dmn_images_check(dmn_images *i);
/* After binning: whether camera c's pixels are there.  If not, an image that came is counted by its fault. */
bool dmn_images_account(dmn_images *i, bool came, size_t c);
#endif
