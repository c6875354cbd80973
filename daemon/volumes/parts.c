#include "daemon/volumes/parts.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/clock.h"
#include "base/cpu.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/volumes/volumes.h"

#define JOB_VERSION 1
#define SOFTWARE    "pyrovox " PVX_VERSION
#define JOB_MAX     ((size_t)256 << 20)
#define STATUS_MAX  ((size_t)64 << 10)
#define PATH_ROOM   4400

const char *const part_state_names[] = {
    [PART_NONE] = "not begun",  [PART_RUNNING] = "running", [PART_DIED] = "died",
    [PART_STOPPED] = "stopped", [PART_FAILED] = "failed",   [PART_DONE] = "done"};

void parts_run(size_t n_sets, unsigned i, unsigned n, size_t *first, size_t *end)
{
    *first = (size_t)((unsigned __int128)n_sets * (i - 1) / n);
    *end = (size_t)((unsigned __int128)n_sets * i / n);
}

void parts_path(const struct parts_job *j, unsigned i, const char *what, char *out, size_t size)
{
    snprintf(out, size, "%s.parts/part-%04u-of-%04u.%s", j->out, i, j->n, what);
}

/* ---- job.json ---- */

/* Runs of numbers without a hole: [[first, last], ...]. */
static cJSON *ranges(const struct parts_job *j)
{
    cJSON *all = cJSON_CreateArray();
    for (size_t k = 0, n; k < j->n_sets; k += n) {
        for (n = 1; k + n < j->n_sets && j->number[k + n] == j->number[k] + n;)
            n++;
        const double run[2] = {(double)j->number[k], (double)j->number[k + n - 1]};
        cJSON_AddItemToArray(all, cJSON_CreateDoubleArray(run, 2));
    }
    return all;
}

static char *job_text(const struct parts_job *j)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddNumberToObject(o, "version", JOB_VERSION);
    cJSON_AddStringToObject(o, "software", SOFTWARE);
    cJSON_AddNumberToObject(o, "parts", j->n);
    cJSON_AddItemToObject(o, "sets", ranges(j));
    cJSON_AddStringToObject(o, "options", j->options);
    cJSON_AddStringToObject(o, "rig", j->rig);
    char *text = cJSON_Print(o);
    cJSON_Delete(o);
    return text;
}

static void job_path(const char *out, char *path, size_t size)
{
    snprintf(path, size, "%s.parts/job.json", out);
}

static bool is_number(const cJSON *v, double lo, double hi)
{
    return cJSON_IsNumber(v) && v->valuedouble >= lo && v->valuedouble <= hi;
}

/* The inverse of ranges; NULL: they are none, or not ascending. */
static uint64_t *parts_numbers(const cJSON *all, size_t *n)
{
    const cJSON *run;
    double last = -1, sets = 0;
    cJSON_ArrayForEach(run, all)
    {
        const cJSON *a = cJSON_GetArrayItem(run, 0), *b = cJSON_GetArrayItem(run, 1);
        if (!is_number(a, last + 1, PARTS_NUMBER_MAX) ||
            !is_number(b, a->valuedouble, PARTS_NUMBER_MAX))
            return NULL;
        last = b->valuedouble;
        sets += b->valuedouble - a->valuedouble + 1;
    }
    uint64_t *out = sets > 0 && sets < 1e8 ? malloc((size_t)sets * sizeof *out) : NULL;
    *n = 0;
    if (out == NULL)
        return NULL;
    cJSON_ArrayForEach(run, all)
    {
        uint64_t a = (uint64_t)cJSON_GetArrayItem(run, 0)->valuedouble;
        uint64_t b = (uint64_t)cJSON_GetArrayItem(run, 1)->valuedouble;
        for (uint64_t k = 0; k <= b - a; k++)
            out[(*n)++] = a + k;
    }
    return out;
}

static pvx_err read_job(const cJSON *o, struct parts_job *j, const char *path, struct pvx_diag *d)
{
    const cJSON *version = cJSON_GetObjectItemCaseSensitive(o, "version");
    const cJSON *n = cJSON_GetObjectItemCaseSensitive(o, "parts");
    const char *rig = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "rig"));
    const char *options = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "options"));
    const char *software = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "software"));
    if (cJSON_IsNumber(version) && version->valuedouble != JOB_VERSION)
        return pvx_fail(d, PVX_EVERSION,
                        "%s: was begun by another version of this program (%.40s): finish it with "
                        "that version, or name another --out",
                        path, software != NULL ? software : "unknown");
    if (version == NULL || !is_number(n, 1, PARTS_MAX) || rig == NULL || options == NULL ||
        (j->number = parts_numbers(cJSON_GetObjectItemCaseSensitive(o, "sets"), &j->n_sets)) ==
            NULL)
        return pvx_fail(d, PVX_EFORMAT, "%s: is damaged, or not a job of `pyrovox reconstruct`",
                        path);
    j->n = (unsigned)n->valuedouble;
    j->software = strdup(software != NULL ? software : "unknown");
    j->rig = strdup(rig);
    j->options = strdup(options);
    return j->rig != NULL && j->options != NULL && j->software != NULL ? PVX_OK : PVX_ENOMEM;
}

