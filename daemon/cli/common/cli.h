/* cli.h - the commands of `pyrovox`, which pyrovox.c lists.
 *
 * A command parses its own arguments with argp (--help explains them).  It prints results on stdout, and progress
 * and errors on stderr.  It returns an exit code: 0 done, 1 failed (message printed), 2 wrong usage,
 * 130 stopped by Ctrl-C. */
#ifndef CLI_H
#define CLI_H
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"

struct cli_command {
    const char *name, *summary;
    int (*run)(int argc, char **argv); /* argv[0] = "pyrovox NAME" */
};
int cmd_cameras_test(int argc, char **argv); /* `pyrovox cameras test`, likewise */

/* Set by SIGINT/SIGTERM after cli_catch_stop().  Long work polls it. */
extern volatile sig_atomic_t cli_stop;
void cli_catch_stop(void);

/* Print "pyrovox: text" on stderr, return 1. */
int cli_error(const struct pvx_diag *d, pvx_err e);
/* Exit code of a command that ended with e: 0, 1 with the error printed, or after PVX_ECANCELED 130 with
 * "stopped", or "stopped; nothing was written". */
int cli_end(const struct pvx_diag *d, pvx_err e, bool nothing_written);

/* PVX_EBUSY: a file of that name is there, and `force` does not allow to write over it.  path NULL: nothing is written. */
PVX_MUST_CHECK pvx_err cli_may_write(const char *path, bool force, struct pvx_diag *d);

/* Progress bar on stderr when it is a terminal, else a line every 10 %.  As rec_progress_fn: ctx is
 * a struct cli_progress; returns false once cli_stop is set. */
struct cli_progress {
    const char *label;
    bool quiet; /* print nothing; Ctrl-C still stops the work */
    double last;
    int64_t t0;
};
bool cli_progress(void *ctx, double done);

/* Seconds since t0, a time of pvx_now_mono. */
double cli_seconds_since(int64_t t0);
/* "3.5 s", "12 min", "4 h". */
const char *cli_duration(double seconds, char out[32]);

/* Columns of the terminal on stdout, 40 to `max`.  100 if stdout is no terminal. */
int cli_columns(int max);

extern const struct cli_command cmd_matrix, cmd_reconstruct, cmd_render, cmd_simcams, cmd_record,
    cmd_status, cmd_top, cmd_demo, cmd_cameras, cmd_doctor, cmd_cpu, cmd_replay, cmd_calibrate,
    cmd_keygen, cmd_convert, cmd_play, cmd_ctl, cmd_repair, cmd_advise, cmd_experiment, cmd_view,
    cmd_share, cmd_value, cmd_report, cmd_temperature;
#endif
