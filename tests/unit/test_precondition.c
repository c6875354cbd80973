/* test_precondition.c - the preconditioner and the direction that it gives, against (6) and (4) of pcg.c. */
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"
#include "recon/frame/inside.h"
#include "recon/solve/impl.h"
#include "recon/solve/passes/pcg_pass.h"

/* A state of the solver on the carved frame: phi of all signs, x > 0, random S. */
struct bed {
    struct scene s;
    rec_frame *f;
    rec_problem *pb;
    struct rec_pcg_passes table;
    struct rec_pcg t;
};

/* The first cs lanes of each pixel. */
static void shoot(const struct scene *s, rec_frame *f, size_t cs)
{
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = (size_t)s->S->block[c].bw * (size_t)s->S->block[c].bh;
        for (size_t i = 0; i < n * cs; i++)
            rec_frame_input(f, c)[i] = s->image[c][i / cs * 4 + i % cs];
        rec_frame_camera(f, c)->present = true;
    }
}

static void bed_new(struct bed *b, int32_t grid, int nch)
{
    scene_new(&b->s, 6, 80, grid, 2, 2);
    struct rec_frame_params p = rec_frame_defaults;
    p.nch = nch;
    T_EQ_I(rec_frame_alone(b->s.S, &b->s.rig, &p, b->s.pool, &b->f, NULL), PVX_OK);
    shoot(&b->s, b->f, nch == 3 ? 4 : 1);
    rec_frame_carve(b->f);
    const struct rec_pictures in = slot_pictures(b->f, 0.01);
    b->pb = b->f->solver->problem;
    T_OK(rec_problem_load(b->pb, b->f->sub, &in));
    rec_pcg_passes_init(&b->table, PVX_CPU_REF);
    b->t = (struct rec_pcg){.pb = b->pb,
                            .x = b->pb->xv[1],
                            .phi = b->pb->xv[2],
                            .d = b->pb->xv[3],
                            .scale = b->pb->xv[4],
                            .stiff = b->pb->stiff,
                            .pass = &b->table};
    size_t n = (size_t)b->pb->a->n * (size_t)b->pb->cs;
    for (size_t i = 0; i < n; i++) {
        b->t.x[i] = 1;
        b->t.phi[i] = (float)t_uniform(-1, 1);
        b->t.scale[i] = (float)t_uniform(0.1, 2);
        b->t.d[i] = 0;
    }
    for (int l = 0; l < 4; l++) {
        b->t.mu[l] = 1;
        b->t.lambda[l] = 0.1 * (l + 1);
    }
}

static void bed_free(struct bed *b)
{
    rec_frame_free(&b->f);
    scene_free(&b->s);
}

T_CASE(scale_and_direction_are_those_of_the_definition)
{
    for (int k = 0; k < 2; k++) {
        static struct bed b;
        bed_new(&b, 32, k % 2 ? 1 : 3);
        const struct rec_subsys *a = b.pb->a;
        size_t cs = (size_t)a->cs, n = (size_t)a->n, chunks = rec_column_chunks(b.pb);
        float *diag = pvx_calloc(n, sizeof *diag);
        double off[2] = {0}, empty = 0;
        b.pb->diag = diag;
        for (size_t q = 0; q < n; q++) {
            diag[q] = q % 7 == 0 ? 0 : (float)t_uniform(0.1, 3);
            b.t.stiff.diag[q] = q % 7 == 0 ? 0 : (float)t_uniform(0, 50);
            b.t.stiff.inverse[q] = (float)t_uniform(0.3, 2);
        }
        for (size_t i = 0; i < chunks; i++) {
            b.table.loop[REC_PASS_SCALE](&b.t, i);
            b.table.loop[REC_PASS_DIRECTION](&b.t, i);
        }
        for (size_t q = 0; q < n; q++)
            for (size_t l = 0; l < (size_t)b.pb->nch; l++) {
                double H =
                    b.pb->share[l] * (double)diag[q] + b.t.lambda[l] * (double)b.t.stiff.diag[q];
                double M = H > 0 ? sqrt((double)b.t.stiff.inverse[q]) / H : 0;
                double S = (double)b.t.scale[q * cs + l], phi = (double)b.t.phi[q * cs + l];
                off[0] = fmax(off[0], fabs(S * S - M) / fmax(M, 1e-3));
                off[1] = fmax(off[1], fabs((double)b.t.d[q * cs + l] + M * phi));
                empty += !(H > 0);
            }
        T_LE(off[0], 1e-5);
        T_LE(off[1], 1e-5);
        T_OK(empty > 0 && empty < 0.5 * (double)n * b.pb->nch);
        bed_free(&b);
        free(diag);
    }
}
