/* check.c - the page of a check: the verdict, and each camera's picture compared with the other cameras. */
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/calibrate/check_say.h"
#include "daemon/cli/report/html.h"
#include "daemon/cli/report/plot.h"

#define WIDTH   480.0 /* of a drawing */
#define TYPICAL (WIDTH / 12)
#define LONGEST (WIDTH / 5)
#define SHOWN   0.02 /* share of the best window's weight that an arrow needs */
#define DEGREES 57.29577951308232

/* ---- the camera's picture as a bitmap inside the page: 8 bits, a palette, no library ---- */

enum { COLOURS = 256, HEAD = 54 };

static void put32(uint8_t *at, uint32_t v)
{
    for (int i = 0; i < 4; i++)
        at[i] = (uint8_t)(v >> 8 * i);
}

/* Colours of hot iron: black, red, yellow, white. */
static void palette(uint8_t *at)
{
    for (int i = 0; i < COLOURS; i++, at += 4) {
        int v = 3 * i;
        at[2] = (uint8_t)(v > 255 ? 255 : v);
        at[1] = (uint8_t)(v < 256 ? 0 : v > 511 ? 255 : v - 256);
        at[0] = (uint8_t)(v < 512 ? 0 : v - 512);
        at[3] = 0;
    }
}

static pvx_err bitmap(FILE *f, const struct rec_check_picture *q, double height)
{
    size_t w = (size_t)q->bw, h = (size_t)q->bh, row = (w + 3) / 4 * 4;
    size_t size = HEAD + (size_t)COLOURS * 4 + row * h;
    float top = 1e-9F;
    uint8_t *v = pvx_calloc(size, 1);
    PVX_NEED(v);
    for (size_t i = 0; i < w * h; i++)
        top = q->b[i] > top ? q->b[i] : top;
    v[0] = 'B', v[1] = 'M';
    put32(v + 2, (uint32_t)size);
    put32(v + 10, HEAD + COLOURS * 4);
    put32(v + 14, 40);
    put32(v + 18, (uint32_t)w);
    put32(v + 22, (uint32_t)h);
    v[26] = 1, v[28] = 8;
    put32(v + 34, (uint32_t)(row * h));
    put32(v + 46, COLOURS);
    palette(v + HEAD);
    for (size_t y = 0; y < h; y++) /* from the bottom up; the square root shows dim parts */
        for (size_t x = 0; x < w; x++) {
            float b = q->b[y * w + x] / top;
            v[HEAD + COLOURS * 4 + (h - 1 - y) * row + x] = (uint8_t)(b > 0 ? 255 * sqrtf(b) : 0);
        }
    fprintf(f,
            "<image x=\"0\" y=\"0\" width=\"%.0f\" height=\"%.1f\" preserveAspectRatio=\"none\" "
            "style=\"image-rendering:pixelated\" href=\"data:image/bmp;base64,",
            WIDTH, height);
    html_base64(f, v, size);
    fputs("\"/>", f);
    free(v);
    return PVX_OK;
}

/* ---- drawings over the picture ---- */

/* Outline of the hull: it follows the edges of the bins. */
static void outline(FILE *f, const struct rec_check_picture *q, double unit)
{
    float top = 0;
    for (size_t i = 0; i < (size_t)q->bw * (size_t)q->bh; i++)
        top = q->hull[i] > top ? q->hull[i] : top;
    fputs("<path class=\"outline\" d=\"", f);
    for (int32_t y = 0; y < q->bh && top > 0; y++)
        for (int32_t x = 0; x < q->bw; x++) {
            size_t i = (size_t)y * (size_t)q->bw + (size_t)x;
            bool in = q->hull[i] > 0.02F * top;
            bool left = x > 0 && q->hull[i - 1] > 0.02F * top;
            bool up = y > 0 && q->hull[i - (size_t)q->bw] > 0.02F * top;
            if (in != left)
                fprintf(f, "M%.1f %.1fv%.1f", x * unit, y * unit, unit);
            if (in != up)
                fprintf(f, "M%.1f %.1fh%.1f", x * unit, y * unit, unit);
        }
    fputs("\"/>", f);
}

