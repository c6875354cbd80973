/* options.h - the command line of `pyrovox simcams`. */
#ifndef SIMCAMS_OPTIONS_H
#define SIMCAMS_OPTIONS_H
#include "daemon/cli/simcams/faults.h"

#define SIMCAMS_MAX_OPTIONS 64

struct simcams_fault_option {
    enum simcams_fault_kind kind;
    const char *text;
};
struct simcams_plan_option {
    enum { SIMCAMS_OPT_KILL, SIMCAMS_OPT_FREEZE, SIMCAMS_OPT_AT } what;
    const char *text;
};

struct simcams_args {
    const char *rig, *write_rig, *write_frames, *address, *board;
    int64_t cameras, ring, seed, sub, max_memory, voxels, poses;
    int32_t width, height;
    double radius, raise, fps, black, hold_s;
    double noise[3]; /* per cent, red green blue */
    double line_hz, link_mbit, camera_mbit, tick_hz, ptp_ms, tai_s;
    bool boot_clock, zip;
    enum cap_pixfmt fmt;
    bool control, private_net;
    char **command; /* NULL = none */
    size_t n_faults, n_plans;
    struct simcams_fault_option fault[SIMCAMS_MAX_OPTIONS];
    struct simcams_plan_option plan[SIMCAMS_MAX_OPTIONS];
};

/* Defaults, then what argv says; strings are argv's.  Ends the program where argp does (--help, wrong
 * usage: 2).  False: not to be used. */
bool simcams_options(int argc, char **argv, struct simcams_args *a);
#endif
