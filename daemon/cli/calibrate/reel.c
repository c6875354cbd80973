#include "daemon/cli/calibrate/reel.h"

#include <stdlib.h>
#include <string.h>

pvx_err calibrate_reel_open(struct calibrate_reel *r, const struct calibrate_look *l, size_t camera,
                            struct pvx_diag *d)
{
    *r = (struct calibrate_reel){.l = l, .camera = camera};
    if (l->source == CALIBRATE_VIDEOS) {
        struct cap_video_info info = {0};
        pvx_err e = cap_video_open(l->video[camera], &r->video, &info, d);
        r->fps = info.fps;
        return e;
    }
    uint32_t c = (uint32_t)l->take_camera[camera];
    const struct cap_take_camera *k = &cap_take_info(l->take)->head.camera[c];
    r->size = cap_take_frame_max(l->take, c);
    r->mem = malloc(r->size > 0 ? r->size : 1);
    if (r->mem == NULL)
        return PVX_ENOMEM;
    return k->fmt == CAP_JPEG ? cap_jpeg_new(k->width, k->height, &r->jpeg) : PVX_OK;
}

static pvx_err from_video(struct calibrate_reel *r, uint32_t number, struct cap_image *img,
                          struct pvx_diag *d)
{
    for (; r->next < number; r->next++)
        PVX_TRY(cap_video_next(r->video, NULL, NULL, d));
    PVX_TRY(cap_video_next(r->video, img, NULL, d));
    r->next++;
    return PVX_OK;
}

static pvx_err from_take(struct calibrate_reel *r, uint32_t number, struct cap_image *img,
                         struct pvx_diag *d)
{
    const cap_take *t = r->l->take;
    const int64_t *member;
    uint32_t c = (uint32_t)r->l->take_camera[r->camera];
    int64_t k = cap_take_find_set(t, number);
    if (k < 0 || cap_take_set(t, (uint64_t)k, &member) == NULL || member[c] < 0)
        return PVX_ENOENT;
    PVX_TRY(cap_take_read(t, c, (uint64_t)member[c], r->mem, r->size, img, d));
    if (img->fmt != CAP_JPEG)
        return PVX_OK;
    struct pvx_diag why = {""};
    const struct cap_image coded = *img;
    pvx_err e = cap_jpeg_decode(r->jpeg, &coded, img, &why);
    return e == PVX_OK ? e
                       : pvx_fail(d, e, "%s: camera %s, set %u: %s", r->l->video[0],
                                  r->l->camera[r->camera].name, number, pvx_diag_text(&why, e));
}

pvx_err calibrate_reel_read(struct calibrate_reel *r, uint32_t number, struct cap_image *img,
                            struct pvx_diag *d)
{
    return r->video != NULL ? from_video(r, number, img, d) : from_take(r, number, img, d);
}

void calibrate_reel_close(struct calibrate_reel *r)
{
    cap_video_close(&r->video);
    cap_jpeg_free(&r->jpeg);
    free(r->mem);
    *r = (struct calibrate_reel){0};
}
