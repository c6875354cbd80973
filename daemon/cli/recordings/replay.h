/* replay.h - parts of `pyrovox replay`: describe a take, and export its frames as files.
 * Both return exit codes, as commands do (cli.h). */
#ifndef REPLAY_H
#define REPLAY_H
#include "capture/take/take.h"
#include "daemon/cli/common/cli.h"

int replay_info(const char *path, const cap_take *t);
/* Write DIR/<camera>/<set, 6 digits>.png, .npy or .jpg, and DIR/rig.yaml.  `pyrovox reconstruct` reads these. */
int replay_export(const cap_take *t, const char *dir);
#endif
