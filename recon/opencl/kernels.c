#include "recon/opencl/kernels.h"

/* id, name below kernels/ */
#define BYTES(id, file)                                                          \
    extern const char rec_cl_##id##_begin[], rec_cl_##id##_end[];                \
    __asm__(".section .rodata\n"                                                 \
            ".global rec_cl_" #id "_begin, rec_cl_" #id "_end\n"                 \
            "rec_cl_" #id "_begin:\n.incbin \"recon/opencl/kernels/" file "\"\n" \
            "rec_cl_" #id "_end:\n.byte 0\n.previous\n");
#define TEXT(id, file)                               \
    {                                                \
        file, rec_cl_##id##_begin, rec_cl_##id##_end \
    }

BYTES(shared, "shared.h")
BYTES(common, "common.cl")
const struct rec_cl_text rec_cl_shared = TEXT(shared, "shared.h"),
                         rec_cl_common = TEXT(common, "common.cl");

#define FILE_BYTES(file) BYTES(file, #file ".cl")
#define FILE_TEXT(file)  TEXT(file, #file ".cl"),
REC_CL_FILES(FILE_BYTES)
const struct rec_cl_text rec_cl_text[REC_CL_N_FILES] = {REC_CL_FILES(FILE_TEXT)};

#define NAME(K, kernel, file) {#kernel, REC_CL_FILE_##file},
const struct rec_cl_kernel_name rec_cl_kernel_names[REC_CL_N_KERNELS] = {REC_CL_KERNELS(NAME)};
