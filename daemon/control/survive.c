#include "daemon/control/survive.h"

#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <unistd.h>

#include "base/log.h"

/* ---- a mapped file that is cut ----------------------------------------------------------------- */

static void survive_say(const char *text, size_t n)
{
    if (write(STDERR_FILENO, text, n) < 0)
        return; /* there is no other place to report it */
}

static uintptr_t survive_hex(const char **p)
{
    uintptr_t v = 0;
    for (; (**p >= '0' && **p <= '9') || (**p >= 'a' && **p <= 'f'); ++*p)
        v = v * 16 + (uintptr_t)(**p <= '9' ? **p - '0' : **p - 'a' + 10);
    return v;
}

/* Print the line of /proc/self/maps that has the address, without any call that a signal handler must not make. */
static void say_mapping(uintptr_t address)
{
    static char line[PATH_MAX + 128];
    size_t n = 0;
    int fd = open("/proc/self/maps", O_RDONLY | O_CLOEXEC);
    for (char c; fd >= 0 && read(fd, &c, 1) == 1;) {
        if (n < sizeof line)
            line[n++] = c;
        if (c != '\n')
            continue;
        const char *p = line;
        uintptr_t from = survive_hex(&p);
        p++;
        if (address >= from && address < survive_hex(&p)) {
            survive_say(line, n);
            return;
        }
        n = 0;
    }
}

/* Several threads work on a matrix: the first to find it cut prints the message, the others wait for the end. */
static void on_bus_error(int sig, siginfo_t *info, void *context)
{
    static atomic_flag told = ATOMIC_FLAG_INIT;
    static const char text[] = "pyrovoxd: a file that is mapped was cut, or its disk fails; delete "
                               "it if it is a matrix, it is rebuilt: ";
    (void)sig;
    (void)context;
    while (atomic_flag_test_and_set(&told))
        pause();
    survive_say(text, sizeof text - 1);
    say_mapping((uintptr_t)info->si_addr);
    _exit(1);
}

void dmn_survive(void)
{
    struct sigaction bus = {.sa_sigaction = on_bus_error, .sa_flags = SA_SIGINFO};
    struct rlimit handles;
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN);
    sigaction(SIGBUS, &bus, NULL);
    if (getrlimit(RLIMIT_NOFILE, &handles) == 0) {
        handles.rlim_cur = handles.rlim_max;
        setrlimit(RLIMIT_NOFILE, &handles);
    }
}

/* ---- recording before a crash ------------------------------------------------------------------ */

static bool marker(char *out, size_t size)
{
    const char *dir = getenv("STATE_DIRECTORY");
    return dir != NULL && snprintf(out, size, "%s/recording", dir) < (int)size;
}

void dmn_remember_recording(bool on)
{
    char path[PATH_MAX];
    if (!marker(path, sizeof path))
        return;
    if (!on) {
        unlink(path);
        return;
    }
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
    if (fd < 0 || fsync(fd) != 0)
        LOG_W(DAEMON, "%s: %m: a restart will not go on recording", path);
    if (fd >= 0)
        close(fd);
}

bool dmn_was_recording(void)
{
    char path[PATH_MAX];
    return marker(path, sizeof path) && access(path, F_OK) == 0;
}
