#include "daemon/cli/common/means.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/file.h"
#include "base/mem.h"

#define PHASES_OF_A_FILE 16
#define PHASES_MOST      10000
#define FILE_MOST        (256 << 20) /* bytes */
#define WHOLE            1e-6        /* of a set: phases that differ by less are one */
#define LOOKS            4096        /* bins */
#define PICTURES         16          /* fewer say little of a variance */
#define FLICKER          4           /* times the median variance: no noise of the dark */

/* ---- the phase of each set, 0 <= phase < 1; NAN: it is in no mean ---- */

static double means_fraction(double cycles)
{
    return cycles - floor(cycles);
}

/* "20" sets; "12.5ms", "2us", "0.1s", "80Hz", "1.2kHz" in ns. */
static pvx_err means_period(const char *text, bool *sets, double *period, struct pvx_diag *d)
{
    static const struct {
        const char *unit;
        double ns;
        bool rate;
    } units[] = {{"s", 1e9, false},
                 {"ms", 1e6, false},
                 {"us", 1e3, false},
                 {"Hz", 1e9, true},
                 {"kHz", 1e6, true}};
    char *end;
    double v = strtod(text, &end);
    *sets = *end == '\0';
    *period = v;
    bool known = *sets;
    for (size_t i = 0; i < sizeof units / sizeof *units && !known; i++)
        if ((known = strcmp(end, units[i].unit) == 0))
            *period = units[i].rate ? units[i].ns / v : v * units[i].ns;
    if (end == text || !known || !(v > 0) || !isfinite(*period) || (*sets && v < 1))
        return pvx_fail(
            d, PVX_EINVAL,
            "--average: '%.60s' should be all, a period in sets of 1 or more (20), or a "
            "period or rate with its unit: 12.5ms, 80Hz",
            text);
    return PVX_OK;
}

/* The time between sets: the mean of those up to 1.5 times the median, because some may be missing. */
static int means_by_ns(const void *a, const void *b)
{
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}
static pvx_err means_interval(const int64_t *t_ns, size_t n, double *out)
{
    int64_t *step = pvx_calloc(n, sizeof *step);
    PVX_NEED(step);
    for (size_t i = 1; i < n; i++)
        step[i - 1] = t_ns[i] - t_ns[i - 1];
    qsort(step, n - 1, sizeof *step, means_by_ns);
    size_t used = 0;
    double sum = 0;
    while (used + 1 < n && (double)step[used] <= 1.5 * (double)step[(n - 1) / 2])
        sum += (double)step[used++];
    *out = used > 0 ? sum / (double)used : 0;
    free(step);
    return PVX_OK;
}

static pvx_err means_by_period(const struct means_how *how, const int64_t *number,
                               const int64_t *t_ns, size_t n, double *phase, double *in_a_cycle,
                               struct pvx_diag *d)
{
    bool sets;
    double period, interval = 1;
    PVX_TRY(means_period(how->average, &sets, &period, d));
    if (!sets && t_ns == NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "--average %s: the times of these pictures are not known; give the period "
                        "in sets, or say what their numbers are (--numbers ms, us or ns)",
                        how->average);
    if (!sets)
        PVX_TRY(means_interval(t_ns, n, &interval));
    if (!sets && n > 1 && period < interval)
        return pvx_fail(d, PVX_EINVAL,
                        "--average %s: a period is shorter than the %.4g ms between two sets; the "
                        "phase of each set is needed (--phase FILE.csv)",
                        how->average, interval * 1e-6);
    for (size_t i = 0; i < n; i++) {
        double at = sets ? (double)(number[i] - number[0]) : (double)(t_ns[i] - t_ns[0]);
        phase[i] = means_fraction(at / period + WHOLE * interval / period);
    }
    *in_a_cycle = interval > 0 ? floor(period / interval + WHOLE) : 1;
    return PVX_OK;
}

static size_t means_find_set(const int64_t *number, size_t n, int64_t wanted)
{
    size_t lo = 0, hi = n;
    while (lo < hi) {
        size_t mid = lo + (hi - lo) / 2;
        if (number[mid] < wanted)
            lo = mid + 1;
        else
            hi = mid;
    }
    return lo < n && number[lo] == wanted ? lo : n;
}

