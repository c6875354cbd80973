/* test_cl_device.c - devices by OpenCL: listed, opened, buffers and sums. */
#include <pthread.h>

#include "tests/t.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/cl_fault.h"
#include "recon/opencl/impl.h"

static rec_cl *cl;

T_CASE(lists_what_there_is)
{
    struct rec_cl_info o[REC_CL_MOST];
    struct pvx_diag d = {""};
    size_t n = rec_cl_list(o, &d), found = n;
    T_OK(n > 0);
    for (size_t i = n; i-- > 0;)
        if (strstr(o[i].platform, cl_bed_name()) != NULL)
            found = i;
    T_OK(found < n);
    if (found == n)
        return;
    T_EQ_S(o[found].why_not, "");
    T_OK(o[found].memory > 1 << 20 && o[found].largest > 1 << 20);
    T_OK(o[found].name[0] != '\0' && o[found].driver[0] != '\0');
    T_EQ_S(rec_cl_about(cl)->name, o[found].name);
    T_OK(rec_cl_lost(cl) == NULL);
    T_OK(o[found].denormals && rec_cl_about(cl)->denormals); /* pocl and Oclgrind keep them */
}

/* The same card by three drivers, a card within the processor, the processor by two. */
T_CASE(the_order_of_devices)
{
    static const struct rec_cl_found there[] = {
        {.info = {"EPYC", .platform = "Portable Computing Language", .kind = REC_CL_CPU,
                  .shares = true}},
        {.info = {"radeonsi", .platform = "rusticl", .kind = REC_CL_GPU}},
        {.info = {"Iris", .platform = "Intel(R) OpenCL Graphics", .kind = REC_CL_GPU,
                  .shares = true}},
        {.info = {"gfx1100", .platform = "AMD Accelerated Parallel Processing",
                  .kind = REC_CL_GPU}},
        {.info = {"gfx1101", .platform = "AMD Accelerated Parallel Processing",
                  .kind = REC_CL_GPU}},
        {.info = {"Xeon", .platform = "Intel(R) OpenCL", .kind = REC_CL_CPU, .shares = true}},
    };
    enum { COUNT = sizeof there / sizeof *there };
    static const char *const want[COUNT] = {"gfx1100", "gfx1101", "radeonsi",
                                            "Iris",    "Xeon",    "EPYC"};
    struct rec_cl_found f[COUNT];
    for (size_t i = 0; i < COUNT; i++) {
        f[i] = there[i];
        f[i].number = i;
    }
    rec_cl_sort(f, COUNT);
    for (size_t i = 0; i < COUNT; i++)
        T_EQ_S(f[i].info.name, want[i]);
}

T_CASE(a_name_that_is_not_there)
{
    struct pvx_diag d = {""};
    rec_cl *other;
    T_EQ_I(rec_cl_open("no such card", &other, &d), PVX_ENOENT);
    T_OK(other == NULL);
    T_CONTAINS(d.text, "no such card");
    T_CONTAINS(d.text, rec_cl_about(cl)->name);
}

T_CASE(buffers_there_and_back)
{
    enum { N = 5000011 }; /* more than the staging memory holds */
    rec_cl_queue *q = cl_bed_queue(cl);
    uint32_t *up = malloc(N * sizeof *up), *down = calloc(N, sizeof *down);
    for (size_t i = 0; i < N; i++)
        up[i] = (uint32_t)t_rand();
    struct rec_cl_buffer a = cl_bed_buffer(cl, q, NULL, N * sizeof *up),
                         b = cl_bed_buffer(cl, q, NULL, N * sizeof *up);
    memset(down, 1, N * sizeof *down);
    rec_cl_download(q, &a, 0, down, N * sizeof *down);
    T_OK(rec_cl_wait(q));
    size_t zeros = 0;
    for (size_t i = 0; i < N; i++)
        zeros += down[i] == 0;
    T_EQ_I(zeros, N);
    rec_cl_upload(q, &a, 0, up, N * sizeof *up);
    rec_cl_copy(q, &a, 4, &b, 8, (N - 2) * sizeof *up);
    rec_cl_zero(q, &b, 40, 4);
    rec_cl_download(q, &b, 0, down, N * sizeof *down);
    T_OK(rec_cl_wait(q));
    size_t wrong = (down[0] != 0) + (down[1] != 0) + (down[10] != 0);
    for (size_t i = 2; i < N; i++)
        wrong += i != 10 && down[i] != up[i - 1];
    T_EQ_I(wrong, 0);
    rec_cl_buffer_free(cl, &a);
    rec_cl_buffer_free(cl, &b);
    rec_cl_queue_free(&q);
    free(up);
    free(down);
}

/* Whole numbers: their sums are exact in any order. */
static void sums_of(rec_cl_queue *q, int cs, uint32_t n)
{
    float *x = malloc(((size_t)n * (size_t)cs + 1) * sizeof *x);
    double want[4] = {0, 0, 0, 0}, got[2][4];
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < cs; c++) {
            x[i * (size_t)cs + (size_t)c] = (float)(t_rand() % 1000003);
            want[c] += x[i * (size_t)cs + (size_t)c];
        }
    struct rec_cl_buffer b = cl_bed_buffer(cl, q, x, ((size_t)n * (size_t)cs + 1) * sizeof *x);
    uint32_t slot = 1, groups[2] = {0, (uint32_t)rec_cl_groups(n)};
    REC_CL_RUN(q, REC_CL_K_SUM_LANES, cs, groups[1], REC_CL_FLAT, REC_CL_BUFFER(&b),
               REC_CL_VALUE(n), REC_CL_BUFFER(rec_cl_parts(q)), REC_CL_VALUE(slot));
    T_OK(rec_cl_sums(q, groups, 2, got));
    for (int c = 0; c < 4; c++) {
        T_NEAR(got[0][c], 0, 0);
        T_NEAR(got[1][c], want[c], 0);
    }
    rec_cl_buffer_free(cl, &b);
    free(x);
}

