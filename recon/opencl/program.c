/* program.c - the kernels' text, compiled for a device. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/log.h"
#include "recon/opencl/impl.h"
#include "recon/opencl/program_cache.h"

static void program_options(const rec_cl *cl, int lanes, char out[96])
{
    cl_device_fp_config fp = 0;
    (void)cl->lib->GetDeviceInfo(cl->device, CL_DEVICE_SINGLE_FP_CONFIG, sizeof fp, &fp, NULL);
    snprintf(out, 96, "-cl-std=CL1.2 -DCS=%d%s", lanes,
             (fp & CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT) != 0
                 ? " -cl-fp32-correctly-rounded-divide-sqrt"
                 : "");
}

/* The first line with "error" of what the compiler said. */
static void program_said(const rec_cl *cl, cl_program p, char out[256])
{
    size_t n = 0;
    out[0] = '\0';
    if (cl->lib->GetProgramBuildInfo(p, cl->device, CL_PROGRAM_BUILD_LOG, 0, NULL, &n) !=
        CL_SUCCESS)
        return;
    char *log = calloc(1, n + 1);
    if (log == NULL)
        return;
    (void)cl->lib->GetProgramBuildInfo(p, cl->device, CL_PROGRAM_BUILD_LOG, n, log, NULL);
    const char *at = strstr(log, "error");
    while (at != NULL && at > log && at[-1] != '\n')
        at--;
    at = at != NULL ? at : log;
    snprintf(out, 256, "%.*s", (int)strcspn(at, "\n"), at);
    free(log);
}

/* What a compiled program depends on. */
static uint64_t program_key(const rec_cl *cl, enum rec_cl_file file, const char *options)
{
    const struct rec_cl_text *text[] = {&rec_cl_shared, &rec_cl_common, &rec_cl_text[file]};
    char host[2][128] = {"", ""};
    (void)cl->lib->GetPlatformInfo(cl->platform, CL_PLATFORM_VERSION, sizeof host[0] - 1, host[0],
                                   NULL);
    (void)cl->lib->GetDeviceInfo(cl->device, CL_DEVICE_VERSION, sizeof host[1] - 1, host[1], NULL);
    const char *name[] = {options,           cl->info.name, cl->info.vendor, cl->info.driver,
                          cl->info.platform, host[0],       host[1]};
    uint64_t key = 0;
    for (size_t i = 0; i < sizeof text / sizeof text[0]; i++)
        key = XXH3_64bits_withSeed(text[i]->begin, (size_t)(text[i]->end - text[i]->begin), key);
    for (size_t i = 0; i < sizeof name / sizeof name[0]; i++)
        key = XXH3_64bits_withSeed(name[i], strlen(name[i]), key);
    return key;
}

/* From what the cache has.  A driver that does not take it is no fault: the program is compiled. */
static bool program_cached(rec_cl *cl, uint64_t key, const char *options, cl_program *out)
{
    size_t bytes = 0;
    unsigned char *binary = rec_cl_cache_read(key, &bytes);
    cl_int taken = CL_SUCCESS, e = CL_SUCCESS;
    if (binary == NULL)
        return false;
    *out = cl->lib->CreateProgramWithBinary(cl->context, 1, &cl->device, &bytes,
                                            (const unsigned char *[]){binary}, &taken, &e);
    free(binary);
    if (*out == NULL)
        return false;
    if (e == CL_SUCCESS && taken == CL_SUCCESS &&
        cl->lib->BuildProgram(*out, 1, &cl->device, options, NULL, NULL) == CL_SUCCESS)
        return true;
    (void)cl->lib->ReleaseProgram(*out);
    *out = NULL;
    return false;
}

/* Some drivers compile the kernels only when they are asked for the binary: so not without need. */
static void program_keep(const rec_cl *cl, uint64_t key, cl_program p)
{
    size_t bytes = 0;
    if (!rec_cl_cache_is_there() ||
        cl->lib->GetProgramInfo(p, CL_PROGRAM_BINARY_SIZES, sizeof bytes, &bytes, NULL) !=
            CL_SUCCESS ||
        bytes == 0)
        return;
    unsigned char *binary = malloc(bytes);
    if (binary != NULL &&
        cl->lib->GetProgramInfo(p, CL_PROGRAM_BINARIES, sizeof binary, &binary, NULL) == CL_SUCCESS)
        rec_cl_cache_write(key, binary, bytes);
    free(binary);
}

static pvx_err program_compile(rec_cl *cl, enum rec_cl_file file, const char *options,
                               cl_program *out, struct pvx_diag *d)
{
    const struct rec_cl_text *of = &rec_cl_text[file];
    char line[64], said[256] = "";
    snprintf(line, sizeof line, "\n#line 1 \"%s\"\n", of->name);
    const char *text[] = {rec_cl_shared.begin, rec_cl_common.begin, line, of->begin};
    const size_t bytes[] = {(size_t)(rec_cl_shared.end - rec_cl_shared.begin),
                            (size_t)(rec_cl_common.end - rec_cl_common.begin), strlen(line),
                            (size_t)(of->end - of->begin)};
    cl_int e = CL_SUCCESS;
    *out = cl->lib->CreateProgramWithSource(cl->context, 4, text, bytes, &e);
    if (*out != NULL && e == CL_SUCCESS)
        e = cl->lib->BuildProgram(*out, 1, &cl->device, options, NULL, NULL);
    if (*out != NULL && e == CL_SUCCESS)
        return PVX_OK;
    if (*out != NULL)
        program_said(cl, *out, said);
    return pvx_fail(d, PVX_ENODEV, "%s: its driver does not compile %s: %s: %s", cl->info.name,
                    of->name, rec_cl_error(e), said);
}

pvx_err rec_cl_build(rec_cl *cl, struct pvx_diag *d)
{
    bool told = false;
    for (int four = 0; four < 2; four++) {
        char options[96];
        program_options(cl, four ? 4 : 1, options);
        for (int f = 0; f < REC_CL_N_FILES; f++) {
            cl_program *p = &cl->program[f][four];
            uint64_t key = program_key(cl, (enum rec_cl_file)f, options);
            if (program_cached(cl, key, options, p))
                continue;
            if (!told)
                LOG_I(RECON, "%s: its driver compiles the kernels, once", cl->info.name);
            told = true;
            PVX_TRY(program_compile(cl, (enum rec_cl_file)f, options, p, d));
            program_keep(cl, key, *p);
        }
    }
    return PVX_OK;
}
