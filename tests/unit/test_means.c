/* Sets grouped by the phase of a cycle, and the sums of their pictures. */
#include <math.h>

#include "daemon/cli/common/means.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

#define SETS 60

static void phases_of(const struct means *m, int out[SETS])
{
    for (int i = 0; i < SETS; i++)
        out[i] = -1;
    for (size_t k = 0; k < m->n; k++)
        for (size_t j = m->begin[k]; j < m->begin[k + 1]; j++) {
            T_OK(j == m->begin[k] || m->member[j] > m->member[j - 1]);
            T_EQ_I(out[m->member[j]], -1); /* in one mean only */
            out[m->member[j]] = (int)m->number[k];
        }
}

/* A period in sets counts by their numbers, so that missing sets shift nothing. */
T_CASE(periods_in_sets)
{
    int64_t number[SETS];
    struct means m;
    int phase[SETS];
    for (int i = 0; i < SETS; i++)
        number[i] = 500 + i + (i > 20 ? 3 : 0);
    T_OK(means_find(&(struct means_how){.average = "all"}, number, NULL, SETS, &m, NULL) == PVX_OK);
    T_EQ_I(m.n, 1);
    T_EQ_I(m.begin[1], SETS);
    means_free(&m);
    T_OK(means_find(&(struct means_how){.average = "7"}, number, NULL, SETS, &m, NULL) == PVX_OK);
    T_EQ_I(m.n, 7);
    phases_of(&m, phase);
    for (int i = 0; i < SETS; i++)
        T_EQ_I(phase[i], (number[i] - 500) % 7);
    means_free(&m);
    /* 2.5 sets: phases 0, 0.4, 0.8, 0.2, 0.6 come back after five */
    T_OK(means_find(&(struct means_how){.average = "2.5", .n = 5}, number, NULL, SETS, &m, NULL) ==
         PVX_OK);
    phases_of(&m, phase);
    static const int five[] = {0, 2, 4, 1, 3};
    for (int i = 0; i < SETS; i++)
        T_EQ_I(phase[i], five[(number[i] - 500) % 5]);
    means_free(&m);
}

