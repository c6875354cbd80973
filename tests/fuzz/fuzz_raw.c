/* fuzz_raw.c - any bytes as a .cine, or as the header of an .mraw: refused with a line that names the file, or read: pictures of one
 * size and format at times that ascend.
 *
 * Bytes that begin with C are a cine.  Of others the first says how long the film beside them is and whether they are a
 * .cihx; the rest is the header. */
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "capture/files/raw.h"
#include "tests/fuzz/fuzz.h"

#define FAR (INT64_MAX / 4) /* times, so that others may subtract them */

static char folder[] = "/dev/shm/fuzz_raw-XXXXXX", cine[64], film[64], cih[64], cihx[64];

static void remove_files(void)
{
    unlink(cine);
    unlink(film);
    unlink(cih);
    unlink(cihx);
}

static void remove_folder(void)
{
    remove_files();
    rmdir(folder);
}

static void save(const char *path, const uint8_t *data, size_t size)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    MUST(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    close(fd);
}

static void name(void)
{
    if (cine[0] != '\0')
        return;
    MUST(mkdtemp(folder) != NULL && atexit(remove_folder) == 0);
    snprintf(cine, sizeof cine, "%s/a.cine", folder);
    snprintf(film, sizeof film, "%s/a.mraw", folder);
    snprintf(cih, sizeof cih, "%s/a.cih", folder);
    snprintf(cihx, sizeof cihx, "%s/a.cihx", folder);
}

static void refused(pvx_err e, const struct pvx_diag *d)
{
    MUST(e == PVX_ENOMEM || strncmp(d->text, folder, strlen(folder)) == 0);
    MUST(strchr(d->text, '\n') == NULL);
}

static void read_all(const char *path)
{
    struct pvx_diag d = {""};
    struct cap_raw r;
    struct cap_image img;
    pvx_err e = cap_raw_open(path, &r, &d);
    if (e != PVX_OK)
        refused(e, &d);
    else
        fuzz_taken++;
    MUST(e != PVX_OK || r.n > 0);
    for (size_t i = 0; i < r.n && e == PVX_OK; i++) {
        MUST(r.frame[i].t_ns >= -FAR && r.frame[i].t_ns <= FAR);
        MUST(i == 0 || r.frame[i].t_ns > r.frame[i - 1].t_ns);
    }
    for (size_t i = 0; i < r.n && i < 4 && e == PVX_OK; i++) {
        d.text[0] = '\0';
        pvx_err one = cap_raw_load(&r, i, &img, &d);
        if (one != PVX_OK) {
            refused(one, &d);
            continue;
        }
        MUST(img.width >= 1 && img.width <= CAP_SIDE_MAX && img.height >= 1 &&
             img.height <= CAP_SIDE_MAX && img.fmt == r.fmt);
        MUST(img.stride == (ptrdiff_t)cap_pixfmt_row(img.fmt, img.width));
        MUST(img.size == (size_t)img.stride * (size_t)img.height);
        unsigned sum = 0;
        for (size_t k = 0; k < img.size; k++)
            sum += ((const uint8_t *)img.data)[k];
        static volatile unsigned keep;
        keep = sum;
        (void)keep;
    }
    cap_raw_close(&r);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const uint8_t pixels[255 * 64];
    name();
    remove_files();
    if (size > 0 && data[0] == 'C') {
        save(cine, data, size);
        read_all(cine);
        return 0;
    }
    if (size == 0)
        return 0;
    save(film, pixels, (size_t)(data[0] & 0x7F) * 64);
    save(data[0] & 0x80 ? cihx : cih, data + 1, size - 1);
    read_all(film);
    return 0;
}
