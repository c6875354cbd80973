#include "daemon/pipeline/beside.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/spawn.h"
#include "daemon/config/endpoints.h"
#include "daemon/pipeline/recording.h"

#define BESIDE_TRIES 5
#define STEADY_NS    (60 * PVX_NS_PER_S) /* a process that ran so long gets all tries again */
#define END_NS       (5 * PVX_NS_PER_S)  /* these three fit into the service's TimeoutStopSec */
#define TERM_NS      (4 * PVX_NS_PER_S)
#define KILL_NS      (1 * PVX_NS_PER_S)

struct dmn_beside {
    char program[PATH_MAX], pattern[DMN_WORD_MAX], base[PATH_MAX];
    char endpoint[DMN_WORD_MAX], format[8], keep_free[32], roll[32];
    uint64_t session;
    int config; /* file with all keys as text: the process's standard input */
    pthread_mutex_t lock;
    pthread_cond_t wake;
    pthread_t thread;
    bool joinable, over, stopping;
    pid_t pid; /* 0: none runs */
    unsigned runs;
    uint64_t written, lost; /* of processes that have ended */
    struct dmn_beside_state st;
};

static const char *const formats[] = {"none", "npy", "hdf5", "vdb", "nvdb"};

/* ---- the process's output: the lines that `pyrovox record` writes when it has no terminal ---- */

/* Under the lock. */
static void take_count(dmn_beside *b, unsigned long long written, unsigned long long lost)
{
    b->st.written = b->written + written;
    b->st.lost = b->lost + lost;
}

static void take_line(dmn_beside *b, const char *line)
{
    unsigned long long n, lost;
    const char *comma = strrchr(line, ',');
    bool counts = comma != NULL && sscanf(line, "%llu volumes", &n) == 1 &&
                  sscanf(comma, ", %llu messages lost", &lost) == 1;
    bool bad = strncmp(line, "pyrovox: ", 9) == 0;
    pthread_mutex_lock(&b->lock);
    if (counts)
        take_count(b, n, lost);
    if (bad)
        snprintf(b->st.error, sizeof b->st.error, "%.*s", (int)sizeof b->st.error - 1, line + 9);
    pthread_mutex_unlock(&b->lock);
    if (bad)
        LOG_W(DAEMON, "recording volumes: %s", line + 9);
    else if (!counts)
        LOG_D(DAEMON, "recording volumes: %s", line);
}

static void listen_to(dmn_beside *b, int fd)
{
    char line[1024];
    FILE *f = fdopen(fd, "r");
    while (f != NULL && fgets(line, sizeof line, f) != NULL) {
        line[strcspn(line, "\n")] = '\0';
        take_line(b, line);
    }
    if (f != NULL)
        fclose(f);
    else
        close(fd);
}

/* ---- the process ---- */

/* Make a new name for each run.  The folder is made here, so that an error is reported at once. */
static pvx_err name_it(dmn_beside *b, char *path, size_t size, struct pvx_diag *d)
{
    char stem[PATH_MAX], again[16] = "";
    PVX_TRY(dmn_recording_name("record.volumes_path", b->pattern, b->base, stem, sizeof stem, d));
    char *slash = strrchr(stem, '/');
    *slash = '\0'; /* base is before it */
    PVX_TRY(pvx_mkdirs(slash == stem ? "/" : stem, d));
    *slash = '/';
    if (b->runs > 0)
        snprintf(again, sizeof again, "-%u", b->runs + 1);
    int n = snprintf(path, size, "%s-%016llx%s%s", stem, (unsigned long long)b->session, again,
                     strcmp(b->format, "hdf5") == 0 ? ".h5" : "");
    return n < (int)size ? PVX_OK
                         : pvx_fail(d, PVX_ERANGE, "record.volumes_path: '%s' is too long", path);
}

