/* sections.c - the report as one page, the most needed sections first.  It loads no files and runs no scripts. */
#include <math.h>
#include <string.h>

#include "daemon/cli/calibrate/page/figures.h"
#include "daemon/cli/report/html.h"
#include "recon/board/spec.h"

/* ---- the verdict ---- */

struct verdict {
    const char *class, *word;
};

/* The class of a word of rec_calib_verdict. */
static const char *class_of(const char *word)
{
    return strcmp(word, "good") == 0 ? "good" : strcmp(word, "just enough") == 0 ? "warn" : "bad";
}

static struct verdict verdict_of(const struct calibrate_result *r)
{
    struct rec_uncertainty u = {.px = r->report->px, .voxels_95 = r->report->voxels_95};
    if (r->rig == NULL)
        return (struct verdict){"bad", "No rig"};
    if (rec_calib_says(r->report, REC_CALIB_REFUSED, -1))
        return (struct verdict){"bad", "Refused"};
    const char *word = rec_calib_verdict(&u);
    bool warned = rec_calib_says(r->report, REC_CALIB_WARNING, -1);
    const char *class = class_of(word);
    return strcmp(class, "good") == 0   ? warned ? (struct verdict){"warn", "Good, with warnings"}
                                                 : (struct verdict){class, "Good"}
             : strcmp(class, "warn") == 0 ? (struct verdict){class, "Just enough"}
           : strcmp(word, "not enough") == 0 ? (struct verdict){class, "Not enough"}
                                             : (struct verdict){class, "Does not see the volume"};
}

static void sections_verdict(FILE *f, const struct calibrate_result *r)
{
    struct verdict v = verdict_of(r);
    const struct rec_calib_report *o = r->report;
    size_t count[3] = {0};
    for (size_t i = 0; i < o->n_findings; i++)
        count[o->finding[i].severity]++;
    fprintf(f, "<div class=\"verdict %s\"><b>%s</b>", v.class, v.word);
    if (r->failure != NULL) {
        fputs("<p>", f);
        html_text(f, r->failure);
        fputs("</p>", f);
    }
    if (r->rig != NULL) {
        fputs("<p>Expected error in the volume: ", f);
        html_number(f, o->px, 3);
        fputs(" px, ", f);
        html_number(f, o->voxels, 3);
        fputs(" voxels; with 95 % below ", f);
        html_number(f, o->voxels_95, 3);
        fprintf(f, " in the worst camera. Tomography bears %.2f to %.2f.</p>", REC_CALIB_GOOD,
                REC_CALIB_FAIR);
    }
    if (count[REC_CALIB_REFUSED] > 0)
        fprintf(f, "<p>%s</p>",
                r->accepted ? "The rig was accepted all the same."
                            : "The rig should not be believed, for what is refused below.");
    else if (count[REC_CALIB_WARNING] > 0)
        fprintf(f, "<p>%zu warning%s below.</p>", count[REC_CALIB_WARNING],
                count[REC_CALIB_WARNING] == 1 ? "" : "s");
    fputs("</div>\n", f);
}

static void findings(FILE *f, const struct calibrate_result *r)
{
    fputs("<ul class=\"findings\">", f);
    for (size_t i = 0; i < r->report->n_findings; i++) {
        const struct rec_calib_finding *n = &r->report->finding[i];
        const char *s = calibrate_severity(n->severity);
        fprintf(f, "<li class=\"%s\"><b>%s</b><span>", s, s);
        html_text(f, n->text);
        fputs("</span></li>\n", f);
    }
    fputs("</ul>\n", f);
}

/* ---- the cameras ---- */

static void sections_held(FILE *f, unsigned held)
{
    fputs("<td>", f);
    for (int i = 0; i < REC_LENS; i++)
        if ((held >> i & 1) != 0)
            fprintf(f, "%s ", calibrate_lens[i]);
    fputs("</td>", f);
}

