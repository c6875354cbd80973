/* The one table of outcomes. */
#include "tests/stability/stab.h"

#include <stdlib.h>

static FILE *csv;
static int rows, failed;

int stab_rows(void)
{
    return rows;
}
int stab_failed(void)
{
    return failed;
}

void stab_begin(const struct stab_run *run)
{
    rows = failed = 0;
    if (run->folder != NULL) {
        char path[4096];
        snprintf(path, sizeof path, "%s/stability.csv", run->folder);
        csv = fopen(path, "w");
        if (csv == NULL) {
            perror(path);
            exit(2);
        }
        fprintf(csv, "case,basis,solver,outcome,error,bound,pass,rel_residual,iterations,"
                     "active_voxels,ms\n");
    }
    printf("  %-46s | %-9s | %-10s | %-10s | %-9s | %-7s |\n", "case", "basis", "solver", "outcome",
           "error", "bound");
}

void stab_add(const struct stab_row *r)
{
    bool pass = r->sound && isfinite(r->error) && r->error <= r->bound;
    const char *basis = r->basis < 0 ? "-" : rec_basis_name((enum rec_basis)r->basis);
    char bound[32] = "-";
    if (isfinite(r->bound))
        snprintf(bound, sizeof bound, "%.3g", r->bound);
    printf("  %-46s | %-9s | %-10s | %-10s | %-9.3g | %-7s | %s\n", r->name, basis, r->solver,
           r->outcome, r->error, bound, pass ? "PASS" : "FAIL");
    fflush(stdout);
    if (csv != NULL)
        fprintf(csv, "\"%s\",%s,%s,%s,%.6g,%s,%d,%.6g,%u,%d,%.3f\n", r->name, basis, r->solver,
                r->outcome, r->error, bound, pass, r->residual, r->iterations, r->voxels, r->ms);
    rows++;
    failed += !pass;
}

void stab_end(void)
{
    if (csv != NULL && fclose(csv) != 0) {
        perror("stability.csv");
        exit(2);
    }
    csv = NULL;
}
