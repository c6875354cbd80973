#include "daemon/cli/running/screen.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/cli/common/ask.h"
#include "daemon/cli/common/page.h"
#include "daemon/cli/running/status_cameras.h"
#include "daemon/cli/running/status_compute.h"
#include "daemon/cli/running/status_ring.h"

#define REDRAW_NS (300 * PVX_NS_PER_MS)
#define LINE_NS   (60 * PVX_NS_PER_S) /* longest time between lines off a terminal */
#define LABEL     12                  /* columns of a camera's name */

static void bar(double share, char out[31])
{
    int n = (int)(share * 30 + 0.5);
    memset(out, '.', 30);
    memset(out, '#', (size_t)(n < 0 ? 0 : n > 30 ? 30 : n));
    out[30] = '\0';
}

static void draw_daemon(struct page *p, const struct follow *f)
{
    const cJSON *s = f->status;
    double total = 0;
    for (int a = 0; a < 3; a++) {
        double n = (double)f->last.grid.n[a];
        total = a == 0 ? n : total * n;
    }
    const struct pvp_report *r = &f->last.report;
    double active = r->active_voxels;
    page_line(p, "latency  p50 %6.1f ms   p99 %6.1f ms   max %6.1f ms   (received -> sent)",
              ask_num(s, "latency_ms", "p50"), ask_num(s, "latency_ms", "p99"),
              ask_num(s, "latency_ms", "max"));
    page_line(p, "spread   p50 %6.2f ms   p99 %6.2f ms   (exposures within a set)",
              ask_num(s, "spread_ms", "p50"), ask_num(s, "spread_ms", "p99"));
    char b[31];
    bar(total > 0 ? active / total : 0, b);
    page_line(p, "hull     %6.0f of %.0f voxels [%s] %4.1f %%", active, total, b,
              total > 0 ? 100 * active / total : 0);
    page_line(p, "solver   %s, %u iterations, residual %.4f, %.2f M entries, %.0f kB/volume",
              r->solver, r->iterations, r->rel_residual, (double)r->entries * 1e-6,
              ask_num(s, "last", "bytes") * 1e-3);
    page_line(p, "ms       photometry %.1f   hull %.1f   restrict %.1f   solve %.1f",
              (double)r->photometry_ns * 1e-6, (double)r->hull_ns * 1e-6,
              (double)r->restrict_ns * 1e-6, (double)r->solve_ns * 1e-6);
}

static void draw_compute(struct page *p, const cJSON *s)
{
    char text[STATUS_LINE];
    if (compute_line(s, text, sizeof text) > 0)
        page_words(p, 8, "compute", text);
}

static void draw_stages(struct page *p, const cJSON *s)
{
    char text[256] = "";
    size_t n = 0;
    const cJSON *k;
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "stages")) if (n < sizeof text) n +=
        (size_t)snprintf(text + n, sizeof text - n, "%s%s %.1f ms (p99 %.1f, %.0f waiting)",
                         n > 0 ? ", " : "", ask_text(k, "name", NULL), ask_num(k, "mean_ms", NULL),
                         ask_num(k, "p99_ms", NULL), ask_num(k, "queued", NULL));
    page_words(p, 8, "stages", text);
}

/* Draw the places that lost sets: sets that did not become a volume or were not recorded. */
static void draw_drops(struct page *p, const cJSON *s)
{
    char text[400] = "";
    size_t n = 0;
    const cJSON *k;
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "drops"))
    {
        if (n < sizeof text && ask_num(k, "value", NULL) > 0)
            n += (size_t)snprintf(text + n, sizeof text - n, "%s%s %.0f", n > 0 ? ", " : "",
                                  ask_text(k, "name", NULL), ask_num(k, "value", NULL));
    }
    if (n < sizeof text && ask_num(s, "record", "sets_missed") > 0)
        snprintf(text + n, sizeof text - n, "%snot recorded %.0f", n > 0 ? ", " : "",
                 ask_num(s, "record", "sets_missed"));
    page_words(p, 8, "dropped", text[0] != '\0' ? text : "nothing");
}

static void draw_ring(struct page *p, const cJSON *s)
{
    char text[STATUS_LINE];
    const cJSON *k;
    if (ring_line(s, text, sizeof text) == 0)
        return;
    page_words(p, 8, "ring", text);
    cJSON_ArrayForEach(k, cJSON_GetObjectItemCaseSensitive(s, "triggers"))
    {
        trigger_line(k, text, sizeof text);
        page_words(p, 8, "trigger", text);
    }
}

static void draw_clients(struct page *p, const cJSON *s)
{
    if (cJSON_HasObjectItem(s, "keys"))
        page_line(p, "clients  %.0f subscribed, %.0f keys listed, %.0f refused",
                  ask_num(s, "subscribers", NULL), ask_num(s, "keys", "listed"),
                  ask_num(s, "keys", "refused"));
    else
        page_line(p, "clients  %.0f subscribed; no keys", ask_num(s, "subscribers", NULL));
}

