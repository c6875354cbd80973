/* test_cl_frame_bits.c - frame sets on a device have the same bits from run to run, for any number of the device's
 * threads, and beside one another. */
#include <pthread.h>
#include <unistd.h>
#include <xxhash.h>

#include "tests/lib/cl_frames.h"

/* Another process: prints the hash of a volume, and how many threads the device has. */
static void print_hash(void)
{
    struct scene s;
    struct card_pair p;
    struct rec_frame_params f = frame_params(3);
    if (getenv("T_CL_HASH") == NULL)
        return;
    cl = cl_bed_open();
    f.solve.blend = REC_BLEND_ON;
    scene_of(&s, 6, 96, 32, REC_TRILINEAR);
    card_pair_new(&p, cl, s.S, &s.rig, f, s.pool);
    shoot(&s, &p, 0.01);
    take(&p, NULL, NULL);
    size_t n = (size_t)p.there->report.active_voxels;
    printf("hash %016llx %u\n", (unsigned long long)XXH3_64bits(p.there->x, n * 16),
           rec_cl_about(cl)->units);
    exit(t_case_fails > 0);
}

T_CASE(same_bits_from_run_to_run_and_for_any_number_of_threads)
{
    unsigned long long hash[4] = {0};
    T_NOT_UNDER_SANITIZERS();
    for (int k = 0; k < 4; k++) { /* 1, 2, 3, 3 threads */
        char self[PATH_MAX], line[256];
        int threads = k < 3 ? k + 1 : 3;
        unsigned units = 0;
        ssize_t len = readlink("/proc/self/exe", self, sizeof self - 1);
        self[len > 0 ? len : 0] = '\0';
        snprintf(line, sizeof line, "%d", threads);
        setenv("POCL_MAX_PTHREAD_COUNT", line, 1);
        setenv("T_CL_HASH", "1", 1);
        FILE *child = popen(self, "r");
        unsetenv("T_CL_HASH");
        while (child != NULL && fgets(line, sizeof line, child) != NULL)
            if (sscanf(line, "hash %llx %u", &hash[k], &units) != 2)
                printf("%s", line);
        T_EQ_I(child != NULL ? pclose(child) : -1, 0);
        if (strcmp(cl_bed_name(), "Portable") == 0)
            T_EQ_I(units, threads);
        T_OK(hash[k] != 0 && hash[k] == hash[0]);
    }
    unsetenv("POCL_MAX_PTHREAD_COUNT");
}

static void *carve_one(void *f)
{
    rec_frame_carve(f);
    return NULL;
}

/* Set k + 1 is carved while k is solved, as in the daemon.  Then the same sets one after the other. */
T_CASE_OF_THREADS(two_sets_in_flight)
{
    enum { SETS = 6 };
    struct scene s;
    struct rec_frame_params p = frame_params(3);
    rec_carver *k;
    rec_solver *v;
    rec_frame *f[SETS];
    float *x[SETS];
    scene_of(&s, 6, 96, 32, REC_TRILINEAR);
    p.card = cl;
    T_EQ_I(rec_carver_new(s.S, &s.rig, &p, s.pool, &k, NULL), PVX_OK);
    T_EQ_I(rec_solver_new(s.S, &p, &v, NULL), PVX_OK);
    for (int i = 0; i < SETS; i++)
        T_EQ_I(rec_frame_new(k, v, &f[i], NULL), PVX_OK);
    for (int turn = 0; turn < 2; turn++) {
        t_state = 0;
        for (int i = 0; i < SETS; i++) {
            scene_at(&s, 0.2 + 0.15 * i);
            scene_shoot(&s, f[i], 0.01);
        }
        rec_frame_carve(f[0]);
        for (int i = 0; i < SETS; i++) {
            pthread_t thread;
            bool beside = turn == 0 && i + 1 < SETS;
            if (beside)
                T_EQ_I(pthread_create(&thread, NULL, carve_one, f[i + 1]), 0);
            T_EQ_I(rec_frame_solve(f[i], 0, NULL), PVX_OK);
            if (beside)
                pthread_join(thread, NULL);
            else if (i + 1 < SETS)
                rec_frame_carve(f[i + 1]);
            T_OK(f[i]->report.on_card && f[i]->report.active_voxels > 1000);
            size_t bytes = (size_t)f[i]->report.active_voxels * 16;
            if (turn == 0)
                x[i] = memcpy(pvx_calloc(bytes, 1), f[i]->x, bytes);
            else
                T_OK(memcmp(x[i], f[i]->x, bytes) == 0);
        }
    }
    for (int i = 0; i < SETS; i++) {
        free(x[i]);
        rec_frame_free(&f[i]);
    }
    rec_carver_free(&k);
    rec_solver_free(&v);
    scene_free(&s);
}

T_MAIN((cl_fault_begin(), cl_bed_begin(), print_hash(), cl = cl_bed_open()), rec_cl_close(&cl))
