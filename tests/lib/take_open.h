/* take_open.h - a take that must open. */
#ifndef TESTS_TAKE_OPEN_H
#define TESTS_TAKE_OPEN_H
#include "../t.h"
#include "capture/take/take.h"

static cap_take *open_take(const char *name)
{
    cap_take *t;
    struct pvx_diag d = {""};
    pvx_err e = cap_take_open(name, &t, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    return t;
}
#endif
