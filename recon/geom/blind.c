#include "recon/geom/blind.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define TINY    0.03 /* of the picture's shorter side */
#define PLAIN   0.01 /* the same: wrong units make it smaller than this */
#define FITS    0.2  /* share of the volume that a camera sees by a reading that fits */
#define LITTLE  0.5 /* mean share; if the cameras see less, another reading is believed that shows */
#define WHOLE   0.9  /* this much */
#define MIDDLE  0.12 /* of the picture's size: a principal point is this near to its middle */
#define ODD     1.5  /* fx over fy, or the other way round, is less */
#define SQUARE  1.25 /* the same, where the order of K is beyond doubt */
#define ALIKE   0.03 /* cx and cy as shares of the picture, of their sum */
#define GREATER 6 /* times a camera's distance from the origin: a volume in other units is larger */
#define EACH    0.95 /* a reading that changes one thing more must show more by this */
#define TRIED   5    /* points along each side of the volume: for readings, */
#define LOOKED  16   /* and before a camera is called blind */

enum pose { AS_GIVEN, TO_WORLD, PLACE, TRANSPOSED, N_POSES };
static const char *const pose_words[N_POSES] = {
    [TO_WORLD] = "R and t lead from the camera to the world (give R transposed and -R^T t)",
    [PLACE] = "t is the camera's place (give -R t)",
    [TRANSPOSED] = "R is transposed",
};
static const struct {
    double by;
    const char *words;
} units[] = {
    {1, NULL},
    {1e-3, "t is in millimetres (give t / 1000)"},
    {1e-2, "t is in centimetres (give t / 100)"},
    {1e3, "the volume is in millimetres (give min and max / 1000)"},
    {1e2, "the volume is in centimetres (give min and max / 100)"},
};
/* by 0: such that cx and cy are in the middle of the picture. */
static const struct {
    double by;
    int order[4]; /* place of fx, fy, cx, cy in the K that is given */
    const char *words;
} lenses[] = {
    {1, {0, 1, 2, 3}, NULL},
    {0.5, {0, 1, 2, 3}, "K is that of pictures of twice the size (give K / 2)"},
    {0.25, {0, 1, 2, 3}, "K is that of pictures of four times the size (give K / 4)"},
    {2, {0, 1, 2, 3}, "K is that of pictures of half the size (give K * 2)"},
    {0,
     {0, 1, 2, 3},
     "K is in millimetres or that of pictures of another size (give it in pixels)"},
    {1, {0, 2, 1, 3}, "K is in the order fx, cx, fy, cy (give fx, fy, cx, cy)"},
    {1, {2, 3, 0, 1}, "K is in the order cx, cy, fx, fy (give fx, fy, cx, cy)"},
};
#define COUNT(a) (sizeof(a) / sizeof *(a))

_Static_assert(REC_READINGS == N_POSES * 2 * COUNT(units) * COUNT(lenses), "readings");

struct reading {
    enum pose pose;
    bool opengl; /* the camera's y is up, and it looks along -z */
    size_t unit, lens;
};

static int blind_changes(struct reading w)
{
    return (w.pose != AS_GIVEN) + w.opengl + (w.unit > 0) + (w.lens > 0);
}

static void blind_read_lens(struct rec_camera *c, size_t lens)
{
    const double K[4] = {c->fx, c->fy, c->cx, c->cy};
    const int *at = lenses[lens].order;
    double k = lenses[lens].by;
    if (!(k > 0)) /* mean of both directions */
        k = 0.5 * (c->width / (2 * c->cx + 1) + c->height / (2 * c->cy + 1));
    c->fx = K[at[0]] * k;
    c->fy = K[at[1]] * k;
    c->cx = (K[at[2]] + 0.5) * k - 0.5;
    c->cy = (K[at[3]] + 0.5) * k - 0.5;
}

static struct rec_camera blind_read(const struct rec_camera *c, struct reading w)
{
    struct rec_camera o = *c;
    double t[3];
    if (blind_changes(w) > 0)
        o.n_windows = 0; /* they stand before the camera where it was */
    for (int i = 0; i < 3; i++)
        o.t[i] = t[i] = c->t[i] * units[w.unit].by;
    for (int i = 0; i < 9 && (w.pose == TO_WORLD || w.pose == TRANSPOSED); i++)
        o.R[i] = c->R[3 * (i % 3) + i / 3];
    for (int i = 0; i < 3 && (w.pose == TO_WORLD || w.pose == PLACE); i++)
        o.t[i] = -(o.R[3 * i] * t[0] + o.R[3 * i + 1] * t[1] + o.R[3 * i + 2] * t[2]);
    for (int i = 1; i < 3 && w.opengl; i++) {
        o.t[i] = -o.t[i];
        for (int j = 0; j < 3; j++)
            o.R[3 * i + j] = -o.R[3 * i + j];
    }
    if (w.lens > 0)
        blind_read_lens(&o, w.lens);
    return o;
}

