#include "daemon/cli/reconstruct/memory.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/pipeline/pipeline.h"

#define LOOK_MATRIX 0.6e9 /* silhouettes.c */

static size_t memory_bins_of(const struct rec_rig *rig, int32_t binning)
{
    size_t n = 0;
    for (size_t c = 0; c < rig->n_cameras; c++)
        n += (size_t)(rig->cameras[c].width / binning) * (size_t)(rig->cameras[c].height / binning);
    return n;
}

/* The sizes on which a set's work areas depend. */
struct size {
    double n, bins, voxels; /* active voxels, bins, voxels */
    double lane;            /* bytes of a bin or voxel */
    double of_channels;     /* bytes of a bin for a weight per channel, if Bayer pixels are rays */
    double windows;         /* bytes of a voxel's windows */
};

/* A problem's vectors (recon/solve/problem.c). */
static double problem(const struct size *z)
{
    return z->n * (9 * z->lane + 40) + z->bins * (4 * z->lane + 4 + z->of_channels);
}

/* A frame slot: pictures and volume. */
static double slot(const struct size *z)
{
    return z->bins * (z->lane + 10 + z->of_channels) + z->n * (z->lane + 4);
}

/* The restricted systems of a set on all levels. */
static double systems(const struct size *z)
{
    double system = z->n * (z->windows + 4) + z->bins * 2;
    return 1.2 * system + z->voxels / 7 * 2 * sizeof(int32_t) + z->bins / 3 * 2 * z->lane;
}

void reconstruct_need(const struct reconstruct_options *o, const struct rec_rig *rig,
                      const struct rec_frame_params *p, const struct rec_active_estimate *e,
                      const struct reconstruct_seen *seen, struct reconstruct_need *out)
{
    double cameras = (double)rig->n_cameras, bins = 1.02 * (double)e->bins;
    double voxels = (double)rec_grid_count(&rig->grid), bricks = voxels / REC_BRICK_VOXELS;
    double pixels = (double)memory_bins_of(rig, 1), lane = p->nch == 3 ? 16 : 4;
    double slots = (double)((rig->n_cameras + 3) / 4 * 4);
    const struct size z = {
        .n = fmin((double)seen->bricks_most * REC_BRICK_VOXELS, (double)e->columns),
        .bins = bins,
        .voxels = voxels,
        .lane = lane,
        .of_channels = e->bins == memory_bins_of(rig, 1) ? 16 : 0,
        .windows = slots * (double)(sizeof(uint32_t) + e->window)};
    const struct size coarse = {.n = 0.2 * z.n,
                                .bins = bins / 4,
                                .lane = lane,
                                .of_channels = z.of_channels},
                      none = {.bins = bins, .lane = lane, .of_channels = z.of_channels};
    *out = (struct reconstruct_need){0};
    out->base = 80e6 + pixels * 3 * 2 * 2 + (o->background != NULL ? bins * lane : 0) +
                pixels * 12; /* maps of photometry */
    out->look = LOOK_MATRIX + slot(&none) + systems(&none) + problem(&none) + 16 * bins +
                bricks * (8 * cameras + 40);
    out->matrix = (double)e->stored;
    out->build = (double)e->building;
    out->sets = DMN_N_SLOTS_LOSSLESS * slot(&z) + DMN_N_SYSTEMS_LOSSLESS * systems(&z) +
                problem(&z) + problem(&coarse) + 1.4 * z.n * lane + bins * (5 + z.of_channels) +
                bricks * 40 + voxels / 8 * sizeof(int32_t) + z.n + 1.3 * seen->slabs * (lane + 7);
    if (o->bars > 0) /* modes and work areas of each slot, and the bricks that are written */
        out->sets += (DMN_N_SLOTS_LOSSLESS + 1) * (o->bars + 6.0) * z.n * lane + problem(&z);
    if (p->temporal)
        out->sets += 2 * voxels * lane;
    if (o->save_hull != NULL)
        out->sets += voxels * 17 + bins * 5;
    out->volume = voxels * p->nch * sizeof(float);
    double run = out->matrix + out->sets + out->volume;
    out->most = out->base + fmax(out->look, fmax(out->build, run));
}

/* ---- memory that is free ---- */

/* The number after `key` in the first line of a file that begins with key.  INFINITY: there is none. */
static double memory_number_in(const char *path, const char *key)
{
    char line[256];
    double v = INFINITY;
    FILE *f = fopen(path, "re");
    if (f == NULL)
        return v;
    while (fgets(line, sizeof line, f) != NULL) {
        char *end;
        if (strncmp(line, key, strlen(key)) != 0)
            continue;
        double got = strtod(line + strlen(key), &end);
        v = end != line + strlen(key) ? got : v; /* "max": no limit */
        break;
    }
    fclose(f);
    return v;
}

/* The memory that the limits of this process's cgroup and of the cgroups above it leave. */
static double free_in_cgroup(void)
{
    char line[1024], path[1280];
    double least = INFINITY;
    FILE *f = fopen("/proc/self/cgroup", "re");
    if (f == NULL)
        return least;
    while (fgets(line, sizeof line, f) != NULL) {
        if (strncmp(line, "0::/", 4) != 0)
            continue;
        line[strcspn(line, "\n")] = '\0';
        for (char *group = line + 3, *slash; group[1] != '\0'; *slash = '\0') {
            snprintf(path, sizeof path, "/sys/fs/cgroup%s/memory.max", group);
            double most = memory_number_in(path, "");
            snprintf(path, sizeof path, "/sys/fs/cgroup%s/memory.current", group);
            double used = memory_number_in(path, "");
            if (isfinite(most) && isfinite(used))
                least = fmin(least, fmax(most - used, 0));
            slash = strrchr(group, '/');
            if (slash == group)
                break;
        }
    }
    fclose(f);
    return least;
}

double reconstruct_room(void)
{
    double kib = memory_number_in("/proc/meminfo", "MemAvailable:");
    if (!isfinite(kib))
        kib = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE) / 1024;
    return 0.8 * fmin(kib * 1024, free_in_cgroup());
}
