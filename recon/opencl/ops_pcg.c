/* The loops of solve/passes/pcg_pass_impl.h, in its order. */
#include "recon/opencl/ops.h"

static void pass_begin(const struct rec_cl_at *t, struct rec_pcg *v)
{
    REC_CL_COLUMNS(t, REC_CL_K_PCG_BEGIN, REC_CL_VALUE(t->n), REC_CL_NEAR(t),
                   REC_CL_VECTOR(t, v->d), REC_CL_VECTOR(t, v->smooth.diag2),
                   REC_CL_VECTOR(t, v->stiff.by), REC_CL_VECTOR(t, v->stiff.inverse),
                   REC_CL_VECTOR(t, v->stiff.diag));
}

static void pass_scale(const struct rec_cl_at *t, struct rec_pcg *v)
{
    const cl_float4 share = rec_cl_four(v->pb->share), lambda = rec_cl_four(v->lambda);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_SCALE, REC_CL_VALUE(t->n), REC_CL_VALUE(share),
                   REC_CL_VALUE(lambda), REC_CL_VECTOR(t, v->pb->diag),
                   REC_CL_VECTOR(t, v->stiff.diag), REC_CL_VECTOR(t, v->stiff.inverse),
                   REC_CL_VECTOR(t, v->scale));
}

static void pass_direction(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    const cl_float4 beta = rec_cl_four(v->beta), mu = rec_cl_four(v->mu);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_DIRECTION, REC_CL_VALUE(t->n), REC_CL_VALUE(beta),
                   REC_CL_VALUE(mu), REC_CL_VECTOR(t, v->x), REC_CL_VECTOR(t, v->phi),
                   REC_CL_VECTOR(t, v->scale), REC_CL_VECTOR(t, v->d), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 1, sums);
}

static void pass_curvature(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    int four = rec_cl_per_channel(v->pb);
    rec_cl_forward(t->q, t->a, t->cs, rec_cl_twin_of(t->s, v->d), rec_cl_twin_of(t->s, v->q),
                   false);
    REC_CL_ROWS(t, REC_CL_K_PCG_ROWS_SQUARE, REC_CL_BINS(t), REC_CL_WEIGHTS(t, v->pb, four),
                REC_CL_VECTOR(t, v->q), REC_CL_TO_PARTS(t));
    rec_cl_want(t, t->rows, sums[0]);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_CURVATURE, REC_CL_VALUE(t->n), REC_CL_NEAR(t),
                   REC_CL_VECTOR(t, v->d), REC_CL_VECTOR(t, v->stiff.by), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 1, sums + 1);
}

/* ar is free between a step and the next gradient, and has e.  How much was clipped is known on the device alone. */
static void pass_step(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    const cl_float4 alpha = rec_cl_four(v->alpha);
    double each[4];
    for (int l = 0; l < 4; l++)
        each[l] = v->alpha[l] > 0 ? 1 / v->alpha[l] : 0;
    const cl_float4 inverse = rec_cl_four(each);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_STEP, REC_CL_VALUE(t->n), REC_CL_VALUE(alpha),
                   REC_CL_VALUE(inverse), REC_CL_VECTOR(t, v->x), REC_CL_VECTOR(t, v->d),
                   REC_CL_VECTOR(t, v->next), REC_CL_VECTOR(t, v->ar), REC_CL_TO_PARTS(t));
    v->any_clipped = true;
    rec_cl_sums_of(t, t->columns, 1, sums);
}

/* q = A d + A e. */
static void pass_clipped(const struct rec_cl_at *t, struct rec_pcg *v)
{
    rec_cl_forward(t->q, t->a, t->cs, rec_cl_twin_of(t->s, v->ar), rec_cl_twin_of(t->s, v->q),
                   true);
}

static void pass_smoothness(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    REC_CL_COLUMNS(t, REC_CL_K_PCG_SMOOTHNESS, REC_CL_VALUE(t->n), REC_CL_NEAR(t),
                   REC_CL_VECTOR(t, v->x), REC_CL_VECTOR(t, v->stiff.by),
                   REC_CL_VECTOR(t, v->stiff.inverse), REC_CL_VECTOR(t, v->lx), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 2, sums);
}
static void pass_residual(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    const cl_float4 alpha = rec_cl_four(v->alpha);
    int four = rec_cl_per_channel(v->pb);
    REC_CL_ROWS(t, REC_CL_K_PCG_ROWS_STEP, REC_CL_BINS(t), REC_CL_WEIGHTS(t, v->pb, four),
                REC_CL_VALUE(alpha), REC_CL_VECTOR(t, v->r), REC_CL_VECTOR(t, v->q),
                REC_CL_TO_PARTS(t));
    rec_cl_want(t, t->rows, sums[0]);
    pass_smoothness(t, v, sums + 1);
}