/* How far the volume's middle is from that of the picture, in pictures; 0: behind the camera. */
static double blind_off_middle(const struct rec_camera *c, const struct rec_grid *g)
{
    double X[3], uv[2];
    for (int a = 0; a < 3; a++)
        X[a] = 0.5 * (g->min[a] + g->max[a]);
    return rec_camera_project(c, X, uv)
               ? hypot((uv[0] + 0.5) / c->width - 0.5, (uv[1] + 0.5) / c->height - 0.5)
               : 0;
}

static bool blind_in_middle(const struct rec_camera *c)
{
    return fabs((c->cx + 0.5) / c->width - 0.5) < MIDDLE &&
           fabs((c->cy + 0.5) / c->height - 0.5) < MIDDLE;
}

/* Pixels that are not square, or a principal point that is not in the picture. */
static bool blind_odd(const struct rec_camera *c)
{
    const double wide = c->fx / c->fy;
    return wide > SQUARE || wide < 1 / SQUARE || c->cx < 0 || c->cy < 0 || c->cx > c->width ||
           c->cy > c->height;
}

/* Once the lens is read so, and not before, the principal point is near the middle of the picture.  The volume is
 * nearer to it than before.  In pictures that are cut from larger ones it is not. */
static bool blind_lens_fits(const struct rec_camera *c, const struct rec_grid *g, size_t lens)
{
    if (c->model >= REC_TELECENTRIC)
        return false; /* its K is per metre, or not there */
    struct rec_camera as = blind_read(c, (struct reading){.lens = lens});
    const double wide = as.fx / as.fy, across = (c->cx + 0.5) / c->width,
                 down = (c->cy + 0.5) / c->height;
    if (!(lenses[lens].by > 0) && fabs(across - down) > ALIKE * (across + down))
        return false; /* cut out of a larger picture */
    if (lenses[lens].order[0] + lenses[lens].order[1] != 1 && !blind_odd(c))
        return false; /* a right order gives a right lens */
    for (size_t k = 1; k < lens && !(lenses[lens].by > 0); k++)
        if (blind_lens_fits(c, g, k))
            return false; /* the better known one */
    return blind_in_middle(&as) && !blind_in_middle(c) && wide < ODD && wide > 1 / ODD &&
           blind_off_middle(&as, g) <= blind_off_middle(c, g);
}

/* The volume is so much larger than the camera's distance from the origin that their units may differ. */
static bool blind_huge(const struct rec_camera *c, const struct rec_grid *g)
{
    double at[3], far = 0, side = 0;
    rec_camera_centre(c, at);
    for (int a = 0; a < 3; a++) {
        far += at[a] * at[a];
        side = fmax(side, g->max[a] - g->min[a]);
    }
    return side > GREATER * sqrt(far);
}

/* How a camera sees the volume, by n^3 points. */
struct look {
    double share; /* of the points; 0 if `tiny` or `inside` */
    bool tiny, inside, behind;
    bool plain; /* it sees some of it, though it is `tiny` or the camera `inside` */
};
static struct look blind_look(const struct rec_camera *c, const struct rec_grid *g, int n)
{
    double centre[3], lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY}, X[3], uv[2];
    int seen = 0, front = 0;
    struct look l = {.inside = true};
    rec_camera_centre(c, centre);
    for (int a = 0; a < 3; a++)
        l.inside = l.inside && centre[a] > g->min[a] && centre[a] < g->max[a];
    for (int i = 0; i < n * n * n; i++) {
        const int at[3] = {i % n, i / n % n, i / n / n};
        for (int a = 0; a < 3; a++)
            X[a] = g->min[a] + (at[a] + 0.5) / n * (g->max[a] - g->min[a]);
        if (!rec_camera_project(c, X, uv))
            continue;
        front++;
        seen += rec_camera_sees(c, X, uv);
        for (int a = 0; a < 2; a++) {
            lo[a] = fmin(lo[a], uv[a]);
            hi[a] = fmax(hi[a], uv[a]);
        }
    }
    double side = fmax(hi[0] - lo[0], hi[1] - lo[1]) * n / (n - 1);
    const double shorter = c->width < c->height ? c->width : c->height;
    l.behind = front == 0;
    l.tiny = seen > 0 && side < TINY * shorter;
    l.share = l.tiny || l.inside ? 0 : (double)seen / (n * n * n);
    l.plain = seen > 0 && (l.inside || side >= PLAIN * shorter);
    return l;
}

