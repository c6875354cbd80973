/* cpu.c - `pyrovox cpu`: which inner loops are used on this machine, and why. */
#include <argp.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/cpu.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/doctor/host.h"
#include "daemon/doctor/parse.h"

static error_t cpu_parse(int key, char *arg, struct argp_state *state)
{
    if (key != ARGP_KEY_ARG)
        return ARGP_ERR_UNKNOWN;
    argp_error(state, "unexpected argument '%s'", arg);
    return 0;
}

static void print_memory(void)
{
    printf("memory    %.1f GB/s, read plus written, by all processors\n", doc_copy_rate() * 1e-9);
}

static void print_cards(struct doc_host *host)
{
    struct pvx_diag why = {""};
    char line[320];
    struct doc_card *card = pvx_calloc(REC_CL_MOST, sizeof *card);
    size_t n = card != NULL ? host->cards(host, card, &why) : 0;
    for (size_t i = 0; i < n; i++) {
        doc_card_line(&card[i], line, sizeof line);
        printf("device    %s\n", line);
    }
    if (n == 0)
        printf("device    none besides the processors: %s\n", why.text);
    free(card);
}

static int cpu_run(int argc, char **argv)
{
    static const struct argp argp = {
        .parser = cpu_parse,
        .doc = "Show the kernels in use, all that this CPU can run, and the OpenCL devices.\v"
               "Kernels are the inner loops of the solver and of the pixels.  `ref` is plain C and "
               "the specification; the others are tested against it.  To narrow them, for "
               "comparison or to find a fault, put --cpu NAME before any command, or set "
               "PYROVOX_CPU=NAME, which pyrovoxd heeds too.\n\n"
               "Devices are for `compute` of pyrovoxd.yaml and for reconstruct --compute.  Their "
               "rates and that of the processors are measured, for a few tenths of a second each.  "
               "A processor (pocl) is used only if its name is given.\n\n"
               "Examples:\n"
               "  pyrovox cpu\n"
               "  pyrovox --cpu ref reconstruct --rig rig.yaml --frames take \\\n"
               "          --black 0.02 --out vol\n"
               "  PYROVOX_CPU=ref pyrovoxd --config my.yaml\n"};
    argp_parse(&argp, argc, argv, 0, NULL, NULL);
    char model[256] = "";
    const char *env = getenv("PYROVOX_CPU");
    struct doc_host host;
    doc_host_init(&host);
    char *info = doc_file(&host, "/proc/cpuinfo");
    (void)doc_parse_key(info != NULL ? info : "", "model name", model, sizeof model);
    free(info);
    printf("cpu       %s%s%ld online\n", model, model[0] != '\0' ? ", " : "",
           sysconf(_SC_NPROCESSORS_ONLN));
    printf("kernels   %s", pvx_cpu_name(pvx_cpu()));
    if (env != NULL)
        printf(" (PYROVOX_CPU=%s)", env);
    for (int level = PVX_CPU_REF; level <= (int)pvx_cpu_have(); level++)
        printf("%s%s", level == PVX_CPU_REF ? " in use, of " : ", ",
               pvx_cpu_name((enum pvx_cpu)level));
    printf("\n");
    print_memory();
    print_cards(&host);
    return 0;
}

const struct cli_command cmd_cpu = {"cpu", "which inner loops this CPU runs", cpu_run};