pvx_err parts_load(const char *out, struct parts_job *j, struct pvx_diag *d)
{
    char path[PATH_ROOM], *text;
    size_t len;
    *j = (struct parts_job){.out = out};
    job_path(out, path, sizeof path);
    PVX_TRY(pvx_file_read(path, JOB_MAX, &text, &len, d));
    cJSON *o = cJSON_ParseWithLength(text, len);
    free(text);
    pvx_err e = read_job(o, j, path, d);
    cJSON_Delete(o);
    if (e != PVX_OK)
        parts_free(j);
    return e;
}

void parts_free(struct parts_job *j)
{
    free((char *)j->rig);
    free((char *)j->options);
    free((char *)j->software);
    free((uint64_t *)j->number);
    *j = (struct parts_job){0};
}

static bool has_line(const char *text, const char *line, size_t n)
{
    for (; *text != '\0'; text += strcspn(text, "\n"), text += *text == '\n')
        if (strcspn(text, "\n") == n && strncmp(text, line, n) == 0)
            return true;
    return false;
}

/* The first line of `a` that `b` has not, or "nothing". */
static void other_line(const char *a, const char *b, char *out, size_t size)
{
    for (size_t n; *a != '\0'; a += n + (a[n] == '\n')) {
        n = strcspn(a, "\n");
        if (has_line(b, a, n))
            continue;
        snprintf(out, size, "%.*s", (int)n, a);
        return;
    }
    snprintf(out, size, "nothing");
}

/* Compare with the job as it was begun; the error names what differs. */
static pvx_err parts_compare(const struct parts_job *was, const struct parts_job *j,
                             struct pvx_diag *d)
{
    char old[120], new[120];
    if (strcmp(was->software, SOFTWARE) != 0)
        return pvx_fail(d, PVX_ESTALE,
                        "%s.parts: was begun by %.40s, this is %s: finish it with that version, or "
                        "name another --out",
                        j->out, was->software, SOFTWARE);
    if (was->n != j->n)
        return pvx_fail(
            d, PVX_ESTALE,
            "%s.parts: was begun in %u parts, not in %u: continue with that number, or name "
            "another --out",
            j->out, was->n, j->n);
    if (strcmp(was->options, j->options) != 0) {
        other_line(was->options, j->options, old, sizeof old);
        other_line(j->options, was->options, new, sizeof new);
        return pvx_fail(
            d, PVX_ESTALE,
            "%s.parts: was begun with other options (then '%s', now '%s'): use the same, "
            "or name another --out",
            j->out, old, new);
    }
    if (strcmp(was->rig, j->rig) != 0)
        return pvx_fail(d, PVX_ESTALE,
                        "%s.parts: was begun with another rig.yaml: use that one, or name another "
                        "--out",
                        j->out);
    if (was->n_sets != j->n_sets ||
        memcmp(was->number, j->number, j->n_sets * sizeof *j->number) != 0)
        return pvx_fail(
            d, PVX_ESTALE,
            "%s.parts: was begun with %zu frame sets, now there are %zu: is the recording "
            "still being written?  --first and --last choose the sets",
            j->out, was->n_sets, j->n_sets);
    return PVX_OK;
}

/* The process that links its file first has begun the job.  This also holds if several nodes begin at once. */
pvx_err parts_begin(const struct parts_job *j, struct pvx_diag *d)
{
    char path[PATH_ROOM], mine[PATH_ROOM + 300], host[256] = "";
    struct parts_job was;
    snprintf(path, sizeof path, "%s.parts", j->out);
    PVX_TRY(pvx_mkdirs(path, d));
    job_path(j->out, path, sizeof path);
    gethostname(host, sizeof host - 1);
    snprintf(mine, sizeof mine, "%s.%s.%ld", path, host, (long)getpid());
    char *text = job_text(j);
    PVX_NEED(text);
    pvx_err e = access(path, F_OK) == 0 ? PVX_OK : pvx_file_write(mine, text, strlen(text), d);
    cJSON_free(text);
    if (e == PVX_OK && access(path, F_OK) != 0 && link(mine, path) != 0 && errno != EEXIST)
        e = pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    unlink(mine);
    PVX_THEN(e, parts_load(j->out, &was, d));
    if (e != PVX_OK)
        return e;
    e = parts_compare(&was, j, d);
    parts_free(&was);
    return e;
}