/* Times decide: 80 Hz seen by 1000 sets a second is 12.5 sets, with jitter of a tenth of a set. */
T_CASE(periods_in_time)
{
    int64_t number[SETS], t[SETS];
    struct means m;
    int phase[SETS];
    struct pvx_diag d = {""};
    for (int i = 0; i < SETS; i++) {
        number[i] = i;
        t[i] = 7000000000 + i * 1000000 + (i % 3 - 1) * 100000 + (i == 0 ? 100000 : 0);
    }
    static const char *const same[] = {"12.5ms", "80Hz", "0.0125s", "12500us", "0.08kHz"};
    for (int k = 0; k < 5; k++) {
        T_OK(means_find(&(struct means_how){.average = same[k]}, number, t, SETS, &m, NULL) ==
             PVX_OK);
        T_EQ_I(m.n, 12);
        phases_of(&m, phase);
        for (int i = 0; i < SETS; i++) {
            double at = (double)(t[i] - t[0]) / 12.5e6 * 12;
            if (fabs(at - round(at)) > 1e-3)
                T_EQ_I(phase[i], (int)floor(at) % 12);
        }
        means_free(&m);
    }
    static const char *const bad[] = {"0", "-3", "0.5", "12.5m", "x", "", "nan", "inf", "0Hz"};
    for (int k = 0; k < 9; k++) {
        d.text[0] = '\0';
        T_EQ_I(means_find(&(struct means_how){.average = bad[k]}, number, t, SETS, &m, &d),
               PVX_EINVAL);
        T_CONTAINS(d.text, "should be all, a period in sets");
        means_free(&m);
    }
    d.text[0] = '\0';
    T_EQ_I(means_find(&(struct means_how){.average = "2kHz"}, number, t, SETS, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "shorter than the 1");
    means_free(&m);
    d.text[0] = '\0';
    T_EQ_I(means_find(&(struct means_how){.average = "80Hz"}, number, NULL, SETS, &m, &d),
           PVX_EINVAL);
    T_CONTAINS(d.text, "times of these pictures are not known");
    means_free(&m);
}

T_CASE(phases_of_a_file)
{
    static const struct {
        const char *text, *why;
    } files[] = {{"frame,phase\n", "no set has a phase"},
                 {"frame,phase\r\n3,0.5\r\n\r\n# by hand\n7,1\n9,0.999\n", NULL},
                 {"Frame,Degrees\n3,180\n7,360\n9,719.9", NULL},
                 {"", "is empty"},
                 {"3,0.5\n", ":1: the first line should be"},
                 {"frame,phase\n3,180\n", ":2: phase 180 should be 0 to 1; if these are degrees"},
                 {"frame,phase\n3,0.5\n3,0.6\n", ":3: frame 3 has a phase already"},
                 {"frame,phase\n3;0.5\n", ":2: '3;0.5' should be"},
                 {"frame,phase\n3,nan\n", ":2: '3,nan' should be"},
                 {"frame,phase\n3,0.5 s\n", ":2: '3,0.5 s' should be"}};
    int64_t number[SETS];
    struct means m;
    int phase[SETS];
    char path[100];
    for (int i = 0; i < SETS; i++)
        number[i] = i;
    scratch_new();
    snprintf(path, sizeof path, "%s/phase.csv", dir);
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        struct pvx_diag d = {""};
        FILE *f = fopen(path, "w");
        fputs(files[k].text, f);
        fclose(f);
        pvx_err e =
            means_find(&(struct means_how){.phases = path, .n = 4}, number, NULL, SETS, &m, &d);
        T_EQ_I(e == PVX_OK, files[k].why == NULL);
        if (files[k].why != NULL)
            T_CONTAINS(d.text, files[k].why);
        else {
            phases_of(&m, phase);
            for (int i = 0; i < SETS; i++)
                T_EQ_I(phase[i], i == 3 ? 2 : i == 7 ? 0 : i == 9 ? 3 : -1);
        }
        means_free(&m);
    }
    scratch_remove();
}

/* What is saturated once is saturated in the mean; a pixel without a number has none there either. */
T_CASE(sums)
{
    double sum[4] = {0}, square[4] = {0};
    uint8_t full[4] = {0};
    struct means_sum s = {sum, square, full, 4, 0};
    float a[4] = {0.25F, 1, 0.5F, (float)NAN}, b[4] = {0.75F, 0.5F, 0.5F, 0.5F}, out[4];
    means_add(&s, a, 1);
    means_add(&s, b, 1);
    means_take(&s, out, 1);
    T_OK(out[0] == 0.5F && out[1] == 1 && out[2] == 0.5F && isnan(out[3]));
}

/* A pattern that stays and a flame that flickers in two of seven bins are not in the noise; green has twice that of red. */
T_CASE(noise_between_pictures)
{
    enum { BINS = 9000, CS = 4 };
    static double sum[BINS * CS], square[BINS * CS];
    static uint8_t full[BINS * CS];
    static float pattern[BINS], bins[BINS * CS];
    float out[3];
    struct means_sum s = {sum, square, full, (size_t)BINS * CS, 0};
    for (int i = 0; i < BINS; i++)
        pattern[i] = (float)(t_uniform(0, 0.3));
    for (int k = 0; k < 40; k++) {
        double flicker = t_uniform(0, 1);
        for (int i = 0; i < BINS * CS; i++)
            bins[i] = (float)((double)pattern[i / CS] + (i / CS % 7 < 2 ? flicker : 0) +
                              (i % CS == 1 ? 0.02 : 0.01) * t_normal());
        means_add(&s, bins, 1e9F);
        if (k == 10) {
            T_OK(means_noise(&s, CS, 3, out) == PVX_OK);
            T_OK(out[0] == 0 && out[1] == 0 && out[2] == 0); /* too few */
        }
    }
    T_OK(means_noise(&s, CS, 3, out) == PVX_OK);
    T_NEAR((double)out[0], 0.01, 0.0005);
    T_NEAR((double)out[1], 0.02, 0.001);
    T_NEAR((double)out[2], 0.01, 0.0005);
}
