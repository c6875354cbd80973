/* optics.h - rays through real optics, traced surface by surface: what the camera models are held against.  It shares
 * no code and no formula with recon/geom: Snell's law in vectors at each face, a sensor as a plane in space. */
#ifndef T_OPTICS_H
#define T_OPTICS_H
#include <math.h>
#include <stdbool.h>

struct optics_plate { /* n . x = at on the face that light from the flame meets last */
    double n[3], at, thickness, index;
};

static inline double optics_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Moves o along d to the plane n . x = at. */
static inline void optics_go(double o[3], const double d[3], const double n[3], double at)
{
    double s = (at - optics_dot(n, o)) / optics_dot(n, d);
    for (int a = 0; a < 3; a++)
        o[a] += s * d[a];
}

/* Snell's law at a plane with normal n, index from `from` to `to`: d (unit) bends.  False: total reflection. */
static inline bool optics_bend(double d[3], const double n[3], double from, double to)
{
    double c = optics_dot(n, d), r = from / to, side = c < 0 ? -1 : 1;
    double t[3], sine2 = 0; /* the tangential part scales by r */
    for (int a = 0; a < 3; a++) {
        t[a] = r * (d[a] - c * n[a]);
        sine2 += t[a] * t[a];
    }
    if (sine2 >= 1)
        return false;
    for (int a = 0; a < 3; a++)
        d[a] = t[a] + side * sqrt(1 - sine2) * n[a];
    return true;
}

/* A ray from the camera through one plate after the other. */
static inline bool optics_plates(const struct optics_plate *p, int n, double o[3], double d[3])
{
    for (int i = 0; i < n; i++) {
        optics_go(o, d, p[i].n, p[i].at);
        if (!optics_bend(d, p[i].n, 1, p[i].index))
            return false;
        optics_go(o, d, p[i].n, p[i].at + p[i].thickness);
        if (!optics_bend(d, p[i].n, p[i].index, 1))
            return false;
    }
    return true;
}
#endif
