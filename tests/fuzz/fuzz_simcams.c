/* fuzz_simcams.c - any text as a line for simulated cameras, from the start, at a time and by hand: it is taken
 * or refused with a reason, and all values that were taken are in range. */
#include <string.h>

#include "daemon/cli/simcams/faults.h"
#include "tests/fuzz/fuzz.h"

#define CAMERAS 3

static void in_range(const struct simcams_state *s)
{
    const struct cap_gvcam_fault *f = &s->fault;
    const double *v;
#define CHECK(number, name, n, min, max, member)  \
    v = (const double *)(const void *)&f->member; \
    for (int k = 0; k < (n); k++)                 \
        MUST(v[k] >= (min) && v[k] <= (max));
    SIMCAMS_FAULTS(CHECK)
#undef CHECK
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct rec_rig rig;
    struct simcams_state state[CAMERAS];
    struct simcams_plan plan = {0};
    struct simcams_order order;
    struct pvx_diag d = {""};
    char text[2048];
    if (rig.n_cameras == 0)
        MUST(rec_rig_ring(CAMERAS, 2.5, 80, 60, 32, &rig) == PVX_OK);
    for (int c = 0; c < CAMERAS; c++)
        state[c] = simcams_healthy();
    size_t n = size < sizeof text - 1 ? size : sizeof text - 1;
    if (n > 0)
        memcpy(text, data, n);
    text[n] = '\0';
    pvx_err e = simcams_control(&rig, text, state, &order, &d);
    MUST((e == PVX_OK) == (d.text[0] == '\0'));
    fuzz_taken += e == PVX_OK;
    d.text[0] = '\0';
    MUST((simcams_at_line(&rig, text, &plan, &d) == PVX_OK) == (d.text[0] == '\0'));
    d.text[0] = '\0';
    MUST((simcams_set_line(&rig, text, state, &plan, &d) == PVX_OK) == (d.text[0] == '\0'));
    for (int c = 0; c < CAMERAS; c++)
        in_range(&state[c]);
    return 0;
}
