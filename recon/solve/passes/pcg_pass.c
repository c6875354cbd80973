#include "recon/solve/passes/pcg_pass.h"

#include "recon/solve/card.h"

/* What a pass goes over, and how many sums come from its rows and its columns. */
struct shape {
    bool rows, columns;
    int of_rows, of_columns;
};
static const struct shape shapes[REC_PCG_PASSES] = {
    [REC_PASS_EXPECTED] = {.columns = true},
    [REC_PASS_BEGIN] = {.columns = true},
    [REC_PASS_SCALE] = {.columns = true},
    [REC_PASS_DIRECTION] = {.columns = true, .of_columns = 1},
    [REC_PASS_CURVATURE] = {true, true, 1, 1},
    [REC_PASS_STEP] = {.columns = true, .of_columns = 1},
    [REC_PASS_CLIPPED] = {.columns = false}, /* slabs */
    [REC_PASS_RESIDUAL] = {true, true, 1, 2},
    [REC_PASS_SMOOTHNESS] = {.columns = true, .of_columns = 2},
    [REC_PASS_BRIGHTNESS] = {.columns = true, .of_columns = 3},
    [REC_PASS_STIFFNESS] = {.columns = true, .of_columns = 1},
    [REC_PASS_GRADIENT] = {.columns = true, .of_columns = 2},
    [REC_PASS_REGRADIENT] = {.columns = true, .of_columns = 2},
    [REC_PASS_SLOPE] = {.columns = true, .of_columns = 1},
    [REC_PASS_RETREAT] = {.columns = true},
};

static bool pass_clipped_any(const rec_problem *pb)
{
    bool any = false;
    for (size_t k = 0; k < rec_column_chunks(pb); k++)
        any = any || pb->n_clipped[k] > 0;
    return any;
}

void rec_pcg_pass(struct rec_pcg *t, enum rec_pcg_pass which, double (*sums)[4])
{
    rec_problem *pb = t->pb;
    const struct rec_card_ops *card = rec_card_of(pb->a);
    const struct shape *s = &shapes[which];
    if (card != NULL) {
        card->pass(t, which, sums);
        return;
    }
    size_t rows = s->rows ? rec_row_chunks(pb) : 0;
    size_t end = rows + (s->columns ? rec_column_chunks(pb) : 0);
    if (which == REC_PASS_CURVATURE)
        rec_start_product(pb, t->d);
    pvx_pool_run(pb->a->pool, which == REC_PASS_CLIPPED ? (size_t)pb->a->slabs : end,
                 t->pass->loop[which], t);
    for (int i = 0; i < s->of_rows; i++)
        rec_sum(pb, 0, rows, i, sums[i]);
    for (int i = 0; i < s->of_columns; i++)
        rec_sum(pb, rows, end, i, sums[s->of_rows + i]);
    if (which == REC_PASS_STEP)
        t->any_clipped = pass_clipped_any(pb);
}
