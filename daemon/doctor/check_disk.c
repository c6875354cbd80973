/* check_disk.c - room and speed for recordings of raw frames. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/doctor/checks.h"

#define CHUNK ((size_t)1 << 20)

static void check_disk_room(struct doctor *d, const char *dir)
{
    double have;
    if (!d->host->space(d->host, dir, &have)) {
        struct doc_finding *f = doc_say(d, DOC_FAIL, 76, "disk.space",
                                        "%s: the folder does not exist or cannot be read", dir);
        doc_means(f, "recording cannot start");
        doc_command(f, "mkdir -p %s", doc_quote(dir));
        return;
    }
    double s = d->load.bytes_per_s > 0 ? have / d->load.bytes_per_s : 1e9;
    if (doc_settled(s >= 600, d, DOC_OK, 54, "disk.space",
                    "%s: %.0f GB free, %.0f minutes of raw frames", dir, have * 1e-9, s / 60))
        return;
    struct doc_finding *f =
        doc_say(d, s < 60 ? DOC_FAIL : DOC_WARN, 69, "disk.space",
                "%s: %.1f GB free, enough for %.0f s of raw frames", dir, have * 1e-9, s);
    doc_means(f, "the recording ends when the disk is full");
    doc_note(f, "use another disk, or delete old takes");
}

/* Write to a fresh file and wait until it is on the disk; bytes per second, 0: could not. */
static double write_rate(const char *dir, double bytes, char *err, size_t size)
{
    char path[4400];
    snprintf(path, sizeof path, "%s/.pyrovox-doctor-XXXXXX", dir);
    int fd = mkstemp(path);
    char *chunk = fd >= 0 ? malloc(CHUNK) : NULL;
    if (chunk == NULL) {
        snprintf(err, size, "%s", strerror(errno));
        if (fd >= 0)
            close(fd);
        return 0;
    }
    unlink(path);
    for (size_t i = 0; i < CHUNK; i++)
        chunk[i] = (char)(i * 2654435761u >> 13); /* so that no file system compresses it */
    int64_t t0 = pvx_now_mono();
    double done = 0;
    ssize_t n = 1;
    while (done < bytes && n > 0) {
        n = write(fd, chunk, CHUNK);
        done += n > 0 ? (double)n : 0;
    }
    bool ok = n > 0 && fdatasync(fd) == 0;
    if (!ok)
        snprintf(err, size, "%s", strerror(errno));
    double s = (double)(pvx_now_mono() - t0) * 1e-9;
    free(chunk);
    close(fd);
    return ok && s > 0 ? done / s : 0;
}

static void check_disk_speed(struct doctor *d, const char *dir)
{
    char err[128] = "";
    double rate = write_rate(dir, d->host->disk_write, err, sizeof err);
    if (doc_settled(rate == 0, d, DOC_UNKNOWN, 40, "disk.speed", "%s: cannot be written to: %s",
                    dir, err))
        return;
    if (rate >= 1.5 * d->load.bytes_per_s) {
        doc_say(d, DOC_OK, 51, "disk.speed", "%s: takes %.0f MB/s, cameras give %.0f", dir,
                rate * 1e-6, d->load.bytes_per_s * 1e-6);
        return;
    }
    struct doc_finding *f = doc_say(d, rate < d->load.bytes_per_s ? DOC_FAIL : DOC_WARN, 71,
                                    "disk.speed", "%s: takes %.0f MB/s, cameras give %.0f", dir,
                                    rate * 1e-6, d->load.bytes_per_s * 1e-6);
    doc_means(f, "raw recording cannot keep up and loses frames");
    doc_note(f, "use an NVMe disk, a packed or Bayer pixel_format, or a lower fps");
}

void doc_check_disk(struct doctor *d)
{
    if (d->load.record[0] == '\0')
        return;
    check_disk_room(d, d->load.record);
    if (d->host->disk_write > 0)
        check_disk_speed(d, d->load.record);
}
