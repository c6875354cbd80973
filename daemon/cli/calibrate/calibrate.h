/* calibrate.h - the steps of `pyrovox calibrate`, one file each. */
#ifndef CLI_CALIBRATE_H
#define CLI_CALIBRATE_H

/* argv[0] = "pyrovox calibrate NAME".  Each returns the exit code. */
int calibrate_background(int argc, char **argv);
int calibrate_board(int argc, char **argv);
int calibrate_check(int argc, char **argv);
int calibrate_colour(int argc, char **argv);
int calibrate_dark(int argc, char **argv);
int calibrate_export(int argc, char **argv);
int calibrate_flat(int argc, char **argv);
int calibrate_gain(int argc, char **argv);
int calibrate_import(int argc, char **argv);
int calibrate_live(int argc, char **argv);
int calibrate_noise(int argc, char **argv);
int calibrate_refine(int argc, char **argv);
int calibrate_response(int argc, char **argv);
int calibrate_solve(int argc, char **argv);
int calibrate_spectral(int argc, char **argv);
#endif
