/* A frame set from pixels to a sparse volume: partial sets, hard pictures, reuse of a slot, the same
 * bits for any number of threads. */
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"

#include "base/clock.h"
#include "tests/lib/entries.h"
#include "recon/frame/inside.h"

static struct scene sc;

static rec_frame *frame(const struct rec_frame_params *p)
{
    rec_frame *f = NULL;
    struct pvx_diag d = {""};
    if (rec_frame_alone(sc.S, &sc.rig, p, sc.pool, &f, &d) != PVX_OK) {
        printf("%s\n", d.text);
        exit(2);
    }
    return f;
}
static struct rec_frame_params params(void)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.photo.saturation = 1e30f;
    return p;
}
static bool sound(const rec_frame *f)
{
    struct rec_sparse v;
    rec_frame_volume(f, &v);
    for (int32_t q = 0; q < v.n; q++) {
        if (q > 0 && v.index[q] <= v.index[q - 1])
            return false;
        for (int l = 0; l < v.cs; l++)
            if (!(v.value[q * v.cs + l] >= 0 && v.value[q * v.cs + l] < 1e12f))
                return false;
    }
    const struct rec_frame_report *r = rec_frame_get_report(f);
    return isfinite(r->solve.rel_residual) && isfinite(r->solve.objective) && isfinite(r->sigma);
}
static void run(rec_frame *f)
{
    rec_frame_carve(f);
    T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
    T_OK(sound(f));
}

/* Bins of camera 0 that are lit by light of 0.003 on the left half of its picture, in black elsewhere. */
static size_t faintly_lit(const struct rec_photometry *known)
{
    struct rec_frame_params p = params();
    struct rec_photometry old = sc.rig.cameras[0].photometry;
    sc.rig.cameras[0].photometry = *known;
    rec_frame *f = frame(&p);
    sc.rig.cameras[0].photometry = old;
    const struct rec_sysmat_block *b = &sc.S->block[0];
    size_t cs = p.nch == 3 ? 4 : 1, lit = 0, n = (size_t)b->bw * (size_t)b->bh;
    float *img = rec_frame_input(f, 0);
    for (size_t i = 0; i < n; i++)
        for (size_t l = 0; l < cs; l++)
            img[i * cs + l] = i % (size_t)b->bw < (size_t)b->bw / 2 ? 0.003f : 0;
    rec_frame_camera(f, 0)->present = true;
    rec_frame_carve(f);
    for (size_t i = 0; i < n; i++)
        lit += rec_frame_lit(f, 0)[i];
    rec_frame_free(&f);
    return lit;
}

T_CASE(known_read_noise_lowers_the_floor)
{
    size_t n = (size_t)sc.S->block[0].bw * (size_t)sc.S->block[0].bh;
    struct rec_photometry known = {.has_noise = true, .read_noise = 5e-4};
    T_EQ_I(faintly_lit(&(struct rec_photometry){0}), 0);
    T_LE((double)n / 3, faintly_lit(&known));
    known.read_noise =
        0.01; /* the floor stays where it is; noise that is seen raises the threshold */
    T_EQ_I(faintly_lit(&known), 0);
}

/* Variance over light of a bin, of each channel the mean over cameras, of which one's is known. */
T_CASE(known_noise_of_light_reaches_the_solver)
{
    struct rec_photometry *of = &sc.rig.cameras[1].photometry, old = *of;
    float *gain = sc.rig.cameras[1].gain, was = gain[2];
    struct rec_frame_params p = params();
    *of = (struct rec_photometry){.has_noise = true, .read_noise = 1e-3, .noise_gain = 2e-3};
    gain[2] = 4;
    rec_frame *f = frame(&p);
    scene_shoot(&sc, f, 0.01);
    rec_frame_carve(f);
    double bins = sc.S->binning * sc.S->binning, n = (double)sc.rig.n_cameras;
    for (int l = 0; l < 3; l++)
        T_NEAR(rec_frame_pictures(f).shot[l], 2e-3 * (l == 2 ? 4 : 1) / bins / n, 1e-9);
    rec_frame_free(&f);
    *of = old;
    gain[2] = was;
}

/* Noise in blue is blue's alone: red and green are solved as if it were not there.  Only the silhouettes, which are of
 * all channels, differ by a few bins. */
