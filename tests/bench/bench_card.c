/* bench_card.c - frame sets on an OpenCL device beside two threads of this CPU, in turns in one run: stages, bytes per
 * iteration, errors.  From raw 8-bit pictures in colour to volumes: one set after the other, which is the latency, and
 * as the daemon does it, where a set is carved while another one is solved.
 *
 *     CARD=NAME      part of the device's or the platform's name (default: Portable, which is pocl)
 *     CARD_SIZES=N   the first N of 64^3, 128^3, 256^3 (default: 3, of a device that is no GPU 1); 256: that one alone
 *
 * A device that is a CPU only shows that this runs. */
#include "bench.h"

#include "daemon/pipeline/images.h"
#include "daemon/pipeline/pipeline.h"
#include "recon/opencl/impl.h"

#define TURNS 5 /* of 256^3 on a device that is no GPU 1: it takes half a minute */

static rec_cl *cl;

enum { UNPACK, PHOTO, CARVE, RESTRICT, SOLVE, ALL, STAGES };
static const char *const stage_names[STAGES] = {
    "raw pictures", "photometry and vote", "hull", "restrict", "solve", "one set"};

struct shots {
    const struct scene *s;
    const rec_sysmat *S;
    struct cap_image image[REC_MAX_CAMERAS];
    uint8_t *bytes[REC_MAX_CAMERAS];
};

struct side {
    const char *name;
    const struct shots *shots;
    struct rec_frame_params p;
    rec_frame *f;
    dmn_images *images;
    double least[STAGES]; /* ms */
    double error, rate;
    bool raw_on_card;
    uint64_t bytes; /* of the device's memory */
    int sets, left; /* of the pipeline */
};

static void shoot(struct shots *t)
{
    for (size_t c = 0; c < t->s->rig.n_cameras; c++) {
        int32_t w = t->s->rig.cameras[c].width, h = t->s->rig.cameras[c].height;
        size_t n = (size_t)w * (size_t)h * 3;
        t->bytes[c] = scene_rgb8(t->s, c);
        t->image[c] = (struct cap_image){t->bytes[c], n, w, h, (ptrdiff_t)w * 3, CAP_RGB8, 0};
    }
}

static void side_load(const struct side *d, rec_frame *f)
{
    const struct cap_image *image[REC_MAX_CAMERAS];
    uint64_t mask;
    size_t n = d->shots->s->rig.n_cameras;
    for (size_t c = 0; c < n; c++)
        image[c] = &d->shots->image[c];
    CHECK(dmn_images_bin_frame(d->images, image, f, &mask) == n ? PVX_OK : PVX_EINVAL);
}

static void side_turn(struct side *d)
{
    const struct rec_frame_report *r = rec_frame_get_report(d->f);
    struct rec_sparse v;
    rec_frame_reset(d->f);
    int64_t t0 = pvx_now_mono();
    side_load(d, d->f);
    int64_t t1 = pvx_now_mono();
    rec_frame_carve(d->f);
    CHECK(rec_frame_solve(d->f, 0, NULL));
    const double took[STAGES] = {ms(t1 - t0),     ms(r->photo_ns + r->vote_ns),
                                 ms(r->hull_ns),  ms(r->restrict_ns),
                                 ms(r->solve_ns), ms(pvx_now_mono() - t0)};
    for (int i = 0; i < STAGES; i++)
        d->least[i] = d->least[i] == 0 || took[i] < d->least[i] ? took[i] : d->least[i];
    d->raw_on_card = r->raw_on_card;
    float *dense = must_floats(rec_grid_count(&d->f->S->grid) * 3);
    rec_frame_volume(d->f, &v);
    rec_sparse_to_dense(&v, dense);
    d->error = rec_rel_l2(dense, d->shots->s->truth, rec_grid_count(&d->f->S->grid) * 3);
    free(dense);
}

/* ---- as the daemon does it ---- */

