#include "daemon/cli/calibrate/reel.h"

#include <stdlib.h>

pvx_err calibrate_reel_open(struct calibrate_reel *r, struct calibrate_look *l, size_t camera,
                            struct pvx_diag *d)
{
    (void)d;
    *r = (struct calibrate_reel){.l = l, .camera = camera};
    if (l->source == CALIBRATE_REELS)
        return PVX_OK;
    uint32_t c = (uint32_t)l->take_camera[camera];
    const struct cap_take_camera *k = &cap_take_info(l->take)->head.camera[c];
    r->size = cap_take_frame_max(l->take, c);
    r->mem = malloc(r->size > 0 ? r->size : 1);
    if (r->mem == NULL)
        return PVX_ENOMEM;
    return k->fmt == CAP_JPEG ? cap_jpeg_new(k->width, k->height, &r->jpeg) : PVX_OK;
}

static pvx_err from_reel(struct calibrate_reel *r, uint32_t number, struct cap_image *img,
                         struct pvx_diag *d)
{
    const struct cap_pairs *p = &r->l->pairs;
    size_t k = number < p->n && p->number[number] == number ? number : 0; /* as a rule */
    while (k < p->n && p->number[k] != number)
        k++;
    int64_t row = k < p->n ? p->row[k * r->l->n_cameras + r->camera] : -1;
    cap_loaded_free(&r->loaded);
    if (row < 0)
        return PVX_ENOENT;
    pvx_err e = cap_reel_load(&r->l->reel[r->camera], (size_t)row, &r->loaded, d);
    *img = r->loaded.img;
    return e;
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
                       : pvx_fail(d, e, "%s: camera %s, set %u: %s", r->l->path,
                                  r->l->camera[r->camera].name, number, pvx_diag_text(&why, e));
}

pvx_err calibrate_reel_read(struct calibrate_reel *r, uint32_t number, struct cap_image *img,
                            struct pvx_diag *d)
{
    return r->l->take == NULL ? from_reel(r, number, img, d) : from_take(r, number, img, d);
}

void calibrate_reel_close(struct calibrate_reel *r)
{
    cap_loaded_free(&r->loaded);
    cap_jpeg_free(&r->jpeg);
    free(r->mem);
    *r = (struct calibrate_reel){0};
}