T_CASE(noise_of_one_channel)
{
    struct rec_frame_params p = params();
    float *dense[2] = {NULL, NULL};
    for (int noisy = 0; noisy < 2; noisy++) {
        rec_frame *f = frame(&p);
        uint32_t seed = 1;
        scene_shoot(&sc, f, 0.003);
        for (size_t c = 0; c < sc.rig.n_cameras; c++) {
            float *img = rec_frame_input(f, c);
            for (size_t i = 0; i < sc.S->row0[c + 1] - sc.S->row0[c]; i++) {
                seed = seed * 1664525 + 1013904223;
                double even = (double)seed / 4294967296.0 - 0.5;
                img[4 * i + 2] += noisy ? (float)(0.05 * sqrt(12) * even) : 0;
            }
        }
        run(f);
        const struct rec_pictures in = rec_frame_pictures(f);
        T_NEAR(in.sigma[0], 0.003, 0.001);
        T_NEAR(in.sigma[1], 0.003, 0.001);
        T_NEAR(in.sigma[2], noisy ? 0.05 : 0.003, noisy ? 0.01 : 0.001);
        struct rec_sparse v;
        rec_frame_volume(f, &v);
        dense[noisy] = pvx_calloc(sc.voxels * 3, sizeof **dense);
        rec_sparse_to_dense(&v, dense[noisy]);
        rec_frame_free(&f);
    }
    for (size_t l = 0; l < 3; l++) {
        double off = 0, size = 0;
        for (size_t i = l; i < 3 * sc.voxels; i += 3) {
            double d = (double)dense[0][i] - dense[1][i];
            off += d * d;
            size += (double)dense[0][i] * dense[0][i];
        }
        printf("  channel %zu differs by %.3f\n", l, sqrt(off / size));
        if (l < 2)
            T_LE(sqrt(off / size), 0.1); /* with one noise for all 0.13 and 0.28 */
        else
            T_LE(0.1, sqrt(off / size));
    }
    free(dense[0]);
    free(dense[1]);
}

T_CASE(what_a_card_cannot_do_is_named)
{
    struct rec_frame_params p = rec_frame_defaults;
    T_OK(rec_frame_card_why_not(&p) == NULL);
    p.solve.solver = rec_solver_names()[0];
    p.solve.stop = REC_STOP_ITERATIONS;
    p.absorption = 1;
    T_OK(rec_frame_card_why_not(&p) == NULL);
    p.solve.solver = rec_solver_names()[1];
    T_CONTAINS(rec_frame_card_why_not(&p), "solver");
    p = rec_frame_defaults;
    p.solve.stop = REC_STOP_LCURVE;
    T_CONTAINS(rec_frame_card_why_not(&p), "L-curve");
    p = rec_frame_defaults;
    p.temporal = true;
    T_CONTAINS(rec_frame_card_why_not(&p), "previous volume");
    p = rec_frame_defaults;
    p.at_least = true;
    T_CONTAINS(rec_frame_card_why_not(&p), "bounds");
}

T_CASE(flame_comes_out)
{
    struct rec_frame_params p = params();
    rec_frame *f = frame(&p);
    scene_shoot(&sc, f, 0.01);
    run(f);
    struct rec_sparse v;
    rec_frame_volume(f, &v);
    const struct rec_frame_report *r = rec_frame_get_report(f);
    T_LE(scene_error(&sc, &v), 0.35); /* a grid this coarse: voxels as large as the flame's blobs */
    T_EQ_I(r->cameras, sc.rig.n_cameras);
    T_EQ_I(r->active_voxels, v.n);
    T_EQ_I(r->entries, rec_frame_subsys(f)->nnz);
    T_EQ_I(r->active_rays, rec_frame_subsys(f)->rows);
    T_EQ_I(r->hull.inside + r->hull.partial, v.n);
    T_EQ_I(r->hull.inside + r->hull.partial + r->hull.outside, sc.voxels);
    T_NEAR(r->sigma, 0.01, 0.002);
    T_OK(r->photo_ns > 0 && r->hull_ns > 0 && r->restrict_ns > 0 && r->solve_ns > 0);
    float *dense = pvx_calloc(sc.voxels * 3, sizeof *dense);
    memset(dense, 0xff, sc.voxels * 3 * sizeof *dense);
    rec_sparse_to_dense(&v, dense);
    double d = 0, sum = 0;
    for (size_t i = 0; i < sc.voxels * 3; i++)
        sum += dense[i];
    for (int32_t q = 0; q < v.n; q++)
        for (int l = 0; l < 3; l++)
            d += v.value[q * 4 + l];
    T_NEAR(sum, d, 1e-9 * d);
    free(dense);
    rec_frame_free(&f);
}

