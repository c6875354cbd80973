/* input_file.h - an input as a file in memory, for parsers of files that are modules, and what is said of it. */
#ifndef TESTS_INPUT_FILE_H
#define TESTS_INPUT_FILE_H
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "tests/fuzz/fuzz.h"
#include "tests/lib/plugins.h"

static char input_folder[] = "/dev/shm/fuzz-XXXXXX", input_file[64];

static void input_remove(void)
{
    unlink(input_file);
    rmdir(input_folder);
}

/* The first time: NAME in a folder of its own. */
static void input_write(const char *name, const uint8_t *data, size_t size)
{
    if (input_file[0] == '\0') {
        plugins_of_this_build();
        MUST(mkdtemp(input_folder) != NULL);
        snprintf(input_file, sizeof input_file, "%s/%s", input_folder, name);
        atexit(input_remove);
    }
    int fd = open(input_file, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    MUST(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    close(fd);
}

/* It is refused with one line that names it. */
static void input_refused(pvx_err e, const struct pvx_diag *d)
{
    MUST(e == PVX_ENOMEM || strncmp(d->text, input_file, strlen(input_file)) == 0);
    MUST(strchr(d->text, '\n') == NULL);
}
#endif