/* Start the process; *fd reads its output. */
static pvx_err beside_begin(dmn_beside *b, int *fd, struct pvx_diag *d)
{
    char path[PATH_MAX], parent[16];
    int ends[2];
    pid_t pid = 0;
    PVX_TRY(name_it(b, path, sizeof path, d));
    if (pipe2(ends, O_CLOEXEC) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "recording volumes: %s", strerror(errno));
    snprintf(parent, sizeof parent, "%ld", (long)getpid());
    const char *const argv[] = {b->program, "record", "--endpoint", b->endpoint,   "--format",
                                b->format,  "--out",  path,         "--keep-free", b->keep_free,
                                "--roll",   b->roll,  "--daemon",   parent,        NULL};
    lseek(b->config, 0, SEEK_SET);
    int err = pvx_spawn(argv, b->config, ends[1],
                        &pid); /* Ctrl-C ends only the daemon; volumes until then are recorded */
    close(ends[1]);
    if (err != 0) {
        close(ends[0]);
        return pvx_fail(d, pvx_err_from_errno(err),
                        "%s: %s; it records volumes: install it beside pyrovoxd", b->program,
                        strerror(err));
    }
    *fd = ends[0];
    pthread_mutex_lock(&b->lock);
    b->pid = pid;
    b->runs++;
    b->st.running = true;
    b->st.error[0] = '\0';
    snprintf(b->st.path, sizeof b->st.path, "%.*s", (int)sizeof b->st.path - 1, path);
    if (b->stopping)
        kill(pid, SIGTERM);
    pthread_mutex_unlock(&b->lock);
    LOG_I(DAEMON, "recording volumes to %s", path);
    return PVX_OK;
}

/* Wait for the end of the process and return its status: it has closed its output, but may still live. */
static int beside_reap(dmn_beside *b)
{
    int status = 0;
    siginfo_t is;
    while (waitid(P_PID, (id_t)b->pid, &is, WEXITED | WNOWAIT) != 0 && errno == EINTR)
        ;
    pthread_mutex_lock(&b->lock); /* after waitpid the system may reuse the pid: do not signal it */
    while (waitpid(b->pid, &status, 0) < 0 && errno == EINTR)
        ;
    b->pid = 0;
    b->st.running = false;
    b->written = b->st.written;
    b->lost = b->st.lost;
    pthread_mutex_unlock(&b->lock);
    return status;
}

/* Record how the process ended.  Returns whether to start it again: not after exit codes 1 and 2, which it explains. */
static bool died(dmn_beside *b, int status)
{
    pthread_mutex_lock(&b->lock);
    bool asked = b->stopping, why = b->st.error[0] != '\0';
    int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    b->st.failed = code != 0 && !asked;
    b->st.deaths += b->st.failed;
    if (b->st.failed && !why)
        snprintf(b->st.error, sizeof b->st.error,
                 code < 0 ? "ended by signal %d" : "ended with exit code %d",
                 code < 0 ? WTERMSIG(status) : code);
    char error[sizeof b->st.error];
    snprintf(error, sizeof error, "%s", b->st.error);
    bool failed = b->st.failed;
    pthread_mutex_unlock(&b->lock);
    if (failed)
        LOG_E(DAEMON, "recording volumes: %s; %s holds what was recorded before", error,
              b->st.path);
    return failed && code != 1 && code != 2;
}

/* false: stopped meanwhile. */
static bool pause_before(dmn_beside *b, unsigned tries)
{
    int64_t until = pvx_now_mono() + (PVX_NS_PER_S << tries);
    struct timespec ts = {.tv_sec = until / PVX_NS_PER_S, .tv_nsec = until % PVX_NS_PER_S};
    pthread_mutex_lock(&b->lock);
    while (!b->stopping && pthread_cond_timedwait(&b->wake, &b->lock, &ts) != ETIMEDOUT)
        ;
    bool go_on = !b->stopping;
    pthread_mutex_unlock(&b->lock);
    return go_on;
}

struct job {
    dmn_beside *b;
    int fd;
};

static void *watch_over(void *arg)
{
    struct job *job = arg;
    dmn_beside *b = job->b;
    int fd = job->fd;
    free(job);
    for (unsigned tries = 0;;) {
        struct pvx_diag d = {""};
        int64_t t0 = pvx_now_mono();
        listen_to(b, fd);
        if (!died(b, beside_reap(b)))
            break;
        tries = pvx_now_mono() - t0 > STEADY_NS ? 0 : tries;
        if (tries == BESIDE_TRIES)
            LOG_E(DAEMON, "recording volumes: given up after %d tries", BESIDE_TRIES);
        if (tries == BESIDE_TRIES || !pause_before(b, tries++))
            break;
        pvx_err e = beside_begin(b, &fd, &d);
        if (e != PVX_OK) {
            LOG_E(DAEMON, "recording volumes: %s", pvx_diag_text(&d, e));
            pthread_mutex_lock(&b->lock);
            snprintf(b->st.error, sizeof b->st.error, "not begun again: %.200s",
                     pvx_diag_text(&d, e));
            pthread_mutex_unlock(&b->lock);
            break;
        }
    }
    pthread_mutex_lock(&b->lock);
    b->over = true;
    pthread_cond_broadcast(&b->wake);
    pthread_mutex_unlock(&b->lock);
    return NULL;
}