/* A camera that is not there leaves the system: as if the rig had never had it. */
T_CASE(absent_cameras)
{
    struct rec_frame_params p = params();
    rec_frame *f = frame(&p);
    for (int without = 0; without < 2; without++) {
        scene_shoot(&sc, f, 0);
        size_t n = (size_t)(sc.S->block[1].bw * sc.S->block[1].bh) * 4;
        float *in = rec_frame_input(f, 1);
        for (size_t i = 0; i < n; i++)
            in[i] = without ? NAN : 1e30f; /* whatever is left in the slot */
        rec_frame_camera(f, 1)->present = false;
        run(f);
        const struct rec_subsys *a = rec_frame_subsys(f);
        uint32_t *row = rows_of_system(a);
        for (int32_t i = 0; i < a->rows; i++)
            if (row[i] >= a->row0[1] && row[i] < a->row0[2])
                T_OK(!"row of an absent camera");
        free(row);
        T_EQ_I(rec_frame_get_report(f)->cameras, sc.rig.n_cameras - 1);
        T_EQ_I(rec_frame_get_report(f)->not_finite, 0);
        struct rec_sparse v;
        rec_frame_volume(f, &v);
        T_LE(scene_error(&sc, &v), 0.4);
    }
    for (size_t left = 0; left < 3; left++) { /* 0, 1 and 2 cameras; two must see a voxel */
        scene_shoot(&sc, f, 0);
        for (size_t c = left; c < sc.rig.n_cameras; c++)
            rec_frame_camera(f, c)->present = false;
        run(f);
        T_EQ_I(rec_frame_get_report(f)->cameras, left);
        T_EQ_I(rec_frame_get_report(f)->solve.status == REC_EMPTY, left < 2);
    }
    rec_frame_free(&f);
}

enum picture {
    EMPTY,
    ONE_PIXEL,
    ALL_LIT,
    CONTRADICTION,
    NOT_FINITE,
    SATURATED,
    DENORMAL,
    BLACK_CAMERA,
    HOT_PIXELS,
    NEGATIVE,
    NOISE_ALONE,
    N_PICTURES
};

static void paint(rec_frame *f, enum picture what)
{
    scene_shoot(&sc, f, what == NOISE_ALONE ? 0.3 : 0.01);
    for (size_t c = 0; c < sc.rig.n_cameras; c++) {
        float *in = rec_frame_input(f, c);
        size_t n = (size_t)(sc.S->block[c].bw * sc.S->block[c].bh);
        for (size_t i = 0; i < n * 4; i++) {
            size_t bin = i / 4;
            switch (what) {
            case EMPTY: in[i] = 0; break;
            case ONE_PIXEL: in[i] = bin == n / 2; break;
            case ALL_LIT: in[i] = 0.5f; break;
            case CONTRADICTION: in[i] = (bin < n / 2) == (c % 2 == 0); break;
            case NOT_FINITE:
                if (bin % 7 == 0)
                    in[i] = bin % 3 == 0 ? NAN : bin % 3 == 1 ? INFINITY : -INFINITY;
                break;
            case SATURATED: in[i] = in[i] * 4 < 1 ? in[i] * 4 : 1; break;
            case DENORMAL: in[i] *= 1e-38f; break;
            case BLACK_CAMERA: in[i] = c == 2 ? 0 : in[i]; break;
            case HOT_PIXELS: in[i] = bin % 97 == 0 ? 1 : in[i]; break;
            case NEGATIVE: in[i] = -in[i]; break;
            default: break;
            }
        }
    }
}

T_CASE(hard_pictures)
{
    struct rec_frame_params p = params();
    p.photo.saturation = 0.998f;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        p.solve.solver = *name;
        for (int threshold = 0; threshold < 2; threshold++) {
            p.photo.threshold = threshold ? 0 : -1;
            rec_frame *f = frame(&p);
            for (int what = 0; what < N_PICTURES; what++) {
                paint(f, (enum picture)what);
                run(f);
                const struct rec_frame_report *r = rec_frame_get_report(f);
                bool empty = r->solve.status == REC_EMPTY;
                if (threshold == 0) {
                    if (what == EMPTY || what == DENORMAL || what == NEGATIVE)
                        T_OK(empty);
                    if (what == BLACK_CAMERA)
                        T_OK(!empty && r->vote.out == 4 && r->vote.why[2] == REC_WRONG_DARK);
                    if (what == ALL_LIT) {
                        T_EQ_I(r->hull.outside, 0);
                        T_OK(!empty);
                    }
                }
                if (what == NOT_FINITE)
                    T_OK(r->not_finite > 0 && !empty);
                if (what == SATURATED)
                    T_OK(r->saturated > 0 && !empty);
                if (what == HOT_PIXELS)
                    T_OK(!empty);
            }
            rec_frame_free(&f);
        }
    }
}

