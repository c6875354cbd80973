#include "capture/pixel/recipe.h"

#include "capture/pixel/pixfmt_priv.h"

_Static_assert(CAP_RECIPE_FACTOR == CAP_MAP_FACTOR, "the bits of a word that are its factor");

static void recipe_maps(const struct cap_maps *m, struct cap_recipe *out)
{
    size_t bins = (size_t)(m->width / m->p.binning) * (size_t)(m->height / m->p.binning);
    out->maps = m->number;
    out->whole = m->n_patches < bins;
    out->most = m->saturated;
    out->word = m->word;
    out->plane = m->plane;
    out->planes = m->planes;
    out->mask = m->mask;
    out->matrix = m->has_matrix ? m->matrix : NULL;
}

static void recipe_yuv(const struct cap_yuv_coef *k, struct cap_recipe *out)
{
    out->depth = 12;
    out->y = k->y[0];
    for (int c = 0; c < 3; c++) {
        out->cb[c] = k->cb[c];
        out->cr[c] = k->cr[c];
        out->at[c] = k->at0[c];
    }
}

pvx_err cap_recipe_of(const struct cap_image *img, const struct cap_convert_params *p,
                      struct cap_recipe *out)
{
    struct cap_pix j;
    enum cap_layout layout = cap_pixfmt_layout(img->fmt);
    PVX_TRY(cap_pix_check(img, p, 0, 0, &j));
    if (j.full == 0 || layout == CAP_LAYOUT_JPEG)
        return PVX_EUNSUP;
    *out = (struct cap_recipe){.samples = j.samples,
                               .depth = cap_pixfmt_depth(img->fmt),
                               .grey = j.grey,
                               .swapped = j.swapped,
                               .rays = j.rays,
                               .cell = j.cell,
                               .clip = j.clip,
                               .most = j.most,
                               .table = j.table,
                               .full = j.scale_full,
                               .unit = j.unit};
    if (layout == CAP_LAYOUT_YUV)
        recipe_yuv(&j.yuv, out);
    if (j.maps != NULL)
        recipe_maps(j.maps, out);
    return PVX_OK;
}
