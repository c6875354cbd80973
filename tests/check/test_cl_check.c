/* test_cl_check.c - a device that computes wrongly is not used (daemon/pipeline/compute_check.h). */
#include "daemon/pipeline/compute.h"
#include "daemon/pipeline/compute_check.h"
#include "tests/t.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/cl_fault.h"

/* What is said of a device with this fault. */
static pvx_err check(const char *fault, struct pvx_diag *d)
{
    cl_fault(NULL);
    rec_cl *cl = cl_bed_open();
    cl_fault(fault);
    pvx_err e = dmn_compute_check(cl, d);
    rec_cl_close(&cl);
    return e;
}

T_CASE(a_device_that_computes_rightly)
{
    struct pvx_diag d = {""};
    T_EQ_I(check(NULL, &d), PVX_OK);
    T_EQ_S(d.text, "");
}

/* From the k-th kernel on it does nothing: no hull, no columns, no product, no step, or no grey. */
T_CASE(a_device_that_computes_wrongly)
{
    struct pvx_diag none = {""};
    T_EQ_I(check("clEnqueueNDRangeKernel:0:idle", &none), PVX_OK);
    long all = cl_fault_calls();
    T_LE(100, all);
    for (int part = 0; part <= 60; part += T_SANITIZED ? 30 : 10) {
        struct pvx_diag d = {""};
        char fault[64];
        snprintf(fault, sizeof fault, "clEnqueueNDRangeKernel:%ld:idle", 1 + all * part / 100);
        T_EQ_I(check(fault, &d), PVX_EUNSUP);
        T_CONTAINS(d.text, "it computes wrongly: the volume of a small flame differs by ");
        T_OK(cl_fault_happened());
    }
}

T_CASE(a_device_that_fails)
{
    struct pvx_diag d = {""};
    T_EQ_I(check("clEnqueueNDRangeKernel:300:error", &d), PVX_ENODEV);
    T_CONTAINS(d.text, "CL_OUT_OF_RESOURCES");
}

T_CASE(it_is_refused_by_name)
{
    const struct dmn_compute_want w = {.word = "opencl:portable", .what = "it"};
    struct dmn_compute c;
    struct pvx_diag d = {""};
    cl_fault("clEnqueueNDRangeKernel:1:idle");
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_EUNSUP);
    T_CONTAINS(d.text, "it: opencl:portable: ");
    T_CONTAINS(d.text, "update its driver");
    T_OK(c.card == NULL);
    d.text[0] = '\0';
    cl_fault("clEnqueueNDRangeKernel:300:error"); /* that is no reason not to start */
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_OK);
    T_OK(c.card == NULL && c.warn);
    T_CONTAINS(c.said, "compute: the processors; ");
    T_CONTAINS(c.said, "CL_OUT_OF_RESOURCES");
    cl_fault(NULL);
    T_EQ_I(dmn_compute_open(&w, &c, &d), PVX_OK);
    T_OK(c.card != NULL);
    dmn_compute_close(&c);
}

T_MAIN((cl_fault_begin(), cl_bed_begin()), (void)0)