/* Silhouettes that meet in one voxel. */
T_CASE(hull_of_one_voxel)
{
    struct rec_frame_params p = params();
    p.photo.threshold = 0.5f;
    rec_frame *f = frame(&p);
    int32_t j = rec_grid_index(&sc.rig.grid, 6, 5, 7);
    struct entries all = entries_of(sc.S);
    scene_shoot(&sc, f, 0);
    for (size_t c = 0; c < sc.rig.n_cameras; c++) {
        const struct rec_sysmat_block *b = &sc.S->block[c];
        float *in = rec_frame_input(f, c);
        memset(in, 0, (size_t)(b->bw * b->bh) * 4 * sizeof *in);
        for (uint32_t e = all.colptr[j]; e < all.colptr[j + 1]; e++)
            for (size_t l = 0; l < 3; l++)
                if (all.row[e] >= sc.S->row0[c] && all.row[e] < sc.S->row0[c + 1])
                    in[(all.row[e] - sc.S->row0[c]) * 4 + l] = 0.5f + (float)entries_value(&all, e);
    }
    entries_free(&all);
    run(f);
    struct rec_sparse v;
    rec_frame_volume(f, &v);
    T_OK(v.n >= 1 && v.n < 60);
    bool found = false;
    for (int32_t q = 0; q < v.n; q++)
        found = found || (v.index[q] == j && v.value[q * 4] > 0);
    T_OK(found);
    rec_frame_free(&f);
}

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    struct rec_frame_params p = params();
    uint64_t state = t_state;
    float *want = NULL;
    size_t n = 0;
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        p.solve.solver = *name;
        for (unsigned threads = 1; threads <= 4; threads++) {
            pvx_pool *pool, *keep = sc.pool;
            if (pvx_pool_new(threads, "bits", &pool) != PVX_OK)
                exit(2);
            sc.pool = pool;
            rec_frame *f = frame(&p);
            t_state = state; /* the same noise */
            scene_shoot(&sc, f, 0.01);
            run(f);
            struct rec_sparse v;
            rec_frame_volume(f, &v);
            if (threads == 1) {
                n = (size_t)v.n * 4;
                want = pvx_calloc(n, sizeof *want);
                memcpy(want, v.value, n * sizeof *want);
            } else {
                T_EQ_I(v.n * 4, n);
                T_OK(memcmp(want, v.value, n * sizeof *want) == 0);
            }
            rec_frame_free(&f);
            pvx_pool_free(&pool);
            sc.pool = keep;
        }
        free(want);
    }
}

/* A slot carries nothing over; a warm start changes how long it takes, not where it ends. */
T_CASE_OF_THREADS(slots_and_warm_starts)
{
    struct rec_frame_params p = params();
    rec_frame *f = frame(&p), *g = frame(&p);
    uint64_t state = t_state;
    scene_shoot(&sc, f, 0.01);
    run(f);
    paint(g, NOT_FINITE);
    run(g);
    paint(g, ALL_LIT);
    run(g);
    t_state = state;
    scene_shoot(&sc, g, 0.01);
    run(g);
    struct rec_sparse a, b;
    rec_frame_volume(f, &a);
    rec_frame_volume(g, &b);
    T_EQ_I(a.n, b.n);
    T_OK(a.n == b.n && memcmp(a.value, b.value, (size_t)a.n * 4 * sizeof *a.value) == 0);

    t_state = state;
    scene_shoot(&sc, g, 0.01);
    rec_frame_carve(g);
    T_OK(rec_frame_solve(g, 0, &a) == PVX_OK);
    T_LE(rec_frame_get_report(g)->solve.iterations, rec_frame_get_report(f)->solve.iterations / 2);
    T_LE(rec_frame_get_report(g)->solve.objective,
         rec_frame_get_report(f)->solve.objective * 1.0001);
    T_EQ_I(rec_frame_solve(g, 0, &b), PVX_EINVAL); /* its own volume is no start */

    t_state = state; /* no time at all: the start comes back, scaled to fit */
    scene_shoot(&sc, g, 0.01);
    rec_frame_carve(g);
    T_OK(rec_frame_solve(g, pvx_now_mono() - 1, &a) == PVX_OK);
    T_EQ_I(rec_frame_get_report(g)->solve.status, REC_DEADLINE);
    T_LE(rec_frame_get_report(g)->solve.rel_residual,
         rec_frame_get_report(f)->solve.rel_residual * 1.01);
    T_OK(sound(g));
    rec_frame_free(&f);
    rec_frame_free(&g);
}

