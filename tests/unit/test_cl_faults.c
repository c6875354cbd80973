/* test_cl_faults.c - a device that fails, hangs or has no room: it is lost, at once and for good, and no number is
 * wrong. */
#include "tests/t.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/cl_fault.h"
#include "tests/lib/scratch.h"
#include "recon/opencl/impl.h"

enum { N = 1000 };
static float up[N];
static double sum_of_up;

/* What a part of a frame set does.  Fills *sum; 0: lost. */
static bool work(rec_cl_queue *q, const struct rec_cl_buffer *a, const struct rec_cl_buffer *b,
                 double *sum, float down[N])
{
    const uint32_t n = N, slot = 0, groups = (uint32_t)rec_cl_groups(n);
    double got[1][4];
    rec_cl_upload(q, a, 0, up, sizeof up);
    rec_cl_zero(q, b, 0, sizeof up);
    rec_cl_copy(q, a, 0, b, 0, sizeof up);
    REC_CL_RUN(q, REC_CL_K_SUM_LANES, 1, groups, REC_CL_FLAT, REC_CL_BUFFER(b), REC_CL_VALUE(n),
               REC_CL_BUFFER(rec_cl_parts(q)), REC_CL_VALUE(slot));
    bool ok = rec_cl_sums(q, &groups, 1, got);
    *sum = got[0][0];
    rec_cl_download(q, b, 0, down, N * sizeof *down);
    return rec_cl_wait(q) && ok;
}

/* Opens a device, works and closes it, with the fault.  Whether the fault happened. */
static bool session(const char *text)
{
    static float down[N];
    rec_cl *cl;
    rec_cl_queue *q = NULL, *other = NULL;
    struct rec_cl_buffer a = {NULL, 0}, b = {NULL, 0};
    struct pvx_diag d = {""};
    double sum = -1;
    cl_fault(text);
    pvx_err e = rec_cl_open(cl_bed_name(), &cl, &d);
    if (e == PVX_OK)
        cl->patience = strstr(text, "hang") != NULL ? 0.05 : 600;
    PVX_THEN(e, rec_cl_queue_new(cl, &q, &d));
    PVX_THEN(e, rec_cl_queue_new(cl, &other, &d));
    PVX_THEN(e, rec_cl_buffer_new(cl, sizeof up, &a, &d));
    PVX_THEN(e, rec_cl_buffer_new(cl, sizeof up, &b, &d));
    if (e != PVX_OK) {
        T_OK(cl_fault_happened());
        T_OK(d.text[0] != '\0');
    } else {
        memset(down, 0, sizeof down);
        rec_cl_after(q, other);
        bool ok = work(q, &a, &b, &sum, down);
        rec_cl_zero(other, &a, 0, sizeof up);
        rec_cl_after(q, other);
        ok = rec_cl_wait(q) && ok;
        T_EQ_I(ok, rec_cl_lost(cl) == NULL);
        if (ok) {
            T_NEAR(sum, sum_of_up, 0);
            T_OK(memcmp(down, up, sizeof up) == 0);
        } else {
            T_OK(sum == 0 || sum == sum_of_up);
            T_OK(cl_fault_happened());
        }
    }
    if (cl != NULL) {
        rec_cl_buffer_free(cl, &a);
        rec_cl_buffer_free(cl, &b);
    }
    rec_cl_queue_free(&q);
    rec_cl_queue_free(&other);
    bool happened = cl_fault_happened();
    rec_cl_close(&cl);
    cl_fault(NULL);
    return happened;
}

static const char *const functions[] = {
#define NAME(f) "cl" #f,
    REC_CL_FUNCTIONS(NAME)};
enum { FUNCTIONS = sizeof functions / sizeof functions[0], MOST = 5 };

static int sweep(const char *what, const char *of)
{
    int happened = 0;
    for (int f = 0; f < FUNCTIONS; f++)
        for (int n = 1; n <= MOST && strstr(functions[f], of) != NULL; n++) {
            char text[96];
            snprintf(text, sizeof text, "%s:%d:%s", functions[f], n, what);
            if (!session(text))
                break;
            happened++;
            if (t_case_fails > 0) {
                printf("  with %s\n", text);
                return happened;
            }
        }
    return happened;
}

T_CASE(without_a_fault)
{
    T_OK(!session("clFlush:1000000:error"));
    T_EQ_I(cl_fault_objects(), 0);
}
T_CASE(any_function_may_fail)
{
    T_OK(sweep("error", "cl") > 2 * FUNCTIONS);
}
T_CASE(work_may_fail)
{
    T_OK(sweep("event", "clEnqueue") > 10);
}
T_CASE(a_device_may_hang)
{
    T_OK(sweep("hang", "clEnqueue") > 10);
}

static rec_cl *opened(double patience)
{
    cl_fault(NULL);
    rec_cl *cl = cl_bed_open();
    cl->patience = patience;
    return cl;
}

