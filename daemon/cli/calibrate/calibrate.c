/* calibrate.c - `pyrovox calibrate`: from a printed board to rig.yaml, a step at a time. */
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/common/cli.h"

static const struct {
    const char *name, *summary;
    int (*run)(int argc, char **argv);
} steps[] = {
    {"board", "a sheet to print: PDF or SVG in true size", calibrate_board},
    {"live", "from the rig's own cameras to rig.yaml, with a screen that guides", calibrate_live},
    {"solve", "from pictures of the board to rig.yaml", calibrate_solve},
    {"import", "a calibration of another program to rig.yaml", calibrate_import},
    {"export", "the rig's cameras for another program", calibrate_export},
    {"check", "does a flame agree with the rig; which camera is wrong, and how", calibrate_check},
    {"refine", "poses corrected by a flame", calibrate_refine},
    {"response", "light of each sample value, from a ladder of exposures", calibrate_response},
    {"dark", "what cameras see with their caps on, hot and dead pixels", calibrate_dark},
    {"flat", "vignetting and each pixel's sensitivity; noise", calibrate_flat},
    {"noise", "read noise and gain, from several levels of light", calibrate_noise},
    {"gain", "cameras beside each other, by a source or a flame", calibrate_gain},
    {"colour", "every camera's colours made those of one", calibrate_colour},
    {"spectral", "kelvin and soot by a source of known temperature", calibrate_spectral},
    {"background", "what cameras see without a flame, from pictures or live", calibrate_background},
};

static void calibrate_help(FILE *f)
{
    fputs("Usage: pyrovox calibrate STEP [ARGUMENTS]\n"
          "From cameras on tripods to a rig.yaml.\n\nSteps:\n",
          f);
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        fprintf(f, "  %-10s %s\n", steps[i].name, steps[i].summary);
    fputs("\n`pyrovox calibrate STEP --help` explains one.\n", f);
}

static int calibrate_run(int argc, char **argv)
{
    static char name[80]; /* outlives this call: argp keeps pointers to argv[0] */
    bool asked = argc > 1 && (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
                              strcmp(argv[1], "-?") == 0);
    for (size_t i = 0; argc > 1 && i < sizeof steps / sizeof *steps; i++)
        if (strcmp(argv[1], steps[i].name) == 0) {
            snprintf(name, sizeof name, "%s %s", argv[0], argv[1]);
            argv[1] = name;
            return steps[i].run(argc - 1, argv + 1);
        }
    if (argc > 1 && !asked)
        fprintf(stderr, "pyrovox calibrate: no step '%s'\n", argv[1]);
    calibrate_help(asked ? stdout : stderr);
    return asked ? 0 : 2;
}

const struct cli_command cmd_calibrate = {"calibrate", "from a printed board to rig.yaml",
                                          calibrate_run};
