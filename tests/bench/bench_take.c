/* bench_take.c - recording raw frames: 8 cameras of 640x480 RGB8, MB/s into a take beside what plain
 * write(2) of the same bytes takes in the same run, into the page cache and onto the disk (fdatasync at
 * the end), and what of one core it costs at 30 sets/s; then reading the take back, with its checksums,
 * beside read(2).  Files lie in the folder given, or the current one. */
#include <fcntl.h>
#include <unistd.h>

#include "base.h"
#include "tests/lib/take.h"

enum { CAMERAS = 8, W = 640, H = 480, FRAME = W * H * 3, SETS = 120, ROUNDS = 3 };
#define MB (1e-6 * FRAME * CAMERAS * SETS)

static unsigned char *pixels; /* [2 sets] */
static char path[4096];

static double seconds(void)
{
    return (double)pvx_now_mono() * 1e-9;
}

static void sync_file(void)
{
    int fd = open(path, O_RDONLY);
    if (fd < 0 || fdatasync(fd) != 0)
        perror(path);
    close(fd);
}

struct cost {
    double written, synced, cpu; /* s */
};

static struct cost plain(void)
{
    struct cost c;
    unlink(path);
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    double t0 = seconds(), c0 = bench_cpu();
    for (int i = 0; i < SETS * CAMERAS; i++)
        if (write(fd, pixels + (size_t)(i % (2 * CAMERAS)) * FRAME, FRAME) != FRAME)
            perror(path);
    c.written = seconds() - t0;
    c.cpu = bench_cpu() - c0;
    close(fd);
    sync_file();
    c.synced = seconds() - t0;
    return c;
}

static void no_release(struct cap_frame *f)
{
    (void)f;
}

static struct cost take(void)
{
    struct cap_take_camera cameras[CAMERAS];
    char name[CAMERAS][8];
    for (int i = 0; i < CAMERAS; i++) {
        snprintf(name[i], sizeof name[i], "cam%d", i);
        cameras[i] = (struct cap_take_camera){.name = name[i]};
    }
    struct cap_take_head h = take_head(cameras, CAMERAS);
    struct pvx_diag d = {""};
    struct cost c;
    cap_take_writer *w;
    unlink(path);
    double t0 = seconds(), c0 = bench_cpu();
    bench_check(cap_take_create(path, &h, &w, &d), &d);
    for (uint64_t k = 0; k < SETS; k++) {
        struct cap_frame f[CAMERAS];
        struct cap_set s = {.number = k, .n = CAMERAS};
        for (uint32_t i = 0; i < CAMERAS; i++) {
            const void *px = pixels + ((k % 2) * CAMERAS + i) * FRAME;
            f[i] = (struct cap_frame){.img = {px, FRAME, W, H, W * 3, CAP_RGB8, 0},
                                      .camera = i,
                                      .id = k,
                                      .release = no_release};
            s.frame[i] = &f[i];
        }
        bench_check(cap_take_put_set(w, &s, &d), &d);
        bench_check(cap_take_commit(w, &d), &d);
    }
    c.written = seconds() - t0;
    c.cpu = bench_cpu() - c0;
    bench_check(cap_take_close(&w, &d), &d);
    sync_file();
    c.synced = seconds() - t0;
    return c;
}

/* MB/s: all frames of the take in `path` by cap_take_read; by read(2). */
static void reading(double *with_take, double *with_read)
{
    struct pvx_diag d = {""};
    cap_take *t;
    unsigned char *mem = malloc(FRAME);
    bench_check(cap_take_open(path, &t, &d), &d);
    double t0 = seconds();
    for (uint64_t k = 0; k < SETS; k++)
        for (uint32_t c = 0; c < CAMERAS; c++) {
            struct cap_image img;
            bench_check(cap_take_read(t, c, k, mem, FRAME, &img, &d), &d);
        }
    *with_take = MB / (seconds() - t0);
    cap_take_free(&t);
    int fd = open(path, O_RDONLY);
    ssize_t n, all = 0;
    t0 = seconds();
    while ((n = read(fd, mem, FRAME)) > 0)
        all += n;
    *with_read = 1e-6 * (double)all / (seconds() - t0);
    close(fd);
    free(mem);
}

int main(int argc, char **argv)
{
    snprintf(path, sizeof path, "%s/bench_take.tmp.h5", argc > 1 ? argv[1] : ".");
    pixels = pvx_calloc(2 * CAMERAS, FRAME);
    for (size_t i = 0; i < (size_t)2 * CAMERAS * FRAME; i++)
        pixels[i] = (unsigned char)(i * 2654435761u >> 13);
    printf("\n-- raw recording: %d sets of %d x %dx%d RGB8, %.0f MB; 30 sets/s are %.0f MB/s\n",
           SETS, CAMERAS, W, H, MB, MB / SETS * 30);
    printf("%-28s %12s %12s %14s\n", "best of 3, alternating", "cache MB/s", "disk MB/s",
           "core at 30/s");
    struct cost best[2] = {{1e9, 1e9, 1e9}, {1e9, 1e9, 1e9}};
    for (int r = 0; r < ROUNDS; r++)
        for (int i = 0; i < 2; i++) {
            struct cost c = i == 0 ? plain() : take();
            best[i].written = fmin(best[i].written, c.written);
            best[i].synced = fmin(best[i].synced, c.synced);
            best[i].cpu = fmin(best[i].cpu, c.cpu);
        }
    static const char *const what[] = {"plain write(2)", "take (HDF5, checksums)"};
    for (int i = 0; i < 2; i++)
        printf("%-28s %12.0f %12.0f %13.1f%%\n", what[i], MB / best[i].written, MB / best[i].synced,
               100 * best[i].cpu / SETS * 30);
    printf("take over plain: %.2f x the time into the cache, %.2f x onto the disk\n",
           best[1].written / best[0].written, best[1].synced / best[0].synced);
    double a, b;
    reading(&a, &b);
    printf("reading back: %.0f MB/s with checksums, %.0f MB/s by read(2)\n", a, b);
    unlink(path);
    free(pixels);
    return 0;
}
