/* card.c - what can be solved on a graphics card. */
#include "recon/frame/impl.h"

const char *rec_frame_card_why_not(const struct rec_frame_params *p)
{
    if (!rec_solver_is_default(p->solve.solver))
        return "a solver for comparison";
    if (p->solve.stop == REC_STOP_LCURVE)
        return "the stop at the corner of the L-curve";
    if (p->temporal)
        return "the expectation from the previous volume";
    if (p->at_least)
        return "saturated pixels as lower bounds";
    if (p->again)
        return "error bars";
    if (p->solve.trace != NULL)
        return "a trace of the iterates";
    return NULL;
}
