/* test_cl_frame.c - whole frame sets on a device, compared with the processors (tests/lib/card_pair.h). */
#include <pthread.h>
#include <unistd.h>
#include <xxhash.h>

#include "recon/carve/hull_bricks.h"
#include "recon/matrix/active.h"
#include "tests/lib/scene.h"
#include "tests/lib/card_pair.h"
#include "tests/lib/cl_fault.h"

static rec_cl *cl;

static struct rec_frame_params frame_params(int nch)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.nch = nch;
    p.photo.saturation = 1e30F;
    return p;
}

/* scene_new with this basis. */
static void scene_of(struct scene *s, size_t cameras, int32_t w, int32_t grid, enum rec_basis basis)
{
    const struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 2};
    scene_new(s, cameras, w, grid, 1, 2);
    rec_sysmat_free(&s->S);
    s->rig.grid.basis = basis;
    T_EQ_I(rec_sysmat_build(&s->rig, &p, s->pool, NULL, NULL, &s->S, NULL), PVX_OK);
}

/* Pictures of the scene for the pair; with one channel, the first. */
static void shoot(const struct scene *s, struct card_pair *p, double noise)
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

static void take(struct card_pair *p, const struct rec_sparse *before_here,
                 const struct rec_sparse *before_there)
{
    card_pair_take(p, before_here, before_there);
    T_EQ_I(p->wrong, 0);
}

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
    for (size_t c = 0; c < 6;
         c++) { /* wrong gains, and pictures that lie a bin too far up or down */
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

/* ---- the same bits ------------------------------------------------------------------------------*/

/* Another process: prints the hash of a volume, and how many threads the device has. */
static void print_hash(void)
{
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    if (getenv("T_CL_HASH") == NULL)
        return;
    cl = cl_bed_open();
    f.solve.blend = REC_BLEND_ON;
    scene_of(&s, 6, 96, 32, REC_TRILINEAR);
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    size_t n = (size_t)p.there->report.active_voxels;
    printf("hash %016llx %u\n", (unsigned long long)XXH3_64bits(p.there->x, n * 16),
           rec_cl_about(cl)->units);
    exit(t_case_fails > 0);
}

T_CASE(same_bits_from_run_to_run_and_for_any_number_of_threads)
{
    unsigned long long hash[4] = {0};
    T_NOT_UNDER_SANITIZERS();
    for (int k = 0; k < 4; k++) { /* 1, 2, 3, 3 threads */
        char self[PATH_MAX], line[256];
        int threads = k < 3 ? k + 1 : 3;
        unsigned units = 0;
        ssize_t len = readlink("/proc/self/exe", self, sizeof self - 1);
        self[len > 0 ? len : 0] = '\0';
        snprintf(line, sizeof line, "%d", threads);
        setenv("POCL_MAX_PTHREAD_COUNT", line, 1);
        setenv("T_CL_HASH", "1", 1);
        FILE *child = popen(self, "r");
        unsetenv("T_CL_HASH");
        while (child != NULL && fgets(line, sizeof line, child) != NULL)
            if (sscanf(line, "hash %llx %u", &hash[k], &units) != 2)
                printf("%s", line);
        T_EQ_I(child != NULL ? pclose(child) : -1, 0);
        if (strcmp(cl_bed_name(), "Portable") == 0)
            T_EQ_I(units, threads);
        T_OK(hash[k] != 0 && hash[k] == hash[0]);
    }
    unsetenv("POCL_MAX_PTHREAD_COUNT");
}

static void *carve_one(void *f)
{
    rec_frame_carve(f);
    return NULL;
}

/* Set k + 1 is carved while k is solved, as in the daemon.  Then the same sets one after the other. */
T_CASE_OF_THREADS(two_sets_in_flight)
{
    enum { SETS = 6 };
    struct scene s;
    struct rec_frame_params p = frame_params(3);
    rec_carver *k;
    rec_solver *v;
    rec_frame *f[SETS];
    float *x[SETS];
    scene_of(&s, 6, 96, 32, REC_TRILINEAR);
    p.card = cl;
    T_EQ_I(rec_carver_new(s.S, &s.rig, &p, s.pool, &k, NULL), PVX_OK);
    T_EQ_I(rec_solver_new(s.S, &p, &v, NULL), PVX_OK);
    for (int i = 0; i < SETS; i++)
        T_EQ_I(rec_frame_new(k, v, &f[i], NULL), PVX_OK);
    for (int turn = 0; turn < 2; turn++) {
        t_state = 0;
        for (int i = 0; i < SETS; i++) {
            scene_at(&s, 0.2 + 0.15 * i);
            scene_shoot(&s, f[i], 0.01);
        }
        rec_frame_carve(f[0]);
        for (int i = 0; i < SETS; i++) {
            pthread_t thread;
            bool beside = turn == 0 && i + 1 < SETS;
            if (beside)
                T_EQ_I(pthread_create(&thread, NULL, carve_one, f[i + 1]), 0);
            T_EQ_I(rec_frame_solve(f[i], 0, NULL), PVX_OK);
            if (beside)
                pthread_join(thread, NULL);
            else if (i + 1 < SETS)
                rec_frame_carve(f[i + 1]);
            T_OK(f[i]->report.on_card && f[i]->report.active_voxels > 1000);
            size_t bytes = (size_t)f[i]->report.active_voxels * 16;
            if (turn == 0)
                x[i] = memcpy(pvx_calloc(bytes, 1), f[i]->x, bytes);
            else
                T_OK(memcmp(x[i], f[i]->x, bytes) == 0);
        }
    }
    for (int i = 0; i < SETS; i++) {
        free(x[i]);
        rec_frame_free(&f[i]);
    }
    rec_carver_free(&k);
    rec_solver_free(&v);
    scene_free(&s);
}

/* ---- back to the processors ---------------------------------------------------------------------*/

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
            T_EQ_I(rec_frame_solve(p.here, 0, NULL), PVX_OK);
            T_EQ_I(rec_frame_solve(p.there, 0, NULL), PVX_OK);
            same_volumes(&p);
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
    shoot(&s, &p, 0.01);
    card_pair_copy(&p);
    rec_frame_carve(p.here);
    rec_frame_carve(p.there);
    T_OK(p.here->report.active_voxels > 1000);
    T_EQ_I(rec_frame_solve(p.here, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_solve(p.there, 0, NULL), PVX_OK);
    same_volumes(&p);
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
    shoot(&s, &p, 0.01);
    card_pair_copy(&p);
    rec_frame_carve(p.here);
    rec_frame_carve(p.there);
    T_EQ_I(rec_frame_solve(p.here, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_solve(p.there, 0, NULL), PVX_OK);
    same_volumes(&p);
    T_EQ_S(p.there->report.why_here, rec_frame_card_why_not(&f));
    card_pair_free(&p);

    f = frame_params(3); /* it was asked for while the card was at work */
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    struct rec_solve_params corner = f.solve;
    corner.stop = REC_STOP_LCURVE;
    rec_solver_tune(p.here->solver, &corner);
    rec_solver_tune(p.there->solver, &corner);
    shoot(&s, &p, 0.01);
    card_pair_copy(&p);
    rec_frame_carve(p.here);
    rec_frame_carve(p.there);
    T_OK(p.there->sub->card != NULL);
    T_EQ_I(rec_frame_solve(p.here, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_solve(p.there, 0, NULL), PVX_OK);
    same_volumes(&p);
    T_CONTAINS(p.there->report.why_here, "L-curve");
    card_pair_free(&p);
    scene_free(&s);
}

T_MAIN((cl_fault_begin(), cl_bed_begin(), print_hash(), cl = cl_bed_open()), rec_cl_close(&cl))
