/* The report of a calibration as a page: well-formed whatever things are called, small, and with the numbers of the
 * JSON.  Known cameras look at a known board (lib/board_views.h); some of their pictures are bad. */
#include "daemon/cli/calibrate/report.h"

#include <cjson/cJSON.h>

#include "base/file.h"
#include "recon/geom/rig.h"
#include "tests/lib/board_views.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

#define HOSTILE "<script>alert('1')</script>&\"\xff\x01\xef\xbf\xbf"

static struct bv s;
static struct bv_result solved;
static struct calibrate_look look;
static struct calibrate_result result;
static char *page, *json;
static size_t page_len, json_len;

/* A picture for every view, three more that are none. */
static void pictures(void)
{
    static struct calibrate_picture picture[BV_CAMERAS * BV_FRAMES + 3];
    look = (struct calibrate_look){
        .n_cameras = s.cameras, .n_views = s.n, .view = s.view, .picture = picture};
    memcpy(look.camera, s.named, s.cameras * sizeof *s.named);
    for (size_t i = 0; i < s.n; i++) {
        char path[80];
        snprintf(path, sizeof path, "poses/%s/%06u.png", s.named[s.view[i].camera].name,
                 s.view[i].frame);
        picture[look.n++] = (struct calibrate_picture){.camera = s.view[i].camera,
                                                       .frame = s.view[i].frame,
                                                       .path = strdup(path),
                                                       .view = s.view[i],
                                                       .square = 20,
                                                       .at = i};
        look.count[s.view[i].camera].sight[REC_SIGHT_FOUND]++;
        look.count[s.view[i].camera].pictures++;
    }
    for (int i = 0; i < 3; i++) {
        struct calibrate_picture *p = &picture[look.n++];
        *p = (struct calibrate_picture){.camera = 1,
                                        .frame = (uint32_t)i,
                                        .path = strdup("poses/" HOSTILE ".png"),
                                        .unreadable = i == 0,
                                        .outcome = i == 1 ? REC_SIGHT_DARK : REC_SIGHT_BLURRED,
                                        .at = CALIBRATE_NO_VIEW};
        snprintf(p->text, sizeof p->text, "reason %d: " HOSTILE, i);
        look.count[1].pictures++;
    }
}

static pvx_err written(const struct calibrate_result *r, const char *name, char **text, size_t *len)
{
    struct pvx_diag d = {""};
    pvx_err e = calibrate_write_report(at("%s", name), calibrate_json, calibrate_html, r, &d);
    return e == PVX_OK ? pvx_file_read(at("%s", name), 4 << 20, text, len, &d) : e;
}

static void begin(void)
{
    plugins_of_this_build();
    scratch_new();
    bv_init(&s, 8, true);
    s.warp[0] = 4e-4;
    s.warp[1] = -2e-4;
    s.wrong = 0.003;
    bv_everywhere(&s);
    s.pose[7] = s.pose[6]; /* nothing moved */
    bv_take(&s);
    for (size_t i = 0; i < s.n; i++) /* of one view, corners that fit no board */
        if (i == 30)
            for (size_t k = 0; k < s.view[i].n; k++)
                s.view[i].corner[k].x += 20 * t_uniform(-1, 1);
    snprintf(s.named[1].name, sizeof s.named[1].name, "%s", "<script>\"'&");
    bv_solve(&s, &solved);
    pictures();
    result = (struct calibrate_result){.board = &s.board,
                                       .grid = &solved.rig.grid,
                                       .look = &look,
                                       .report = &solved.report,
                                       .rig = &solved.rig};
    if (written(&result, "report.html", &page, &page_len) != PVX_OK ||
        written(&result, "report.json", &json, &json_len) != PVX_OK)
        exit(1);
}

/* What a parser of XML says of a file: it takes no page that a browser would have to guess at. */
static int parsed(const char *name)
{
    char cmd[700];
    snprintf(
        cmd, sizeof cmd,
        "/usr/bin/python3 -c 'import sys, xml.etree.ElementTree as t; t.parse(sys.argv[1])' %s",
        name);
    return system(cmd);
}

static size_t count(const char *text, const char *part)
{
    size_t n = 0;
    for (; (text = strstr(text, part)) != NULL; text += strlen(part))
        n++;
    return n;
}

T_CASE(solved_at_all)
{
    T_CHECK_(solved.e == PVX_OK, "%s", pvx_diag_text(&solved.d, solved.e));
}

