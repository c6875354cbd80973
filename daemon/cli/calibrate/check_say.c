#include "daemon/cli/calibrate/check_say.h"

#include <math.h>

#define DEGREES 57.29577951308232

void check_sentence(const struct check_result *r, size_t c, char out[CHECK_SENTENCE])
{
    char text[DMN_CHECK_WORDS];
    dmn_check_sentence(&r->verdict->figures.camera[c], text);
    snprintf(out, CHECK_SENTENCE, "%s%s%s", text[0] != '\0' ? r->sets->rig.cameras[c].name : "",
             text[0] != '\0' ? " " : "", text);
}

void check_conclusion(const struct check_result *r, char out[CHECK_SENTENCE])
{
    dmn_check_conclusion(r->verdict->outcome, r->verdict->n_wrong, r->sets->rig.n_cameras, out);
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
    dmn_json_num(j, "flame_moves", r->verdict->figures.moves);
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++)
        check_say_put_camera(j, r, c);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}
