/* A set that a device solves is solved by the processors too, and compared. */
#include "tests/stability/stab.h"

#include "tests/lib/card_pair.h"

static size_t solved;
static double worst, moved;

bool stab_solve_pair(const struct stab_bed *b, rec_frame *f, const struct rec_sparse *previous)
{
    struct card_pair p = {.there = f};
    struct rec_frame_params here = f->carver->p;
    here.card = NULL;
    CHECK(rec_frame_alone(b->S, &b->rig, &here, b->run->pool, &p.here, NULL));
    CHECK(rec_images_new(b->S, here.nch == 3 ? 4 : 1, &p.images));
    stab_fill(b, p.here);
    card_pair_take(&p, previous, previous);
    solved++;
    worst = fmax(worst, p.worst);
    moved = fmax(moved, p.moved);
    rec_frame_free(&p.here);
    rec_images_free(&p.images);
    return p.wrong == 0;
}

size_t stab_pairs(void)
{
    printf("  %zu sets on the device; volumes differ by at most %.2g, %.2g of the bound\n", solved,
           moved, worst);
    return solved;
}
