/* options.h - the command line of `pyrovox reconstruct`. */
#ifndef RECONSTRUCT_OPTIONS_H
#define RECONSTRUCT_OPTIONS_H
#include <argp.h>
#include "daemon/cli/common/frames_in.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/frame/frame.h"

struct reconstruct_options {
    struct opt_rig rig;
    const char *frames, *out, *report, *cache, *background;
    const char *save_hull; /* folder of pictures, or NULL */
    bool fit;              /* --fit-volume */
    double fit_margin;     /* m; < 0 = one coarse cell */
    uint32_t fit_frames;   /* frame sets to look at; 0 = all */
    const char *save_rig;  /* or NULL */
    struct rec_frame_params frame;
    int64_t first, last;
    double deadline_ms;  /* 0 = none */
    const char *compute; /* of daemon/config/compute.h */
    uint32_t bars;       /* solves for error bars; 0: none */
    bool grey, warm, quiet, no_hull;
    bool anyway;          /* solve what rig and pictures make meaningless */
    bool stop_said;       /* --stop */
    bool find_absorption; /* of frame.absorption */
    int32_t bayer;        /* 0 auto, 1 rays, 2 demosaic */
    double memory;        /* bytes; < 0 = what is free */
    bool plan;            /* only predict time, memory and disk */
    double plan_hours;    /* also predict how many machines finish in it; 0 = do not */
    struct frames_in_reading reading;
    bool recording;       /* out is one HDF5 file, not a folder */
    unsigned part, parts; /* --array; 0: all in one */
    unsigned node_n;      /* processes of it that share this node's memory, at least 1 */
    bool resume, join;
    unsigned slurm; /* parts to submit to Slurm; 0 = none */
    const char *sbatch;
    char *said; /* options that change the volumes, one a line, sorted; owner: caller, free() */
};

/* Exits on wrong usage and on --help. */
void reconstruct_parse(int argc, char **argv, struct reconstruct_options *o);
/* The number of words that `arg` and its value take, if it only chooses which process solves which part; otherwise 0.
 * Such options are left out of a part's own command. */
int reconstruct_about_jobs(const char *arg);

#endif
