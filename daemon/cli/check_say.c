#include "daemon/cli/check_say.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "daemon/control/json.h"

#define DEGREES 57.29577951308232

static bool ends_in(const char *path, const char *ext)
{
    size_t n = strlen(path), m = strlen(ext);
    return n > m && strcmp(path + n - m, ext) == 0;
}

void check_direction(const double shift[2], char out[64])
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

static void how(const struct rec_check_camera *o, char *out, size_t size)
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
        check_direction(o->shift, way);
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

void check_sentence(const struct check_result *r, size_t c, char out[CHECK_SENTENCE])
{
    const struct rec_check_camera *o = &r->verdict->figures.camera[c];
    char what[300];
    out[0] = '\0';
    if (o->wrong == REC_WRONG_NOTHING)
        return;
    how(o, what, sizeof what);
    snprintf(out, CHECK_SENTENCE, "%s %s: %s; %s", r->sets->rig.cameras[c].name,
             rec_wrong_name(o->wrong), what, rec_wrong_remedy(o->wrong));
}

void check_conclusion(const struct check_result *r, char out[CHECK_SENTENCE])
{
    const struct rec_check_verdict *v = r->verdict;
    size_t n = r->sets->rig.n_cameras;
    if (v->outcome == REC_CHECK_AGREES)
        snprintf(out, CHECK_SENTENCE, "the flame agrees with the rig in all %zu cameras", n);
    else if (v->outcome == REC_CHECK_NAMED)
        snprintf(out, CHECK_SENTENCE, "%zu of %zu cameras %s wrong; the others agree", v->n_wrong,
                 n, v->n_wrong == 1 ? "is" : "are");
    else
        snprintf(out, CHECK_SENTENCE,
                 "%zu of %zu cameras disagree, and which of them are wrong cannot be told: too few "
                 "would be left that agree; `pyrovox calibrate refine`, or a board, may mend it",
                 v->n_wrong, n);
}

void check_print(const struct check_result *r)
{
    const struct rec_check_figures *f = &r->verdict->figures;
    char text[CHECK_SENTENCE], way[64];
    printf("%u frame sets, pictures in bins of %d x %d pixels\n\n", f->sets,
           r->sets->params.binning, r->sets->params.binning);
    printf("%-12s %-10s %-22s %7s %7s %6s %6s %7s %9s\n", "camera", "", "displaced, px", "+-",
           "turned", "size", "gain", "agrees", "residual");
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++) {
        const struct rec_check_camera *o = &f->camera[c];
        check_direction(o->shift, way);
        printf("%-12s %-10s ", r->sets->rig.cameras[c].name,
               o->wrong == REC_WRONG_NOTHING ? (o->sets > 0 ? "agrees" : "sees none")
                                             : rec_wrong_name(o->wrong));
        if (o->sets == 0)
            printf("%-22s\n", "-");
        else
            printf("%-22s %7.2f %+6.1f\302\260 %+5.1f%% %6.2f %7.3f %9.3f\n", way,
                   hypot(o->sigma[0], o->sigma[1]), o->roll * DEGREES, 100 * o->size, o->gain,
                   o->rho_moved, o->residual);
    }
    printf("\n");
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++) {
        check_sentence(r, c, text);
        if (text[0] != '\0')
            printf("%s\n", text);
    }
    check_conclusion(r, text);
    printf("%s\n", text);
}

/* ---- JSON ---- */

static void put_camera(struct dmn_json *j, const struct check_result *r, size_t c)
{
    const struct rec_check_figures *f = &r->verdict->figures;
    const struct rec_check_camera *o = &f->camera[c];
    char text[CHECK_SENTENCE];
    check_sentence(r, c, text);
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "name", r->sets->rig.cameras[c].name);
    dmn_json_str(j, "wrong", rec_wrong_name(o->wrong));
    dmn_json_str(j, "text", text);
    dmn_json_bool(j, "believed", f->use[c]);
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
    dmn_json_close(j, '}');
}

static void fill(struct dmn_json *j, const void *ctx)
{
    static const char *const outcome[] = {"agrees", "named", "cannot be told"};
    const struct check_result *r = ctx;
    char text[CHECK_SENTENCE];
    check_conclusion(r, text);
    dmn_json_open(j, NULL, '{');
    dmn_json_int(j, "version", 1);
    dmn_json_str(j, "rig", r->rig);
    dmn_json_str(j, "frames", r->frames);
    dmn_json_int(j, "sets", r->verdict->figures.sets);
    dmn_json_int(j, "binning", r->sets->params.binning);
    dmn_json_str(j, "outcome", outcome[r->verdict->outcome]);
    dmn_json_str(j, "text", text);
    dmn_json_num(j, "flame_moves", r->verdict->figures.moves);
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++)
        put_camera(j, r, c);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

pvx_err check_write(const struct check_result *r, const char *path, struct pvx_diag *d)
{
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory", path);
    pvx_err e = ends_in(path, ".json") ? dmn_json_print(f, fill, r, d) : check_html(f, r);
    if (fclose(f) != 0 && e == PVX_OK)
        e = pvx_fail(d, PVX_ENOMEM, "%s: no memory", path);
    if (e == PVX_OK)
        e = pvx_file_write(path, text, len, d);
    free(text);
    return e;
}
