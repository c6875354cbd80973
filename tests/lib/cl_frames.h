/* cl_frames.h - frame sets of tests/unit/test_cl_frame*.c, solved on a device and on the processors (card_pair.h). */
#ifndef TESTS_CL_FRAMES_H
#define TESTS_CL_FRAMES_H
#include "tests/lib/scene.h"
#include "tests/lib/card_pair.h"
#include "tests/lib/cl_fault.h"

static rec_cl *cl;

static inline struct rec_frame_params frame_params(int nch)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.nch = nch;
    p.photo.saturation = 1e30F;
    return p;
}

/* scene_new with this basis. */
static inline void scene_of(struct scene *s, size_t cameras, int32_t w, int32_t grid,
                            enum rec_basis basis)
{
    const struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 2};
    scene_new(s, cameras, w, grid, 1, 2);
    rec_sysmat_free(&s->S);
    s->rig.grid.basis = basis;
    T_EQ_I(rec_sysmat_build(&s->rig, &p, s->pool, NULL, NULL, &s->S, NULL), PVX_OK);
}

/* Pictures of the scene for the pair; with one channel, the first. */
static inline void shoot(const struct scene *s, struct card_pair *p, double noise)
{
    if (p->here->cs == 4) {
        scene_shoot(s, p->here, noise);
        return;
    }
    rec_frame_reset(p->here);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        float *in = rec_frame_input(p->here, c);
        rec_frame_camera(p->here, c)->present = true;
        for (size_t i = 0; i < s->S->row0[c + 1] - s->S->row0[c]; i++)
            in[i] = s->image[c][i * 4] + (float)(noise * t_normal());
    }
}

static inline void take(struct card_pair *p, const struct rec_sparse *before_here,
                        const struct rec_sparse *before_there)
{
    card_pair_take(p, before_here, before_there);
    T_EQ_I(p->wrong, 0);
}

#endif