static double weightiest(const struct rec_lattice *l)
{
    double most = 0, w, d[2];
    for (int i = 0; i < REC_LATTICE; i++)
        if (rec_shift_window(l, i, d, &w))
            most = fmax(most, w);
    return most;
}

/* Draw windows of enough weight as arrows that start where the flame should be. */
static void check_arrows(FILE *f, const struct rec_lattice *l, double height, double scale)
{
    double most = weightiest(l), w, d[2];
    for (int pass = 0; pass < 2; pass++) { /* a dark rim first: they lie on a flame */
        fprintf(f, "<path class=\"%s\" d=\"", pass == 0 ? "rim" : "off");
        for (int i = 0; i < REC_LATTICE; i++) {
            if (!rec_shift_window(l, i, d, &w) || !(w > SHOWN * most))
                continue;
            double x = (i % REC_LATTICE_X + 0.5) / REC_LATTICE_X * WIDTH;
            double y = (i / REC_LATTICE_X + 0.5) / REC_LATTICE_Y * height;
            double s = fmin(scale, LONGEST / hypot(d[0], d[1])), dx = s * d[0], dy = s * d[1];
            fprintf(f, "M%.1f %.1fl%.1f %.1fm%.1f %.1fL%.1f %.1fl%.1f %.1f", x, y, dx, dy,
                    -0.35 * dx - 0.22 * dy, -0.35 * dy + 0.22 * dx, x + dx, y + dy,
                    -0.35 * dx + 0.22 * dy, -0.35 * dy - 0.22 * dx);
        }
        fputs("\"/>", f);
    }
}

/* The factor that lengthens the arrows: one round number for all cameras, set by the largest shift that is drawn. */
static double enlargement(const struct check_result *r)
{
    double worst = 0.2;
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++) {
        const struct rec_check_camera *o = &r->verdict->figures.camera[c];
        if (o->wrong == REC_WRONG_NOTHING || o->wrong == REC_WRONG_MOVED)
            worst = fmax(worst, hypot(o->shift[0], o->shift[1]) / r->sets->params.binning);
    }
    double bins = r->sets->rig.cameras[0].width / r->sets->params.binning;
    return report_round(TYPICAL / worst * bins / WIDTH);
}

static pvx_err check_camera(FILE *f, const struct check_result *r, size_t c, double enlarged)
{
    const struct rec_check_camera *o = &r->verdict->figures.camera[c];
    struct rec_check_picture q;
    char text[CHECK_SENTENCE];
    PVX_TRY(rec_check_look(r->check, c, &q));
    double unit = WIDTH / q.bw, height = unit * q.bh;
    fprintf(f, "<figure><h3>");
    html_text(f, r->sets->rig.cameras[c].name);
    fprintf(f, "</h3><svg viewBox=\"-1 -1 %.0f %.1f\" role=\"img\">", WIDTH + 2, height + 2);
    if (q.b != NULL) {
        PVX_TRY(bitmap(f, &q, height));
        outline(f, &q, unit);
    }
    if (o->wrong == REC_WRONG_NOTHING || o->wrong == REC_WRONG_MOVED)
        check_arrows(f, rec_check_lattice(r->check, c), height, enlarged * unit);
    fprintf(f,
            "<rect class=\"frame\" x=\"0\" y=\"0\" width=\"%.0f\" height=\"%.1f\"/>"
            "</svg><figcaption>",
            WIDTH, height);
    check_sentence(r, c, text);
    html_text(f, text[0] != '\0' ? text : o->sets > 0 ? "agrees" : "sees none of it");
    fputs("</figcaption></figure>\n", f);
    return PVX_OK;
}

/* ---- the page ---- */

