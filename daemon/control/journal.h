/* journal.h - lines of the log as entries of systemd's journal, with fields to search by:
 *
 *   PYROVOX_CAUSE   lost_camera, incomplete, voted_out ...: a word of capture's counters, or one of its own
 *   PYROVOX_CAMERA  its name in the rig
 *   PYROVOX_SET     number of the frame set
 *
 * A line has each field only if it is known.  Threads: any. */
#ifndef DMN_JOURNAL_H
#define DMN_JOURNAL_H
#include <stddef.h>
#include <sys/uio.h>

#include "base/log.h"

/* Sends the log to the journal from now on, if standard error already goes there ($JOURNAL_STREAM). */
void dmn_journal_use(void);

#define DMN_JOURNAL_FIELDS 6
/* Makes the fields of a line; used by dmn_journal_use.  `field` points into `room`.  Returns the number of fields. */
struct dmn_journal_room {
    char priority[16], message[2048], cause[64], camera[96], set[48];
};
size_t dmn_journal_fields(enum pvx_log_level level, const struct pvx_about *about, const char *text,
                          struct dmn_journal_room *room, struct iovec field[DMN_JOURNAL_FIELDS]);
#endif
