/* fuzz_names.c - any lines as the names of pictures of three cameras, or as the times of their films: refused with a line,
 * or each frame is in one set at most, and the sets ascend.
 *
 * The first letter says what the numbers are (0 to 3: enum cap_numbers; f: films), and that of each line the camera. */
#include <fcntl.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "capture/files/pairs.h"
#include "tests/fuzz/fuzz.h"

enum { CAMERAS = 3, NAMES = 40 };
#define FAR (INT64_MAX / 4) /* of a film's time, as film_read.c has it */

static char folder[] = "/dev/shm/fuzz_names-XXXXXX", camera[CAMERAS][64];
static const char *const name[CAMERAS] = {"a", "b", "c"};
static char made[NAMES][400];
static int n_made;

static void remove_files(void)
{
    while (n_made > 0)
        unlink(made[--n_made]);
}

static void remove_all(void)
{
    remove_files();
    for (int c = 0; c < CAMERAS; c++)
        rmdir(camera[c]);
    rmdir(folder);
}

static void make(void)
{
    MUST(mkdtemp(folder) != NULL && atexit(remove_all) == 0);
    for (int c = 0; c < CAMERAS; c++) {
        snprintf(camera[c], sizeof camera[c], "%s/%s", folder, name[c]);
        MUST(mkdir(camera[c], 0777) == 0);
    }
}

static void picture(int c, const char *file)
{
    snprintf(made[n_made], sizeof made[0], "%s/%.255s", camera[c], file);
    int fd = open(made[n_made], O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0)
        return;
    close(fd);
    n_made++;
}

/* Times of a film ascend. */
static void film(struct cap_reel *r, const char *text)
{
    static struct cap_reel_frame frames[CAMERAS][NAMES];
    static char film_name[] = "film", *path[] = {film_name};
    long long at = strtoll(text, NULL, 10);
    if (at < -FAR || at > FAR || (r->n > 0 && at <= r->frame[r->n - 1].at) || r->n == NAMES)
        return;
    if (r->n == 0)
        *r = (struct cap_reel){.kind = CAP_REEL_FILM, .path = path};
    r->frame = r->n > 0 ? r->frame : frames[text[-1] - 'a'];
    r->frame[r->n++] = (struct cap_reel_frame){.at = at};
}

static void read_lines(char *text, bool films, struct cap_reel reel[CAMERAS])
{
    char *rest = text;
    for (char *line; (line = strsep(&rest, "\n")) != NULL && n_made < NAMES;) {
        int c = line[0] - 'a';
        if (c < 0 || c >= CAMERAS || line[1] == '\0' || strchr(line, '/') != NULL)
            continue;
        if (films)
            film(&reel[c], line + 1);
        else
            picture(c, line + 1);
    }
}

static void pair(const struct cap_reel reel[CAMERAS], enum cap_numbers numbers, bool apart)
{
    struct cap_pairs p;
    struct pvx_diag d = {""};
    size_t used[CAMERAS] = {0};
    int64_t last[CAMERAS] = {-1, -1, -1};
    pvx_err e = cap_pairs_find(reel, name, CAMERAS, numbers, apart, &p, &d);
    if (e != PVX_OK)
        MUST(d.text[0] != '\0' && strchr(d.text, '\n') == NULL);
    for (size_t k = 0; k < p.n && e == PVX_OK; k++) {
        bool some = false;
        MUST(k == 0 || p.number[k] > p.number[k - 1]);
        MUST(k == 0 || p.t_ns == NULL || p.t_ns[k] > p.t_ns[k - 1]);
        for (size_t c = 0; c < CAMERAS; c++) {
            int64_t i = p.row[k * CAMERAS + c];
            MUST(i >= -1 && i < (int64_t)reel[c].n && (i < 0 || i > last[c]));
            last[c] = i >= 0 ? i : last[c];
            used[c] += i >= 0;
            some = some || i >= 0;
        }
        MUST(some);
    }
    for (size_t c = 0; c < CAMERAS && e == PVX_OK && p.t_ns == NULL; c++)
        MUST(used[c] == reel[c].n);
    fuzz_taken += e == PVX_OK && p.n > 0;
    cap_pairs_free(&p);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct cap_reel reel[CAMERAS] = {{0}};
    struct pvx_diag d = {""};
    bool good = true;
    if (size == 0)
        return 0;
    if (camera[0][0] == '\0')
        make();
    bool films = data[0] == 'f';
    char *text = strndup((const char *)data + 1, size - 1);
    MUST(text != NULL);
    read_lines(text, films, reel);
    for (int c = 0; c < CAMERAS && !films; c++) {
        pvx_err e = cap_reel_open(camera[c], &reel[c], &d);
        MUST(e == PVX_OK || (d.text[0] != '\0' && strchr(d.text, '\n') == NULL));
        for (size_t i = 1; i < reel[c].n && e == PVX_OK; i++)
            MUST(reel[c].frame[i].at > reel[c].frame[i - 1].at);
        good = good && (e == PVX_OK || e == PVX_ENOENT);
        if (e != PVX_OK)
            cap_reel_close(&reel[c]);
    }
    if (good)
        pair(reel, films ? CAP_NUMBERS_COUNT : (enum cap_numbers)(data[0] & 3), data[0] & 4);
    for (int c = 0; c < CAMERAS && !films; c++)
        cap_reel_close(&reel[c]);
    remove_files();
    free(text);
    return 0;
}
