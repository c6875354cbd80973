/* The one table of outcomes, held against what was measured. */
#include "tests/stability/stab.h"

#include <stdlib.h>
#include <string.h>

/* Room for another machine's roundings and small changes of a solver. */
#define ROOM 1.3

static struct measured {
    char basis[12], solver[12], outcome[16], name[64];
    double error;
} known[512];
static size_t n_known;
static FILE *csv, *measured;
static int rows, failed;

int stab_rows(void)
{
    return rows;
}
int stab_failed(void)
{
    return failed;
}

static FILE *must_open(const char *path, const char *mode)
{
    FILE *f = fopen(path, mode);
    if (f == NULL) {
        perror(path);
        exit(2);
    }
    return f;
}

FILE *stab_csv(const struct stab_run *run, const char *name)
{
    char path[4096];
    if (run->folder == NULL)
        return NULL;
    snprintf(path, sizeof path, "%s/%s.csv", run->folder, name);
    return must_open(path, "w");
}

void stab_begin(const struct stab_run *run)
{
    char line[256];
    FILE *f = must_open(run->quick ? "tests/stability/quick.csv" : "tests/stability/full.csv", "r");
    rows = failed = 0;
    for (n_known = 0; fgets(line, sizeof line, f) != NULL;) {
        struct measured *m = &known[n_known];
        n_known += n_known < sizeof known / sizeof *known - 1 &&
                   sscanf(line, "%11[^,],%11[^,],%15[^,],%lf,%63[^\n]", m->basis, m->solver,
                          m->outcome, &m->error, m->name) == 5;
    }
    fclose(f);
    csv = stab_csv(run, "stability");
    measured = stab_csv(run, "measured");
    if (csv != NULL)
        fprintf(csv, "case,basis,solver,outcome,error,bound,pass,rel_residual,iterations,"
                     "active_voxels,ms\n");
    printf("  %-46s | %-9s | %-10s | %-11s | %-9s | %-8s |\n", "case", "basis", "solver", "outcome",
           "error", "bound");
}

/* Does it pass a row with this outcome and this error? */
static bool passes(const struct stab_row *r, const char *outcome, double error, double bound)
{
    return r->sound && strcmp(r->outcome, outcome) == 0 && isfinite(error) && error <= bound;
}

void stab_add(const struct stab_row *r)
{
    const char *basis = r->basis < 0 ? "-" : rec_basis_name((enum rec_basis)r->basis);
    struct stab_row want = *r;
    if (r->bound == STAB_MEASURED) {
        want.outcome = "not in the file of what was measured";
        for (size_t i = 0; i < n_known; i++)
            if (strcmp(known[i].name, r->name) == 0 && strcmp(known[i].basis, basis) == 0 &&
                strcmp(known[i].solver, r->solver) == 0) {
                want.outcome = known[i].outcome;
                want.bound = ROOM * known[i].error;
            }
        /* Both forms of cgls follow contradictions wherever they lead. */
        if (strncmp(r->solver, "cgls", 4) == 0)
            want.bound = STAB_NO_BOUND;
        if (measured != NULL)
            fprintf(measured, "%s,%s,%s,%.4g,%s\n", basis, r->solver, r->outcome, r->error,
                    r->name);
    }
    bool zeros_fail = !r->flame || !passes(&want, "nothing", 1, want.bound);
    bool pass = passes(&want, r->outcome, r->error, want.bound) && zeros_fail;
    char bound[32] = "-";
    if (isfinite(want.bound))
        snprintf(bound, sizeof bound, "%.3g", want.bound);
    printf("  %-46s | %-9s | %-10s | %-11s | %-9.3g | %-8s | %s", r->name, basis, r->solver,
           r->outcome, r->error, bound, pass ? "PASS\n" : "FAIL");
    if (!pass)
        printf(": wanted %s%s%s\n", want.outcome, r->sound ? "" : "; unsound",
               zeros_fail ? "" : "; a volume of zeros would pass");
    fflush(stdout);
    if (csv != NULL)
        fprintf(csv, "\"%s\",%s,%s,%s,%.6g,%s,%d,%.6g,%u,%d,%.3f\n", r->name, basis, r->solver,
                r->outcome, r->error, bound, pass, r->residual, r->iterations, r->voxels, r->ms);
    rows++;
    failed += !pass;
}

void stab_end(void)
{
    if ((csv != NULL && fclose(csv) != 0) || (measured != NULL && fclose(measured) != 0)) {
        perror("stability.csv");
        exit(2);
    }
    csv = measured = NULL;
}
