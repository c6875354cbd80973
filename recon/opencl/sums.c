/* The sums of the operations: several share a wait. */
#include <assert.h>
#include <string.h>

#include "recon/opencl/ops.h"

void rec_cl_want(const struct rec_cl_at *t, size_t groups, double to[4])
{
    rec_cl_solver *s = t->s;
    assert(s->wanted < REC_CL_SUMS);
    s->want[s->wanted].to = to;
    s->want[s->wanted++].groups = (uint32_t)groups;
}

void rec_cl_fetch(const struct rec_cl_at *t)
{
    rec_cl_solver *s = t->s;
    uint32_t groups[REC_CL_SUMS];
    double got[REC_CL_SUMS][4];
    bool later = s->later;
    s->later = false;
    if (later)
        return;
    for (uint32_t i = 0; i < s->wanted; i++)
        groups[i] = s->want[i].groups;
    (void)rec_cl_sums(t->q, groups, s->wanted, got); /* lost: all 0 */
    for (uint32_t i = 0; i < s->wanted; i++)
        memcpy(s->want[i].to, got[i], sizeof got[i]);
    s->wanted = 0;
}

void rec_cl_later(const struct rec_subsys *sub)
{
    rec_cl_at(sub).s->later = true;
}