T_CASE(what_is_said_of_a_device_that_hangs)
{
    rec_cl *cl = opened(0.05);
    struct pvx_diag d = {""};
    struct rec_cl_buffer b;
    cl_fault("any:1:hang");
    T_EQ_I(rec_cl_buffer_new(cl, 100, &b, &d), PVX_ENODEV);
    T_CONTAINS(rec_cl_lost(cl), "it did not answer for 0.05 s");
    T_CONTAINS(d.text, "it did not answer for 0.05 s");
    rec_cl_queue *q;
    struct pvx_diag later = {""};
    T_EQ_I(rec_cl_queue_new(cl, &q, &later), PVX_ENODEV);
    T_CONTAINS(later.text, "it did not answer for 0.05 s");
    rec_cl_close(&cl);
    cl_fault(NULL);
}

T_CASE(what_is_said_of_work_that_fails)
{
    rec_cl *cl = opened(600);
    rec_cl_queue *q = cl_bed_queue(cl);
    struct rec_cl_buffer a = cl_bed_buffer(cl, q, NULL, sizeof up),
                         b = cl_bed_buffer(cl, q, NULL, sizeof up);
    float down[N];
    double sum;
    cl_fault("clEnqueueNDRangeKernel:1:error");
    T_OK(!work(q, &a, &b, &sum, down));
    T_EQ_S(rec_cl_lost(cl), "sum_lanes: CL_OUT_OF_RESOURCES");
    T_NEAR(sum, 0, 0);
    rec_cl_buffer_free(cl, &a);
    rec_cl_buffer_free(cl, &b);
    rec_cl_queue_free(&q);
    rec_cl_close(&cl);
    cl_fault(NULL);
}

/* The device is not lost by it. */
T_CASE(no_room)
{
    static const char *const faults[] = {"clCreateBuffer:1:-4", "clEnqueueFillBuffer:1:-4",
                                         "clCreateBuffer:1:-5", "clEnqueueFillBuffer:1:event"};
    rec_cl *cl = opened(600);
    struct rec_cl_buffer b;
    for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++) {
        struct pvx_diag d = {""};
        cl_fault(faults[i]);
        T_EQ_I(rec_cl_buffer_new(cl, 2000000, &b, &d), PVX_ENOMEM);
        T_CONTAINS(d.text, "it has no room for 0.002 GB");
        T_OK(rec_cl_lost(cl) == NULL && b.mem == NULL);
    }
    cl_fault(NULL);
    struct pvx_diag d = {""};
    T_EQ_I(rec_cl_buffer_new(cl, rec_cl_about(cl)->largest + 1, &b, &d), PVX_ENOMEM);
    T_CONTAINS(d.text, "at most");
    T_EQ_I(atomic_load(&cl->used), 0);
    rec_cl_close(&cl);
}

/* A kernel that needs too much of what the items of a group share. */
T_CASE(groups_that_are_too_large_for_a_kernel)
{
    rec_cl *cl = opened(600);
    rec_cl_queue *q;
    struct pvx_diag d = {""};
    cl_fault("clGetKernelWorkGroupInfo:1:few");
    T_EQ_I(rec_cl_queue_new(cl, &q, &d), PVX_EUNSUP);
    T_OK(q == NULL && rec_cl_lost(cl) == NULL);
    T_CONTAINS(d.text, rec_cl_kernel_names[0].name);
    T_CONTAINS(d.text, "at most 32 items there, and 64 are needed");
    cl_fault(NULL);
    rec_cl_close(&cl);
}

/* What a driver calls its largest buffer is asked for all the same: the driver has the last word. */
T_CASE(a_buffer_that_is_larger_than_the_largest)
{
    rec_cl *cl = opened(600);
    struct rec_cl_buffer b;
    struct pvx_diag d = {""};
    cl->info.largest = 1000;
    T_EQ_I(rec_cl_buffer_new(cl, 1001, &b, &d), PVX_OK);
    rec_cl_buffer_free(cl, &b);
    cl_fault("clCreateBuffer:1:-61"); /* CL_INVALID_BUFFER_SIZE */
    T_EQ_I(rec_cl_buffer_new(cl, 1001, &b, &d), PVX_ENOMEM);
    T_CONTAINS(d.text, "a buffer of 1e-06 GB is needed, and it has at most 1e-06");
    T_OK(rec_cl_lost(cl) == NULL && b.mem == NULL);
    cl_fault(NULL);
    rec_cl_close(&cl);
}

static void begin(void)
{
    cl_fault_begin();
    cl_bed_begin();
    scratch_new();
    setenv("PYROVOX_CACHE", dir, 1); /* each session opens the device */
    for (int i = 0; i < N; i++)
        sum_of_up += up[i] = (float)(t_rand() % 100000);
}

T_MAIN(begin(), scratch_remove())
