/* program.c - the kernels' text, compiled for a device. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "recon/opencl/impl.h"

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

static pvx_err program_compile(rec_cl *cl, enum rec_cl_file file, const char *options,
                               cl_program *out, struct pvx_diag *d)
{
    const struct rec_cl_text *of = &rec_cl_text[file];
    char line[64], said[256];
    snprintf(line, sizeof line, "\n#line 1 \"%s\"\n", of->name);
    const char *text[] = {rec_cl_shared.begin, rec_cl_common.begin, line, of->begin};
    const size_t bytes[] = {(size_t)(rec_cl_shared.end - rec_cl_shared.begin),
                            (size_t)(rec_cl_common.end - rec_cl_common.begin), strlen(line),
                            (size_t)(of->end - of->begin)};
    cl_int e = CL_SUCCESS;
    *out = cl->lib->CreateProgramWithSource(cl->context, 4, text, bytes, &e);
    if (*out != NULL && e == CL_SUCCESS)
        e = cl->lib->BuildProgram(*out, 1, &cl->device, options, NULL, NULL);
    if (e == CL_SUCCESS)
        return PVX_OK;
    if (*out != NULL)
        program_said(cl, *out, said);
    return pvx_fail(d, PVX_ENODEV, "%s: its driver does not compile %s: %s: %s", cl->info.name,
                    of->name, rec_cl_error(e), said);
}

pvx_err rec_cl_build(rec_cl *cl, struct pvx_diag *d)
{
    for (int four = 0; four < 2; four++) {
        char options[96];
        program_options(cl, four ? 4 : 1, options);
        for (int f = 0; f < REC_CL_N_FILES; f++)
            PVX_TRY(program_compile(cl, (enum rec_cl_file)f, options, &cl->program[f][four], d));
    }
    return PVX_OK;
}
