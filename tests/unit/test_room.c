/* test_room.c - light of a volume in the virtual room against closed forms and plain sums. */
#include "tests/lib/scene.h"

#include <float.h>

#include "recon/geom/traverse.h"
#include "recon/view/flame.h"
#include "recon/view/render.h"
#include "recon/view/room_int.h"
#include "recon/view/room_lamps.h"

static const double pi = 3.14159265358979323846;
static const struct rec_grid box10 = {{-0.5, -0.4, 0}, {0.5, 0.4, 1}, {10, 9, 11}, REC_BOX};

static rec_room *room_of(const struct rec_grid *g, pvx_pool *pool)
{
    rec_room *r;
    T_EQ_I(rec_room_new(g->min, g->max, pool, &r), PVX_OK);
    return r;
}

static float *zeros(const struct rec_grid *g, int nch)
{
    float *v = calloc(rec_grid_count(g) * (size_t)nch, sizeof *v);
    T_OK(v != NULL);
    return v;
}

static float *noise(const struct rec_grid *g, int nch)
{
    float *v = zeros(g, nch);
    for (size_t i = 0; i < rec_grid_count(g) * (size_t)nch; i++)
        v[i] = (float)fmax(0, t_uniform(-1, 1));
    return v;
}

static void centre(const struct rec_grid *g, int32_t index, double x[3])
{
    int32_t v[3];
    rec_grid_ijk(g, index, v);
    for (int a = 0; a < 3; a++)
        x[a] = g->min[a] + (v[a] + 0.5) * rec_grid_h(g, a);
}

static double volume_of(const struct rec_grid *g)
{
    return rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2);
}

/* Points of a body that lie on the way from p to q, by going there in small steps; `grown` m of body more. */
static int steps_inside(const struct room_body *b, const double p[3], const double q[3],
                        double grown)
{
    int n = 0;
    for (int k = 1; k < 4000; k++) {
        double d[3], x, y;
        for (int a = 0; a < 3; a++)
            d[a] = p[a] + (q[a] - p[a]) * k / 4000 - b->centre[a];
        x = d[0] * b->cosine + d[1] * b->sine;
        y = d[1] * b->cosine - d[0] * b->sine;
        n += fabs(x) < b->half[0] + grown && fabs(y) < b->half[1] + grown &&
             fabs(d[2]) < b->half[2] + grown;
    }
    return n;
}

/* room_lamps.h (1), term by term; scale: sum e dV / d^2 of what is above the horizon. */
static void plain_sum(const struct room_scene *s, const struct rec_grid *g, const float *dense,
                      const double p[3], const struct room_face *f, double out[3], double scale[3])
{
    double dv = volume_of(g), ball = cbrt(3 * dv / (4 * pi));
    for (int c = 0; c < 3; c++)
        out[c] = scale[c] = 0;
    for (size_t i = 0; i < rec_grid_count(g); i++) {
        double x[3], d2 = 0, cosine = 0;
        centre(g, (int32_t)i, x);
        for (int a = 0; a < 3; a++) {
            d2 += (x[a] - p[a]) * (x[a] - p[a]);
            cosine += f->n[a] * (x[a] - p[a]);
        }
        bool dark = !(cosine > 0) || !room_scene_free(s, x);
        for (int k = 0; k < s->n_bodies && !dark; k++)
            dark = k != f->body && room_scene_sees(s, k, p, x, 0) != ROOM_ALL;
        if (dark)
            continue;
        double far = fmax(sqrt(d2), ball);
        for (int c = 0; c < 3; c++) {
            out[c] += dense[i * 3 + (size_t)c] * dv * cosine / (far * far * far);
            scale[c] += dense[i * 3 + (size_t)c] * dv / (far * far);
        }
    }
}