T_CASE(well_formed_small_and_alone)
{
    T_EQ_I(parsed(at("report.html")), 0);
    T_EQ_I(page_len, strlen(page));
    printf("  %zu bytes for %zu cameras and %zu views\n", page_len, s.cameras, s.n);
    T_LE(page_len, 2e6);
    T_OK(strstr(page, "http") == NULL && strstr(page, "src=") == NULL &&
         strstr(page, "url(") == NULL && strstr(page, "@import") == NULL);
    T_OK(strstr(page, "prefers-color-scheme:dark") != NULL && strstr(page, "@media print") != NULL);
    T_OK(strstr(page, "nan") == NULL && strstr(page, "inf\"") == NULL);
}

T_CASE(whatever_it_is_called_stays_text)
{
    T_OK(strstr(page, "<script") == NULL);
    T_CONTAINS(page, "&lt;script&gt;&quot;&#39;&amp;");
    T_CONTAINS(page, "&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&amp;&quot;???");
}

T_CASE(the_numbers_are_those_of_the_json)
{
    cJSON *o = cJSON_Parse(json);
    const cJSON *c, *x;
    char row[400];
    const char *table = strstr(page, "<h2>Cameras</h2>");
    T_OK(o != NULL && table != NULL);
    cJSON_ArrayForEach(c, cJSON_GetObjectItem(o, "cameras"))
    {
        const cJSON *u = cJSON_GetObjectItem(c, "expected");
        const double v[5] = {cJSON_GetObjectItem(u, "px")->valuedouble,
                             cJSON_GetObjectItem(u, "voxels")->valuedouble,
                             cJSON_GetObjectItem(u, "voxels_95")->valuedouble,
                             cJSON_GetObjectItem(c, "single_px")->valuedouble,
                             cJSON_GetObjectItem(c, "joint_px")->valuedouble};
        size_t n = 0;
        for (int i = 0; i < 5; i++)
            n += (size_t)snprintf(row + n, sizeof row - n, "<td class=\"n\">%.3f</td>", v[i]);
        T_CONTAINS(table, row);
    }
    cJSON_ArrayForEach(x, cJSON_GetObjectItem(o, "findings"))
    {
        T_OK(cJSON_GetObjectItem(x, "severity") != NULL);
    }
    T_EQ_I(count(page, "<li class="), cJSON_GetArraySize(cJSON_GetObjectItem(o, "findings")));
    size_t boards = (size_t)cJSON_GetArraySize(cJSON_GetObjectItem(o, "boards"));
    T_EQ_I(count(page, "<path class=\"board\""), 2 * boards);
    cJSON_ArrayForEach(x, cJSON_GetObjectItem(cJSON_GetObjectItem(o, "volume"), "expected_px"))
    {
        snprintf(row, sizeof row, ">%.3f</text>", x->valuedouble);
        T_CONTAINS(page, row);
    }
    cJSON_Delete(o);
}

T_CASE(every_picture_that_was_left_out_with_its_reason)
{
    const char *rest = strstr(page, "<h2>Left out: ");
    size_t n = 3;
    T_OK(rest != NULL);
    for (size_t i = 0; i < look.n_views && rest != NULL; i++) {
        const struct rec_calib_view *v = &solved.report.view[i];
        char row[200];
        n += v->fate != REC_VIEW_USED;
        snprintf(row, sizeof row, ">%s/%06u.png<",
                 s.view[i].camera == 1 ? "poses/&lt;script&gt;&quot;&#39;&amp;" : "",
                 s.view[i].frame);
        if (s.view[i].camera != 1)
            snprintf(row, sizeof row, ">poses/cam%u/%06u.png<", s.view[i].camera, s.view[i].frame);
        T_EQ_I(count(rest, row), v->fate != REC_VIEW_USED);
    }
    T_OK(n > 5); /* those that did not move, and the one that fits no board, are among them */
    T_EQ_I(count(rest, "<tr>"), n + 1);
    T_CONTAINS(rest, "nothing moved since number 106");
    T_CONTAINS(rest, "fit no board");
    T_CONTAINS(rest, "reason 2: &lt;");
}

/* A solve that failed at once, with nothing but a sentence. */
T_CASE(without_a_rig)
{
    struct calibrate_result r = result;
    struct rec_calib_report none = {0};
    r.report = &none;
    r.rig = NULL;
    r.failure = "cam<7>: the board is in none of its pictures";
    char *text;
    size_t len;
    T_EQ_I(written(&r, "none.html", &text, &len), PVX_OK);
    T_EQ_I(parsed(at("none.html")), 0);
    T_CONTAINS(text, "cam&lt;7&gt;: the board");
    T_CONTAINS(text, "No rig");
    T_CONTAINS(text, "reason 0");
    T_CONTAINS(text, " corners found");
    T_EQ_I(count(text, "class=\"median\""), 0);
    free(text);
}

static void end(void)
{
    for (size_t i = 0; i < look.n; i++)
        free(look.picture[i].path);
    free(page);
    free(json);
    bv_done(&solved);
    scratch_remove();
}

T_MAIN(begin(), end())
