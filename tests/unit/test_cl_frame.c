/* test_cl_frame.c - whole frame sets on a device, compared with the processors. */
#include "recon/carve/hull_bricks.h"
#include "recon/matrix/active.h"
#include "tests/lib/cl_frames.h"

/* Errors against the truth agree to a thousandth. */
static void errors_agree(const struct scene *s, const struct card_pair *p)
{
    struct rec_sparse v[2];
    rec_frame_volume(p->here, &v[0]);
    rec_frame_volume(p->there, &v[1]);
    double h = scene_error(s, &v[0]), t = scene_error(s, &v[1]);
    T_LE(t, 1.001 * h);
    T_LE(h, 0.6); /* there is a volume */
}

static void say(const char *what, const struct card_pair *p)
{
    printf("  %s: %lld voxels, %u + %u iterations; volumes differ by %.2g, %.2g of the bound\n",
           what, (long long)p->here->report.active_voxels, p->here->report.coarse_iterations,
           p->here->report.solve.iterations, p->moved, p->worst);
}

T_CASE(colours_and_grey_in_both_bases)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        struct scene s;
        scene_of(&s, 6, 96, 33, (enum rec_basis)basis);
        for (int nch = 1; nch <= 3; nch += 2) {
            struct card_pair p;
            card_pair_new(&p, cl, s.S, &s.rig, frame_params(nch), s.pool);
            shoot(&s, &p, 0.01);
            take(&p, NULL, NULL);
            errors_agree(&s, &p);
            T_OK(p.here->report.solve.renewals > 0 && p.here->report.coarse_iterations > 0);
            say(basis == REC_BOX ? "box" : "trilinear", &p);
            card_pair_free(&p);
        }
        scene_free(&s);
    }
}

T_CASE(mosaics_and_cameras_that_are_missing)
{
    struct scene s;
    struct card_pair p;
    scene_of(&s, 7, 96, 32, REC_TRILINEAR);
    card_pair_new(&p, cl, s.S, &s.rig, frame_params(3), s.pool);
    shoot(&s, &p, 0.01);
    scene_filter(&s, p.here);
    take(&p, NULL, NULL);
    T_OK(p.here->per_channel);
    say("mosaic", &p);
    shoot(&s, &p, 0.01);
    rec_frame_camera(p.here, 0)->present = rec_frame_camera(p.here, 4)->present = false;
    take(&p, NULL, NULL);
    T_EQ_I(p.here->report.cameras, 5);
    errors_agree(&s, &p);
    say("five of seven", &p);
    card_pair_free(&p);
    scene_free(&s);
}

T_CASE(a_camera_that_is_voted_out)
{
    struct scene s;
    struct card_pair p;
    T_NOT_UNDER_SANITIZERS();
    scene_of(&s, 6, 96, 32, REC_BOX);
    card_pair_new(&p, cl, s.S, &s.rig, frame_params(3), s.pool);
    shoot(&s, &p, 0.01);
    float *black = rec_frame_input(p.here, 2);
    for (size_t i = 0; i < (s.S->row0[3] - s.S->row0[2]) * 4; i++)
        black[i] = (float)(0.01 * t_normal());
    take(&p, NULL, NULL);
    T_EQ_I(p.here->report.vote.out, 1u << 2);
    errors_agree(&s, &p);
    say("voted out", &p);
    card_pair_free(&p);
    scene_free(&s);
}

T_CASE(absorption)
{
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    f.absorption = 0.3;
    T_NOT_UNDER_SANITIZERS();
    scene_of(&s, 6, 96, 32, REC_TRILINEAR);
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    say("absorption", &p);
    card_pair_free(&p);
    scene_free(&s);
}

T_CASE(cameras_are_corrected)
{
    static const double gain[6] = {1.1, 0.93, 1, 1.05, 0.9, 1.02};
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    f.trust_all = true;
    scene_of(&s, 6, 96, 32, REC_BOX);
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    shoot(&s, &p, 0.002);
    /* wrong gains, and pictures that lie a bin too far up or down */
    for (size_t c = 0; c < 6; c++) {
        float *in = rec_frame_input(p.here, c);
        size_t w = (size_t)s.S->block[c].bw * 4, n = (s.S->row0[c + 1] - s.S->row0[c]) * 4;
        for (size_t i = 0; i < n; i++)
            in[i] *= (float)gain[c];
        if (c % 2)
            memmove(in + w, in, (n - w) * sizeof *in);
    }
    take(&p, NULL, NULL);
    T_OK(p.here->report.selfcal.gain && p.here->report.selfcal.shift);
    for (size_t c = 0; c < 6; c++) {
        const struct rec_selfcal_camera *h = &p.here->report.selfcal.camera[c],
                                        *t = &p.there->report.selfcal.camera[c];
        T_NEAR((double)t->gain, (double)h->gain, 0.05 * (double)h->gain_error);
        for (int i = 0; i < 2; i++)
            T_NEAR((double)t->shift[i], (double)h->shift[i], 0.05 * (double)h->shift_error[i]);
    }
    say("corrected", &p);
    card_pair_free(&p);
    scene_free(&s);
}