static void row(FILE *f, const struct check_result *r, size_t c)
{
    const struct rec_check_camera *o = &r->verdict->figures.camera[c];
    bool good = o->wrong == REC_WRONG_NOTHING, known = o->sets > 0;
    fputs("<tr><th>", f);
    html_text(f, r->sets->rig.cameras[c].name);
    fprintf(f, "</th><td class=\"%s\">%s</td>", good ? "good" : "bad",
            good ? (known ? "agrees" : "sees none") : rec_wrong_name(o->wrong));
    const struct {
        double v;
        int decimals;
    } cell[] = {
        {o->shift[0], 2},       {o->shift[1], 2},        {hypot(o->sigma[0], o->sigma[1]), 2},
        {o->roll * DEGREES, 1}, {100 * o->size, 1},      {o->gain, 2},
        {o->rho_moved, 3},      {100 * o->explained, 0}, {100 * o->lit, 0},
        {o->residual, 3},       {o->with_it, 3}};
    for (size_t i = 0; i < sizeof cell / sizeof *cell; i++)
        html_cell(f, known ? cell[i].v : NAN, cell[i].decimals);
    fputs("</tr>\n", f);
}

static void page_table(FILE *f, const struct check_result *r)
{
    fputs("<h2>Cameras</h2><div class=\"wide\"><table><tr><th>camera</th><th></th>"
          "<th class=\"n\">right px</th><th class=\"n\">down px</th><th class=\"n\">&#177;</th>"
          "<th class=\"n\">turned &#176;</th><th class=\"n\">size %</th><th class=\"n\">gain</th>"
          "<th class=\"n\">agrees</th><th class=\"n\">explained %</th><th class=\"n\">lit %</th>"
          "<th class=\"n\">residual</th><th class=\"n\">with it</th></tr>\n",
          f);
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++)
        row(f, r, c);
    fputs("</table></div><p class=\"mute\">Right, down, turned (clockwise), size: the flame in the "
          "camera's picture against where the others see it. Agrees: correlation with what they "
          "make of it. Explained: its own light inside their hull; lit: where they have light, it "
          "has some. Residual: of a volume made without the camera, and with it.</p>\n",
          f);
}

pvx_err check_html(FILE *f, const void *result)
{
    const struct check_result *r = result;
    static const char *const word[] = {"Agrees", "Wrong", "Cannot be told"};
    enum rec_check_outcome o = r->verdict->outcome;
    struct rec_check_set set;
    struct rec_check_source from = flame_sets_source((struct flame_sets *)r->sets, "report");
    char text[CHECK_SENTENCE];
    fprintf(f,
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>"
            "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"/>"
            "<title>Check: %s</title><style>\n%s"
            ".outline{fill:none;stroke:#35c4ff;stroke-width:1.4}"
            ".rim{fill:none;stroke:#000;stroke-width:5;stroke-opacity:.6}"
            ".off{fill:none;stroke:#7dff6a;stroke-width:2}"
            "</style></head>\n<body>\n<h1>A flame against its rig</h1>\n"
            "<div class=\"verdict %s\"><b>%s</b><p class=\"said\">",
            word[o], report_style, o == REC_CHECK_AGREES ? "good" : "bad", word[o]);
    check_conclusion(r, text);
    html_text(f, text);
    fputs("</p></div>\n<p class=\"mute\"><code>", f);
    html_text(f, r->rig);
    fputs("</code>, <code>", f);
    html_text(f, r->frames);
    fprintf(f, "</code>: %u frame sets.</p><ul class=\"findings\">", r->verdict->figures.sets);
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++) {
        check_sentence(r, c, text);
        if (text[0] == '\0')
            continue;
        fputs("<li class=\"refused\"><b>wrong</b><span>", f);
        html_text(f, text);
        fputs("</span></li>\n", f);
    }
    fputs("</ul>\n", f);
    page_table(f, r);
    double scale = enlargement(r);
    PVX_TRY(from.get(from.ctx, from.n / 2, &set));
    rec_check_load(r->check, &set);
    fprintf(f,
            "<h2>Pictures</h2><p class=\"mute\">Each camera's own picture of frame %llu, with the "
            "outline of the hull that the others give (blue). Arrows: from where the flame should "
            "be to where it is, over all sets, %g times as long as in the picture.</p>"
            "<div class=\"figures\">\n",
            (unsigned long long)set.number, scale);
    for (size_t c = 0; c < r->sets->rig.n_cameras; c++)
        PVX_TRY(check_camera(f, r, c, scale));
    fputs("</div>\n</body></html>\n", f);
    return PVX_OK;
}
