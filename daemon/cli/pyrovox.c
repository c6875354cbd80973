/* pyrovox.c - the program `pyrovox COMMAND [ARGUMENTS]`: finds the command and runs it. */
#include <argp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/cpu.h"
#include "daemon/cli/common/cli.h"
#include "daemon/pipeline/compute.h"

static const struct cli_command *const commands[] = {
    &cmd_demo,      &cmd_matrix, &cmd_reconstruct, &cmd_render, &cmd_simcams,
    &cmd_status,    &cmd_top,    &cmd_record,      &cmd_replay, &cmd_cameras,
    &cmd_calibrate, &cmd_doctor, &cmd_cpu,         &cmd_keygen, &cmd_ctl,
    &cmd_convert,   &cmd_play,   &cmd_repair,      &cmd_advise, &cmd_experiment,
    &cmd_view,      &cmd_share,  &cmd_value,       &cmd_report, &cmd_temperature,
    NULL,
};

static void pyrovox_help(FILE *f)
{
    fputs("Usage: pyrovox [--cpu NAME] COMMAND [ARGUMENTS]\n"
          "Multi-camera flame capture and tomographic reconstruction.\n\nCommands:\n",
          f);
    for (size_t i = 0; commands[i] != NULL; i++)
        fprintf(f, "  %-12s %s\n", commands[i]->name, commands[i]->summary);
    fputs("\n`pyrovox COMMAND --help` explains one command.  The daemon itself is pyrovoxd.\n"
          "--cpu NAME narrows the inner loops (see `pyrovox cpu`).\n",
          f);
}

int main(int argc, char **argv)
{
    if (argc > 2 && strcmp(argv[1], "--cpu") == 0) {
        setenv("PYROVOX_CPU", argv[2], 1); /* for the programs that this one starts too */
        argv += 2;
        argc -= 2;
    }
    struct pvx_diag d = {""};
    if (pvx_cpu_use(NULL, &d) != PVX_OK) {
        fprintf(stderr, "pyrovox: --cpu or PYROVOX_CPU: %s\n", d.text);
        return 2;
    }
    if (argc < 2) {
        pyrovox_help(stderr);
        return 2;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
        strcmp(argv[1], "help") == 0) {
        pyrovox_help(stdout);
        return 0;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("pyrovox %s\n", PVX_VERSION);
        return 0;
    }
    argp_err_exit_status = 2;
    for (size_t i = 0; commands[i] != NULL; i++)
        if (strcmp(argv[1], commands[i]->name) == 0) {
            static char name[80]; /* outlives this call: argp keeps pointers to argv[0] */
            snprintf(name, sizeof name, "pyrovox %s", argv[1]);
            argv[1] = name;
            return dmn_compute_leave(commands[i]->run(argc - 1, argv + 1));
        }
    fprintf(stderr, "pyrovox: no command '%s'; `pyrovox --help` lists them\n", argv[1]);
    return 2;
}