T_CASE(sums_are_those_of_a_serial_sum)
{
    static const uint32_t n[] = {0, 1, 63, 64, 65, 255, 256, 257, 1027, 131072, 131073, 300007};
    rec_cl_queue *q = cl_bed_queue(cl);
    for (size_t i = 0; i < sizeof n / sizeof n[0] && (n[i] <= 257 || !cl_bed_is_simulated()); i++)
        for (int cs = 1; cs <= 4; cs += 3)
            sums_of(q, cs, n[i]);
    rec_cl_queue_free(&q);
}

struct lane {
    rec_cl_queue *q;
    int cs, rounds;
    bool right;
};
static void *lane_run(void *p)
{
    enum { COUNT = 5001 };
    struct lane *l = p;
    float x[COUNT * 4];
    struct pvx_diag d = {""};
    struct rec_cl_buffer b;
    l->right = rec_cl_buffer_new(cl, sizeof x, &b, &d) == PVX_OK;
    for (int r = 0; r < l->rounds && l->right; r++) {
        uint32_t n = COUNT, slot = 2, groups[3] = {0, 0, (uint32_t)rec_cl_groups(n)};
        double got[3][4], want = 0;
        for (int i = 0; i < COUNT * l->cs; i++) {
            x[i] = (float)(i % 100 + r);
            want += i % l->cs == 0 ? x[i] : 0;
        }
        rec_cl_upload(l->q, &b, 0, x, sizeof x);
        REC_CL_RUN(l->q, REC_CL_K_SUM_LANES, l->cs, groups[2], REC_CL_FLAT, REC_CL_BUFFER(&b),
                   REC_CL_VALUE(n), REC_CL_BUFFER(rec_cl_parts(l->q)), REC_CL_VALUE(slot));
        l->right = rec_cl_sums(l->q, groups, 3, got) && got[2][0] == want;
    }
    rec_cl_buffer_free(cl, &b);
    return NULL;
}
T_CASE(two_queues_side_by_side)
{
    if (cl_bed_is_simulated())
        T_SKIP("Oclgrind itself is for one thread");
    struct lane l[2] = {{cl_bed_queue(cl), 1, T_SANITIZED ? 20 : 200, false},
                        {cl_bed_queue(cl), 4, T_SANITIZED ? 20 : 200, false}};
    pthread_t thread[2];
    for (int i = 0; i < 2; i++)
        T_EQ_I(pthread_create(&thread[i], NULL, lane_run, &l[i]), 0);
    for (int i = 0; i < 2; i++)
        pthread_join(thread[i], NULL);
    T_OK(l[0].right && l[1].right);
    rec_cl_queue_free(&l[0].q);
    rec_cl_queue_free(&l[1].q);
}

/* The device then knows what a kernel may take for an item, and a launch of another size is refused. */
T_CASE(every_kernel_says_the_size_of_its_groups)
{
    rec_cl_queue *q = cl_bed_queue(cl);
    for (int k = 0; k < REC_CL_N_KERNELS; k++)
        for (int four = 0; four < 2; four++) {
            size_t size[3] = {0, 0, 0};
            T_EQ_I(cl->lib->GetKernelWorkGroupInfo(q->kernel[k][four], cl->device,
                                                   CL_KERNEL_COMPILE_WORK_GROUP_SIZE, sizeof size,
                                                   size, NULL),
                   CL_SUCCESS);
            bool known = size[0] == REC_CL_GROUP || size[0] == REC_CL_FLAT;
            T_OK(known && size[1] == 1 && size[2] == 1);
            if (!known)
                printf("  kernel %s: %zu\n", rec_cl_kernel_names[k].name, size[0]);
        }
    rec_cl_queue_free(&q);
}

/* What a queue does later sees what another one has done. */
T_CASE(one_queue_after_another)
{
    enum { COUNT = 3000000 };
    rec_cl_queue *a = cl_bed_queue(cl), *b = cl_bed_queue(cl);
    float *x = malloc(COUNT * sizeof *x), *y = malloc(COUNT * sizeof *y);
    struct rec_cl_buffer at_a = cl_bed_buffer(cl, a, NULL, COUNT * sizeof *x),
                         at_b = cl_bed_buffer(cl, b, NULL, COUNT * sizeof *x);
    for (int round = 1; round <= 5; round++) {
        for (int i = 0; i < COUNT; i++)
            x[i] = (float)(i + round);
        rec_cl_upload(a, &at_a, 0, x, COUNT * sizeof *x);
        rec_cl_after(b, a);
        rec_cl_copy(b, &at_a, 0, &at_b, 0, COUNT * sizeof *x);
        rec_cl_download(b, &at_b, 0, y, COUNT * sizeof *y);
        T_OK(rec_cl_wait(b));
        T_OK(memcmp(x, y, COUNT * sizeof *x) == 0);
        T_OK(rec_cl_wait(a));
    }
    rec_cl_buffer_free(cl, &at_a);
    rec_cl_buffer_free(cl, &at_b);
    rec_cl_queue_free(&a);
    rec_cl_queue_free(&b);
    free(x);
    free(y);
}

T_MAIN((cl_fault_begin(), cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
