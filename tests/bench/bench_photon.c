/* bench_photon.c - what it is worth that the rig knows its noise (photometry: noise): pictures with the noise of
 * photons, variance = read^2 + gain light, solved with and without those two numbers, and pictures of 1 %
 * gaussian noise beside them.  The table is in recon/NUMERICS.md, 3. */
#include "curve.h"

static const struct view_set views_5 = {"5 on a ring", 8, 5, 3, {0, 1, 2, 4, 6}};

static const struct photons {
    double peak, read; /* electrons; peak 0: gaussian noise of 1 % */
} photons[] = {{200, 2}, {2000, 5}, {0, 0}};

/* Variance of a sample over its light, and read noise, of full scale. */
static double gain_of(const struct photons *p, const struct scene *s)
{
    return p->peak > 0 ? s->peak / p->peak : 0;
}
static double read_of(const struct photons *p, const struct scene *s)
{
    return p->peak > 0 ? p->read * gain_of(p, s) : noise_1.sigma * s->peak;
}

static void expose(struct shot *t, const struct scene *s, double read, double gain)
{
    size_t nch = (size_t)s->nch, cs = nch == 3 ? 4 : 1;
    bench_seed(7);
    for (size_t c = 0; c < t->n_cameras; c++)
        for (size_t i = 0; i < t->floats[c] / cs; i++)
            for (size_t k = 0; k < nch; k++) {
                double light = (double)s->image[c][i * nch + k];
                t->px[c][i * cs + k] =
                    (float)(light + sqrt(read * read + gain * light) * bench_normal());
            }
}

static void one(FILE *csv, const struct flame *f, const struct view_set *v, struct scene *s,
                const rec_sysmat *S, pvx_pool *pool)
{
    float *dense = must_floats(rec_grid_count(&S->grid) * (size_t)s->nch);
    struct shot shot;
    shot_new(&shot, s, &noise_0, 1);
    for (size_t n = 0; n < sizeof photons / sizeof *photons; n++) {
        const double read = read_of(&photons[n], s), gain = gain_of(&photons[n], s);
        expose(&shot, s, read, gain);
        for (int known = 0; known < 2; known++) {
            double least;
            for (size_t c = 0; c < s->rig.n_cameras; c++)
                s->rig.cameras[c].photometry = (struct rec_photometry){
                    .has_noise = known, .read_noise = read, .noise_gain = gain};
            struct rec_frame_report r = solve_once(s, &shot, S, "pcg", pool, dense, &least);
            bench_row(csv, "%s,%s,%s,%s,%g,%d,%u,%.5f,%.4f", f->name, f->use, v->name,
                      rec_basis_name(S->grid.basis), photons[n].peak, known, r.solve.iterations,
                      rec_rel_l2(dense, s->truth, rec_grid_count(&S->grid) * (size_t)s->nch),
                      view_error(s, dense, pool));
        }
    }
    shot_free(&shot);
    free(dense);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf(
        "\nthe noise of photons, known to the rig or not; peak in electrons, 0: 1 %% gaussian\n");
    FILE *csv =
        bench_csv(argc, argv, "photon", "scene,use,rig,basis,peak,known,iterations,volume,view");
    for (int kind = 0; kind < N_FLAMES; kind++)
        for (int k = 0; k < 2 && kind != FLAME_PLUME; k++) {
            const struct view_set *v = k == 0 ? &views_8 : &views_5;
            struct scene s;
            if (!scene_new(&s, (enum flame_kind)kind, v, size_64, flames[kind].t, pool))
                continue;
            scene_truth(&s, (kind + k) % 2 ? REC_BOX : REC_TRILINEAR, pool);
            rec_sysmat *S = scene_matrix(&s, 0, pool, NULL);
            one(csv, &flames[kind], v, &s, S, pool);
            rec_sysmat_free(&S);
            scene_fini(&s);
        }
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
