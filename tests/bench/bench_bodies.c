/* bench_bodies.c - a rod or a log through a fire: the error of what two cameras see, when the rig knows
 * of the body, when it does not, and when there is none, in both bases.
 *
 * Pictures are sums of the field in quarter-cell steps up to the body, never the system matrix.  What is
 * judged is the same for all three: voxels whose middle is outside the body and seen past it by two
 * cameras at least. */
#include "bench.h"

static struct rec_body bodies[] = {
    {.name = "rod",
     .kind = REC_BODY_CYLINDER,
     .a = {-0.6, -0.1, 0.42},
     .b = {0.6, 0.1, 0.5},
     .radius = 0.03},
    {.name = "log", .kind = REC_BODY_BOX, .a = {-0.4, -0.09, 0.1}, .b = {0.4, 0.09, 0.28}},
};

static bool sees_past(const struct rec_camera *c, const struct rec_bodies *b, const double x[3])
{
    double from[3], d[3], uv[2], far = 0;
    rec_camera_centre(c, from);
    for (int a = 0; a < 3; a++) {
        d[a] = x[a] - from[a];
        far += d[a] * d[a];
    }
    far = sqrt(far);
    for (int a = 0; a < 3; a++)
        d[a] /= far;
    return rec_camera_sees(c, x, uv) && rec_body_hit(b, from, d) >= far;
}

/* Voxels that are judged, [N]. */
static uint8_t *judged(const struct scene *s, const struct rec_bodies *b, double *share)
{
    size_t n = rec_grid_count(&s->rig.grid), sum = 0;
    uint8_t *out = pvx_calloc(n, 1);
    if (out == NULL)
        CHECK(PVX_ENOMEM);
    for (size_t i = 0; i < n; i++) {
        double x[3];
        int views = 0;
        grid_centre(&s->rig.grid, (int32_t)i, x);
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            views += sees_past(&s->rig.cameras[c], b, x);
        out[i] = views >= 2 && !rec_body_inside(b->body, x);
        sum += out[i];
    }
    *share = (double)sum / (double)n;
    return out;
}

struct outcome {
    double error, ms, build_s;
    int32_t columns;
    uint64_t nnz;
};

static double error_of(const struct scene *s, const float *dense, const uint8_t *mask)
{
    size_t n = rec_grid_count(&s->rig.grid), nch = (size_t)s->nch;
    double wrong = 0, all = 0;
    for (size_t i = 0; i < n * nch; i++) {
        double t = s->truth[i], e = (double)dense[i] - t;
        if (!mask[i / nch])
            continue;
        wrong += e * e;
        all += t * t;
    }
    return sqrt(wrong / all);
}

/* What of the pictures of s the default solver makes with the bodies that its rig names. */
static struct outcome solve(const struct scene *s, const uint8_t *mask, pvx_pool *pool)
{
    struct outcome out = {0};
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_sysmat *S;
    rec_frame *f;
    int64_t t0 = pvx_now_mono();
    CHECK(rec_sysmat_build(&s->rig, &rec_sysmat_defaults, pool, NULL, NULL, &S, NULL));
    out.build_s = ms(pvx_now_mono() - t0) / 1000;
    out.nnz = S->nnz;
    p.nch = s->nch;
    p.photo.saturation = 1e30f;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    bench_seed(1);
    scene_fill(s, f, 0.01);
    t0 = pvx_now_mono();
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    out.ms = ms(pvx_now_mono() - t0);
    rec_frame_volume(f, &v);
    out.columns = v.n;
    float *dense = must_floats(rec_grid_count(&s->rig.grid) * (size_t)s->nch);
    rec_sparse_to_dense(&v, dense);
    out.error = error_of(s, dense, mask);
    free(dense);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    return out;
}

static void shoot_again(struct scene *s, pvx_pool *pool)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(s->image[c]);
    free(s->unseen_image);
    scene_shoot(s, pool);
}

static void compare(FILE *csv, enum flame_kind kind, struct rec_body *body, enum rec_basis basis,
                    pvx_pool *pool)
{
    static const char *const names[] = {"without", "known", "unknown"};
    const struct rec_bodies one = {1, body};
    struct scene s;
    struct outcome out[3];
    double share;
    if (!scene_new(&s, kind, &views_8, size_64, flames[kind].t, pool))
        return;
    scene_truth(&s, basis, pool);
    uint8_t *mask = judged(&s, &one, &share);
    out[0] = solve(&s, mask, pool);
    s.field.bodies = &one;
    shoot_again(&s, pool);
    out[2] = solve(&s, mask, pool);
    s.rig.bodies = one;
    out[1] = solve(&s, mask, pool);
    s.rig.bodies = (struct rec_bodies){0}; /* not its own */
    for (int i = 0; i < 3; i++)
        bench_row(csv, "%s,%s,%s,%s,%s,%.4f,%.5f,%.4f,%d,%llu,%.3f,%.3f", flames[kind].name,
                  flames[kind].use, rec_basis_name(basis), body->name, names[i], share,
                  out[i].error, out[i].error / out[0].error, out[i].columns,
                  (unsigned long long)out[i].nnz, out[i].build_s, out[i].ms);
    free(mask);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    static const enum flame_kind fires[] = {FLAME_WALL, FLAME_POOL, FLAME_JET, FLAME_HOLLOW};
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nbodies in the flame, 8 cameras, 64^3, 1 %% noise, error of what two cameras "
           "see, %u threads\n",
           pvx_pool_threads(pool));
    FILE *csv =
        bench_csv(argc, argv, "bodies",
                  "scene,use,basis,body,rig,judged,volume,of_without,columns,nnz,build_s,solve_ms");
    for (int basis = REC_TRILINEAR; basis >= REC_BOX; basis--)
        for (size_t b = 0; b < sizeof bodies / sizeof *bodies; b++)
            for (size_t i = 0; i < sizeof fires / sizeof *fires; i++)
                compare(csv, fires[i], &bodies[b], (enum rec_basis)basis, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
