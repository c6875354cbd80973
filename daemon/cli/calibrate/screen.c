#include "daemon/cli/calibrate/screen.h"

#include <stdarg.h>
#include <stdio.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/cli/common/page.h"

#define REDRAW_NS (250 * PVX_NS_PER_MS)

static size_t screen_add(char *out, size_t size, size_t n, const char *fmt, ...) PVX_PRINTF(4, 5);
static size_t screen_add(char *out, size_t size, size_t n, const char *fmt, ...)
{
    va_list ap;
    if (n >= size)
        return n;
    va_start(ap, fmt);
    int k = vsnprintf(out + n, size - n, fmt, ap);
    va_end(ap);
    return k > 0 ? n + (size_t)k : n;
}

static const char *screen_name_of(const struct live *l, uint32_t c)
{
    return l->job.look.camera[c].name;
}

/* ---- words ---- */

/* Write what is still missing: "cam2-cam3: 2 joint poses, need 5". */
static void screen_say_missing(const struct live *l, char *out, size_t size)
{
    struct calibrate_graph g;
    size_t n = 0, said = 0, nc = l->job.look.n_cameras;
    out[0] = '\0';
    calibrate_graph(l->common, nc, &g);
    for (uint32_t k = 1; k < g.groups && said < 3; k++)
        for (uint32_t c = 0; c < nc; c++)
            if (g.group[c] == k) {
                n = screen_add(out, size, n, "%s%s: %s%s%.120s", said++ > 0 ? "; " : "",
                               screen_name_of(l, c),
                               !l->camera[c].running     ? "does not run"
                               : l->camera[c].boards > 0 ? "no pose together with the others"
                                                         : "has not seen the board",
                               l->camera[c].error[0] != '\0' ? ": " : "", l->camera[c].error);
                break;
            }
    for (size_t i = g.n_tree; i-- > 0 && said < 4;)
        if (g.tree[i].common < REC_CALIB_JOINT)
            n = screen_add(out, size, n, "%s%s-%s: %u joint pose%s, need %d",
                           said++ > 0 ? "; " : "", screen_name_of(l, g.tree[i].a),
                           screen_name_of(l, g.tree[i].b), g.tree[i].common,
                           g.tree[i].common == 1 ? "" : "s", REC_CALIB_JOINT);
}

/* A camera that runs and is not joined yet must see the board first. */
static bool join_first(const struct live *l, char *out, size_t size)
{
    struct calibrate_graph g;
    size_t nc = l->job.look.n_cameras;
    calibrate_graph(l->common, nc, &g);
    for (uint32_t c = 0; c < nc && g.groups > 1; c++)
        if (g.group[c] != 0 && l->camera[c].running) {
            snprintf(out, size, "show the board to %s and a camera beside it at once",
                     screen_name_of(l, c));
            return true;
        }
    return false;
}

/* Write what to do next: "face cam3, low". */
static void say_advice(const struct live *l, char *out, size_t size)
{
    const struct live_result *r = &l->result;
    bool floor = l->job.in.options.world == REC_WORLD_FLOOR;
    out[0] = '\0';
    if (l->poses == 0)
        snprintf(out, size,
                 floor ? "lay the board flat on the floor of the volume, print up, its middle "
                         "where x = y = 0 shall be"
                       : "show the board to two cameras or more at once");
    else if (!join_first(l, out, size) && r->there && r->e == PVX_OK && r->next.text[0] != '\0') {
        bool good = r->n == l->job.look.n_cameras && rec_calib_good(&r->report);
        snprintf(out, size, "%s: %.2g -> %.2g voxels%s", r->next.text, r->next.now, r->next.then,
                 good ? " (good already)" : "");
    }
    if (out[0] == '\0')
        snprintf(out, size, "another pose: elsewhere in the volume, tilted otherwise");
}

