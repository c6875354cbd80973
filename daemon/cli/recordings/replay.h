/* replay.h - parts of `pyrovox replay`: what a take holds, in words; its frames as files.
 * Exit codes as commands (cli.h). */
#ifndef REPLAY_H
#define REPLAY_H
#include "capture/take/take.h"
#include "daemon/cli/common/cli.h"

int replay_info(const char *path, const cap_take *t);
/* DIR/<camera>/<set, 6 digits>.png, .npy or .jpg, and DIR/rig.yaml: what `pyrovox reconstruct` reads. */
int replay_export(const cap_take *t, const char *dir);
#endif