struct means_file {
    const char *path;
    size_t line;
    double whole; /* a cycle in the column's unit; 0: not known yet */
};

/* One line, "frame,phase". */
static pvx_err means_line(const struct means_file *at, const char *text, const int64_t *number,
                          size_t n, double *phase, struct pvx_diag *d)
{
    long long frame;
    double v;
    int used = 0;
    if (sscanf(text, " %lld , %lf %n", &frame, &v, &used) != 2 || text[used] != '\0' ||
        !isfinite(v))
        return pvx_fail(d, PVX_EFORMAT,
                        "%s:%zu: '%.40s' should be the number of a frame and its phase, 12,0.25",
                        at->path, at->line, text);
    if (at->whole == 1 && !(v >= 0 && v <= 1))
        return pvx_fail(d, PVX_EFORMAT,
                        "%s:%zu: phase %g should be 0 to 1; if these are degrees, name the column "
                        "degrees",
                        at->path, at->line, v);
    size_t i = means_find_set(number, n, frame);
    if (i < n && !isnan(phase[i]))
        return pvx_fail(d, PVX_EFORMAT, "%s:%zu: frame %lld has a phase already", at->path,
                        at->line, frame);
    if (i < n)
        phase[i] = means_fraction(v / at->whole);
    return PVX_OK;
}

static pvx_err means_by_file(const char *path, const int64_t *number, size_t n, double *phase,
                             struct pvx_diag *d)
{
    char *text = NULL, *rest;
    size_t len;
    struct means_file at = {.path = path};
    pvx_err e = pvx_file_read(path, FILE_MOST, &text, &len, d);
    if (e == PVX_OK && memchr(text, '\0', len) != NULL)
        e = pvx_fail(d, PVX_EFORMAT, "%s: is no text", path);
    for (size_t i = 0; i < n; i++)
        phase[i] = (double)NAN;
    for (rest = text; e == PVX_OK && rest != NULL && *rest != '\0';) {
        char *now = strsep(&rest, "\n");
        at.line++;
        now[strcspn(now, "\r")] = '\0';
        if (now[strspn(now, " \t")] == '\0' || now[0] == '#')
            continue;
        if (at.whole > 0)
            e = means_line(&at, now, number, n, phase, d);
        else if (strcasecmp(now, "frame,phase") == 0)
            at.whole = 1;
        else if (strcasecmp(now, "frame,degrees") == 0)
            at.whole = 360;
        else
            e = pvx_fail(d, PVX_EFORMAT,
                         "%s:%zu: the first line should be frame,phase (0 to 1) or frame,degrees",
                         path, at.line);
    }
    if (e == PVX_OK && at.whole == 0)
        e = pvx_fail(d, PVX_EFORMAT, "%s: is empty", path);
    free(text);
    return e;
}

/* ---- sets to means ---- */

static size_t means_place(double phase, size_t cycle)
{
    return (size_t)fmin(phase * (double)cycle, (double)cycle - 1);
}

/* Counts, then places: members stay in ascending order. */
static pvx_err means_group(const double *phase, size_t sets, size_t cycle, struct means *m,
                           struct pvx_diag *d)
{
    size_t *at = pvx_calloc(cycle, sizeof *at), most = 0, least = SIZE_MAX, used = 0;
    m->begin = pvx_calloc(cycle + 1, sizeof *m->begin);
    m->member = pvx_calloc(sets, sizeof *m->member);
    m->number = pvx_calloc(cycle, sizeof *m->number);
    if (at == NULL || m->begin == NULL || m->member == NULL || m->number == NULL) {
        free(at);
        return pvx_fail(d, PVX_ENOMEM, "no memory for the list of means");
    }
    for (size_t i = 0; i < sets; i++)
        if (!isnan(phase[i]))
            at[means_place(phase[i], cycle)]++;
    for (size_t k = 0; k < cycle; k++) {
        size_t n = at[k];
        at[k] = used;
        used += n;
        if (n == 0)
            continue;
        most = n > most ? n : most;
        least = n < least ? n : least;
        m->number[m->n++] = (int64_t)k;
        m->begin[m->n] = used;
    }
    for (size_t i = 0; i < sets; i++)
        if (!isnan(phase[i]))
            m->member[at[means_place(phase[i], cycle)]++] = i;
    free(at);
    if (m->n == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "no set has a phase: are the frame numbers those of the file?");
    char some[60] = "";
    if (least < most)
        snprintf(some, sizeof some, "%zu to ", least);
    fprintf(stderr, "pyrovox: %zu mean%s of %s%zu set%s%s", m->n, m->n == 1 ? "" : "s", some, most,
            most == 1 ? "" : "s", m->n == 1 ? "" : " each");
    if (m->n < cycle)
        fprintf(stderr, "; without a set: %zu of %zu phases", cycle - m->n, cycle);
    if (used < sets)
        fprintf(stderr, "; in no mean, without a phase: %zu of %zu sets", sets - used, sets);
    fprintf(stderr, "\n");
    return PVX_OK;
}