static void pass_brightness(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    REC_CL_COLUMNS(t, REC_CL_K_PCG_BRIGHTNESS, REC_CL_VALUE(t->n), REC_CL_VECTOR(t, v->x),
                   REC_CL_VECTOR(t, v->stiff.inverse), REC_CL_VECTOR(t, v->lx),
                   REC_CL_VECTOR(t, v->next), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 3, sums);
}
static void pass_stiffness(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    const struct rec_pcg_bright bright = rec_pcg_bright(v);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_STIFFNESS, REC_CL_VALUE(t->n), REC_CL_VALUE(bright.dark),
                   REC_CL_VALUE(bright.scale), REC_CL_VECTOR(t, v->next),
                   REC_CL_VECTOR(t, v->smooth.diag2), REC_CL_VECTOR(t, v->stiff.by),
                   REC_CL_VECTOR(t, v->stiff.inverse), REC_CL_VECTOR(t, v->stiff.diag),
                   REC_CL_VECTOR(t, v->lx), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 1, sums);
}

static void pass_regradient(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    const cl_float4 lambda = rec_cl_four(v->lambda);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_GRADIENT, REC_CL_VALUE(t->n), REC_CL_NEAR(t),
                   REC_CL_VALUE(lambda), REC_CL_VECTOR(t, v->x), REC_CL_VECTOR(t, v->ar),
                   REC_CL_VECTOR(t, v->lx), REC_CL_VECTOR(t, v->scale),
                   REC_CL_VECTOR(t, v->phi_old), REC_CL_VECTOR(t, v->phi), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 2, sums);
}
static void pass_gradient(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    rec_cl_adjoint(t->q, t->a, t->cs, rec_cl_twin_of(t->s, v->q), rec_cl_twin_of(t->s, v->ar));
    pass_regradient(t, v, sums);
}

static void pass_slope(const struct rec_cl_at *t, struct rec_pcg *v, double (*sums)[4])
{
    REC_CL_COLUMNS(t, REC_CL_K_PCG_SLOPE, REC_CL_VALUE(t->n), REC_CL_VECTOR(t, v->x),
                   REC_CL_VECTOR(t, v->next), REC_CL_VECTOR(t, v->phi), REC_CL_TO_PARTS(t));
    rec_cl_sums_of(t, t->columns, 1, sums);
}
static void pass_retreat(const struct rec_cl_at *t, struct rec_pcg *v)
{
    const cl_float4 back = rec_cl_four(v->back);
    REC_CL_COLUMNS(t, REC_CL_K_PCG_RETREAT, REC_CL_VALUE(t->n), REC_CL_VALUE(back),
                   REC_CL_VECTOR(t, v->x), REC_CL_VECTOR(t, v->next));
}

void rec_cl_pass(struct rec_pcg *v, enum rec_pcg_pass pass, double (*sums)[4])
{
    const struct rec_cl_at at = rec_cl_at(v->pb->a), *t = &at;
    switch (pass) {
    case REC_PASS_BEGIN: pass_begin(t, v); break;
    case REC_PASS_SCALE: pass_scale(t, v); break;
    case REC_PASS_DIRECTION: pass_direction(t, v, sums); break;
    case REC_PASS_CURVATURE: pass_curvature(t, v, sums); break;
    case REC_PASS_STEP: pass_step(t, v, sums); break;
    case REC_PASS_CLIPPED: pass_clipped(t, v); break;
    case REC_PASS_RESIDUAL: pass_residual(t, v, sums); break;
    case REC_PASS_SMOOTHNESS: pass_smoothness(t, v, sums); break;
    case REC_PASS_BRIGHTNESS: pass_brightness(t, v, sums); break;
    case REC_PASS_STIFFNESS: pass_stiffness(t, v, sums); break;
    case REC_PASS_GRADIENT: pass_gradient(t, v, sums); break;
    case REC_PASS_REGRADIENT: pass_regradient(t, v, sums); break;
    case REC_PASS_SLOPE: pass_slope(t, v, sums); break;
    case REC_PASS_RETREAT: pass_retreat(t, v); break;
    case REC_PASS_EXPECTED: /* a prediction is solved here (solve.c) */
    case REC_PCG_PASSES: break;
    }
}
