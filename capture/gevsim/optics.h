/* optics.h - the effects and faults of lens and sensor on a picture.  The simulated cameras and the tests without a
 * network use the same arithmetic.
 *
 *     P = mirror(blur(shift(F))) + B          F the flame's picture, linear, 1 = full scale; outside of it 0
 *     P = S  with flat,  B  with empty,  0  with cap,  1000  with flood; cap before flood before flat
 *     v = min(exposure gain V P, 1000)^response + pedestal + H                                   (1)
 * Then follow the caller's noise, clipping to 0..1 and rounding, in this order.  So noise does not scale with the
 * signal, and clipping comes after exposure.
 *
 *     shift       (dx,dy) px: F(x - dx, y - dy), to the right and down; Catmull and Rom's cubic between pixels
 *     blur        Gaussian of standard deviation sigma px, each way, cut at 4 sigma
 *     mirrored    left to right, F only
 *     flat        place n = 1, 2 ... of a diffuse source that fills the view: S = 1/2 (1 + (u cos a + v sin a)/10),
 *                 a = (n - 1) 90 degrees, and 45 more for every fourth; u, v = -1..1 from edge to edge.  The mean of
 *                 four places is even
 *     background  B = background (0.6 + 0.4 sin(7 u + p) cos(5 v + q)), p and q by the seed; shifted as F is
 *     vignetting  V = (1 + t rho^2)^-2, cos^4 of the angle; rho = 1 and V = 1 - vignetting in the corner
 *     response    exponent; 1 = linear
 *     hot         share of pixels, the same ones for a seed, more of them for a larger share; H = 0.2..1 there
 * Source of (1): EMVA Standard 1288, release 4.0, section 2; cos^4: any textbook of optics.
 * Threads: pure. */
#ifndef CAP_OPTICS_H
#define CAP_OPTICS_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_OPTICS_SHIFT_MAX 16384 /* px */
#define CAP_OPTICS_BLUR_MAX  20    /* px */

struct cap_optics {
    double shift[2], blur; /* px */
    double flat;           /* place; 0 = the flame */
    double background;     /* full scale */
    double vignetting;     /* 0..0.99 */
    double gain, exposure; /* factors */
    double response;       /* > 0 */
    double pedestal;       /* full scale */
    double hot;            /* share */
    bool cap, flood, empty, mirrored;
    bool none[4]; /* fills the padding, because owners compare the struct as bytes */
};
extern const struct cap_optics cap_optics_none; /* gain, exposure and response 1, no pedestal */

struct cap_optics_shape {
    int32_t width, height;
    int nch;       /* samples of a pixel */
    uint64_t seed; /* of this camera's hot pixels and background */
};
/* image [h][w][nch]: F in, v out, never above 1000^response.  scratch has the same size.  All values must be finite
 * and in the ranges above.  Allocates nothing.
 * Cost: 640x480x3 2 ms; a response or a background 6 more, blur by 2 px 4, by 20 px 40. */
void cap_optics_apply(const struct cap_optics *o, const struct cap_optics_shape *s, float *image,
                      float *scratch);
#endif