uint64_t parts_session(const struct parts_job *j)
{
    uint64_t h = XXH3_64bits(j->rig, strlen(j->rig));
    h = XXH3_64bits_withSeed(j->options, strlen(j->options), h);
    return XXH3_64bits_withSeed(j->number, j->n_sets * sizeof *j->number, h);
}

/* ---- one part ---- */

struct part {
    const struct parts_job *job;
    unsigned i;
    int lock;
    uint64_t sets, before; /* done before t0 */
    int64_t t_taken, t0, t_said;
    struct part_status earlier; /* tries */
    enum part_state said;
};

/* Test the lock without taking it, which could disturb another process. */
static bool parts_is_held(const struct parts_job *j, unsigned i)
{
    char path[PATH_ROOM];
    struct flock l = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    parts_path(j, i, "lock", path, sizeof path);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return false;
    bool held = fcntl(fd, F_OFD_GETLK, &l) == 0 && l.l_type != F_UNLCK;
    close(fd);
    return held;
}

static void parts_copy_text(const cJSON *o, const char *key, char *out, size_t size)
{
    const char *text = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, key));
    snprintf(out, size, "%s", text != NULL ? text : "");
}

static double parts_number_of(const cJSON *o, const char *key)
{
    const cJSON *v = cJSON_GetObjectItemCaseSensitive(o, key);
    return is_number(v, 0, 9e15) ? v->valuedouble : 0;
}

static void read_status(const cJSON *o, struct part_status *s)
{
    const char *state = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(o, "state"));
    for (int k = PART_NONE; k <= PART_DONE && state != NULL; k++)
        if (strcmp(state, part_state_names[k]) == 0)
            s->state = (enum part_state)k;
    s->done = (uint64_t)parts_number_of(o, "done");
    s->sets_per_s = parts_number_of(o, "sets_per_s");
    s->elapsed_s = parts_number_of(o, "elapsed_s");
    s->pid = (int64_t)parts_number_of(o, "pid");
    parts_copy_text(o, "kernels", s->kernels, sizeof s->kernels);
    parts_copy_text(o, "host", s->host, sizeof s->host);
    parts_copy_text(o, "error", s->error, sizeof s->error);
}

/* A power cut or a file server may lose data that was written. */
static bool parts_is_whole(const struct parts_job *j, unsigned i, uint64_t done)
{
    char path[PATH_ROOM];
    vol_reader *r;
    parts_path(j, i, "h5", path, sizeof path);
    if (vol_reader_open(path, &r, NULL) != PVX_OK)
        return false;
    bool whole = !vol_reader_cut(r) && vol_reader_count(r) == done;
    vol_reader_close(&r);
    return whole;
}

void parts_status(const struct parts_job *j, unsigned i, struct part_status *s)
{
    char path[PATH_ROOM], *text;
    size_t len, first, end;
    parts_run(j->n_sets, i, j->n, &first, &end);
    *s = (struct part_status){.sets = end - first};
    parts_path(j, i, "json", path, sizeof path);
    if (pvx_file_read(path, STATUS_MAX, &text, &len, NULL) != PVX_OK)
        return;
    cJSON *o = cJSON_ParseWithLength(text, len);
    read_status(o, s);
    cJSON_Delete(o);
    free(text);
    if (s->state == PART_RUNNING && !parts_is_held(j, i))
        s->state = PART_DIED;
    if (s->state == PART_DONE && !parts_is_whole(j, i, s->done)) {
        s->state = PART_FAILED;
        snprintf(s->error, sizeof s->error, "its file has changed since it was done");
    }
}

static pvx_err is_busy(const struct parts_job *j, unsigned i, struct pvx_diag *d)
{
    struct part_status s;
    parts_status(j, i, &s);
    return pvx_fail(d, PVX_EBUSY, "part %u of %u is being solved by process %" PRId64 " on %s", i,
                    j->n, s.pid, s.host[0] != '\0' ? s.host : "another node");
}

static bool has_file(const struct parts_job *j, unsigned i, const char *what)
{
    char path[PATH_ROOM];
    parts_path(j, i, what, path, sizeof path);
    return access(path, F_OK) == 0;
}