static void running_draw_cameras(struct page *p, const cJSON *s)
{
    const cJSON *k, *all = cJSON_GetObjectItemCaseSensitive(s, "cameras");
    char text[STATUS_LINE], agrees[16], gain[16];
    page_line(p, "%-*s %-8s %7s %9s %5s %5s %5s %5s %6s %5s", LABEL, "camera", "state", "fps",
              "frames", "bad", "late", "gaps", "lost", "agrees", "gain");
    cJSON_ArrayForEach(k, all)
    {
        bool seen = ask_num(k, "check", "sets") > 0; /* false: not checked by the flame yet */
        snprintf(agrees, sizeof agrees, seen ? "%.3f" : "-",
                 ask_num(k, "check", "agreement_displaced"));
        snprintf(gain, sizeof gain, seen ? "%.2f" : "-", ask_num(k, "check", "gain"));
        page_line(p, "%-*.*s %-8s %7.2f %9.0f %5.0f %5.0f %5.0f %5.0f %6s %5s", LABEL, LABEL,
                  ask_text(k, "name", NULL), ask_text(k, "state", NULL), ask_num(k, "fps", NULL),
                  ask_num(k, "counts", "received"),
                  ask_num(k, "counts", "incomplete") + ask_num(k, "counts", "bad_size"),
                  ask_num(k, "counts", "late") + ask_num(k, "counts", "unmatched"),
                  ask_num(k, "counts", "id_gap"), ask_num(k, "counts", "lost_camera"), agrees,
                  gain);
    }
    cJSON_ArrayForEach(k, all)
    {
        camera_trouble(k, text);
        page_words(p, LABEL, ask_text(k, "name", NULL), text);
        page_words(p, LABEL, ask_text(k, "name", NULL), selfcal_words(k, text, sizeof text));
    }
}

static void running_draw_page(const struct follow *f, const char *title, const char *foot)
{
    static struct page p;
    page_begin(&p);
    if (title != NULL)
        page_line(&p, "%s", title);
    char verdict[STATUS_LINE]; /* above all that a small terminal may cut off */
    (void)verdict_line(f->status, verdict);
    page_words(&p, 8, "verdict", f->status != NULL ? verdict : "-");
    page_line(&p, "%s", "");
    page_line(&p, "sets     %6.2f/s   %llu received   %llu sets missing   %llu messages lost here",
              follow_rate(f), (unsigned long long)f->volumes, (unsigned long long)f->missing,
              (unsigned long long)f->lost);
    if (f->truth.known && f->error >= 0)
        page_line(&p, "error    %6.3f now   %.3f mean   (relative L2 against the known flame)",
                  f->error, f->error_n == 0 ? f->error : f->error_sum / (double)f->error_n);
    if (ask_text(f->status, "open_to_all", NULL)[0] != '\0')
        page_line(&p, "insecure %s is open to all who reach it",
                  ask_text(f->status, "open_to_all", NULL));
    draw_daemon(&p, f);
    draw_compute(&p, f->status);
    draw_stages(&p, f->status);
    draw_clients(&p, f->status);
    draw_drops(&p, f->status);
    draw_ring(&p, f->status);
    page_line(&p, "%s", "");
    running_draw_cameras(&p, f->status);
    if (f->ended)
        page_line(&p, "the daemon has ended: %s", f->end_reason);
    if (foot != NULL) {
        page_line(&p, "%s", "");
        page_line(&p, "%s", foot);
    }
    page_show(&p);
}

static void draw_line(const struct screen *s, const struct follow *f)
{
    printf("%6.1f s  %6.2f sets/s  %llu sets  %llu sets missing  %llu messages lost  latency p50 "
           "%.1f p99 %.1f ms"
           "  hull %u  residual %.4f",
           (double)(pvx_now_mono() - s->t0_ns) * 1e-9, follow_rate(f),
           (unsigned long long)f->volumes, (unsigned long long)f->missing,
           (unsigned long long)f->lost, ask_num(f->status, "latency_ms", "p50"),
           ask_num(f->status, "latency_ms", "p99"), f->last.report.active_voxels,
           f->last.report.rel_residual);
    if (f->truth.known && f->error >= 0)
        printf("  error %.3f", f->error);
    printf("\n");
    fflush(stdout);
}

void screen_open(struct screen *s)
{
    *s = (struct screen){.tty = isatty(STDOUT_FILENO), .open = true, .t0_ns = pvx_now_mono()};
    if (s->tty)
        page_open();
}

void screen_draw(struct screen *s, const struct follow *f, const char *title, const char *foot)
{
    int64_t now = pvx_now_mono(), since = now - s->t0_ns;
    if (!s->open || now < s->next_ns || (!s->tty && f->volumes == 0))
        return;
    int64_t line = since < PVX_NS_PER_S ? PVX_NS_PER_S : since < LINE_NS ? since : LINE_NS;
    s->next_ns = now + (s->tty ? REDRAW_NS : line);
    if (s->tty)
        running_draw_page(f, title, foot);
    else
        draw_line(s, f);
}

void screen_close(struct screen *s)
{
    if (s->open && s->tty)
        page_close();
    s->open = false;
}
