/* vm_volumes.c - are these volumes those?
 *
 *   vm_volumes LIVE REFERENCE BOUND      folders of `pyrovox record`, and a relative L2 bound
 * A live daemon's sets begin anywhere in a repeated sequence of instants; each of its volumes must be that
 * of one instant within BOUND, and further from every other instant than two bounds and than half of what
 * instants are from each other.  Two instants must occur at least. */
#include <glob.h>
#include <stdbool.h>
#include <stdlib.h>

#include "capture/files/imgio.h"
#include "tests/t.h"

#define MAX_REFS 16

struct volume {
    float *v;
    size_t n;
};
static const char *live_dir, *ref_dir;
static double bound;

static bool load(const char *path, struct volume *out)
{
    struct pvx_diag d = {""};
    size_t shape[4];
    int ndim;
    pvx_err e = cap_npy_load(path, &out->v, shape, &ndim, &d);
    if (e != PVX_OK) {
        T_EQ_S(d.text, "");
        return false;
    }
    out->n = shape[0] * shape[1] * shape[2] * shape[3];
    return true;
}

static double distance(const struct volume *a, const struct volume *ref)
{
    double diff = 0, norm = 0;
    if (a->n != ref->n)
        return INFINITY;
    for (size_t i = 0; i < a->n; i++) {
        double x = a->v[i], y = ref->v[i];
        diff += (x - y) * (x - y);
        norm += y * y;
    }
    return norm > 0 ? sqrt(diff / norm) : INFINITY;
}

static void files(const char *dir, glob_t *g)
{
    char pattern[4096];
    snprintf(pattern, sizeof pattern, "%s/*.npy", dir);
    T_EQ_I(glob(pattern, 0, NULL, g), 0);
}

T_CASE(same)
{
    glob_t refs = {0}, live = {0};
    struct volume ref[MAX_REFS] = {0};
    unsigned met[MAX_REFS] = {0};
    files(ref_dir, &refs);
    files(live_dir, &live);
    size_t n = refs.gl_pathc < MAX_REFS ? refs.gl_pathc : MAX_REFS;
    double apart = INFINITY, worst = 0, other = INFINITY;
    for (size_t i = 0; i < n; i++)
        T_OK(load(refs.gl_pathv[i], &ref[i]));
    for (size_t i = 0; i < n && t_case_fails == 0; i++)
        for (size_t k = 0; k < n; k++)
            if (k != i)
                apart = fmin(apart, distance(&ref[i], &ref[k]));
    T_OK(n > 1 && apart > 4 * bound); /* or a wrong set could not be told from a right one */
    for (size_t i = 0; i < live.gl_pathc && t_case_fails == 0; i++) {
        struct volume v = {0};
        if (!load(live.gl_pathv[i], &v))
            break;
        size_t best = 0;
        double least = INFINITY;
        for (size_t k = 0; k < n; k++)
            if (distance(&v, &ref[k]) < least) {
                least = distance(&v, &ref[k]);
                best = k;
            }
        for (size_t k = 0; k < n; k++)
            if (k != best)
                other = fmin(other, distance(&v, &ref[k]));
        met[best]++;
        worst = fmax(worst, least);
        free(v.v);
    }
    T_LE(worst, bound);
    T_OK(other > 2 * bound && other > apart / 2);
    size_t occurred = 0;
    for (size_t i = 0; i < n; i++)
        occurred += met[i] > 0;
    T_OK(occurred > 1);
    printf("  %zu volumes, %zu instants %.2g apart: worst relative L2 %.3g, bound %.3g\n",
           live.gl_pathc, n, apart, worst, bound);
    for (size_t i = 0; i < n; i++)
        free(ref[i].v);
    globfree(&refs);
    globfree(&live);
}

int main(int argc, char **argv)
{
    if (argc != 4)
        return 2;
    live_dir = argv[1];
    ref_dir = argv[2];
    bound = atof(argv[3]);
    return t_run();
}
