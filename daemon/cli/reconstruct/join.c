#include "daemon/cli/reconstruct/join.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/cpu.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/volumes/parts.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/join.h"

#define SEAM_WRONG 0.02 /* of the volume: the early sets leave a smaller difference */

bool reconstruct_join_has_job(const char *out)
{
    struct parts_job j;
    bool has = parts_load(out, &j, NULL) == PVX_OK;
    if (has)
        parts_free(&j);
    return has;
}

bool reconstruct_join_is_due(const char *out, unsigned i)
{
    struct parts_job j;
    struct part_status s;
    bool all = parts_load(out, &j, NULL) == PVX_OK;
    if (!all)
        return false;
    for (unsigned k = 0; k < j.n && all; k++) {
        parts_status(&j, (i + k) % j.n + 1, &s);
        all = s.state == PART_DONE;
    }
    parts_free(&j);
    return all;
}

static bool join_load_set(const char *path, uint64_t set, bool last, float **dense, size_t *n)
{
    vol_reader *r;
    struct vol_volume v;
    if (vol_reader_open(path, &r, NULL) != PVX_OK)
        return false;
    uint64_t count = vol_reader_count(r);
    bool ok =
        count > 0 && vol_reader_get(r, last ? count - 1 : 0, &v, NULL) == PVX_OK && v.v.set == set;
    *dense = NULL;
    if (ok) {
        *n = pvp_grid_count(&v.v.grid);
        *dense = pvx_calloc(*n, sizeof **dense);
        if (*dense != NULL)
            vol_to_dense(&v, *dense);
    }
    vol_reader_close(&r);
    return *dense != NULL;
}

/* ||a - b|| / ||b|| of the set before part i.  a: as part i has it, b: as the part before has it.  < 0: not known. */
static double seam(const struct parts_job *j, unsigned i)
{
    char here[4500], before[4500];
    size_t first, end, n, m;
    float *a, *b = NULL;
    parts_run(j->n_sets, i, j->n, &first, &end);
    parts_path(j, i, "seam.h5", here, sizeof here);
    parts_path(j, i - 1, "h5", before, sizeof before);
    if (first == 0 || !join_load_set(here, j->number[first - 1], false, &a, &n))
        return -1;
    double off = 0, all = 0;
    bool ok = join_load_set(before, j->number[first - 1], true, &b, &m) && n == m;
    for (size_t k = 0; ok && k < n; k++) {
        double x = (double)a[k] - (double)b[k];
        off += x * x;
        all += (double)b[k] * (double)b[k];
    }
    free(a);
    free(b);
    return !ok ? -1 : all > 0 ? sqrt(off / all) : off > 0 ? INFINITY : 0;
}

static void say_part(unsigned i, const struct part_status *s, double off)
{
    char took[32];
    printf("%5u  %-9s  %7llu of %-7llu  %8.1f  %9s  %s", i, part_state_names[s->state],
           (unsigned long long)s->done, (unsigned long long)s->sets, s->sets_per_s,
           cli_duration(s->elapsed_s, took), s->host);
    if (s->state == PART_RUNNING || s->state == PART_DIED)
        printf(", process %lld", (long long)s->pid);
    printf("%s%s\n", s->error[0] != '\0' ? ": " : "", s->error);
    if (off > SEAM_WRONG)
        printf("       its beginning and the end of part %u differ by %.1f %%: the motion between "
               "them is lost; use fewer parts\n",
               i - 1, 100 * off);
}

/* Totals of the table. */
struct sum {
    unsigned done, running;
    double left, rate;       /* sets still to solve; sets a second of the running parts */
    double elapsed, slowest; /* s: of all parts; until the last running part has ended */
    double seam;             /* the worst; < 0: none is known */
    bool by[PVX_CPU_BEST + 1];
};