/* One voxel: the closed form where it shines, exactly nothing behind pillar and block. */
T_CASE(one_voxel_and_its_shadows)
{
    float *v = zeros(&box10, 1);
    int32_t at = rec_grid_index(&box10, 6, 4, 3);
    double lamp[3], dv = volume_of(&box10);
    v[at] = 7;
    centre(&box10, at, lamp);
    rec_room *r = room_of(&box10, NULL);
    T_EQ_I(rec_room_light(r, &box10, v, 1), PVX_OK);
    int lit = 0, shadow = 0, unsure = 0;
    for (int k = 0; k < r->scene.n_faces; k++) {
        const struct room_face *f = &r->scene.face[k];
        for (int32_t j = 0; j <= f->nv; j += 2)
            for (int32_t i = 0; i <= f->nu; i += 2) {
                double p[3], d2 = 0, cosine = 0;
                float e = r->light[3 * room_point(f, i, j, p)];
                if (e < 0)
                    continue;
                for (int a = 0; a < 3; a++) {
                    d2 += (lamp[a] - p[a]) * (lamp[a] - p[a]);
                    cosine += f->n[a] * (lamp[a] - p[a]);
                }
                int less = 0, more = 0;
                for (int b = 0; b < r->scene.n_bodies; b++)
                    if (b != f->body) {
                        less += steps_inside(&r->scene.body[b], p, lamp, -1e-3) > 0;
                        more += steps_inside(&r->scene.body[b], p, lamp, 1e-3) > 0;
                    }
                if (less > 0 || cosine <= 0) {
                    T_OK(e == 0);
                    shadow += less > 0;
                } else if (more == 0) {
                    double want = 7 * dv * cosine / (d2 * sqrt(d2));
                    T_NEAR(e, want, 2e-6 * want);
                    lit++;
                } else {
                    unsure++;
                }
            }
    }
    T_LE(2000, lit);
    T_LE(200, shadow);
    T_LE(unsure, 0.05 * lit);
    rec_room_free(&r);
    free(v);
}

/* As near as one likes, a voxel is a ball: its light grows to the ball's surface and is finite inside. */
T_CASE(near_voxels_are_balls)
{
    struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {4, 4, 4}, REC_TRILINEAR};
    float *v = zeros(&g, 1);
    int32_t at = rec_grid_index(&g, 1, 1, 0);
    double x[3], R = cbrt(3 * volume_of(&g) / (4 * pi)), e[3];
    v[at] = 2;
    centre(&g, at, x);
    rec_room *r = room_of(&g, NULL);
    struct room_lamps l;
    T_EQ_I(room_lamps_init(&l, &r->scene, &g, v, 1), PVX_OK);
    double n[3] = {0, 0, 1};
    for (double d = 0; d < 3 * R; d += R / 8) {
        room_lamps_shine(&l, &r->scene, (double[3]){x[0], x[1], x[2] - d}, n, -1, e);
        /* field of a ball of emission 2: 4/3 pi 2 d inside, 4/3 pi R^3 2 / d^2 outside */
        double want = d < R ? 8 * pi / 3 * d : 8 * pi / 3 * R * R * R / (d * d);
        T_NEAR(e[0], want, 1e-12);
        T_OK(e[1] == 0 && e[2] == 0);
    }
    room_lamps_fini(&l);
    rec_room_free(&r);
    free(v);
}

static double taken(const rec_room *r, int channel)
{
    double power = 0;
    for (int k = 0; k < r->scene.n_faces; k++) {
        const struct room_face *f = &r->scene.face[k];
        for (int32_t j = 0; j <= f->nv; j++)
            for (int32_t i = 0; i <= f->nu; i++) {
                double x[3], e = r->light[3 * room_point(f, i, j, x) + (size_t)channel];
                power += fmax(0, e) * room_point_area(f, i, j);
            }
    }
    return power;
}

/* What the surfaces take is what all voxels send out, 4 pi e dV; with bodies too, but for the shadows'
 * edges between points. */
