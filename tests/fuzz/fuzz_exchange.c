/* fuzz_exchange.c - any bytes as a calibration of another program.  The first byte says how they come:
 *     t   a .toml      c   COLMAP's cameras.txt and images.txt, with "%%\n" between them     b   the same, .bin
 *     any other: a file whose format is seen by its content
 * Refused in one line, or cameras whose poses are rotations.  HDF5 is not among them: libhdf5 has checksums of its own. */
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "recon/exchange/exchange.h"
#include "tests/fuzz/fuzz.h"

static char folder[] = "/dev/shm/fuzz_exchange-XXXXXX";
static const char *const names[4] = {"cameras.txt", "images.txt", "cameras.bin", "images.bin"};

static void part_path(char out[64], int i)
{
    snprintf(out, 64, "%s/%s", folder, names[i]);
}

static void remove_all(void)
{
    char path[64];
    for (int i = 0; i < 4; i++) {
        part_path(path, i);
        unlink(path);
    }
    rmdir(folder);
}

static void write_part(int i, const uint8_t *data, size_t n)
{
    char path[64];
    part_path(path, i);
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    MUST(fd >= 0 && write(fd, data, n) == (ssize_t)n);
    close(fd);
}

static pvx_err colmap(const uint8_t *data, size_t size, bool binary, struct rec_exchange *x,
                      struct pvx_diag *d)
{
    static bool made;
    if (!made)
        MUST(mkdtemp(folder) != NULL && atexit(remove_all) == 0);
    made = true;
    const uint8_t *end = data + size, *cut = memmem(data, size, "%%\n", 3);
    remove_all();
    MUST(mkdir(folder, 0700) == 0);
    write_part(2 * binary, data, cut != NULL ? (size_t)(cut - data) : size);
    write_part(2 * binary + 1, cut != NULL ? cut + 3 : end,
               cut != NULL ? (size_t)(end - cut - 3) : 0);
    return rec_exchange_read(folder, REC_EXCHANGE_COLMAP, x, d);
}

static void use(const struct rec_exchange *x)
{
    double at[3];
    for (size_t i = 0; i < x->n; i++) {
        const struct rec_exchange_camera *c = &x->camera[i];
        MUST(rec_rig_name_ok(c->c.name));
        MUST(c->c.width >= 0 && c->c.width <= 16384 && c->c.height >= 0 && c->c.height <= 16384);
        MUST(!c->lens || (c->c.fx > 0 && c->c.fy > 0 && isfinite(c->c.cx) && isfinite(c->c.cy)));
        for (int k = 0; k < 8; k++)
            MUST(isfinite(c->c.dist[k]));
        for (int k = 0; k < 9 && c->pose; k++)
            MUST(fabs(c->c.R[k]) < 1.01);
    }
    if (rec_exchange_aim(x, at))
        MUST(isfinite(at[0]) && isfinite(at[1]) && isfinite(at[2]));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct rec_exchange x;
    struct pvx_diag d = {""};
    if (size == 0)
        return 0;
    memset(&x, 0, sizeof x);
    char *text = malloc(size); /* of its own, so that reading behind it is seen */
    MUST(text != NULL);
    memcpy(text, data + 1, size - 1);
    pvx_err e;
    if (*data == 'c' || *data == 'b')
        e = colmap(data + 1, size - 1, *data == 'b', &x, &d);
    else
        e = rec_exchange_parse(text, size - 1, *data == 't' ? "f.toml" : "f.yaml",
                               REC_EXCHANGE_AUTO, &x, &d);
    free(text);
    PVX_THEN(e, rec_exchange_end(&x, &d));
    if (e == PVX_OK) {
        fuzz_taken++;
        use(&x);
    } else {
        MUST(strchr(d.text, '\n') == NULL);
        MUST(e == PVX_ENOMEM || d.text[0] != '\0');
    }
    return 0;
}
