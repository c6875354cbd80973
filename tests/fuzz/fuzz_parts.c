/* fuzz_parts.c - any text as job.json, and as how far a part is: taken in range, or refused with a reason.
 * A byte of 1 stands for the name and version of this program, which a job must have to be gone on with. */
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/volumes/parts.h"
#include "tests/fuzz/fuzz.h"

static char folder[] = "/dev/shm/fuzz_parts-XXXXXX", out[64], folder_of[80], job[128], status[128],
            lock[128];
static const uint64_t numbers[] = {3, 4, 5, 9};
static const struct parts_job mine = {.out = out,
                                      .n = 1,
                                      .rig = "version: 1\n",
                                      .options = "--black 0.02\n--grid 24\n",
                                      .number = numbers,
                                      .n_sets = 4};

static void remove_all(void)
{
    unlink(job);
    unlink(status);
    unlink(lock);
    rmdir(folder_of);
    rmdir(folder);
}

static void put(const char *path, const void *data, size_t size)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    MUST(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    close(fd);
}

static void make(void)
{
    struct part_status s;
    static const char runs[] = "{\"state\":\"running\",\"done\":2}";
    MUST(mkdtemp(folder) != NULL);
    snprintf(out, sizeof out, "%s/v.h5", folder);
    snprintf(folder_of, sizeof folder_of, "%s.parts", out);
    snprintf(job, sizeof job, "%s/job.json", folder_of);
    parts_path(&mine, 1, "json", status, sizeof status);
    parts_path(&mine, 1, "lock", lock, sizeof lock);
    atexit(remove_all);
    MUST(parts_begin(&mine, NULL) == PVX_OK && parts_begin(&mine, NULL) == PVX_OK);
    put(lock, "", 0);
    put(status, runs, sizeof runs - 1);
    parts_status(&mine, 1, &s);
    MUST(s.state == PART_DIED && s.done == 2); /* its lock is nobody's */
}

static void put_job(const uint8_t *data, size_t size)
{
    static const char software[] = "pyrovox " PVX_VERSION;
    char *text = malloc(size * sizeof software + 1);
    size_t n = 0;
    MUST(text != NULL);
    for (size_t i = 0; i < size; i++) {
        if (data[i] != 1)
            text[n++] = (char)data[i];
        else
            n += (size_t)snprintf(text + n, sizeof software, "%s", software);
    }
    put(job, text, n);
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct parts_job j;
    struct part_status s;
    struct pvx_diag d = {""};
    if (folder_of[0] == '\0')
        make();
    put_job(data, size);
    put(status, data, size);
    if (parts_load(out, &j, &d) == PVX_OK) {
        MUST(j.n >= 1 && j.n <= PARTS_MAX && j.n_sets >= 1 && j.rig != NULL && j.options != NULL);
        for (size_t k = 1; k < j.n_sets; k++)
            MUST(j.number[k] > j.number[k - 1]);
        pvx_err e = parts_begin(&mine, &d);
        MUST(e == PVX_OK || (e == PVX_ESTALE && strchr(d.text, '\n') == NULL));
        if (e == PVX_OK)
            MUST(parts_session(&j) == parts_session(&mine));
        fuzz_taken += e == PVX_OK;
        parts_free(&j);
    } else {
        MUST(d.text[0] != '\0');
    }
    parts_status(&mine, 1, &s);
    MUST(s.state <= PART_DONE && s.sets == 4 && s.pid >= 0);
    MUST(memchr(s.host, 0, sizeof s.host) != NULL && memchr(s.error, 0, sizeof s.error) != NULL);
    return 0;
}
