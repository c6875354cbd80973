/* ffmpeg.h - write pictures into a video with the program ffmpeg.
 *
 * The program is used instead of the library, because users have its encoders and know them.  It reads raw pictures
 * from a socket and writes PATH.tmp.PID.EXT, which is renamed at the end.  Ctrl-C of a terminal does not reach it:
 * ffmpeg_end then makes a whole video of the pictures so far.
 * Threads: one at a time. */
#ifndef FFMPEG_H
#define FFMPEG_H
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"

typedef struct ffmpeg ffmpeg;

/* Whether path is the name of a video: .mp4 .mov .mkv (H.264) or .webm (VP9). */
bool ffmpeg_can(const char *path);

/* Pictures of w x h pixels, nch 1 or 3, 8 bits, fps a second.  Errors name the file; PVX_ENOENT: ffmpeg is
 * not installed, names the package.  Owner: caller, until ffmpeg_end or ffmpeg_drop. */
PVX_MUST_CHECK pvx_err ffmpeg_begin(const char *path, int32_t w, int32_t h, int nch, int fps,
                                    ffmpeg **out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err ffmpeg_add(ffmpeg *f, const uint8_t *samples, struct pvx_diag *d);
/* Wait until ffmpeg has finished.  Frees *f, after an error too; then there is no file. */
PVX_MUST_CHECK pvx_err ffmpeg_end(ffmpeg **f, struct pvx_diag *d);
void ffmpeg_drop(ffmpeg **f); /* stop without a file */

#endif