static void say_now(const struct live *l, char *out, size_t size)
{
    switch (l->now) {
    case LIVE_OPENING: snprintf(out, size, "waiting for the cameras"); return;
    case LIVE_UNSEEN: snprintf(out, size, "no camera sees the board"); return;
    case LIVE_MOVING: snprintf(out, size, "the board moves: hold it still"); return;
    case LIVE_STILL: snprintf(out, size, "the board stands still: wait"); return;
    case LIVE_ALONE:
        snprintf(out, size, "the first picture needs two cameras that see the board");
        return;
    case LIVE_MISSING:
        snprintf(out, size, "%s gave no picture with the others", screen_name_of(l, l->missing));
        return;
    case LIVE_KNOWN: snprintf(out, size, "this pose is taken: move the board on"); return;
    case LIVE_TAKEN: snprintf(out, size, "taken as number %u: move the board on", l->last); return;
    }
}

static void say_error(const struct live *l, char *out, size_t size)
{
    const struct live_result *r = &l->result;
    size_t n = 0;
    out[0] = '\0';
    if (!r->there) {
        snprintf(out, size, "not known yet");
        return;
    }
    if (r->e != PVX_OK) {
        snprintf(out, size, "%.300s", pvx_diag_text(&r->d, r->e));
        return;
    }
    uint32_t worst = 0;
    for (uint32_t c = 0; c < r->n; c++)
        if (!(r->report.camera[c].expected.voxels_95 <= r->report.camera[worst].expected.voxels_95))
            worst = c;
    const struct rec_uncertainty *u = &r->report.camera[worst].expected;
    n = screen_add(out, size, n, "%.3f voxels, %.3f px; 95 %% below %.3f in %s: %s",
                   r->report.voxels, r->report.px, u->voxels_95, screen_name_of(l, r->of[worst]),
                   rec_calib_verdict(u));
    if (r->n < l->job.look.n_cameras)
        screen_add(out, size, n, " (%zu of %zu cameras)", r->n, l->job.look.n_cameras);
}

/* ---- the screen ---- */

static void exposure(const struct live_camera *c, char *out, size_t size)
{
    snprintf(out, size, "%3.0f %%%s", 100 * c->bright,
             c->clipped > 0.005 ? " clipped"
             : c->bright < 0.15 ? " dark"
                                : "");
}

static void screen_draw_cameras(struct page *p, const struct live *l)
{
    page_line(p, "%-12s %8s  %-18s %6s %8s %9s %-12s %s", "camera", "pictures", "sees now",
              "boards", "coverage", "blur px", "exposure", "95 % below");
    for (uint32_t c = 0; c < l->job.look.n_cameras; c++) {
        const struct live_camera *k = &l->camera[c];
        char sees[40], light[24] = "-", blur[16] = "-", trust[24] = "-";
        if (!k->running)
            snprintf(sees, sizeof sees, "not running");
        else if (!k->seen)
            snprintf(sees, sizeof sees, "no picture");
        else if (k->corners > 0)
            snprintf(sees, sizeof sees, "%zu corners", k->corners);
        else
            snprintf(sees, sizeof sees, "%s", rec_sight_name(k->outcome));
        if (k->seen)
            exposure(k, light, sizeof light);
        if (k->blur > 0)
            snprintf(blur, sizeof blur, "%.1f", k->blur);
        for (size_t i = 0; l->result.there && l->result.e == PVX_OK && i < l->result.n; i++)
            if (l->result.of[i] == c)
                snprintf(trust, sizeof trust, "%.3f voxels",
                         l->result.report.camera[i].expected.voxels_95);
        page_line(p, "%-12.12s %5.1f/s  %-18s %6zu %6.0f %% %9s %-12s %s%s%.60s",
                  screen_name_of(l, c), k->fps, sees, k->boards,
                  100.0 * __builtin_popcountll(k->places) / LIVE_PLACES, blur, light, trust,
                  k->error[0] != '\0' ? "  " : "", k->error);
    }
}

