/* Terms of the model where they are pushed: bodies larger than the flame, in another place than the rig says,
 * unknown to it; a flame that jumps while each volume leans on the one before. */
#include "tests/stability/stab.h"

#include <string.h>

/* No flame gets through it to the cameras on the side of +x. */
static struct rec_body wall = {
    .name = "wall", .kind = REC_BODY_BOX, .a = {0.6, -1.5, -1}, .b = {0.7, 1.5, 2}};
static struct rec_body rod = {.name = "rod",
                              .kind = REC_BODY_CYLINDER,
                              .a = {-0.6, -0.1, 0.42},
                              .b = {0.6, 0.1, 0.5},
                              .radius = 0.03};

/* Pictures with `there` in them, reconstructed by a rig that knows of `said` (NULL: of none). */
static void bodies(const struct stab_run *run, enum rec_basis basis, const char *name,
                   struct rec_body *there, struct rec_body *said)
{
    struct stab_bed b;
    const struct rec_bodies stand = {1, there};
    stab_bed_new(&b, run, RIG_RING, 8, basis, run->size);
    b.bodies = &stand;
    stab_bed_render(&b, NULL);
    stab_bed_noise(&b, 0.01);
    b.rig.bodies = (struct rec_bodies){said != NULL, said};
    rec_sysmat_free(&b.S);
    CHECK(rec_sysmat_build(&b.rig, &(struct rec_sysmat_params){.binning = 1}, run->pool, NULL, NULL,
                           &b.S, NULL));
    struct stab_result r = stab_reconstruct(&b, NULL);
    struct stab_row row = stab_row_of(name, &b, rec_solver_names()[0], &r);
    stab_add(&row);
    b.rig.bodies = (struct rec_bodies){0}; /* not its own */
    stab_bed_free(&b);
}

/* Each set is another flame at another place.  The worst error of them all, which must be that of each set by
 * itself: nothing of the one before may be left. */
static void jumps(const struct stab_run *run, enum rec_basis basis)
{
    struct stab_bed b;
    rec_frame *f[2];
    struct rec_sparse last = {0};
    struct stab_result worst = {.finite = true};
    struct rec_flame flame;
    bool sound = true;
    stab_bed_new(&b, run, RIG_RING, 8, basis, run->size);
    for (int i = 0; i < 2; i++) {
        struct rec_frame_params p = b.p;
        p.temporal = true;
        CHECK(rec_frame_alone(b.S, &b.rig, &p, run->pool, &f[i], NULL));
    }
    for (int k = 0; k < 6; k++) {
        rec_flame_init(&flame, &b.rig.grid, (uint32_t)(1 + k));
        rec_flame_at(&flame, 0.37 * k, &b.pose);
        for (int g = 0; g < b.pose.n; g++) /* a flame half as wide, to and fro */
            for (int a = 0; a < 2; a++) {
                b.pose.blob[g].m[a] = 0.5 * b.pose.blob[g].m[a] + (((k >> a) & 1) ? 0.2 : -0.2);
                b.pose.blob[g].s[a] *= 0.5;
            }
        stab_bed_render(&b, NULL);
        stab_bed_noise(&b, 0.01);
        struct stab_result r = stab_solve(&b, f[k % 2], k > 0 ? &last : NULL);
        struct stab_result alone = stab_reconstruct(&b, NULL);
        sound = sound && r.finite && alone.flame && r.error <= 1.02 * alone.error;
        if (r.error >= worst.error)
            worst = r;
        rec_frame_volume(f[k % 2], &last);
    }
    struct stab_row row =
        stab_row_of("a flame that jumps every frame, temporal", &b, rec_solver_names()[0], &worst);
    row.sound = row.sound && sound;
    stab_add(&row);
    for (int i = 0; i < 2; i++)
        rec_frame_free(&f[i]);
    stab_bed_free(&b);
}

void stab_terms(const struct stab_run *run)
{
    struct rec_body moved = rod;
    for (int a = 0; a < 3; a++) {
        moved.a[a] += 0.04;
        moved.b[a] += 0.04;
    }
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        enum rec_basis of = (enum rec_basis)basis;
        bodies(run, of, "a body larger than the flame", &wall, &wall);
        bodies(run, of, "a body larger than the flame, unknown", &wall, NULL);
        bodies(run, of, "a rod through the flame", &rod, &rod);
        bodies(run, of, "a rod that moved by its width", &moved, &rod);
        jumps(run, of);
    }
}
