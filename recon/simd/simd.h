/* simd.h - what each ISA file offers to kernels.c: one function that overwrites its slots. */
#ifndef REC_SIMD_H
#define REC_SIMD_H
#include "recon/kernels.h"

void rec_kernels_ref(struct rec_kernels *k);
#if defined(__x86_64__)
void rec_kernels_avx2(struct rec_kernels *k);
void rec_kernels_avx512(struct rec_kernels *k); /* over AVX2's */
#endif

#endif