T_CASE(no_light_is_lost)
{
    float *v = noise(&box10, 3);
    double sent[3] = {0};
    struct rec_grid wide = box10;
    wide.min[2] -= 0.1; /* the balls of the lowest voxels are cut by no floor */
    for (size_t i = 0; i < rec_grid_count(&box10) * 3; i++)
        sent[i % 3] += 4 * pi * v[i] * volume_of(&box10);
    for (int bodies = 0; bodies < 2; bodies++) {
        rec_room *r = room_of(&wide, NULL);
        if (bodies == 0) {
            r->scene.n_bodies = 0;
            r->scene.n_faces = 6;
        }
        T_EQ_I(rec_room_light(r, &box10, v, 3), PVX_OK);
        for (int c = 0; c < 3; c++)
            T_NEAR(taken(r, c) / sent[c], 1, bodies == 0 ? 2e-4 : 1e-3);
        rec_room_free(&r);
    }
    free(v);
}

/* Balls of many voxels against the plain sum, at random points of all faces: the header's bound, and far
 * less on average. */
T_CASE(balls_against_the_plain_sum)
{
    struct rec_grid g = {{-0.5, -0.4, 0}, {0.5, 0.4, 1}, {20, 17, 23}, REC_BOX};
    float *v = noise(&g, 3);
    rec_room *r = room_of(&g, NULL);
    struct room_lamps l;
    T_EQ_I(room_lamps_init(&l, &r->scene, &g, v, 3), PVX_OK);
    double bound = 3 * ROOM_THETA * ROOM_THETA / pow(1 - ROOM_THETA, 4), sum = 0;
    int n = 0;
    for (int t = 0; t < 600; t++) {
        const struct room_face *f = &r->scene.face[t % r->scene.n_faces];
        double p[3], got[3], want[3], scale[3], a = t_uniform(0, 1), b = t_uniform(0, 1);
        for (int k = 0; k < 3; k++)
            p[k] = f->o[k] + a * f->u[k] + b * f->v[k];
        if (f->body < 0 && room_scene_covered(&r->scene, p))
            continue;
        room_lamps_shine(&l, &r->scene, p, f->n, f->body, got);
        plain_sum(&r->scene, &g, v, p, f, want, scale);
        for (int c = 0; c < 3; c++) {
            T_NEAR(got[c], want[c], bound * scale[c]);
            if (scale[c] > 0) {
                sum += fabs(got[c] - want[c]) / scale[c];
                n++;
            }
        }
    }
    T_LE(1000, n);
    T_LE(sum / n, 0.02 * bound);
    room_lamps_fini(&l);
    rec_room_free(&r);
    free(v);
}

/* Flame alone of a room: surfaces are made dark. */
static void only_flame(rec_room *r)
{
    memset(r->light, 0, r->scene.n_points * 3 * sizeof *r->light);
    memset(r->ambient, 0, sizeof r->ambient);
}

/* Behind the pillar there is exactly nothing of the flame, beside it exactly all of it. */
T_CASE(the_pillar_hides_the_flame)
{
    enum { W = 120, H = 90 };
    for (int basis = 0; basis < 2; basis++) {
        struct rec_grid g = box10, wide = box10;
        g.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
        wide.min[2] -= 0.1; /* the trilinear basis reaches half a voxel further down */
        float *v = noise(&g, 1), *room = malloc(W * H * sizeof *room);
        float *alone = malloc(W * H * sizeof *alone);
        rec_room *r = room_of(&wide, NULL);
        T_EQ_I(rec_room_light(r, &g, v, 1), PVX_OK);
        only_flame(r);
        struct rec_camera c;
        rec_room_camera(r, 0, 0.3, W, H, &c);
        T_EQ_I(rec_room_render(r, &c, 1, room), PVX_OK);
        T_EQ_I(rec_render(&g, v, 1, &(struct rec_eye){.camera = &c, .sub = 1}, NULL, alone),
               PVX_OK);
        int hidden = 0, seen = 0;
        for (int i = 0; i < W * H; i++) {
            double o[3], d[3], q[3];
            T_OK(rec_camera_ray(&c, i % W, i / W, o, d));
            for (int a = 0; a < 3; a++)
                q[a] =
                    o[a] + 1.8 * r->scene.size * d[a]; /* past the pillar, before the flame ends */
            if (!(alone[i] > 0)) {
                T_OK(room[i] == 0);
            } else if (steps_inside(&r->scene.body[0], o, q, -1e-3) > 0) {
                T_OK(room[i] == 0);
                hidden++;
            } else if (steps_inside(&r->scene.body[0], o, q, 1e-3) == 0) {
                T_NEAR(room[i], alone[i], 1e-6);
                seen++;
            }
        }
        T_LE(300, hidden);
        T_LE(300, seen);
        rec_room_free(&r);
        free(v);
        free(room);
        free(alone);
    }
}

