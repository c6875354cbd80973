/* paint.h - a small canvas: filled rectangles, lines, pictures and labels in one RGB image.
 * Coordinates are pixels from the top left.  Parts outside are cut off.  Colours are display values
 * 0..1.  Threads: one at a time per canvas. */
#ifndef PAINT_H
#define PAINT_H
#include <stdint.h>
#include "base/err.h"

struct paint {
    int32_t w, h;
    float *pix; /* [h][w][3] */
};
struct paint_rgb {
    float r, g, b;
};

/* Errors: PVX_ENOMEM.  Owner: caller, until paint_fini. */
PVX_MUST_CHECK pvx_err paint_init(struct paint *p, int32_t w, int32_t h, struct paint_rgb ground);
void paint_fini(struct paint *p);

void paint_dot(struct paint *p, int32_t x, int32_t y, struct paint_rgb c);
void paint_rect(struct paint *p, int32_t x, int32_t y, int32_t w, int32_t h, struct paint_rgb c);
void paint_line(struct paint *p, double x0, double y0, double x1, double y1, struct paint_rgb c);

/* Letters are 5 x 7 dots of `size` pixels, 6 dots apart; capitals are drawn as small letters.
 * Returns the width drawn. */
int32_t paint_text(struct paint *p, int32_t x, int32_t y, int size, struct paint_rgb c,
                   const char *text);

#endif