/* ---- from outside ---- */

/* An endpoint that lets this host in without a key, even if keys are configured. */
static const char *beside_find_endpoint(const struct dmn_config *c)
{
    for (size_t i = 0; i < c->endpoints.n; i++)
        if (dmn_endpoint_reach(c->endpoints.v[i]) != DMN_REACH_NET &&
            strchr(c->endpoints.v[i], '*') == NULL)
            return c->endpoints.v[i];
    return c->endpoints.n == 0 ? dmn_default_endpoint(DMN_VOLUMES) : NULL;
}

/* Write the configuration into a file without a name, so that no file is left behind. */
static pvx_err beside_describe(dmn_beside *b, const struct dmn_config *c)
{
    char *text = dmn_config_format(c);
    size_t n = text == NULL ? 0 : strlen(text);
    b->config = memfd_create("pyrovoxd.yaml", MFD_CLOEXEC);
    bool ok = text != NULL && b->config >= 0 && write(b->config, text, n) == (ssize_t)n;
    free(text);
    return ok ? PVX_OK : PVX_ENOMEM;
}

pvx_err dmn_beside_new(const struct dmn_config *c, uint64_t session, dmn_beside **out,
                       struct pvx_diag *d)
{
    char bin[PATH_MAX - 16];
    *out = NULL;
    const char *endpoint = beside_find_endpoint(c);
    if (endpoint == NULL)
        return c->record_volumes == 0
                   ? PVX_OK
                   : pvx_fail(d, PVX_EINVAL,
                              "%s: record.volumes: needs an ipc:// or tcp://127.0.0.1:PORT "
                              "address among publish.endpoints",
                              c->name);
    dmn_beside *b = pvx_calloc(1, sizeof *b);
    PVX_NEED(b);
    pthread_mutex_init(&b->lock, NULL);
    pvx_cond_init(&b->wake, CLOCK_MONOTONIC);
    if (pvx_exe_dir(bin, sizeof bin) == PVX_OK)
        snprintf(b->program, sizeof b->program, "%s/pyrovox", bin);
    snprintf(b->endpoint, sizeof b->endpoint, "%s", endpoint);
    snprintf(b->pattern, sizeof b->pattern, "%s", c->record_volumes_path);
    snprintf(b->format, sizeof b->format, "%s",
             formats[c->record_volumes == 0 ? 2 : c->record_volumes]);
    snprintf(b->keep_free, sizeof b->keep_free, "%.17g", c->record_keep_free_gb);
    snprintf(b->roll, sizeof b->roll, "%.17g", c->record_roll_s);
    if (realpath(c->dir, b->base) == NULL)
        snprintf(b->base, sizeof b->base, "%s", c->dir);
    b->session = session;
    b->over = true;
    pvx_err e = beside_describe(b, c);
    if (e != PVX_OK)
        dmn_beside_free(&b);
    *out = b;
    return e;
}

/* Join the thread of a process that has ended. */
static void beside_join(dmn_beside *b)
{
    if (b->joinable)
        pthread_join(b->thread, NULL);
    b->joinable = false;
}