/* Where a voxel is in front of a surface that it lights, the pixel is the sum of both; outside of the room
 * there is nothing, and from there one looks through the nearest wall. */
T_CASE(pixels_are_flame_and_surface)
{
    enum { W = 64, H = 48 };
    struct rec_grid g = box10;
    float *v = noise(&g, 1), all[W * H], flame[W * H], none[W * H];
    rec_room *r = room_of(&g, NULL);
    struct rec_camera in, out;
    T_EQ_I(rec_room_render(r, &in, 1, all), PVX_EINVAL);
    T_EQ_I(rec_room_light(r, &g, v, 1), PVX_OK);
    double eye[3] = {40, 3, 12}, at[3] = {0, 0, 0.5}, up[3] = {0, 0, 1};
    T_EQ_I(rec_look_at_camera(eye, at, up, 0.3, W, H, &out), PVX_OK);
    T_EQ_I(rec_room_render(r, &out, 1, all), PVX_OK);
    T_OK(all[0] == 0); /* past the room */
    T_OK(all[H / 2 * W + W / 2] > 0);
    rec_room_camera(r, 2, 0.3, W, H, &in);
    T_EQ_I(rec_room_render(r, &in, 1, all), PVX_OK);
    double ambient = r->ambient[0];
    T_OK(ambient > 0);
    r->ambient[0] = 0;
    T_EQ_I(rec_room_render(r, &in, 1, none), PVX_OK);
    only_flame(r);
    T_EQ_I(rec_room_render(r, &in, 1, flame), PVX_OK);
    int both = 0;
    for (int i = 0; i < W * H; i++) {
        double o[3], d[3], enter, leave;
        struct room_hit hit;
        T_OK(rec_camera_ray(&in, i % W, i / W, o, d));
        T_OK(room_scene_ray(&r->scene, o, d, &enter, &leave, &hit));
        const struct room_face *f = &r->scene.face[hit.face];
        double albedo = room_albedo(f, hit.a, hit.b);
        T_NEAR(all[i] - none[i], albedo / pi * ambient, 1e-6);
        T_OK(none[i] >= flame[i]);
        for (int a = 0; a < 3; a++) /* the hit is where it says */
            T_NEAR(o[a] + leave * d[a], f->o[a] + hit.a * f->u[a] + hit.b * f->v[a], 1e-9);
        both += flame[i] > 0 && none[i] > flame[i];
    }
    T_LE(50, both);
    rec_room_free(&r);
    free(v);
}

