/* test_cl_rates.c - how fast a device moves bytes, measured without its kernels. */
#include "../t.h"

#include "recon/opencl/rates.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/cl_fault.h"

T_CASE(every_device_has_rates)
{
    struct rec_cl_info o[REC_CL_MOST];
    struct rec_cl_rates r;
    struct pvx_diag d = {""};
    size_t n = rec_cl_list(o, &d);
    T_OK(n > 0);
    for (size_t i = 0; i < n; i++) {
        if (o[i].why_not[0] != '\0')
            continue;
        T_EQ_I(rec_cl_measure(i, &r, &d), PVX_OK);
        T_EQ_S(d.text, "");
        /* bytes a second: no memory is slower than a disk, none faster than a thousand times the fastest */
        T_OK(r.copy > 1e6 && r.copy < 1e16);
        T_OK(r.up > 1e6 && r.up < 1e16);
        T_OK(r.down > 1e6 && r.down < 1e16);
    }
    T_OK(rec_cl_measure(n, &r, &d) == PVX_ENOENT);
    T_OK(d.text[0] != '\0' && r.copy == 0);
}

T_MAIN((cl_fault_begin(), cl_bed_begin()), (void)0)
