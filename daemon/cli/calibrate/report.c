#include "daemon/cli/calibrate/report.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/file.h"

const char *const calibrate_lens[REC_LENS] = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};
const char *const calibrate_fate[REC_VIEW_JOINT + 1] = {
    "used", "broken", "few corners", "twice", "still", "no board", "disagrees with other cameras"};

const char *calibrate_severity(enum rec_calib_severity s)
{
    return s == REC_CALIB_NOTE ? "note" : s == REC_CALIB_WARNING ? "warning" : "refused";
}

static void print_unreadable(const struct calibrate_look *l, size_t c)
{
    for (size_t i = 0; i < l->n; i++)
        if (l->picture[i].camera == c && l->picture[i].unreadable) {
            printf("%s: %zu cannot be read: %s\n", l->camera[c].name, l->count[c].unreadable,
                   l->picture[i].text);
            return;
        }
}

void calibrate_print_pictures(const struct calibrate_result *r)
{
    const struct calibrate_look *l = r->look;
    size_t legacy = 0;
    for (size_t i = 0; i < l->n; i++)
        legacy += l->picture[i].outcome == REC_SIGHT_FOUND && l->picture[i].at < l->n_views &&
                  l->picture[i].legacy;
    if (l->said[0] != '\0')
        printf("%s\n", l->said);
    printf("the board is in %zu of %zu pictures of %zu cameras\n", l->n_views, l->n, l->n_cameras);
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct calibrate_count *n = &l->count[c];
        print_unreadable(l, c);
        for (int s = REC_SIGHT_FOUND + 1; s < REC_N_SIGHTS; s++)
            if (n->sight[s] > 0)
                printf("%s: %zu without: %s: %s\n", l->camera[c].name, n->sight[s],
                       rec_sight_name((enum rec_sight)s), l->picture[n->example[s]].text);
    }
    if (r->board->kind == REC_CHARUCO && r->board->rows % 2 == 0 && l->n_views > 0)
        printf("its squares lie as OpenCV %s 4.6 draws them%s\n",
               2 * legacy > l->n_views ? "before" : "since",
               2 * legacy > l->n_views && !r->board->legacy ? ": \"legacy\" belongs into its spec"
                                                            : "");
    if (l->n_views > 0 && l->grid != r->board->grid)
        printf(
            "its markers count from the %s row, stand as %s draws them, with borders of %s: %s\n",
            (l->grid & REC_GRID_UP) != 0 ? "bottom" : "top",
            (l->grid & REC_GRID_TURNED) != 0 ? "AprilTag" : "OpenCV",
            (l->grid & REC_GRID_WIDE) != 0 ? "two cells" : "one cell",
            l->grid == REC_GRID_KALIBR ? "a grid of Kalibr, \"kalibr\" belongs into its spec"
                                       : "read as such");
}

void calibrate_print_cameras(const struct calibrate_result *r)
{
    const struct calibrate_look *l = r->look;
    printf("\n%-12s %11s %5s %9s %8s %11s %7s %10s\n", "camera", "with board", "used", "single px",
           "joint px", "expected px", "voxels", "95 % below");
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct rec_calib_of_camera *o = &r->report->camera[c];
        printf("%-12s %5zu /%4zu %5zu %9.3f %8.3f %11.3f %7.3f %10.3f  %s\n", l->camera[c].name,
               l->count[c].sight[REC_SIGHT_FOUND], l->count[c].pictures, o->used, o->single,
               o->joint, o->expected.px, o->expected.voxels, o->expected.voxels_95,
               rec_calib_says(r->report, REC_CALIB_REFUSED, -1) ? "refused"
                                                                : rec_calib_verdict(&o->expected));
    }
    printf("\n");
}

void calibrate_print_findings(const struct calibrate_result *r)
{
    for (size_t i = 0; i < r->report->n_findings; i++)
        printf("%s: %s\n", calibrate_severity(r->report->finding[i].severity),
               r->report->finding[i].text);
}

pvx_err calibrate_report_possible(const char *path, bool html, struct pvx_diag *d)
{
    if (pvx_path_ends(path, ".json") || (html && pvx_path_ends(path, ".html")))
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP, "%s: %s", path,
                    html ? "a report is written as .html or .json"
                         : "this report is written as .json");
}

pvx_err calibrate_write_report(const char *path, void (*json)(struct dmn_json *j, const void *of),
                               pvx_err (*html)(FILE *f, const void *of), const void *of,
                               struct pvx_diag *d)
{
    char *text = NULL;
    size_t len = 0;
    PVX_TRY(calibrate_report_possible(path, html != NULL, d));
    FILE *f = open_memstream(&text, &len);
    PVX_NEED(f);
    pvx_err e = pvx_path_ends(path, ".json") ? dmn_json_print(f, json, of, d) : html(f, of);
    if (fclose(f) != 0 && e == PVX_OK)
        e = PVX_ENOMEM;
    PVX_THEN(e, pvx_file_write(path, text, len, d));
    free(text);
    return e;
}