static void camera_row(FILE *f, const struct calibrate_result *r, size_t c)
{
    const struct calibrate_count *n = &r->look->count[c];
    const struct rec_calib_of_camera *o =
        r->report->camera != NULL ? &r->report->camera[c] : &(const struct rec_calib_of_camera){0};
    const char *word = r->rig != NULL ? rec_calib_verdict(&o->expected) : "";
    fputs("<tr><th>", f);
    html_text(f, r->look->camera[c].name);
    fprintf(f, "</th><td class=\"%s\">%s</td>", *word == '\0' ? "" : class_of(word), word);
    html_cell(f, r->rig != NULL ? o->expected.px : NAN, 3);
    html_cell(f, r->rig != NULL ? o->expected.voxels : NAN, 3);
    html_cell(f, r->rig != NULL ? o->expected.voxels_95 : NAN, 3);
    html_cell(f, o->used > 0 ? o->single : NAN, 3);
    html_cell(f, o->used > 0 ? o->joint : NAN, 3);
    html_cell(f, r->report->camera != NULL ? 100 * o->coverage : NAN, 0);
    fprintf(f, "<td class=\"n\">%zu</td><td class=\"n\">%zu</td><td class=\"n\">%zu</td>",
            n->pictures, n->sight[REC_SIGHT_FOUND], o->used);
    sections_held(f, o->held);
    fputs("</tr>\n", f);
}

static void sections_cameras(FILE *f, const struct calibrate_result *r)
{
    fputs(
        "<h2>Cameras</h2><div class=\"wide\"><table><tr><th>camera</th><th></th>"
        "<th class=\"n\">expected px</th><th class=\"n\">voxels</th><th class=\"n\">95 % below</th>"
        "<th class=\"n\">single px</th><th class=\"n\">joint px</th>"
        "<th class=\"n\">coverage %</th><th class=\"n\">pictures</th>"
        "<th class=\"n\">with board</th><th class=\"n\">used</th><th>held</th></tr>\n",
        f);
    for (size_t c = 0; c < r->look->n_cameras; c++)
        camera_row(f, r, c);
    fputs("</table></div><p class=\"mute\">Expected: the error of projections all through the "
          "volume, rms. Single: what each camera has with itself; joint: with all others. Held: "
          "numbers of the lens that the pictures do not tell.</p>\n",
          f);
}

static pvx_err sections_pictures(FILE *f, const struct calibrate_result *r)
{
    double enlargement = report_enlargement(r);
    fputs("<h2>Residuals and coverage</h2>", f);
    if (enlargement > 0)
        fprintf(
            f,
            "<p class=\"mute\">Thin lines go from a corner towards where it was seen, away from "
            "where it is expected, %g times as long as in the picture, in all cameras; blue arrows "
            "are medians of %s, which should be short and point nowhere in common; red lines are "
            "cut. Cells are darker the more corners they have; red ones have none.</p>\n",
            enlargement, "small parts of the picture");
    fputs("<div class=\"figures\">\n", f);
    for (size_t c = 0; c < r->look->n_cameras; c++)
        PVX_TRY(report_camera(f, r, c, enlargement));
    fputs("</div>\n", f);
    return PVX_OK;
}

/* ---- held out ---- */

static void folds(FILE *f, const struct calibrate_result *r)
{
    fputs("<h2>Held out</h2>", f);
    if (r->rig == NULL) {
        fputs("<p class=\"mute\">Not known without a rig.</p>\n", f);
        return;
    }
    fputs(
        "<p class=\"mute\">A part of the poses is left out in turn: how well it fits what the rest "
        "says, and how far the rest's rig is from the whole one's in the volume.</p><div "
        "class=\"wide\"><table class=\"small\"><tr><th>part</th><th class=\"n\">trained px</th><th "
        "class=\"n\">held out px</th><th class=\"n\">volume px</th></tr>\n",
        f);
    for (int i = 0; i < REC_CALIB_FOLDS; i++) {
        fprintf(f, "<tr><th>%d</th>", i + 1);
        html_cell(f, r->report->fold[i].trained, 3);
        html_cell(f, r->report->fold[i].held_out, 3);
        html_cell(f, r->report->fold[i].volume, 3);
        fputs("</tr>\n", f);
    }
    fputs("</table></div>\n", f);
}

/* ---- views left out ---- */