/* A ball that is seen whole has no point that is hidden, a hidden one none that is seen; few are neither. */
T_CASE(balls_and_their_points)
{
    const double lo[3] = {-0.5, -0.5, 0}, hi[3] = {0.5, 0.5, 1};
    struct room_scene s;
    room_scene_init(&s, lo, hi, 40);
    int count[3] = {0}, needless = 0;
    for (int t = 0; t < 20000; t++) {
        const struct room_face *f = &s.face[t_rand() % 6];
        double p[3], c[3], r = t_uniform(0, 0.2), a = t_uniform(0, 1), b = t_uniform(0, 1);
        int k = (int)(t_rand() % ROOM_BODIES), seen = 0;
        for (int i = 0; i < 3; i++) {
            p[i] = f->o[i] + a * f->u[i] + b * f->v[i];
            c[i] = t_uniform(lo[i], hi[i]);
        }
        enum room_seen says = room_scene_sees(&s, k, p, c, r);
        count[says]++;
        for (int j = 0; j < 40; j++) {
            double x[3], len = 0;
            for (int i = 0; i < 3; i++) {
                x[i] = t_normal();
                len += x[i] * x[i];
            }
            for (int i = 0; i < 3; i++) /* on the ball's surface, which is its most */
                x[i] = c[i] + r * x[i] / sqrt(len);
            seen += room_scene_sees(&s, k, p, x, 0) == ROOM_ALL;
        }
        T_OK(says != ROOM_ALL || seen == 40);
        T_OK(says != ROOM_NONE || seen == 0);
        needless += says == ROOM_PART && (seen == 0 || seen == 40);
    }
    T_LE(100, count[ROOM_ALL]);
    T_LE(100, count[ROOM_NONE]);
    T_LE(100, count[ROOM_PART]);
    T_LE(needless, 0.6 * count[ROOM_PART]);
}

/* Wherever the box is and whatever its shape: all faces there, each where its normal says, no ray lost. */
T_CASE(any_box)
{
    for (int t = 0; t < 200; t++) {
        double min[3], max[3], scale = pow(10, t_uniform(-3, 3));
        for (int a = 0; a < 3; a++) {
            min[a] = scale * t_uniform(-9, 9);
            max[a] = min[a] + scale * t_uniform(0.05, 3);
        }
        struct room_scene s;
        room_scene_init(&s, min, max, 40);
        T_EQ_I(s.n_faces, ROOM_FACES);
        const struct room_face *last = &s.face[ROOM_FACES - 1];
        T_EQ_I(s.n_points, last->first + (size_t)(last->nu + 1) * (size_t)(last->nv + 1));
        for (int k = 0; k < s.n_faces; k++) { /* straight at the middle of each */
            const struct room_face *f = &s.face[k];
            double o[3], d[3], enter, leave, back = 1e-3 * s.size;
            struct room_hit hit;
            for (int a = 0; a < 3; a++) {
                o[a] = f->o[a] + 0.5 * f->u[a] + 0.5 * f->v[a] + back * f->n[a];
                d[a] = -f->n[a];
            }
            T_OK(room_scene_free(&s, o));
            T_OK(room_scene_ray(&s, o, d, &enter, &leave, &hit));
            T_EQ_I(hit.face, k);
            T_NEAR(leave, back, 1e-6 * s.size);
            T_NEAR(hit.a, 0.5, 1e-9);
            T_NEAR(hit.b, 0.5, 1e-9);
        }
    }
}

/* 1024 times the room with the same emission per metre: 1024 times the light everywhere. */
T_CASE(all_scales_with_the_box)
{
    enum { W = 40, H = 30, N = W * H * 3 };
    float image[2][N];
    for (int k = 0; k < 2; k++) {
        struct rec_grid g = {{-0.001, 0.002, -0.003}, {0.001, 0.004, 0.001}, {6, 7, 8}, REC_BOX};
        for (int a = 0; a < 3; a++) {
            g.min[a] *= k == 0 ? 1 : 1024;
            g.max[a] *= k == 0 ? 1 : 1024;
        }
        float *v = zeros(&g, 3);
        for (size_t i = 0; i < rec_grid_count(&g) * 3; i++)
            v[i] = (float)(1 + (i * 7919) % 13);
        rec_room *r = room_of(&g, NULL);
        struct rec_camera c;
        T_EQ_I(rec_room_light(r, &g, v, 3), PVX_OK);
        rec_room_camera(r, 0.8, 0.3, W, H, &c);
        T_EQ_I(rec_room_render(r, &c, 2, image[k]), PVX_OK);
        rec_room_free(&r);
        free(v);
    }
    float most = 0;
    for (int i = 0; i < N; i++)
        most = fmaxf(most, image[1][i]);
    for (int i = 0; i < N; i++)
        T_NEAR(1024 * image[0][i], image[1][i], 1e-5 * most);
}