T_CASE(a_part_of_the_matrix)
{
    struct scene s;
    struct card_pair p;
    struct rec_sysmat_params m = {1, 2};
    rec_sysmat *outline = NULL, *part = NULL;
    scene_new(&s, 6, 96, 64, 2, 2);
    T_EQ_I(rec_sysmat_outline(&s.rig, &m, s.pool, (struct rec_progress){0}, &outline, NULL),
           PVX_OK);
    rec_frame *f;
    struct rec_frame_params fp = frame_params(3);
    T_EQ_I(rec_frame_alone(s.S, &s.rig, &fp, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0.01);
    rec_frame_carve(f);
    const uint8_t *lit[REC_MAX_CAMERAS];
    for (size_t c = 0; c < s.rig.n_cameras; c++)
        lit[c] = rec_frame_lit(f, c);
    rec_hull *h;
    T_EQ_I(rec_hull_new(outline, &h), PVX_OK);
    T_OK(rec_hull_bricks(h, &fp.hull, lit, f->believed, s.pool, outline->active->brick) > 0);
    rec_hull_free(&h);
    rec_frame_free(&f);
    T_EQ_I(rec_sysmat_build_active(&s.rig, &outline, s.pool, (struct rec_progress){0}, &part, NULL),
           PVX_OK);
    T_OK(part->active->columns < s.voxels / 2);
    card_pair_new(&p, cl, part, &s.rig, fp, s.pool);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    say("part", &p);
    scene_at(&s, 0.9);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    T_OK(p.here->report.hull.cut > 0);
    card_pair_free(&p);
    rec_sysmat_free(&part);
    scene_free(&s);
}

T_CASE(nothing_burns_and_tiny_grids)
{
    struct scene s;
    struct card_pair p;
    scene_of(&s, 4, 64, 13, REC_BOX);
    T_OK(s.S->coarse == NULL);
    card_pair_new(&p, cl, s.S, &s.rig, frame_params(3), s.pool);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    T_OK(p.here->report.solve.iterations > 0);
    rec_frame_reset(p.here);
    for (size_t c = 0; c < s.rig.n_cameras; c++) {
        memset(rec_frame_input(p.here, c), 0, (s.S->row0[c + 1] - s.S->row0[c]) * 16);
        rec_frame_camera(p.here, c)->present = true;
    }
    take(&p, NULL, NULL);
    T_EQ_I(p.there->report.active_voxels, 0);
    T_EQ_I(p.there->report.solve.status, REC_EMPTY);
    rec_frame_reset(p.here); /* not one camera */
    take(&p, NULL, NULL);
    shoot(&s, &p, 0.01); /* and the slot is as good as new */
    take(&p, NULL, NULL);
    errors_agree(&s, &p);
    card_pair_free(&p);
    scene_free(&s);
}

/* A copy of a volume. */
static struct rec_sparse keep(const rec_frame *f)
{
    struct rec_sparse v;
    rec_frame_volume(f, &v);
    int32_t *index = pvx_calloc((size_t)v.n + 1, sizeof *index);
    float *value = pvx_calloc((size_t)v.n * (size_t)v.cs + 1, sizeof *value);
    memcpy(index, v.index, (size_t)v.n * sizeof *index);
    memcpy(value, v.value, (size_t)v.n * (size_t)v.cs * sizeof *value);
    v.index = index;
    v.value = value;
    return v;
}
static void drop(struct rec_sparse *v)
{
    free((void *)v->index);
    free((void *)v->value);
}

/* With coarser grids and without them; the flame goes on, then jumps. */
T_CASE(warm_starts)
{
    for (int coarse = 0; coarse < 2; coarse++) {
        struct scene s;
        struct card_pair p;
        struct rec_frame_params f = frame_params(3);
        f.coarse_start = coarse;
        scene_of(&s, 6, 96, 32, REC_TRILINEAR);
        card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
        int warm = 0;
        for (int k = 0; k < 3; k++) {
            struct rec_sparse v[2] = {keep(p.here), keep(p.there)};
            scene_at(&s, k < 2 ? 0.3 + 0.002 * k : 0.9);
            shoot(&s, &p, 0.01);
            take(&p, k > 0 ? &v[0] : NULL, k > 0 ? &v[1] : NULL);
            warm += p.there->report.warm;
            drop(&v[0]);
            drop(&v[1]);
        }
        T_LE(1, warm);
        say(coarse ? "warm" : "warm, one grid", &p);
        card_pair_free(&p);
        scene_free(&s);
    }
}

T_CASE(channels_as_one)
{
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    f.solve.blend = REC_BLEND_ON;
    f.solve.tolerance = 5e-4F;
    scene_of(&s, 6, 96, 32, REC_TRILINEAR);
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    T_OK(p.here->report.solve.blended > 0);
    errors_agree(&s, &p);
    say("blended", &p);
    card_pair_free(&p);
    scene_free(&s);
}

T_CASE(other_stops_and_no_time)
{
    struct scene s;
    scene_of(&s, 6, 64, 24, REC_BOX);
    for (int k = 0; k < 3; k++) {
        struct card_pair p;
        struct rec_frame_params f = frame_params(1);
        f.solve.stop = k == 0 ? REC_STOP_DISCREPANCY : REC_STOP_ITERATIONS;
        f.solve.iterations = k == 2 ? 7 : 0;
        f.solve.lambda = k == 2 ? 0.1F : -1;
        card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
        shoot(&s, &p, 0.01);
        take(&p, NULL, NULL);
        card_pair_copy(&p); /* the right-hand side again: pictures of a sort */
        rec_frame_carve(p.there);
        T_EQ_I(rec_frame_solve(p.there, 1, NULL), PVX_OK); /* the deadline is long past */
        T_EQ_I(p.there->report.solve.status, REC_DEADLINE);
        T_OK(p.there->report.on_card && isfinite(p.there->report.solve.rel_residual));
        card_pair_free(&p);
    }
    scene_free(&s);
}

T_MAIN((cl_fault_begin(), cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