/* Why a view was not used, after its picture was found good. */
static void fate(FILE *f, const struct rec_calib_view *v)
{
    static const char *const why[] = {
        [REC_VIEW_BROKEN] = "its corners have ids or places that the board does not have",
        [REC_VIEW_FEW] = "fewer than 6 corners, or all on one line",
        [REC_VIEW_TWICE] = "this camera has another picture of the same number"};
    if (v->fate == REC_VIEW_STILL)
        fprintf(f, "nothing moved since number %u, which counts for both", v->like);
    else if (v->fate == REC_VIEW_SELF)
        fputs("its corners fit no board, whatever its pose", f);
    else if (v->fate == REC_VIEW_JOINT)
        fprintf(f,
                "alone it fits to %.2f px rms, with what the other cameras saw of the same number "
                "to %.2f: the board or a camera moved, or it was exposed at another time",
                v->single, v->joint);
    else
        fputs(why[v->fate], f);
}

static bool rejected(const struct calibrate_result *r, const struct calibrate_picture *p)
{
    return p->at == CALIBRATE_NO_VIEW ||
           (r->report->view != NULL && r->report->view[p->at].fate != REC_VIEW_USED);
}

static void rejected_row(FILE *f, const struct calibrate_result *r,
                         const struct calibrate_picture *p)
{
    const struct rec_calib_view *v =
        p->at != CALIBRATE_NO_VIEW && r->report->view != NULL ? &r->report->view[p->at] : NULL;
    fputs("<tr><th>", f);
    html_text(f, r->look->camera[p->camera].name);
    fprintf(f, "</th><td class=\"n\">%u</td><td>", p->frame);
    html_text(f, v != NULL       ? calibrate_fate[v->fate]
                 : p->unreadable ? "unreadable"
                                 : rec_sight_name(p->outcome));
    fputs("</td><td class=\"any\">", f);
    if (v != NULL)
        fate(f, v);
    else
        html_text(f, p->text);
    fputs("</td><td class=\"any mute\">", f);
    html_text(f, p->path);
    fputs("</td></tr>\n", f);
}

static void left_out(FILE *f, const struct calibrate_result *r)
{
    size_t n = 0;
    for (size_t i = 0; i < r->look->n; i++)
        n += rejected(r, &r->look->picture[i]);
    fprintf(f, "<h2>Left out: %zu of %zu pictures</h2>\n", n, r->look->n);
    if (n == 0)
        return;
    fputs("<div class=\"wide\"><table><tr><th>camera</th><th class=\"n\">number</th><th>what</th>"
          "<th>why</th><th>file</th></tr>\n",
          f);
    for (size_t i = 0; i < r->look->n; i++)
        if (rejected(r, &r->look->picture[i]))
            rejected_row(f, r, &r->look->picture[i]);
    fputs("</table></div>\n", f);
}

/* ---- the page ---- */

static void sections_head(FILE *f, const struct calibrate_result *r)
{
    char board[REC_BOARD_TEXT];
    const struct rec_calib_report *o = r->report;
    rec_board_text(r->board, board);
    fprintf(f,
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>"
            "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"/>"
            "<title>Calibration: %s</title><style>\n%s</style></head>\n<body>\n"
            "<h1>Calibration of %zu cameras</h1>\n",
            verdict_of(r).word, report_style, r->look->n_cameras);
    sections_verdict(f, r);
    fprintf(f, "<p class=\"mute\">Board <code>");
    html_text(f, board);
    fprintf(f, "</code>, in %zu of %zu pictures", r->look->n_views, r->look->n);
    if (r->rig != NULL)
        fprintf(
            f,
            ", %zu instants. All corners used: %.3f px rms each camera alone, %.3f px together; "
            "chi&#178; per degree of freedom %.2f",
            o->n_frames, o->single, o->joint, o->chi2);
    fputs(".</p><p class=\"mute said\">", f);
    html_text(f, r->look->said);
    fputs("</p>\n", f);
    findings(f, r);
}

pvx_err calibrate_html(FILE *f, const void *result)
{
    const struct calibrate_result *r = result;
    sections_head(f, r);
    sections_cameras(f, r);
    PVX_TRY(sections_pictures(f, r));
    fputs("<h2>Common poses</h2>\n", f);
    report_pairs(f, r);
    fputs("<h2>Rig and boards</h2>\n", f);
    report_rig(f, r);
    fputs("<h2>Error through the volume</h2>\n", f);
    report_volume(f, r);
    folds(f, r);
    fputs("<h2>Shape of the board</h2>\n", f);
    report_warp(f, r);
    left_out(f, r);
    fputs("</body></html>\n", f);
    return PVX_OK;
}
