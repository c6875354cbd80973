/* bench_card.c - frame sets on an OpenCL device beside two threads of this CPU, in turns in one run: stages, bytes per
 * iteration, latency, errors.  It begins with binned pixels; bench_offline.c has what comes before.
 *
 *     CARD=NAME      part of the device's or the platform's name (default: Portable, which is pocl)
 *     CARD_SIZES=N   the first N of 64^3, 128^3, 256^3 (default: 3, of a device that is no GPU 1); 256: that one alone
 *
 * A device that is a CPU only shows that this runs. */
#include "bench.h"

#include "recon/opencl/device.h"

#define TURNS 5 /* of 256^3 on a device that is no GPU 1: it takes half a minute */

static rec_cl *cl;

enum { PHOTO, CARVE, RESTRICT, SOLVE, ALL, STAGES };
static const char *const stage_names[STAGES] = {"photometry and vote", "hull", "restrict", "solve",
                                                "set"};

struct side {
    const char *name;
    rec_frame *f;
    double least[STAGES]; /* ms */
    double error;
};

static void side_turn(struct side *d, const struct scene *s, const float *const *pixels)
{
    const struct rec_frame_report *r = rec_frame_get_report(d->f);
    struct rec_sparse v;
    rec_frame_reset(d->f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_sysmat_block *b = &d->f->S->block[c];
        memcpy(rec_frame_input(d->f, c), pixels[c],
               (size_t)b->bw * (size_t)b->bh * 4 * sizeof *pixels[c]);
        rec_frame_camera(d->f, c)->present = true;
    }
    int64_t t0 = pvx_now_mono();
    rec_frame_carve(d->f);
    CHECK(rec_frame_solve(d->f, 0, NULL));
    const double took[STAGES] = {ms(r->photo_ns + r->vote_ns), ms(r->hull_ns), ms(r->restrict_ns),
                                 ms(r->solve_ns), ms(pvx_now_mono() - t0)};
    for (int i = 0; i < STAGES; i++)
        d->least[i] = d->least[i] == 0 || took[i] < d->least[i] ? took[i] : d->least[i];
    float *dense = must_floats(rec_grid_count(&d->f->S->grid) * 3);
    rec_frame_volume(d->f, &v);
    rec_sparse_to_dense(&v, dense);
    d->error = rec_rel_l2(dense, s->truth, rec_grid_count(&d->f->S->grid) * 3);
    free(dense);
}

/* Means of binning x binning pixels with noise of 1 % of the peak. */
static void make_pixels(const struct scene *s, const rec_sysmat *S, float *pixels[])
{
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_sysmat_block *b = &S->block[c];
        size_t k = (size_t)S->binning, w = (size_t)s->rig.cameras[c].width, bw = (size_t)b->bw;
        pixels[c] = must_floats(bw * (size_t)b->bh * 4);
        for (size_t i = 0; i < bw * (size_t)b->bh; i++)
            for (size_t l = 0; l < 3; l++) {
                double sum = 0;
                for (size_t j = 0; j < k * k; j++) {
                    size_t x = i % bw * k + j % k, y = i / bw * k + j / k;
                    sum += s->image[c][(y * w + x) * 3 + l] + 0.01 * s->peak * bench_normal();
                }
                pixels[c][i * 4 + l] = (float)(sum / (double)(k * k));
            }
    }
}

/* Columns once by windows, rows once by entries of two bytes, and the vectors (recon/opencl/README.md). */
static double bytes_per_iteration(const rec_frame *f)
{
    const struct rec_frame_report *r = rec_frame_get_report(f);
    return bytes_of_windows(rec_frame_subsys(f)) + 2.0 * (double)r->entries +
           (double)r->active_voxels * 316 + (double)r->active_rays * 64;
}

static void size_say(FILE *csv, const int32_t size[3], const struct side side[2])
{
    const struct rec_frame_report *r = rec_frame_get_report(side[0].f),
                                  *t = rec_frame_get_report(side[1].f);
    double bytes = bytes_per_iteration(side[0].f);
    printf("\n%d^3 trilinear from 8 x %dx%d: %lld voxels, %lld rays, %.2f M entries; %u + %u "
           "iterations here, %u + %u there%s%s\n"
           "  %.1f MB an iteration, %.3f ms at 3 TB/s; volume error %.4f here, %.4f there, %.5f "
           "times as large\n",
           size[2], size[0], size[1], (long long)r->active_voxels, (long long)r->active_rays,
           (double)r->entries * 1e-6, r->coarse_iterations, r->solve.iterations,
           t->coarse_iterations, t->solve.iterations,
           t->on_card ? "" : ", SOLVED HERE: ", t->why_here, bytes * 1e-6, bytes / 3e9,
           side[0].error, side[1].error, side[1].error / side[0].error);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < STAGES; i++)
            bench_row(csv, "%d,%d,%d,%s,%s,%.4f,%.1f", size[2], size[0], size[1], side[k].name,
                      stage_names[i], side[k].least[i], i == ALL ? 1e3 / side[k].least[i] : 0.0);
}

static void run(FILE *csv, const int32_t size[3], pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct side side[2] = {{.name = "cpu, 2 threads"}, {.name = rec_cl_about(cl)->name}};
    float *pixels[REC_MAX_CAMERAS];
    struct pvx_diag d = {""};
    struct scene s;
    rec_sysmat *S;
    scene_flame(&s, size, REC_TRILINEAR, pool);
    CHECK(rec_sysmat_build(&s.rig, &rec_sysmat_defaults, pool, NULL, NULL, &S, NULL));
    make_pixels(&s, S, pixels);
    for (int k = 0; k < 2; k++) {
        p.card = k == 1 ? cl : NULL;
        bench_check(rec_frame_alone(S, &s.rig, &p, pool, &side[k].f, &d), &d);
    }
    int turns = rec_cl_about(cl)->kind == REC_CL_GPU || size[2] < 256 ? TURNS : 1;
    for (int turn = 0; turn < turns; turn++)
        for (int k = 0; k < 2; k++)
            side_turn(&side[k], &s, (const float *const *)pixels);
    size_say(csv, size, side);
    for (int k = 0; k < 2; k++)
        rec_frame_free(&side[k].f);
    for (size_t c = 0; c < s.rig.n_cameras; c++)
        free(pixels[c]);
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
    printf("card: binned pixels to volume on %s (%s, driver %s)%s\n", about->name, about->platform,
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