/* The pairs that hold the rig together, as many in a line as fit. */
static void draw_graph(struct page *p, const struct live *l)
{
    struct calibrate_graph g;
    char text[400] = "", missing[400];
    size_t n = 0;
    calibrate_graph(l->common, l->job.look.n_cameras, &g);
    for (size_t i = 0; i < g.n_tree; i++) {
        if (n > 0 && n + 24 > (size_t)(p->cols > 60 ? p->cols - 10 : 50)) {
            page_line(p, "joined    %s", text);
            n = 0;
        }
        n = screen_add(text, sizeof text, n, "%s%s-%s %u", n > 0 ? "   " : "",
                       screen_name_of(l, g.tree[i].a), screen_name_of(l, g.tree[i].b),
                       g.tree[i].common);
    }
    page_line(p, "joined    %s", n > 0 ? text : "none yet: poses that two cameras see together");
    screen_say_missing(l, missing, sizeof missing);
    page_words(p, 9, "missing", missing[0] != '\0' ? missing : "nothing");
}

static void draw_findings(struct page *p, const struct live *l)
{
    const struct rec_calib_report *r = &l->result.report;
    for (size_t i = 0; l->result.there && i < r->n_findings && i < 3; i++)
        if (r->finding[i].severity == REC_CALIB_REFUSED)
            page_words(p, 9, "refused", r->finding[i].text);
        else if (r->finding[i].severity == REC_CALIB_WARNING &&
                 r->finding[i].what != REC_CALIB_VERDICT &&
                 r->finding[i].what != REC_CALIB_WEAK_PAIR)
            page_words(p, 9, "warning", r->finding[i].text);
}

/* What a person has to act on stands above the tables, which a small terminal may cut off. */
static void screen_draw_page(const struct live *l)
{
    static struct page p;
    char text[500];
    page_begin(&p);
    page_line(&p, "pyrovox calibrate live   %zu poses in %s   %.1f s per solution", l->poses,
              l->frames, l->result.seconds);
    page_line(&p, "Ctrl-C ends, keeps every picture and writes %s", l->a->out);
    page_line(&p, "%s", "");
    say_now(l, text, sizeof text);
    page_words(&p, 9, "NOW", text);
    say_advice(l, text, sizeof text);
    page_words(&p, 9, "NEXT", text);
    say_error(l, text, sizeof text);
    page_words(&p, 9, "expected", text);
    draw_findings(&p, l);
    page_line(&p, "%s", "");
    screen_draw_cameras(&p, l);
    page_line(&p, "%s", "");
    draw_graph(&p, l);
    page_show(&p);
}

/* ---- lines ---- */

static void print_lines(struct live_screen *s, const struct live *l)
{
    char text[500];
    if (l->taken_now > s->said_taken) {
        printf("number %u taken:", l->last);
        for (uint32_t c = 0; c < l->job.look.n_cameras; c++)
            printf(" %s %zu", screen_name_of(l, c), l->camera[c].corners);
        screen_say_missing(l, text, sizeof text);
        printf(" corners%s%s\n", text[0] != '\0' ? "; missing: " : "", text);
        s->said_taken = l->taken_now;
    }
    bool trouble = l->now == LIVE_OPENING || l->now == LIVE_UNSEEN || l->now == LIVE_ALONE ||
                   l->now == LIVE_MISSING;
    if (trouble && l->now != s->said_now) {
        say_now(l, text, sizeof text);
        printf("%s\n", text);
    }
    s->said_now = trouble ? l->now : s->said_now;
    if (l->result.there && l->result.poses > s->said_poses) {
        say_error(l, text, sizeof text);
        printf("after %zu poses, %.2f s: %s\n", l->result.poses, l->result.seconds, text);
        say_advice(l, text, sizeof text);
        printf("next: %s\n", text);
        s->said_poses = l->result.poses;
    }
    fflush(stdout);
}

void live_screen_open(struct live_screen *s)
{
    *s = (struct live_screen){.tty = isatty(STDOUT_FILENO), .said_now = LIVE_TAKEN};
    if (s->tty)
        page_open();
}

void live_screen_draw(struct live_screen *s, struct live *l)
{
    int64_t now = pvx_now_mono();
    if (s->tty && now < s->next_ns)
        return;
    s->next_ns = now + REDRAW_NS;
    pthread_mutex_lock(&l->lock);
    if (s->tty)
        screen_draw_page(l);
    else if (!l->a->quiet)
        print_lines(s, l);
    pthread_mutex_unlock(&l->lock);
}

void live_screen_close(struct live_screen *s)
{
    if (s->tty)
        page_close();
    s->tty = false;
}
