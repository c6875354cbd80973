#include "daemon/cli/reconstruct_join.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/mem.h"
#include "daemon/cli/cli.h"
#include "daemon/cli/parts.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/join.h"

#define SEAM_WRONG 0.02 /* of the volume: more than a few sets' memory leaves */

bool reconstruct_join_has_job(const char *out)
{
    struct parts_job j;
    bool has = parts_load(out, &j, NULL) == PVX_OK;
    if (has)
        parts_free(&j);
    return has;
}

bool reconstruct_join_is_due(const char *out)
{
    struct parts_job j;
    struct part_status s;
    bool all = parts_load(out, &j, NULL) == PVX_OK;
    if (!all)
        return false;
    for (unsigned i = 1; i <= j.n && all; i++) {
        parts_status(&j, i, &s);
        all = s.state == PART_DONE;
    }
    parts_free(&j);
    return all;
}

static bool load_set(const char *path, uint64_t set, bool last, float **dense, size_t *n)
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

/* ||a - b|| / ||b|| of the set before part i, as this part has it and as the part before; < 0: not known. */
static double seam(const struct parts_job *j, unsigned i)
{
    char here[4500], before[4500];
    size_t first, end, n, m;
    float *a, *b = NULL;
    parts_run(j->n_sets, i, j->n, &first, &end);
    parts_path(j, i, "seam.h5", here, sizeof here);
    parts_path(j, i - 1, "h5", before, sizeof before);
    if (first == 0 || !load_set(here, j->number[first - 1], false, &a, &n))
        return -1;
    double off = 0, all = 0;
    bool ok = load_set(before, j->number[first - 1], true, &b, &m) && n == m;
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
    printf("%5u  %-9s  %7llu of %-7llu  %8.1f  %s", i, part_state_names[s->state],
           (unsigned long long)s->done, (unsigned long long)s->sets, s->sets_per_s, s->host);
    if (s->state == PART_RUNNING || s->state == PART_DIED)
        printf(", process %lld", (long long)s->pid);
    printf("%s%s\n", s->error[0] != '\0' ? ": " : "", s->error);
    if (off > SEAM_WRONG)
        printf(
            "       its beginning and the end of part %u differ by %.1f %%: motion there is lost "
            "between them; make fewer parts\n",
            i - 1, 100 * off);
}

/* A line for each that is not as it should be; where there are few, for all. */
static unsigned table(const struct parts_job *j, double *worst)
{
    struct part_status s;
    unsigned done = 0;
    printf(" part  state      sets                sets/s  where\n");
    for (unsigned i = 1; i <= j->n; i++) {
        parts_status(j, i, &s);
        done += s.state == PART_DONE;
        double off = i > 1 ? seam(j, i) : -1;
        *worst = off > *worst ? off : *worst;
        if (j->n <= 40 || s.state != PART_DONE || off > SEAM_WRONG)
            say_part(i, &s, off);
    }
    return done;
}

static pvx_err join(const struct parts_job *j, size_t *missing, struct pvx_diag *d)
{
    char path[4500];
    size_t n = 0;
    const char **file = pvx_calloc(j->n, sizeof *file);
    uint64_t *number = pvx_calloc(j->n_sets, sizeof *number);
    pvx_err e = file != NULL && number != NULL ? PVX_OK : PVX_ENOMEM;
    for (size_t k = 0; k < j->n_sets && e == PVX_OK; k++)
        number[k] = j->number[k];
    for (unsigned i = 1; i <= j->n && e == PVX_OK; i++) {
        parts_path(j, i, "h5", path, sizeof path);
        if (access(path, R_OK) != 0)
            continue;
        file[n] = strdup(path);
        e = file[n++] != NULL ? PVX_OK : PVX_ENOMEM;
    }
    const struct vol_join what = {
        .out = j->out, .part = file, .n_parts = n, .number = number, .n = j->n_sets};
    if (e == PVX_OK)
        e = vol_join(&what, missing, d);
    for (size_t k = 0; file != NULL && k < n; k++)
        free((char *)file[k]);
    free(file);
    free(number);
    return e;
}

int reconstruct_join(const char *out)
{
    struct parts_job j;
    struct pvx_diag d = {""};
    double worst = -1;
    size_t missing = 0;
    pvx_err e = parts_load(out, &j, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    unsigned done = table(&j, &worst);
    e = join(&j, &missing, &d);
    if (e == PVX_OK) {
        printf("%s: %zu of %zu sets, %u of %u parts", out, j.n_sets - missing, j.n_sets, done, j.n);
        if (worst >= 0)
            printf("; at the seams volumes differ by %.2f %% at most", 100 * worst);
        printf("\n");
    }
    if (e == PVX_OK && missing > 0)
        printf("missing: %zu sets, which read as not solved.  What died or failed is done again by "
               "--resume\n",
               missing);
    parts_free(&j);
    return e != PVX_OK ? cli_error(&d, e) : missing > 0;
}
