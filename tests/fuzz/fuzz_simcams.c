/* fuzz_simcams.c - any text as an order to simulated cameras, by hand, by timetable and as an option: it is taken
 * or refused with a reason, and what was taken is in range. */
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
    MUST((simcams_plan_line(&rig, text, &plan, &d) == PVX_OK) == (d.text[0] == '\0'));
    for (int k = 0; k < SIMCAMS_N_KINDS; k++) {
        d.text[0] = '\0';
        e = simcams_fault_option(&rig, (enum simcams_fault_kind)k, text, state, &d);
        MUST((e == PVX_OK) == (d.text[0] == '\0'));
    }
    d.text[0] = '\0';
    e = simcams_plan_option(&rig, (size & 1) != 0, text, &plan, &d);
    MUST((e == PVX_OK) == (d.text[0] == '\0'));
    for (int c = 0; c < CAMERAS; c++)
        in_range(&state[c]);
    return 0;
}