T_CASE_OF_THREADS(threads_give_the_same_bits)
{
    enum { W = 50, H = 41 };
    struct rec_grid g = box10;
    g.basis = REC_TRILINEAR;
    float *v = noise(&g, 3), *a = malloc(W * H * 3 * sizeof *a), *b = malloc(W * H * 3 * sizeof *b);
    pvx_pool *pool;
    T_EQ_I(pvx_pool_new(3, "t", &pool), PVX_OK);
    rec_room *r = room_of(&g, NULL), *s = room_of(&g, pool);
    struct rec_camera c;
    rec_room_camera(r, 1, 0.3, W, H, &c);
    T_EQ_I(rec_room_light(r, &g, v, 3), PVX_OK);
    T_EQ_I(rec_room_light(s, &g, v, 3), PVX_OK);
    T_EQ_I(memcmp(r->light, s->light, r->scene.n_points * 3 * sizeof *r->light), 0);
    T_EQ_I(rec_room_render(r, &c, 2, a), PVX_OK);
    T_EQ_I(rec_room_render(s, &c, 2, b), PVX_OK);
    T_EQ_I(memcmp(a, b, W * H * 3 * sizeof *a), 0);
    T_EQ_I(rec_room_render(r, &c, 0, a), PVX_EINVAL);
    T_EQ_I(rec_room_light(r, &g, v, 2), PVX_EINVAL);
    rec_room_free(&r);
    rec_room_free(&s);
    pvx_pool_free(&pool);
    free(v);
    free(a);
    free(b);
}

/* What is no emission is dark, and what is too much for a float is the largest. */
T_CASE(nothing_but_numbers_gets_out)
{
    enum { W = 32, H = 24, N = W * H * 3 };
    struct rec_grid g = box10;
    float *v = noise(&g, 3), *clean = zeros(&g, 3), a[N], b[N];
    const float bad[] = {NAN, INFINITY, -INFINITY, -3};
    memcpy(clean, v, rec_grid_count(&g) * 3 * sizeof *v);
    for (size_t i = 0; i < rec_grid_count(&g) * 3; i += 5) {
        v[i] = bad[i / 5 % 4];
        clean[i] = 0;
    }
    rec_room *r = room_of(&g, NULL);
    struct rec_camera c;
    rec_room_camera(r, 3, 0.3, W, H, &c);
    T_EQ_I(rec_room_light(r, &g, v, 3), PVX_OK);
    T_EQ_I(rec_room_render(r, &c, 1, a), PVX_OK);
    T_EQ_I(rec_room_light(r, &g, clean, 3), PVX_OK);
    T_EQ_I(rec_room_render(r, &c, 1, b), PVX_OK);
    T_EQ_I(memcmp(a, b, sizeof a), 0);
    for (size_t i = 0; i < rec_grid_count(&g) * 3; i++)
        v[i] = FLT_MAX;
    T_EQ_I(rec_room_light(r, &g, v, 3), PVX_OK);
    T_EQ_I(rec_room_render(r, &c, 1, a), PVX_OK);
    for (int i = 0; i < N; i++)
        T_OK(isfinite(a[i]) && a[i] > 0);
    memset(v, 0, rec_grid_count(&g) * 3 * sizeof *v);
    T_EQ_I(rec_room_light(r, &g, v, 3), PVX_OK);
    T_EQ_I(rec_room_render(r, &c, 1, a), PVX_OK);
    for (int i = 0; i < N; i++)
        T_OK(a[i] == 0);
    rec_room_free(&r);
    double lo[3] = {0, 0, 0}, flat[3] = {1, 0, 1}, nan[3] = {1, NAN, 1};
    T_EQ_I(rec_room_new(lo, flat, NULL, &r), PVX_EINVAL);
    T_EQ_I(rec_room_new(lo, nan, NULL, &r), PVX_EINVAL);
    rec_room_free(&r);
    free(v);
    free(clean);
}
