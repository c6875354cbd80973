#include "daemon/cli/calibrate/check_say.h"

#include <math.h>
#include <string.h>

#define DEGREES 57.29577951308232

bool check_explained(const struct check_result *r)
{
    const enum rec_cause c = r->belong->cause;
    return c != REC_CAUSE_NONE && c != REC_CAUSE_SATURATED && c != REC_CAUSE_GAIN &&
           c != REC_CAUSE_CAMERA && c != REC_CAUSE_UNTOLD;
}

/* It is about more than one camera. */
static bool check_of_rig(const struct check_result *r)
{
    return check_explained(r) && __builtin_popcountll(r->belong->cameras) != 1;
}

void check_sentence(const struct check_result *r, size_t c, char out[CHECK_SENTENCE])
{
    char text[DMN_CHECK_WORDS];
    out[0] = '\0';
    if (check_of_rig(r))
        return;
    dmn_check_sentence(&r->verdict->figures.camera[c], text);
    snprintf(out, CHECK_SENTENCE, "%s%s%s", text[0] != '\0' ? r->sets->rig.cameras[c].name : "",
             text[0] != '\0' ? " " : "", text);
}

/* Grey pictures fit those with colour in the mean of the channels, which is all that a check compares. */
static void check_grey(const struct flame_sets *s, char *out, size_t size)
{
    size_t n = 0;
    for (size_t c = 0; c < s->rig.n_cameras && n + REC_NAME_MAX + 2 < size; c++)
        if ((s->grey >> c & 1) != 0)
            n += (size_t)snprintf(out + n, size - n, "%s%s", n > 0 ? ", " : "",
                                  s->rig.cameras[c].name);
}

void check_conclusion(const struct check_result *r, char out[CHECK_SENTENCE])
{
    char grey[200] = "";
    if (check_of_rig(r))
        rec_plausible_line(r->belong, out);
    else
        dmn_check_conclusion(r->verdict->outcome, r->verdict->n_wrong, r->sets->rig.n_cameras, out);
    check_grey(r->sets, grey, sizeof grey);
    size_t n = strlen(out);
    if (grey[0] != '\0')
        snprintf(out + n, CHECK_SENTENCE - n,
                 "; of %s only the brightness was compared, it is grey and other cameras have "
                 "colour: solve one channel (reconstruct --grey; channels: 1), or leave one kind "
                 "out (--cameras A,B,...)",
                 grey);
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
        dmn_check_direction(o->shift, way);
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
    if (r->belong->cause != REC_CAUSE_NONE && !check_of_rig(r)) {
        rec_plausible_line(r->belong, text);
        printf("%s\n", text);
    }
}

/* ---- JSON ---- */

static void check_say_put_camera(struct dmn_json *j, const struct check_result *r, size_t c)
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
    dmn_check_figures_json(j, o);
    dmn_json_close(j, '}');
}

void check_json(struct dmn_json *j, const void *ctx)
{
    const struct check_result *r = ctx;
    char text[CHECK_SENTENCE];
    check_conclusion(r, text);
    dmn_json_open(j, NULL, '{');
    dmn_json_int(j, "version", 1);
    dmn_json_str(j, "rig", r->rig);
    dmn_json_str(j, "frames", r->frames);
    dmn_json_int(j, "sets", r->verdict->figures.sets);
    dmn_json_int(j, "binning", r->sets->params.binning);
    dmn_json_str(j, "outcome", dmn_check_outcome(r->verdict->outcome));
    dmn_json_str(j, "text", text);
    dmn_json_str(j, "cause", rec_cause_name(r->belong->cause));
    dmn_json_str(j, "next", r->belong->next);
    dmn_json_num(j, "flame_moves", r->verdict->figures.moves);
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++)
        check_say_put_camera(j, r, c);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}
