/* A shared segment of any bytes, as pyrovox_share.h reads it: nothing outside of it is touched, and what is given lies in it. */
#include <string.h>
#include <sys/mman.h>

#include "proto/clients/pyrovox_share.h"
#include "tests/fuzz/fuzz.h"

static void inside(const struct pvp_share *s, const void *at, size_t size)
{
    const unsigned char *p = at;
    MUST(p >= s->map && (size_t)(p - s->map) <= s->size && size <= s->size - (size_t)(p - s->map));
    unsigned sum = 0;
    for (size_t i = 0; i < size; i++)
        sum += p[i];
    __asm__ volatile("" : : "r"(sum)); /* every byte is read */
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char *const names[] = {"density", "emission", "red", "green", "blue", ""};
    struct pvp_share s;
    struct pvp_share_volume v;
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    MUST(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    int e = pvp_share_attach(&s, fd);
    MUST(pvp_share_text(e)[0] != '\0');
    if (e != PVP_SHARE_OK) {
        MUST(s.fd == -1 && s.map == NULL);
        return 0;
    }
    MUST(!pvp_share_alive(&s)); /* nobody holds its lock */
    e = pvp_share_newest(&s, &v);
    MUST(e == PVP_SHARE_ENDED || e == PVP_SHARE_FOREIGN);
    MUST((v.number != 0) == (v.grids != NULL) && (e == PVP_SHARE_ENDED || v.number == 0));
    if (v.number != 0) {
        fuzz_taken++;
        inside(&s, v.grids, v.size);
        MUST(pvp_share_intact(&s, &v));
        for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
            size_t bytes = 0;
            const void *grid = pvp_share_grid(&v, names[i], &bytes);
            if (grid != NULL)
                inside(&s, grid, bytes);
        }
        void *copy = malloc(v.size + 1);
        MUST(copy != NULL && pvp_share_copy(&s, &v, copy) && v.grids == copy);
        free(copy);
    }
    pvp_share_close(&s);
    MUST(s.fd == -1);
    pvp_share_close(&s);
    return 0;
}