static void join_count(struct sum *sum, const struct part_status *s, double off)
{
    bool running = s->state == PART_RUNNING;
    double left = (double)s->sets - (double)s->done;
    sum->done += s->state == PART_DONE;
    sum->elapsed += s->elapsed_s;
    sum->seam = fmax(sum->seam, off);
    sum->left += running || s->state == PART_NONE ? left : 0;
    sum->running += running;
    sum->rate += running ? s->sets_per_s : 0;
    if (running)
        sum->slowest = fmax(sum->slowest, left / s->sets_per_s); /* no set done yet: not finite */
    for (int k = 0; k <= PVX_CPU_BEST && s->done > 0; k++)
        sum->by[k] |= strstr(s->kernels, pvx_cpu_name((enum pvx_cpu)k)) != NULL;
}

/* Print a line for each part that is not done.  If there are few parts, print a line for all. */
static void join_table(const struct parts_job *j, struct sum *sum)
{
    struct part_status s;
    *sum = (struct sum){.seam = -1};
    printf(" part  state      sets                sets/s       time  where\n");
    for (unsigned i = 1; i <= j->n; i++) {
        parts_status(j, i, &s);
        double off = i > 1 ? seam(j, i) : -1;
        join_count(sum, &s, off);
        if (j->n <= 40 || s.state != PART_DONE || off > SEAM_WRONG)
            say_part(i, &s, off);
    }
}

/* Print when it will end.  It uses only durations, because the clocks of two nodes may differ. */
static void say_end(const struct sum *sum)
{
    char in[32];
    double s = fmax(sum->slowest, sum->left / sum->rate);
    if (sum->running > 0 && isfinite(s))
        printf("running parts: %u, %.3g sets/s; the %.0f sets that are left take them %s\n",
               sum->running, sum->rate, sum->left, cli_duration(s, in));
}

static void say_kernels(const struct sum *sum)
{
    char names[64] = "";
    int n = 0;
    for (int k = 0; k <= PVX_CPU_BEST; k++)
        if (sum->by[k])
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s",
                     n++ > 0 ? ", " : "", pvx_cpu_name((enum pvx_cpu)k));
    if (n > 1)
        printf("the parts were solved by different kernels (%s): equal only to rounding\n", names);
}

static pvx_err reconstruct_join_join(const struct parts_job *j, size_t *missing, struct pvx_diag *d)
{
    char path[4500];
    size_t n = 0;
    const char **file = pvx_calloc(j->n, sizeof *file);
    pvx_err e = file != NULL ? PVX_OK : PVX_ENOMEM;
    for (unsigned i = 1; i <= j->n && e == PVX_OK; i++) {
        parts_path(j, i, "h5", path, sizeof path);
        if (access(path, R_OK) != 0)
            continue;
        file[n] = strdup(path);
        e = file[n++] != NULL ? PVX_OK : PVX_ENOMEM;
    }
    const struct vol_join what = {
        .out = j->out, .part = file, .n_parts = n, .number = j->number, .n = j->n_sets};
    PVX_THEN(e, vol_join(&what, missing, d));
    for (size_t k = 0; file != NULL && k < n; k++)
        free((char *)file[k]);
    free(file);
    return e;
}

int reconstruct_join(const char *out)
{
    struct parts_job j;
    struct pvx_diag d = {""};
    struct sum sum;
    size_t missing = 0;
    pvx_err e = parts_load(out, &j, &d);
    if (e == PVX_ENOENT && access(out, F_OK) == 0)
        snprintf(d.text, sizeof d.text, "%s: was not made in parts, so there is nothing to join",
                 out);
    if (e != PVX_OK)
        return cli_error(&d, e);
    join_table(&j, &sum);
    say_end(&sum);
    say_kernels(&sum);
    e = reconstruct_join_join(&j, &missing, &d);
    if (e == PVX_OK) {
        char took[32];
        printf("%s: %zu of %zu sets, %u of %u parts, in %s of all of them together", out,
               j.n_sets - missing, j.n_sets, sum.done, j.n, cli_duration(sum.elapsed, took));
        if (sum.seam >= 0)
            printf("; at the seams volumes differ by %.2f %% at most", 100 * sum.seam);
        printf("\n");
    }
    if (e == PVX_OK && missing > 0)
        printf(
            "missing: %zu sets, which read as not solved.  --resume solves parts again that died "
            "or failed\n",
            missing);
    parts_free(&j);
    return e != PVX_OK ? cli_error(&d, e) : missing > 0;
}
