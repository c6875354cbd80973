/* test_cl_fallback.c - frame sets that a device cannot do, or no longer: the processors solve them, with their bits. */
#include "tests/lib/cl_frames.h"

static void same_volumes(const struct card_pair *p)
{
    const rec_frame *h = p->here, *t = p->there;
    T_OK(h->report.active_voxels > 0);
    T_EQ_I(t->report.active_voxels, h->report.active_voxels);
    T_EQ_I(memcmp(h->col, t->col, (size_t)h->report.active_voxels * sizeof *h->col), 0);
    size_t n = (size_t)h->report.active_voxels * (size_t)h->cs;
    T_EQ_I(memcmp(h->x, t->x, n * sizeof *h->x), 0);
    T_EQ_I(t->report.solve.iterations, h->report.solve.iterations);
}

static void carve_both(const struct scene *s, struct card_pair *p)
{
    shoot(s, p, 0.01);
    card_pair_copy(p);
    rec_frame_carve(p->here);
    rec_frame_carve(p->there);
}
static void solve_both(const struct card_pair *p)
{
    T_EQ_I(rec_frame_solve(p->here, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_solve(p->there, 0, NULL), PVX_OK);
    same_volumes(p);
}

T_CASE(a_card_that_is_lost)
{
    struct scene s;
    scene_of(&s, 6, 64, 32, REC_TRILINEAR);
    for (int when = 0; when < 2; when++) { /* in the solve, in the carving */
        struct card_pair p;
        rec_cl *own = cl_bed_open();
        card_pair_new(&p, own, s.S, &s.rig, frame_params(3), s.pool);
        shoot(&s, &p, 0.01);
        take(&p, NULL, NULL);         /* it knew the cameras' state before */
        for (int k = 0; k < 2; k++) { /* and from then on */
            shoot(&s, &p, 0.01);
            card_pair_copy(&p);
            rec_frame_carve(p.here);
            if (when == 1)
                rec_cl_lose(own, "it was pulled out");
            rec_frame_carve(p.there);
            T_OK((p.there->sub->card != NULL) == (when == 0 && k == 0));
            rec_cl_lose(own, "it was pulled out");
            solve_both(&p);
            T_OK(!p.there->report.on_card);
            T_EQ_S(p.there->report.why_here, "it was pulled out");
        }
        card_pair_free(&p);
        rec_cl_close(&own);
    }
    scene_free(&s);
}

/* A device that refuses one thing after the other while a slot is made: it says so, and all is given back. */
T_CASE(a_device_that_refuses_something)
{
    static const char *const functions[] = {"clCreateBuffer", "clCreateCommandQueue",
                                            "clEnqueueMapBuffer", "clCreateKernel"};
    struct scene s;
    struct rec_frame_params p = frame_params(3);
    scene_of(&s, 4, 48, 32, REC_BOX);
    p.card = cl;
    const uint64_t used = atomic_load(&cl->used);
    const long objects = cl_fault_objects();
    for (size_t i = 0; i < sizeof functions / sizeof *functions; i++) {
        int step = strcmp(functions[i], "clCreateKernel") == 0 ? 2 * REC_CL_N_KERNELS : 1, k = 1;
        for (bool happened = true; happened; k += step) {
            struct pvx_diag d = {""};
            char fault[64];
            rec_frame *f;
            snprintf(fault, sizeof fault, "%s:%d:-4", functions[i], k);
            cl_fault(fault);
            pvx_err e = rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, &d);
            happened = cl_fault_happened();
            T_EQ_I(e == PVX_OK, !happened);
            T_EQ_I(f != NULL, !happened);
            T_EQ_I(d.text[0] != '\0', happened);
            rec_frame_free(&f);
            T_OK(rec_cl_lost(cl) == NULL);
            T_EQ_I(atomic_load(&cl->used), used);
            T_EQ_I(cl_fault_objects(), objects);
            if (t_case_fails > 0) {
                printf("  with %s: %s\n", fault, d.text);
                happened = false;
            }
        }
        printf("  %s: %d\n", functions[i], (k - 1) / step);
        T_LE(4, (k - 1) / step);
    }
    cl_fault(NULL);
    scene_free(&s);
}

T_CASE(a_hull_that_has_no_room_on_the_card)
{
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    scene_of(&s, 6, 64, 32, REC_TRILINEAR);
    f.card = cl;
    rec_carver *k;
    rec_solver *v;
    card_pair_new(&p, cl, s.S, &s.rig, frame_params(3), s.pool);
    rec_frame_free(&p.there);
    T_EQ_I(rec_carver_new(s.S, &s.rig, &f, s.pool, &k, NULL), PVX_OK);
    k->columns = 1000;
    T_EQ_I(rec_solver_new(s.S, &f, &v, NULL), PVX_OK);
    T_EQ_I(rec_frame_new(k, v, &p.there, NULL), PVX_OK);
    carve_both(&s, &p);
    T_OK(p.here->report.active_voxels > 1000);
    solve_both(&p);
    T_CONTAINS(p.there->report.why_here, "room for");
    T_OK(rec_cl_lost(cl) == NULL);
    card_pair_free(&p);
    rec_carver_free(&k);
    rec_solver_free(&v);
    scene_free(&s);
}

T_CASE(what_only_processors_can_do)
{
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    scene_of(&s, 6, 64, 24, REC_BOX);
    f.at_least = true;
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    carve_both(&s, &p);
    solve_both(&p);
    T_EQ_S(p.there->report.why_here, rec_frame_card_why_not(&f));
    card_pair_free(&p);

    f = frame_params(3); /* it was asked for while the card was at work */
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    struct rec_solve_params corner = f.solve;
    corner.stop = REC_STOP_LCURVE;
    rec_solver_tune(p.here->solver, &corner);
    rec_solver_tune(p.there->solver, &corner);
    carve_both(&s, &p);
    T_OK(p.there->sub->card != NULL);
    solve_both(&p);
    T_CONTAINS(p.there->report.why_here, "L-curve");
    card_pair_free(&p);
    scene_free(&s);
}

T_MAIN((cl_fault_begin(), cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
