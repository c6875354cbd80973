/* cmd_cpu.c - `pyrovox cpu`: which inner loops this machine runs, and why. */
#include <argp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/cli.h"
#include "recon/kernels.h"

static const struct {
    const char *name;
    unsigned flag;
} feature[] = {{"avx2", REC_CPU_AVX2}, {"avx512", REC_CPU_AVX512}, {"neon", REC_CPU_NEON}};
#define N_FEATURES (sizeof feature / sizeof *feature)

/* Value of `key` in /proc/cpuinfo, "" when it is not there. */
static void cpuinfo(const char *key, char *out, size_t size)
{
    char line[512];
    FILE *f = fopen("/proc/cpuinfo", "r");
    out[0] = '\0';
    while (f != NULL && out[0] == '\0' && fgets(line, sizeof line, f) != NULL) {
        char *colon = strchr(line, ':');
        if (colon == NULL || strncmp(line, key, strlen(key)) != 0)
            continue;
        colon[1 + strcspn(colon + 1, "\n")] = '\0';
        snprintf(out, size, "%s", colon[1] == ' ' ? colon + 2 : colon + 1);
    }
    if (f != NULL)
        fclose(f);
}

/* Names of all kernels that can be had here: "ref, avx2". */
static void list_kernels(char *out, size_t size)
{
    struct rec_kernels k;
    const char *last = "";
    unsigned mask = 0;
    out[0] = '\0';
    for (size_t i = 0; i <= N_FEATURES; i++) {
        rec_kernels_init(&k, mask);
        if (strcmp(k.name, last) != 0)
            snprintf(out + strlen(out), size - strlen(out), "%s%s", i > 0 ? ", " : "", k.name);
        last = k.name;
        mask |= i < N_FEATURES ? feature[i].flag : 0;
    }
}

bool cli_use_cpu(const char *name)
{
    struct rec_kernels k;
    char list[128];
    unsetenv("PYROVOX_CPU");
    list_kernels(list, sizeof list);
    setenv("PYROVOX_CPU", name, 1);
    rec_kernels_init(&k, (unsigned)REC_CPU_ALL);
    if (strcmp(k.name, name) == 0)
        return true;
    fprintf(stderr, "pyrovox: --cpu %s: no such kernels on this machine; it has %s\n", name, list);
    return false;
}

static error_t parse(int key, char *arg, struct argp_state *state)
{
    if (key != ARGP_KEY_ARG)
        return ARGP_ERR_UNKNOWN;
    argp_error(state, "unexpected argument '%s'", arg);
    return 0;
}

static int run(int argc, char **argv)
{
    static const struct argp argp = {
        .parser = parse,
        .doc =
            "Show the CPU's features and the kernels in use.\v"
            "Kernels are the inner loops of the solver.  `ref` is plain C and the specification; "
            "the others are tested against it.  To narrow them, for comparison or to find a "
            "fault, put --cpu NAME before any command, or set PYROVOX_CPU=NAME, which pyrovoxd "
            "heeds too.\n\n"
            "Examples:\n"
            "  pyrovox cpu\n"
            "  pyrovox --cpu ref reconstruct --rig rig.yaml --frames take --out vol\n"
            "  PYROVOX_CPU=ref pyrovoxd --config my.yaml\n"};
    argp_err_exit_status = 2;
    argp_parse(&argp, argc, argv, 0, NULL, NULL);
    char model[256];
    struct rec_kernels k;
    unsigned have = rec_cpu_flags();
    const char *env = getenv("PYROVOX_CPU");
    cpuinfo("model name", model, sizeof model);
    printf("cpu       %s%s%ld online\n", model, model[0] != '\0' ? ", " : "",
           sysconf(_SC_NPROCESSORS_ONLN));
    printf("features ");
    for (size_t i = 0; i < N_FEATURES; i++)
        if (have & feature[i].flag)
            printf(" %s", feature[i].name);
    printf("%s\n", have == 0 ? " none that matter here" : "");
    rec_kernels_init(&k, (unsigned)REC_CPU_ALL);
    printf("kernels   %s", k.name);
    if (env != NULL)
        printf(" (PYROVOX_CPU=%s)", env);
    unsetenv("PYROVOX_CPU");
    list_kernels(model, sizeof model);
    printf(" in use, of %s\n", model);
    return 0;
}

const struct cli_command cmd_cpu = {"cpu", "CPU features and the kernels in use", run};