/* The ray of a place in the picture, in pictures, crosses the volume. */
static bool blind_ray_crosses(const struct rec_camera *c, const struct rec_grid *g, double x,
                              double y)
{
    double o[3], d[3], from = 0, to = INFINITY;
    if (!rec_camera_ray(c, x * c->width - 0.5, y * c->height - 0.5, o, d))
        return false;
    for (int a = 0; a < 3; a++) {
        double s = (g->min[a] - o[a]) / d[a], e = (g->max[a] - o[a]) / d[a];
        from = fmax(from, fmin(s, e)); /* of a ray along the side, both are infinite */
        to = fmin(to, fmax(s, e));
    }
    return from < to;
}

/* A ray of the picture crosses the volume.  A long lens may see none of the points in it. */
static bool blind_crosses(const struct rec_camera *c, const struct rec_grid *g)
{
    bool crosses = false;
    for (int i = 0; i < TRIED * TRIED && !crosses; i++)
        crosses = blind_ray_crosses(c, g, (i % TRIED + 0.5) / TRIED, (i / TRIED + 0.5) / TRIED);
    return crosses;
}

/* What the cameras of a set see by a reading: the sum of their shares, and how many see FITS of the volume. */
struct trial {
    struct reading as;
    double sum;
    size_t fits;
};
static struct trial blind_try(const struct rec_rig *r, uint64_t set, struct reading w)
{
    struct trial t = {.as = w};
    for (size_t c = 0; c < r->n_cameras; c++) {
        if ((set >> c & 1) == 0)
            continue;
        struct rec_camera o = blind_read(&r->cameras[c], w);
        bool possible = (w.lens == 0 || blind_lens_fits(&r->cameras[c], &r->grid, w.lens)) &&
                        (units[w.unit].by <= 1 || blind_huge(&r->cameras[c], &r->grid));
        double share = possible ? blind_look(&o, &r->grid, TRIED).share : 0;
        t.sum += share;
        t.fits += share >= (w.unit > 0 ? LITTLE : FITS);
    }
    return t;
}

/* Reading i, and how many things it changes; 0: it is not tried. */
static int blind_nth(size_t i, struct reading *w)
{
    *w = (struct reading){.pose = (enum pose)(i % N_POSES),
                          .opengl = i / N_POSES % 2 == 1,
                          .unit = i / N_POSES / 2 % COUNT(units),
                          .lens = i / N_POSES / 2 / COUNT(units)};
    int n = blind_changes(*w);
    if (w->lens > 0 && n > 1)
        return 0;
    return lenses[w->lens].by > 0 ? n : 2; /* any size explains more than a certain one */
}

/* The reading by which they see most.  Few cameras fit many readings, so one alone is tried with one change. */
static struct trial blind_best(const struct rec_rig *r, uint64_t set, int most)
{
    struct trial best = {.fits = 0};
    double value = 0;
    for (size_t i = 0; i < REC_READINGS; i++) {
        struct reading w;
        int changes = blind_nth(i, &w);
        if (changes == 0 || changes > most)
            continue;
        struct trial t = blind_try(r, set, w);
        double worth = t.sum * pow(EACH, changes);
        if (worth > value) {
            value = worth;
            best = t;
        }
    }
    return best;
}

struct words {
    char *text;
    size_t size, n;
};
__attribute__((format(printf, 2, 3))) static void blind_say(struct words *w, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(w->text + w->n, w->size - w->n, fmt, args);
    va_end(args);
    w->n += n < 0 ? 0 : (size_t)n < w->size - w->n ? (size_t)n : w->size - w->n - 1;
}

