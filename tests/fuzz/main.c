/* main.c - runs a fuzz target over files and folders given, without libFuzzer: the corpus as a test.
 * Under AddressSanitizer, and where T_LONG is set, each input is also tried cut short at every length up to 512 and with
 * single bytes changed, in 100 ways and in 400.  What stands behind --once is run as it is, and may be nothing: inputs that a campaign found, each
 * of which reaches something of its own.  Where the target takes none of the corpus as good, the test fails. */
#include <dirent.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>

#include "tests/fuzz/fuzz.h"

static int inputs, good;
static bool once, mutations;

static void mutate(const uint8_t *data, size_t n)
{
    uint8_t *copy = malloc(n + 1);
    if (copy == NULL)
        return;
    for (size_t cut = 0; cut < n && cut < 512; cut++) {
        memcpy(copy, data, cut);
        LLVMFuzzerTestOneInput(copy, cut);
    }
    uint32_t r = 1;
    int changes = getenv("T_LONG") != NULL ? 400 : 100;
    for (int i = 0; i < changes && n > 0; i++) {
        memcpy(copy, data, n);
        for (int j = 0; j < 1 + i % 3; j++) {
            r = r * 1664525u + 1013904223u;
            copy[(r >> 8) % n] = (uint8_t)(r >> 24);
        }
        LLVMFuzzerTestOneInput(copy, n);
    }
    free(copy);
}

static void file(const char *path)
{
    FILE *f = fopen(path, "rb");
    if (f == NULL)
        return;
    fseek(f, 0, SEEK_END);
    long n = ftell(f);
    rewind(f);
    uint8_t *data = malloc((size_t)n + 1);
    if (data != NULL && fread(data, 1, (size_t)n, f) == (size_t)n) {
        /* an exact-size copy, so that ASan sees the first byte past the end */
        uint8_t *exact = malloc((size_t)n > 0 ? (size_t)n : 1);
        if (exact != NULL) {
            memcpy(exact, data, (size_t)n);
            unsigned before = fuzz_taken;
            LLVMFuzzerTestOneInput(exact, (size_t)n);
            if (!once) {
                good += fuzz_taken > before;
                if (mutations)
                    mutate(exact, (size_t)n);
            }
            inputs++;
        }
        free(exact);
    }
    free(data);
    fclose(f);
}

int main(int argc, char **argv)
{
#ifdef __SANITIZE_ADDRESS__
    mutations = true;
#else
    mutations = getenv("T_LONG") != NULL;
#endif
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--once") == 0) {
            once = true;
            continue;
        }
        DIR *d = opendir(argv[i]);
        if (d == NULL) {
            file(argv[i]);
            continue;
        }
        struct dirent *e;
        while ((e = readdir(d)) != NULL) {
            char path[4096];
            if (e->d_name[0] == '.')
                continue;
            snprintf(path, sizeof path, "%s/%s", argv[i], e->d_name);
            file(path);
        }
        closedir(d);
    }
    const char *name = strrchr(argv[0], '/');
    name = name != NULL ? name + 1 : argv[0];
    if (inputs == 0) {
        printf("FAIL %s: no corpus\n", name);
        return 1;
    }
    if (good == 0) {
        printf("FAIL %s: nothing of its corpus is good\n", name);
        return 1;
    }
    printf("PASS %s (%d inputs%s)\n", name, inputs, mutations ? " and their mutations" : "");
    return 0;
}
