/* fuzz.h - what every fuzz target has: its entry, and what must hold whatever the input is. */
#ifndef TESTS_FUZZ_H
#define TESTS_FUZZ_H
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Inputs that were taken as good.  A target counts them: none in a whole corpus, and it tests nothing (main.c). */
__attribute__((weak)) unsigned fuzz_taken;

#define MUST(cond)                                                     \
    do {                                                               \
        if (!(cond)) {                                                 \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #cond); \
            abort();                                                   \
        }                                                              \
    } while (0)
#endif
