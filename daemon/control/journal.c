#include "daemon/control/journal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <systemd/sd-journal.h>
#include <unistd.h>

static void journal_add(struct iovec *field, size_t *n, char *text)
{
    field[(*n)++] = (struct iovec){.iov_base = text, .iov_len = strlen(text)};
}

size_t dmn_journal_fields(enum pvx_log_level level, const struct pvx_about *about, const char *text,
                          struct dmn_journal_room *room, struct iovec field[DMN_JOURNAL_FIELDS])
{
    static char identifier[] = "SYSLOG_IDENTIFIER=pyrovoxd";
    size_t n = 0;
    snprintf(room->message, sizeof room->message, "MESSAGE=%s", text);
    journal_add(field, &n, room->message);
    snprintf(room->priority, sizeof room->priority, "PRIORITY=%d", pvx_log_syslog(level));
    journal_add(field, &n, room->priority);
    journal_add(field, &n, identifier);
    if (about != NULL && about->cause != NULL) {
        snprintf(room->cause, sizeof room->cause, "PYROVOX_CAUSE=%s", about->cause);
        journal_add(field, &n, room->cause);
    }
    if (about != NULL && about->camera != NULL && about->camera[0] != '\0') {
        snprintf(room->camera, sizeof room->camera, "PYROVOX_CAMERA=%s", about->camera);
        journal_add(field, &n, room->camera);
    }
    if (about != NULL && about->of_set) {
        snprintf(room->set, sizeof room->set, "PYROVOX_SET=%llu", (unsigned long long)about->set);
        journal_add(field, &n, room->set);
    }
    return n;
}

static bool send_line(enum pvx_log_level level, const struct pvx_about *about, const char *text)
{
    struct dmn_journal_room room;
    struct iovec field[DMN_JOURNAL_FIELDS];
    return sd_journal_sendv(field, (int)dmn_journal_fields(level, about, text, &room, field)) == 0;
}

void dmn_journal_use(void)
{
    struct stat st;
    unsigned long long dev, ino;
    const char *stream = getenv("JOURNAL_STREAM");
    if (stream != NULL && sscanf(stream, "%llu:%llu", &dev, &ino) == 2 &&
        fstat(STDERR_FILENO, &st) == 0 && st.st_dev == dev && st.st_ino == ino)
        pvx_log_set_sink(send_line);
}
