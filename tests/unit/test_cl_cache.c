/* test_cl_cache.c - compiled programs are kept, and what is wrong with a kept one is no fault. */
#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>

#include "tests/t.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/cl_fault.h"
#include "tests/lib/scratch.h"
#include "recon/opencl/impl.h"
#include "recon/opencl/program_cache.h"

enum { PROGRAMS = 2 * REC_CL_N_FILES };

/* How many programs the cache has; `path`: of one of them. */
static int kept(char path[512])
{
    int n = 0;
    DIR *folder = opendir(at("cache"));
    for (struct dirent *f; folder != NULL && (f = readdir(folder)) != NULL;)
        if (strstr(f->d_name, ".pvxp") != NULL) {
            n++;
            if (path != NULL)
                snprintf(path, 512, "%s", at("cache/%.64s", f->d_name));
        }
    if (folder != NULL)
        closedir(folder);
    return n;
}

static double sum_of_three(rec_cl *cl)
{
    const float x[3] = {1, 20, 300};
    const uint32_t n = 3, slot = 0, groups = 1;
    double got[1][4];
    rec_cl_queue *q = cl_bed_queue(cl);
    struct rec_cl_buffer b = cl_bed_buffer(cl, q, x, sizeof x);
    REC_CL_RUN(q, REC_CL_K_SUM_LANES, 1, groups, REC_CL_FLAT, REC_CL_BUFFER(&b), REC_CL_VALUE(n),
               REC_CL_BUFFER(rec_cl_parts(q)), REC_CL_VALUE(slot));
    T_OK(rec_cl_sums(q, &groups, 1, got));
    rec_cl_buffer_free(cl, &b);
    rec_cl_queue_free(&q);
    return got[0][0];
}

/* Opens the device with a fault, and looks whether the kernels do their work.  How often FUNCTION was called. */
static long opens(const char *fault)
{
    cl_fault(fault);
    rec_cl *cl = cl_bed_open();
    long calls = cl_fault_calls();
    T_NEAR(sum_of_three(cl), 321, 0);
    cl_fault(NULL);
    rec_cl_close(&cl);
    return calls;
}
#define COMPILED "clCreateProgramWithSource:0:error"

T_CASE(the_second_time_nothing_is_compiled)
{
    T_EQ_I(opens(COMPILED), PROGRAMS);
    T_EQ_I(kept(NULL), PROGRAMS);
    T_EQ_I(opens(COMPILED), 0);
    T_EQ_I(opens("clCreateProgramWithBinary:0:error"), PROGRAMS);
}

T_CASE(a_damaged_file_is_written_anew)
{
    char path[512] = "", *file;
    size_t n;
    struct pvx_diag d = {""};
    T_EQ_I(kept(path), PROGRAMS);
    T_EQ_I(pvx_file_read(path, 1 << 28, &file, &n, &d), PVX_OK);
    for (int how = 0; how < 5; how++) {
        size_t place[] = {n / 2, 0, 8, 16, n - 1};
        file[place[how]] ^= 1;
        T_EQ_I(pvx_file_write(path, file, n, &d), PVX_OK);
        file[place[how]] ^= 1;
        T_EQ_I(opens(COMPILED), 1);
        T_EQ_I(opens(COMPILED), 0);
    }
    size_t length[] = {0, 7, 31, 32, n - 1};
    for (size_t i = 0; i < sizeof length / sizeof length[0]; i++) {
        T_EQ_I(truncate(path, (off_t)length[i]), 0);
        T_EQ_I(opens(COMPILED), 1);
        T_EQ_I(opens(COMPILED), 0);
    }
    T_EQ_I(kept(NULL), PROGRAMS);
    free(file);
}

T_CASE(what_the_driver_refuses_is_compiled)
{
    cl_fault("clCreateProgramWithBinary:1:-42");
    rec_cl *cl = cl_bed_open();
    T_OK(cl_fault_happened());
    T_NEAR(sum_of_three(cl), 321, 0);
    rec_cl_close(&cl);
    cl_fault("clBuildProgram:2:error");
    cl = cl_bed_open();
    T_OK(cl_fault_happened());
    T_NEAR(sum_of_three(cl), 321, 0);
    rec_cl_close(&cl);
    cl_fault(NULL);
}

T_CASE(without_a_cache)
{
    FILE *f = fopen(at("file"), "w");
    T_OK(f != NULL && fclose(f) == 0);
    setenv("PYROVOX_CACHE", at("file/cache"), 1); /* no such folder can be made */
    T_EQ_I(opens(COMPILED), PROGRAMS);
    T_EQ_I(opens(COMPILED), PROGRAMS);
    unsetenv("PYROVOX_CACHE"); /* as cl_bed.h leaves it: none is named */
    T_EQ_I(opens(COMPILED), PROGRAMS);
    setenv("PYROVOX_CACHE", at("cache"), 1);
}

T_CASE(old_ones_are_removed)
{
    const unsigned char some[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    size_t n = 0;
    int before = kept(NULL);
    for (uint64_t key = 0; key < REC_CL_KEPT; key++) {
        rec_cl_cache_write(key, some, sizeof some);
        const struct timespec then[2] = {{(time_t)(1000 + key), 0}, {(time_t)(1000 + key), 0}};
        T_EQ_I(
            utimensat(AT_FDCWD, at("cache/opencl-%016llx.pvxp", (unsigned long long)key), then, 0),
            0);
    }
    T_EQ_I(kept(NULL), REC_CL_KEPT);
    for (int key = 0; key < REC_CL_KEPT; key++) {
        unsigned char *p = rec_cl_cache_read((uint64_t)key, &n);
        T_EQ_I(p != NULL, key >= before);
        free(p);
    }
    T_EQ_I(opens(COMPILED), 0);
}

static void begin(void)
{
    cl_fault_begin();
    cl_bed_begin();
    scratch_new();
    setenv("PYROVOX_CACHE", at("cache"), 1);
}

T_MAIN(begin(), scratch_remove())