/* Slots that are lent the same systems, one after the other, have the volumes of slots with systems of their own.  They
 * keep them while another slot has the systems. */
T_CASE(systems_are_lent)
{
    struct rec_frame_params p = params();
    rec_frame *own[2] = {frame(&p), frame(&p)}, *bare[2];
    rec_systems *y;
    T_EQ_I(rec_systems_new(own[0]->carver, own[0]->solver, &y, NULL), PVX_OK);
    for (int i = 0; i < 2; i++) {
        uint64_t state = t_state;
        T_EQ_I(rec_frame_new_bare(own[0]->carver, own[0]->solver, &bare[i], NULL), PVX_OK);
        scene_shoot(&sc, own[i], 0.01 + 0.02 * i);
        run(own[i]);
        t_state = state;
        scene_shoot(&sc, bare[i], 0.01 + 0.02 * i);
        rec_frame_lend(bare[i], y);
        run(bare[i]);
        T_OK(rec_frame_give_back(bare[i]) == y);
        T_OK(rec_frame_give_back(bare[i]) == NULL);
    }
    for (int i = 0; i < 2; i++) {
        struct rec_sparse a, b;
        rec_frame_volume(own[i], &a);
        rec_frame_volume(bare[i], &b);
        T_OK(a.n > 0 && a.n == b.n);
        T_OK(a.n == b.n && memcmp(a.index, b.index, (size_t)a.n * sizeof *a.index) == 0);
        T_OK(a.n == b.n && memcmp(a.value, b.value, (size_t)a.n * 4 * sizeof *a.value) == 0);
    }
    rec_systems_free(&y);
    for (int i = 0; i < 2; i++)
        rec_frame_free(&bare[i]);
    for (int i = 0; i < 2; i++)
        rec_frame_free(&own[i]);
}

T_CASE_OF_THREADS(grey_and_background)
{
    struct rec_frame_params p = params();
    p.nch = 1;
    rec_frame *f = frame(&p);
    float *bg[REC_MAX_CAMERAS] = {NULL};
    for (size_t c = 0; c < sc.rig.n_cameras; c++) {
        size_t n = (size_t)(sc.S->block[c].bw * sc.S->block[c].bh);
        bg[c] = pvx_calloc(n, sizeof(float));
        for (size_t i = 0; i < n; i++) {
            bg[c][i] = 0.2f + 0.1f * (float)(i % 5);
            rec_frame_input(f, c)[i] = sc.image[c][i * 4] + bg[c][i];
        }
        T_OK(rec_carver_background(f->carver, c, bg[c]) == PVX_OK);
        rec_frame_camera(f, c)->present = true;
    }
    run(f);
    struct rec_sparse v;
    rec_frame_volume(f, &v);
    double e = 0, t = 0;
    float *dense = pvx_calloc(sc.voxels, sizeof *dense);
    rec_sparse_to_dense(&v, dense);
    for (size_t i = 0; i < sc.voxels; i++) {
        double d = dense[i] - (double)sc.truth[i * 3];
        e += d * d;
        t += (double)sc.truth[i * 3] * sc.truth[i * 3];
    }
    T_EQ_I(v.cs, 1);
    T_LE(sqrt(e / t), 0.3);
    T_EQ_I(rec_carver_background(f->carver, 99, bg[0]), PVX_EINVAL);
    T_OK(rec_carver_background(f->carver, 0, NULL) == PVX_OK);
    for (size_t c = 0; c < sc.rig.n_cameras; c++)
        free(bg[c]);
    free(dense);
    rec_frame_free(&f);
}

T_CASE(refused)
{
    struct rec_frame_params p = params();
    struct pvx_diag d = {""};
    rec_frame *f;
    p.nch = 2;
    T_EQ_I(rec_frame_alone(sc.S, &sc.rig, &p, sc.pool, &f, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "2 channels");
    struct rec_rig other;
    if (rec_rig_ring(3, 2.2, 40, 30, 12, &other) != PVX_OK)
        exit(2);
    p.nch = 3;
    d.text[0] = '\0';
    T_EQ_I(rec_frame_alone(sc.S, &other, &p, sc.pool, &f, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "3 cameras");
    rec_rig_fini(&other);
}

T_MAIN((scene_new(&sc, 6, 48, 14, 2, 2), (void)t_rand()), scene_free(&sc))
