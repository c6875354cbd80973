/* options.h - the command line of `pyrovox simcams`. */
#ifndef SIMCAMS_OPTIONS_H
#define SIMCAMS_OPTIONS_H
#include "daemon/cli/simcams/faults.h"

#define SIMCAMS_MAX_OPTIONS 64

struct simcams_args {
    const char *rig, *write_rig, *write_frames, *address, *board;
    int64_t cameras, ring, seed, sub, max_memory, voxels, poses;
    int32_t width, height;
    double radius, raise, fps, black, hold_s, kelvin; /* kelvin 0: not soot */
    double noise[3];                                  /* per cent, red green blue */
    double tick_hz, ptp_ms;
    bool boot_clock, zip;
    enum cap_pixfmt fmt;
    bool control, private_net;
    char **command; /* NULL = none */
    size_t n_set, n_at;
    const char *set[SIMCAMS_MAX_OPTIONS], *at[SIMCAMS_MAX_OPTIONS];
};

/* Set the defaults, then read argv.  Strings point into argv.  Like argp it ends the program on --help and wrong
 * usage (2). */
void simcams_options(int argc, char **argv, struct simcams_args *a);
#endif