static pvx_err next_set(void *ctx, struct dmn_slot *s)
{
    struct side *d = ctx;
    if (d->left == 0)
        return PVX_ECLOSED;
    s->set = (uint64_t)(d->sets - d->left--);
    s->n_present = (uint32_t)d->shots->s->rig.n_cameras;
    side_load(d, s->frame);
    return PVX_OK;
}
static bool put_volume(void *ctx, const struct dmn_slot *s)
{
    (void)ctx;
    return s->why == DMN_N_DROP;
}

static void side_flow(struct side *d, pvx_pool *pool, int sets)
{
    struct pvx_diag why = {""};
    dmn_pipeline *p;
    const struct dmn_pipeline_params a = {.S = d->shots->S,
                                          .rig = &d->shots->s->rig,
                                          .frame = d->p,
                                          .pool = pool,
                                          .lossless = true,
                                          .source = {next_set, d},
                                          .sink = {.name = "put", .put = put_volume}};
    d->sets = d->left = sets;
    bench_check(dmn_pipeline_new(&a, &p, &why), &why);
    int64_t t0 = pvx_now_mono();
    CHECK(dmn_pipeline_start(p, NULL));
    dmn_pipeline_join(p);
    d->rate = fmax(d->rate, sets / (1e-3 * ms(pvx_now_mono() - t0)));
    dmn_pipeline_free(&p);
}

/* Columns once by windows, rows once by entries of two bytes, and the vectors (recon/opencl/README.md). */
static double bytes_per_iteration(const rec_frame *f)
{
    const struct rec_frame_report *r = rec_frame_get_report(f);
    return bytes_of_windows(rec_frame_subsys(f)) + 2.0 * (double)r->entries +
           (double)r->active_voxels * 316 + (double)r->active_rays * 64;
}

/* ||there - here|| / ||here||; NaN: they have not the same voxels. */
static double volumes_apart(const struct side side[2])
{
    struct rec_sparse h, t;
    double off = 0, all = 0;
    rec_frame_volume(side[0].f, &h);
    rec_frame_volume(side[1].f, &t);
    if (t.n != h.n || memcmp(t.index, h.index, (size_t)h.n * sizeof *h.index) != 0)
        return NAN;
    for (size_t i = 0; i < (size_t)h.n * (size_t)h.cs; i++) {
        double d = (double)t.value[i] - (double)h.value[i];
        off += d * d;
        all += (double)h.value[i] * (double)h.value[i];
    }
    return sqrt(off / all);
}

static void size_say(FILE *csv, const int32_t size[3], const struct side side[2])
{
    const struct rec_frame_report *r = rec_frame_get_report(side[0].f),
                                  *t = rec_frame_get_report(side[1].f);
    double bytes = bytes_per_iteration(side[0].f);
    printf("\n%d^3 trilinear from 8 x %dx%d: %lld voxels, %lld rays, %.2f M entries; %u + %u "
           "iterations here, %u + %u there%s%s\n"
           "  %.1f MB an iteration, %.3f ms at 3 TB/s; volume error %.4f here, %.4f there, %.5f "
           "times as large\n"
           "  the volumes differ by %.2g; matrix, solver and a set take %.2f GB there\n",
           size[2], size[0], size[1], (long long)r->active_voxels, (long long)r->active_rays,
           (double)r->entries * 1e-6, r->coarse_iterations, r->solve.iterations,
           t->coarse_iterations, t->solve.iterations,
           !t->on_card           ? ", SOLVED HERE: "
           : side[1].raw_on_card ? ""
                                 : ", UNPACKED HERE",
           t->why_here, bytes * 1e-6, bytes / 3e9, side[0].error, side[1].error,
           side[1].error / side[0].error, volumes_apart(side), 1e-9 * (double)side[1].bytes);
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < STAGES; i++)
            bench_row(csv, "%d,%d,%d,%s,%s,%.4f,%.1f", size[2], size[0], size[1], side[k].name,
                      stage_names[i], side[k].least[i], i == ALL ? 1e3 / side[k].least[i] : 0.0);
        if (side[k].rate > 0)
            bench_row(csv, "%d,%d,%d,%s,%s,%.4f,%.1f", size[2], size[0], size[1], side[k].name,
                      "sets in a row", 1e3 / side[k].rate, side[k].rate);
    }
}