void part_begin(part *p, uint64_t done)
{
    p->before = done;
    p->t0 = pvx_now_mono();
    p->said = PART_NONE;
    part_say(p, PART_RUNNING, done, NULL);
}

static pvx_err parts_look(part *p, bool resume, bool *done, struct pvx_diag *d)
{
    struct part_status s;
    parts_status(p->job, p->i, &s);
    if (s.state == PART_RUNNING) /* the lock is ours */
        s.state = PART_DIED;
    p->sets = s.sets;
    p->earlier = s;
    *done = s.state == PART_DONE;
    if (resume || !has_file(p->job, p->i, "h5")) {
        if (!*done) /* before the matrix, which may take its time */
            part_begin(p, s.done);
        return PVX_OK;
    }
    return pvx_fail(d, PVX_EBUSY,
                    "%s.parts: part %u of %u exists already (%s, %" PRIu64 " of %" PRIu64
                    " sets): --resume continues it",
                    p->job->out, p->i, p->job->n, part_state_names[s.state], s.done, s.sets);
}

pvx_err part_take(const struct parts_job *j, unsigned i, bool resume, bool *done, part **out,
                  struct pvx_diag *d)
{
    char path[PATH_ROOM];
    struct flock l = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    *out = NULL;
    part *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    *p = (part){.job = j, .i = i, .t_taken = pvx_now_mono()};
    parts_path(j, i, "lock", path, sizeof path);
    p->lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    pvx_err e = p->lock >= 0
                    ? PVX_OK
                    : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    if (e == PVX_OK && fcntl(p->lock, F_OFD_SETLK, &l) != 0)
        e = errno == EAGAIN || errno == EACCES
                ? is_busy(j, i, d)
                : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    PVX_THEN(e, parts_look(p, resume, done, d));
    if (e != PVX_OK)
        part_free(&p);
    *out = p;
    return e;
}

static void add_kernels(cJSON *o, const struct part_status *earlier)
{
    const char *was = earlier->done > 0 ? earlier->kernels : "", *now = pvx_cpu_name(pvx_cpu());
    char all[80];
    snprintf(all, sizeof all, "%s%s%s", was, was[0] != '\0' ? ", " : "", now);
    cJSON_AddStringToObject(o, "kernels", strstr(was, now) != NULL ? was : all);
}

void part_say(part *p, enum part_state state, uint64_t done, const char *error)
{
    char path[PATH_ROOM], host[256] = "";
    int64_t now = pvx_now_mono();
    if (state == p->said && state == PART_RUNNING && now - p->t_said < PVX_NS_PER_S)
        return;
    p->said = state;
    p->t_said = now;
    gethostname(host, sizeof host - 1);
    size_t first, end;
    parts_run(p->job->n_sets, p->i, p->job->n, &first, &end);
    cJSON *o = cJSON_CreateObject();
    cJSON_AddNumberToObject(o, "part", p->i);
    cJSON_AddNumberToObject(o, "parts", p->job->n);
    cJSON_AddStringToObject(o, "state", part_state_names[state]);
    cJSON_AddNumberToObject(o, "sets", (double)p->sets);
    cJSON_AddNumberToObject(o, "done", (double)done);
    if (end > first) {
        cJSON_AddNumberToObject(o, "first", (double)p->job->number[first]);
        cJSON_AddNumberToObject(o, "last", (double)p->job->number[end - 1]);
    }
    cJSON_AddNumberToObject(o, "sets_per_s",
                            (double)(done - p->before) / ((double)(now - p->t0 + 1) * 1e-9));
    cJSON_AddNumberToObject(o, "elapsed_s",
                            p->earlier.elapsed_s + (double)(now - p->t_taken) * 1e-9);
    add_kernels(o, &p->earlier);
    cJSON_AddStringToObject(o, "host", host);
    cJSON_AddNumberToObject(o, "pid", (double)getpid());
    cJSON_AddNumberToObject(o, "updated_ns", (double)pvx_now_real());
    cJSON_AddStringToObject(o, "error", error != NULL ? error : "");
    char *text = cJSON_Print(o);
    cJSON_Delete(o);
    parts_path(p->job, p->i, "json", path, sizeof path);
    /* if the disk is full, writing the volumes reports it */
    if (text != NULL)
        (void)!pvx_file_write(path, text, strlen(text), NULL);
    cJSON_free(text);
}

void part_free(part **pp)
{
    part *p = *pp;
    if (p == NULL)
        return;
    if (p->lock >= 0)
        close(p->lock);
    PVX_FREE(*pp);
}