pvx_err means_find(const struct means_how *how, const int64_t *number, const int64_t *t_ns,
                   size_t sets, struct means *out, struct pvx_diag *d)
{
    *out = (struct means){0};
    double cycle = 1, *phase = pvx_calloc(sets, sizeof *phase);
    if (phase == NULL)
        return pvx_fail(d, PVX_ENOMEM, "no memory for the phases of %zu sets", sets);
    pvx_err e = PVX_OK;
    if (how->phases != NULL) {
        e = means_by_file(how->phases, number, sets, phase, d);
        cycle = PHASES_OF_A_FILE;
    } else if (strcmp(how->average, "all") != 0)
        e = means_by_period(how, number, t_ns, sets, phase, &cycle, d);
    if (how->n > 0)
        cycle = how->n;
    PVX_THEN(e, means_group(phase, sets, (size_t)fmin(cycle, PHASES_MOST), out, d));
    free(phase);
    return e;
}

void means_free(struct means *m)
{
    PVX_FREE(m->begin);
    PVX_FREE(m->member);
    PVX_FREE(m->number);
    m->n = 0;
}

/* ---- pictures ---- */

void means_add(struct means_sum *s, const float *bins, float full)
{
    for (size_t i = 0; i < s->values; i++) {
        s->sum[i] += (double)bins[i];
        s->square[i] += (double)bins[i] * (double)bins[i];
        s->full[i] |= bins[i] >= full;
    }
    s->n++;
}

void means_take(const struct means_sum *s, float *bins, float full)
{
    for (size_t i = 0; i < s->values; i++)
        bins[i] = s->full[i] ? full : (float)(s->sum[i] / s->n);
}

struct means_bin {
    double mean, variance;
};
static int means_by_mean(const void *a, const void *b)
{
    double x = ((const struct means_bin *)a)->mean, y = ((const struct means_bin *)b)->mean;
    return (x > y) - (x < y);
}
static int means_by_variance(const void *a, const void *b)
{
    double x = ((const struct means_bin *)a)->variance, y = ((const struct means_bin *)b)->variance;
    return (x > y) - (x < y);
}

pvx_err means_noise(const struct means_sum *s, size_t cs, size_t channels, float *out)
{
    size_t bins = s->values / cs, step = bins / LOOKS | 1; /* odd: all colours of a mosaic */
    struct means_bin *look = pvx_calloc(bins / step + 1, sizeof *look);
    PVX_NEED(look);
    for (size_t c = 0; c < channels; c++) {
        size_t n = 0;
        for (size_t i = 0; i < bins && s->n >= PICTURES; i += step) {
            double mean = s->sum[i * cs + c] / s->n;
            double variance = (s->square[i * cs + c] - s->n * mean * mean) / (s->n - 1);
            if (isfinite(variance) && s->full[i * cs + c] == 0)
                look[n++] = (struct means_bin){mean, fmax(variance, 0)};
        }
        qsort(look, n, sizeof *look, means_by_mean);
        qsort(look, n / 2, sizeof *look, means_by_variance);
        size_t used = 0;
        double sum = 0;
        while (used < n / 2 && look[used].variance <= FLICKER * look[n / 4].variance)
            sum += look[used++].variance;
        out[c] = used > 0 ? (float)sqrt(sum / (double)used) : 0;
    }
    free(look);
    return PVX_OK;
}