/* So many sets that they take some two seconds; a pipeline begins empty. */
static int sets_of(const struct side *d)
{
    double n = 2000 / d->least[ALL];
    return n < 8 ? 8 : n > 2000 ? 2000 : (int)n;
}

static void side_new(struct side *d, const struct shots *t, pvx_pool *pool)
{
    const struct dmn_images_params how = {
        .nch = 3, .binning = t->S->binning, .fmt = CAP_RGB8, .look = 16};
    struct pvx_diag why = {""};
    d->shots = t;
    d->p.nch = 3;
    bench_check(rec_frame_alone(t->S, &t->s->rig, &d->p, pool, &d->f, &why), &why);
    CHECK(dmn_images_new(&how, &t->s->rig, pool, &d->images, NULL));
}

static void run(FILE *csv, const int32_t size[3], pvx_pool *pool)
{
    struct side side[2] = {{.name = "cpu of 2 threads", .p = rec_frame_defaults},
                           {.name = rec_cl_about(cl)->name, .p = rec_frame_defaults}};
    struct scene s;
    struct shots t = {.s = &s};
    rec_sysmat *S;
    const bool quick = rec_cl_about(cl)->kind == REC_CL_GPU || size[2] < 256;
    scene_flame(&s, size, REC_TRILINEAR, pool);
    CHECK(rec_sysmat_build(&s.rig, &rec_sysmat_defaults, pool, NULL, NULL, &S, NULL));
    t.S = S;
    shoot(&t);
    side[1].p.card = cl;
    for (int k = 0; k < 2; k++)
        side_new(&side[k], &t, pool);
    side[1].bytes = atomic_load(&cl->used);
    for (int turn = 0; turn < (quick ? TURNS : 1); turn++)
        for (int k = 0; k < 2; k++)
            side_turn(&side[k]);
    for (int turn = 0; turn < (quick ? 2 : 0); turn++)
        for (int k = 0; k < 2; k++)
            side_flow(&side[k], pool, sets_of(&side[k]));
    size_say(csv, size, side);
    for (int k = 0; k < 2; k++) {
        rec_frame_free(&side[k].f);
        dmn_images_free(&side[k].images);
    }
    for (size_t c = 0; c < s.rig.n_cameras; c++)
        free(t.bytes[c]);
    rec_sysmat_free(&S);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    static const int32_t sizes[3][3] = {{320, 240, 64}, {320, 240, 128}, {640, 480, 256}};
    const char *name = getenv("CARD"), *many = getenv("CARD_SIZES");
    struct pvx_diag d = {""};
    pvx_pool *pool;
    pvx_err e = rec_cl_open(name != NULL ? name : "Portable", &cl, &d);
    if (e != PVX_OK) {
        bench_not_run("bench_card", pvx_diag_text(&d, e));
        return *bench_status();
    }
    const struct rec_cl_info *about = rec_cl_about(cl);
    int n = many != NULL ? atoi(many) : about->kind == REC_CL_GPU ? 3 : 1;
    printf("card: raw pictures to volumes on %s (%s, driver %s)%s\n", about->name, about->platform,
           about->driver,
           about->kind == REC_CL_GPU ? "" : ": no graphics card, so times say nothing");
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(argc, argv, "card", "voxels,width,height,where,stage,ms,sets_per_s");
    for (int i = 0; i < 3; i++)
        if (i < n && (n <= 3 || sizes[i][2] == n))
            run(csv, sizes[i], pool);
    fclose(csv);
    pvx_pool_free(&pool);
    rec_cl_close(&cl);
    return 0;
}