static void blind_say_reading(struct words *w, struct reading r)
{
#define OPENGL "the camera's axes are OpenGL's (change the signs of rows 2 and 3 of R and t)"
    const char *axes = !r.opengl               ? NULL
                       : blind_changes(r) == 1 ? OPENGL
                           ", or it looks away from the flame (those of rows 1 and 3)"
                                               : OPENGL;
    const char *all[] = {pose_words[r.pose], axes, units[r.unit].words, lenses[r.lens].words};
    const char *join = "if ";
    for (size_t i = 0; i < COUNT(all); i++)
        if (all[i] != NULL) {
            blind_say(w, "%s%s", join, all[i]);
            join = ", and ";
        }
}

static void blind_say_cameras(struct words *w, const struct rec_rig *r, uint64_t set)
{
    const char *join = "";
    for (size_t c = 0, n = 0; c < r->n_cameras; c++)
        if ((set >> c & 1) != 0 && n++ < 8) {
            blind_say(w, "%s%s", join, r->cameras[c].name);
            join = ", ";
        }
    if (__builtin_popcountll(set) > 8)
        blind_say(w, " and %d more", __builtin_popcountll(set) - 8);
}

/* Cameras of one kind: "cam1, cam2: ...". */
static void blind_say_kind(struct words *w, const struct rec_rig *r, uint64_t set, const char *one)
{
    if (set == 0)
        return;
    blind_say(w, "%s", w->n > 0 ? "; " : "");
    blind_say_cameras(w, r, set);
    blind_say(w, ": %s", one);
}

/* The principal points of all cameras are near the middle of pictures of [h, w] only. */
static enum rec_blind blind_size(const struct rec_rig *r, struct words *w)
{
    for (size_t c = 0; c < r->n_cameras; c++) {
        struct rec_camera as = r->cameras[c];
        as.width = r->cameras[c].height;
        as.height = r->cameras[c].width;
        if (!blind_in_middle(&as) || blind_in_middle(&r->cameras[c]))
            return REC_BLIND_NONE;
    }
    blind_say(
        w,
        "cx and cy of all cameras are near the middle of their pictures only if width and height "
        "are swapped (give size: [%d, %d])",
        r->cameras[0].height, r->cameras[0].width);
    return REC_BLIND_SOME;
}

/* A K for smaller pictures still shows the volume, too small and beside the middle. */
static enum rec_blind blind_lens(const struct rec_rig *r, struct words *w)
{
    for (size_t k = 1; k < COUNT(lenses) && r->n_cameras > 1; k++) {
        size_t fits = 0;
        while (fits < r->n_cameras && blind_lens_fits(&r->cameras[fits], &r->grid, k))
            fits++;
        if (fits < r->n_cameras)
            continue;
        blind_say(w, "cx and cy of all cameras are near the middle of their pictures only ");
        blind_say_reading(w, (struct reading){.lens = k});
        return REC_BLIND_SOME;
    }
    return REC_BLIND_NONE;
}

#define DEFINED "in rig.yaml X_cam = R X + t, in metres, with x right, y down, z forward"

/* The middle of one camera's picture is beside the volume.  All others look at the volume, and so would it by another
 * pose that shows it more than twice as much. */
static enum rec_blind blind_beside(const struct rec_rig *r, struct words *w)
{
    size_t beside = 0;
    uint64_t set = 0;
    struct look l = {.share = 0};
    for (size_t c = 0; c < r->n_cameras; c++)
        if (!blind_ray_crosses(&r->cameras[c], &r->grid, 0.5, 0.5)) {
            set |= (uint64_t)1 << c;
            beside = c;
        }
    if (__builtin_popcountll(set) == 1)
        l = blind_look(&r->cameras[beside], &r->grid, LOOKED);
    if (r->n_cameras < 3 || l.share == 0)
        return REC_BLIND_NONE;
    struct trial t = blind_best(r, set, 1);
    struct rec_camera as = blind_read(&r->cameras[beside], t.as);
    if (t.sum < WHOLE || l.share >= LITTLE * t.sum || t.as.unit > 0 || t.as.lens > 0 ||
        !blind_ray_crosses(&as, &r->grid, 0.5, 0.5))
        return REC_BLIND_NONE;
    blind_say(w, "%s sees only %.0f %% of the volume, beside the middle of its picture; ",
              r->cameras[beside].name, 100 * l.share);
    blind_say(w, "it would see %.0f %% ", 100 * t.sum);
    blind_say_reading(w, t.as);
    blind_say(w, ": " DEFINED);
    return REC_BLIND_SOME;
}