pvx_err dmn_beside_start(dmn_beside *b, char *where, size_t size, struct pvx_diag *d)
{
    if (b == NULL)
        return pvx_fail(d, PVX_EUNSUP,
                        "recording volumes needs an ipc:// or tcp://127.0.0.1:PORT address among "
                        "publish.endpoints");
    pthread_mutex_lock(&b->lock);
    bool busy = !b->over;
    pthread_mutex_unlock(&b->lock);
    if (busy)
        return pvx_fail(d, PVX_EBUSY, "volumes are being recorded to %s; stop that first",
                        b->st.path);
    beside_join(b);
    b->stopping = false;
    b->written = b->lost = 0;
    b->st = (struct dmn_beside_state){0};
    struct job *job = pvx_calloc(1, sizeof *job);
    PVX_NEED(job);
    job->b = b;
    pvx_err e = beside_begin(b, &job->fd, d);
    if (e != PVX_OK) {
        free(job);
        return e;
    }
    b->over = false;
    int fd = job->fd;
    if (pthread_create(&b->thread, NULL, watch_over, job) != 0) {
        free(job);
        kill(b->pid, SIGTERM);
        close(fd);
        beside_reap(b);
        b->over = true;
        return pvx_fail(d, PVX_EIO, "recording volumes: no thread to be had");
    }
    pthread_setname_np(b->thread, "beside");
    b->joinable = true;
    snprintf(where, size, "%s", b->st.path);
    return PVX_OK;
}

/* Under the lock. */
static bool wait_over(dmn_beside *b, int64_t ns)
{
    int64_t until = pvx_now_mono() + ns;
    struct timespec ts = {.tv_sec = until / PVX_NS_PER_S, .tv_nsec = until % PVX_NS_PER_S};
    while (!b->over && pthread_cond_timedwait(&b->wake, &b->lock, &ts) != ETIMEDOUT)
        ;
    return b->over;
}

/* Under the lock. */
static void tell_it(const dmn_beside *b, int sig)
{
    if (b->pid > 0)
        kill(b->pid, sig);
}

/* The process has grace_ns to end by itself, then gets SIGTERM, then SIGKILL.  PVX_ETIMEDOUT: it had to be killed. */
static pvx_err beside_finish(dmn_beside *b, int64_t grace_ns)
{
    pvx_err e = PVX_OK;
    pthread_mutex_lock(&b->lock);
    b->stopping = true;
    pthread_cond_broadcast(&b->wake);
    if (!wait_over(b, grace_ns)) {
        tell_it(b, SIGTERM);
        if (!wait_over(b, TERM_NS)) {
            tell_it(b, SIGKILL);
            e = PVX_ETIMEDOUT;
            wait_over(b, KILL_NS);
        }
    }
    bool over = b->over;
    struct dmn_beside_state s = b->st;
    pthread_mutex_unlock(&b->lock);
    if (over)
        beside_join(b);
    LOG_I(DAEMON, "%s: %llu volumes recorded, %llu lost%s", s.path, (unsigned long long)s.written,
          (unsigned long long)s.lost,
          e == PVX_OK ? "" : "; the disk does not answer; what it stored before is kept");
    return e;
}

pvx_err dmn_beside_stop(dmn_beside *b, char *where, size_t size, struct pvx_diag *d)
{
    if (b == NULL || !b->joinable)
        return pvx_fail(d, PVX_ENOENT, "no volumes are being recorded");
    pthread_mutex_lock(&b->lock);
    bool before = b->over;
    pthread_mutex_unlock(&b->lock);
    pvx_err e = beside_finish(b, 0);
    struct dmn_beside_state s;
    dmn_beside_state(b, &s);
    snprintf(where, size, "%s", s.path);
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: the disk does not answer", s.path);
    return before ? pvx_fail(d, PVX_EIO, "%s: had ended before: %s", s.path, s.error) : PVX_OK;
}

void dmn_beside_end(dmn_beside *b)
{
    if (b != NULL && b->joinable)
        beside_finish(b, END_NS); /* the log has the outcome */
}

void dmn_beside_state(dmn_beside *b, struct dmn_beside_state *out)
{
    *out = (struct dmn_beside_state){0};
    if (b == NULL)
        return;
    pthread_mutex_lock(&b->lock);
    *out = b->st;
    pthread_mutex_unlock(&b->lock);
}

void dmn_beside_free(dmn_beside **bp)
{
    dmn_beside *b = *bp;
    if (b == NULL)
        return;
    *bp = NULL;
    if (b->joinable && !b->stopping)
        beside_finish(b, 0);
    if (b->joinable)
        return; /* the process hangs on a disk in the kernel: its thread still uses the memory */
    pthread_mutex_destroy(&b->lock);
    pthread_cond_destroy(&b->wake);
    if (b->config >= 0)
        close(b->config);
    free(b);
}
