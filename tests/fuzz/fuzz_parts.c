/* fuzz_parts.c - any text as job.json, and as how far a part is: taken in range, or refused with a reason. */
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/cli/parts.h"
#include "tests/fuzz/fuzz.h"

static char folder[] = "/tmp/fuzz_parts-XXXXXX", out[64], folder_of[80], job[128], status[128];

static void remove_all(void)
{
    unlink(job);
    unlink(status);
    rmdir(folder_of);
    rmdir(folder);
}

static void make(void)
{
    MUST(mkdtemp(folder) != NULL);
    snprintf(out, sizeof out, "%s/v.h5", folder);
    snprintf(folder_of, sizeof folder_of, "%s.parts", out);
    snprintf(job, sizeof job, "%s/job.json", folder_of);
    snprintf(status, sizeof status, "%s/part-0001-of-0001.json", folder_of);
    MUST(mkdir(folder_of, 0777) == 0);
    atexit(remove_all);
}

static void put(const char *path, const uint8_t *data, size_t size)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    MUST(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    close(fd);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const uint32_t one[] = {7};
    struct parts_job j,
        mine = {.out = out, .n = 1, .rig = "", .options = "", .number = one, .n_sets = 1};
    struct part_status s;
    struct pvx_diag d = {""};
    if (folder_of[0] == '\0')
        make();
    put(job, data, size);
    put(status, data, size);
    if (parts_load(out, &j, &d) == PVX_OK) {
        MUST(j.n >= 1 && j.n <= PARTS_MAX && j.n_sets >= 1 && j.rig != NULL && j.options != NULL);
        for (size_t k = 1; k < j.n_sets; k++)
            MUST(j.number[k] > j.number[k - 1]);
        parts_free(&j);
    } else {
        MUST(d.text[0] != '\0');
    }
    parts_status(&mine, 1, &s);
    MUST(s.state <= PART_DONE && s.sets == 1 && s.pid >= 0);
    MUST(memchr(s.host, 0, sizeof s.host) != NULL && memchr(s.error, 0, sizeof s.error) != NULL);
    return 0;
}