/* Two cameras in one place with one view: most often an entry that was copied. */
static enum rec_blind blind_twins(const struct rec_rig *r, struct words *w)
{
    for (size_t a = 0; a < r->n_cameras; a++)
        for (size_t b = a + 1; b < r->n_cameras; b++) {
            const struct rec_camera *q = &r->cameras[a], *o = &r->cameras[b];
            double apart = 0, size = 0;
            for (int i = 0; i < 9; i++)
                apart = fmax(apart, fabs(q->R[i] - o->R[i]));
            for (int i = 0; i < 3; i++)
                size = fmax(size, fabs(q->t[i]));
            for (int i = 0; i < 3; i++)
                apart = fmax(apart, fabs(q->t[i] - o->t[i]) / size);
            if (apart > 1e-6)
                continue;
            blind_say(w, "%s and %s have the same R and t: was one copied from the other?", q->name,
                      o->name);
            return REC_BLIND_SOME;
        }
    return REC_BLIND_NONE;
}

enum rec_blind rec_rig_blind(const struct rec_rig *r, char *text, size_t size)
{
    struct words w = {text, size, 0};
    uint64_t blind = 0, tiny = 0, inside = 0, behind = 0;
    const size_t all = r->n_cameras;
    double sum = 0;
    bool plain = false;
    text[0] = '\0';
    for (size_t c = 0; c < all; c++) {
        struct look l = blind_look(&r->cameras[c], &r->grid, LOOKED);
        const uint64_t bit = (uint64_t)1 << c;
        bool sees =
            l.share > 0 || (!l.tiny && !l.inside && blind_crosses(&r->cameras[c], &r->grid));
        sum += l.share;
        plain = plain || l.plain;
        blind |= sees ? 0 : bit;
        tiny |= l.tiny && !l.inside ? bit : 0;
        inside |= l.inside ? bit : 0;
        behind |= l.behind && !l.inside ? bit : 0;
    }
    const size_t n = (size_t)__builtin_popcountll(blind);
    if (n == 0 && sum >= LITTLE * (double)all)
        return blind_size(r, &w) != REC_BLIND_NONE || blind_lens(r, &w) != REC_BLIND_NONE ||
                       blind_beside(r, &w) != REC_BLIND_NONE
                   ? REC_BLIND_SOME
                   : blind_twins(r, &w);
    const uint64_t every = all < 64 ? ((uint64_t)1 << all) - 1 : UINT64_MAX;
    struct trial t = blind_best(r, every, 3);
    bool fits = t.sum >= WHOLE * (double)all && sum < LITTLE * (double)all;
    if (n == all && inside == 0)
        fits = !plain && 2 * t.fits > all;
    if (n == 0 && !fits)
        return REC_BLIND_NONE; /* they look at a part of a large volume */
    bool none = n == all && !plain && (fits || (tiny | inside) == 0);
    if (none)
        blind_say(&w, "no camera sees the volume");
    else if (n == 0)
        blind_say(&w, "the cameras see only %.0f %% of the volume", 100 * sum / (double)all);
    else {
        blind_say_kind(&w, r, behind, "the volume is behind it");
        blind_say_kind(&w, r, inside, "it stands inside the volume");
        blind_say_kind(&w, r, tiny, "the volume is less than 3 % of its picture");
        blind_say_kind(&w, r, blind & ~(behind | inside | tiny),
                       "the volume is not in its picture");
    }
    size_t of = all;
    if (!fits && n < all) { /* some cameras alone */
        t = blind_best(r, blind, n > 1 ? 3 : 1);
        fits = 2 * t.fits > n;
        of = n;
    }
    if (fits) {
        blind_say(&w, "; %zu of %zu would see it ", t.fits, of);
        blind_say_reading(&w, t.as);
        blind_say(&w, ": " DEFINED);
    } else {
        blind_say(&w, "; check R, t, K and the volume's min and max: " DEFINED);
    }
    return none ? REC_BLIND_ALL : REC_BLIND_SOME;
}

int rec_blind_reading(const struct rec_rig *r, size_t i, struct rec_camera *as, char *text,
                      size_t size)
{
    struct reading w;
    struct words out = {text, size, 0};
    int changes = blind_nth(i, &w);
    for (size_t c = 0; c < r->n_cameras; c++)
        as[c] = blind_read(&r->cameras[c], w);
    text[0] = '\0';
    blind_say_reading(&out, w);
    return changes;
}
