#include "daemon/control/check_words.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define DEGREES 57.29577951308232

void dmn_check_direction(const double shift[2], char out[64])
{
    snprintf(out, 64, "%.1f %s, %.1f %s", fabs(shift[0]), shift[0] < 0 ? "left" : "right",
             fabs(shift[1]), shift[1] < 0 ? "up" : "down");
}

/* How many sets late its pictures are, 0: none fits better. */
static int lag_of(const struct rec_check_camera *o)
{
    int best = REC_CHECK_LATE;
    for (int i = 0; i < REC_CHECK_LAGS; i++)
        if (o->rho_late[i] > o->rho_late[best])
            best = i;
    return best - REC_CHECK_LATE;
}

static void how_late(const struct rec_check_camera *o, char *out, size_t size)
{
    int lag = lag_of(o);
    if (o->still < 0.15)
        snprintf(out, size, "its picture stands still while the flame moves");
    else
        snprintf(out, size, "its pictures are those of %d frame%s %s", abs(lag),
                 abs(lag) == 1 ? "" : "s", lag > 0 ? "earlier" : "later");
}

static void check_words_how(const struct rec_check_camera *o, char *out, size_t size)
{
    char way[64];
    static const char *const flip[] = {"", "left to right", "upside down",
                                       "both ways (turned by 180 degrees)"};
    switch (o->wrong) {
    case REC_WRONG_DARK:
        snprintf(out, size, "lit in %.0f %% of where the others see flame", 100 * o->lit);
        return;
    case REC_WRONG_FLOODED:
        snprintf(out, size, "%.0f %% of its picture is lit, %.0f %% of its light is no flame's",
                 100 * o->area, 100 * (1 - o->explained));
        return;
    case REC_WRONG_MOVED:
        dmn_check_direction(o->shift, way);
        snprintf(out, size,
                 "its flame lies %.1f px (%s; +- %.2f) from where the others see it, turned by "
                 "%+.1f degrees, %+.1f %% in size",
                 hypot(o->shift[0], o->shift[1]), way, hypot(o->sigma[0], o->sigma[1]),
                 o->roll * DEGREES, 100 * o->size);
        return;
    case REC_WRONG_MIRRORED:
        snprintf(out, size, "its picture is mirrored %s", flip[o->mirrored & 3]);
        return;
    case REC_WRONG_LATE: how_late(o, out, size); return;
    case REC_WRONG_BLURRED:
        snprintf(out, size, "softer than the others by %.1f px", o->blur);
        return;
    case REC_WRONG_GAIN:
        snprintf(out, size, "%.2f times as bright as the others say", o->gain);
        return;
    case REC_WRONG_DISAGREES:
        snprintf(out, size, "it agrees with the others by %.2f where 1 is right", o->rho_moved);
        return;
    default: out[0] = '\0';
    }
}

void dmn_check_sentence(const struct rec_check_camera *o, char out[DMN_CHECK_WORDS])
{
    char what[300];
    out[0] = '\0';
    if (o->wrong == REC_WRONG_NOTHING)
        return;
    check_words_how(o, what, sizeof what);
    snprintf(out, DMN_CHECK_WORDS, "%s: %s; %s", rec_wrong_name(o->wrong), what,
             rec_wrong_remedy(o->wrong));
}

void dmn_check_conclusion(enum rec_check_outcome outcome, size_t n_wrong, size_t n,
                          char out[DMN_CHECK_WORDS])
{
    if (outcome == REC_CHECK_AGREES)
        snprintf(out, DMN_CHECK_WORDS, "the flame agrees with the rig in all %zu cameras", n);
    else if (outcome == REC_CHECK_NAMED)
        snprintf(out, DMN_CHECK_WORDS, "%zu of %zu cameras %s wrong; the others agree", n_wrong, n,
                 n_wrong == 1 ? "is" : "are");
    else
        snprintf(out, DMN_CHECK_WORDS,
                 "%zu of %zu cameras disagree, and which of them are wrong cannot be told: too few "
                 "would be left that agree; `pyrovox calibrate refine`, or a board, may mend it",
                 n_wrong, n);
}

const char *dmn_check_outcome(enum rec_check_outcome outcome)
{
    static const char *const name[] = {"agrees", "named", "cannot be told"};
    return name[outcome];
}

void dmn_check_figures_json(struct dmn_json *j, const struct rec_check_camera *o)
{
    dmn_json_int(j, "sets", o->sets);
    dmn_json_num(j, "right_px", o->shift[0]);
    dmn_json_num(j, "down_px", o->shift[1]);
    dmn_json_num(j, "right_sigma_px", o->sigma[0]);
    dmn_json_num(j, "down_sigma_px", o->sigma[1]);
    dmn_json_num(j, "turned_deg", o->roll * DEGREES);
    dmn_json_num(j, "size", 1 + o->size);
    dmn_json_num(j, "gain", o->gain);
    dmn_json_num(j, "agreement", o->rho);
    dmn_json_num(j, "agreement_displaced", o->rho_moved);
    dmn_json_num(j, "agreement_mirrored", o->rho_mirrored);
    dmn_json_open(j, "agreement_late", '['); /* from REC_CHECK_LATE sets early to as many late */
    for (int i = 0; i < REC_CHECK_LAGS; i++)
        dmn_json_num(j, NULL, o->rho_late[i]);
    dmn_json_close(j, ']');
    dmn_json_num(j, "change", o->still);
    dmn_json_num(j, "blur_px", o->blur);
    dmn_json_num(j, "explained", o->explained);
    dmn_json_num(j, "lit", o->lit);
    dmn_json_num(j, "area", o->area);
    dmn_json_num(j, "saturated", o->saturated);
    dmn_json_num(j, "residual", o->residual);
    dmn_json_num(j, "residual_with_it", o->with_it);
}
