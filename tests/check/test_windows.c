/* test_windows.c - both products with windows, of every instruction set, shape and slot range, against sums
 * in double, with the bounds (N. J. Higham, Accuracy and Stability of Numerical Algorithms, ch. 3)
 *     adjoint  |got - exact| <= g(n+1) sum unit w |y| + 2^-149           n weights that are not 0
 *     scatter  |got - exact| <= g(k+1) (|y| + sum w |x|)                 k of them on a bin
 *     g(n) = n u / (1 - n u),  u = 2^-24
 * (products round once, and unit; the last term is underflow, which products of whole numbers have none of),
 * and nothing read or written beside the arrays: guard pages behind them, and behind the
 * last weight only what windows.h allows. */
#include "tests/t.h"

#include <stdbool.h>

#include "recon/simd/kernels.h"
#include "tests/lib/guarded.h"
#include "tests/lib/hard_values.h"

static const struct shape {
    int32_t high, wide;
} shapes[] = {{2, 2}, {2, 4}, {3, 4}, {4, 4}};
#define SHAPES (sizeof shapes / sizeof *shapes)

#define COLUMNS 23
#define UNIT    0.0173f

/* Images of one camera after the other; some narrower and lower than a window. */
static const struct image {
    int32_t w, h;
} images[] = {{9, 7}, {1, 5}, {2, 2}, {3, 1},  {16, 4}, {4, 4},
              {1, 1}, {5, 3}, {3, 9}, {11, 6}, {2, 8},  {6, 2}};

struct bed {
    struct rec_windows m;
    size_t cameras, row0[REC_SLOTS_MAX + 1];
    int cs;
    float *x, *y, *out_x, *out_y; /* x, y [..][cs] in; as they were before a product */
    double *exact, *size;         /* [room][cs] or [COLUMNS][cs] */
    uint32_t *terms;
};

/* Weights of a window that begins there: what hangs over the camera's image is 0. */
static void fill_weights(const struct bed *b, size_t camera, uint32_t at, uint8_t *w)
{
    const struct image *im = &images[camera];
    int32_t bin = (int32_t)(at - b->row0[camera]), x = bin % im->w, y = bin / im->w;
    for (int32_t r = 0; r < b->m.high; r++)
        for (int32_t k = 0; k < b->m.wide; k++, w++)
            *w = y + r < im->h && x + k < im->w && t_rand() % 5 > 0 ? (uint8_t)t_rand() : 0;
}
/* A window anywhere in the image. */
static void fill_window(const struct bed *b, size_t camera, uint32_t *at, uint8_t *w)
{
    const struct image *im = &images[camera];
    int32_t high = b->m.high, wide = b->m.wide;
    int32_t x = im->w > wide ? (int32_t)(t_rand() % (uint64_t)(im->w - wide + 1)) : 0;
    int32_t y = im->h > high ? (int32_t)(t_rand() % (uint64_t)(im->h - high + 1)) : 0;
    if (t_rand() % 4 == 0) { /* the last there can be */
        x = im->w > wide ? im->w - wide : 0;
        y = im->h > high ? im->h - high : im->h - 1;
    }
    *at = (uint32_t)b->row0[camera] + (uint32_t)(y * im->w + x);
    fill_weights(b, camera, *at, w);
}

static void bed_new(struct bed *b, const struct shape *s, size_t cameras, enum data d, int cs)
{
    size_t slots = (cameras + REC_SLOT_GROUP - 1) / REC_SLOT_GROUP * REC_SLOT_GROUP, size, rows = 0;
    int32_t widest = 0;
    *b =
        (struct bed){.m = {.slots = (int32_t)slots, .high = s->high, .wide = s->wide, .unit = UNIT},
                     .cameras = cameras,
                     .cs = cs};
    size = rec_window_size(&b->m);
    for (size_t c = 0; c < cameras; c++) {
        b->row0[c] = rows;
        rows += (size_t)(images[c].w * images[c].h);
        b->m.pitch[c] = images[c].w;
        widest = images[c].w > widest ? images[c].w : widest;
    }
    b->m.nowhere = (uint32_t)rows;
    /* as small as windows.h has it, so that any bin more dies */
    b->m.room = (uint32_t)rows + (uint32_t)((s->high - 1) * widest + s->wide);
    b->m.at = guarded(COLUMNS * slots * sizeof *b->m.at);
    b->m.w = guarded(COLUMNS * slots * size + REC_WINDOWS_PAD);
    memset(b->m.w + COLUMNS * slots * size, 255, REC_WINDOWS_PAD); /* read, but not used */
    for (size_t q = 0; q < COLUMNS; q++) {
        bool as_before = q > 0 && t_rand() % 2 == 0; /* where the column before has its windows */
        for (size_t c = 0, i = q * slots; c < slots; c++, i++) {
            b->m.at[i] = as_before ? b->m.at[i - slots] : b->m.nowhere;
            if (as_before && b->m.at[i] != b->m.nowhere)
                fill_weights(b, c, b->m.at[i], b->m.w + i * size);
            else if (!as_before && c < cameras && t_rand() % 6 > 0)
                fill_window(b, c, &b->m.at[i], b->m.w + i * size);
        }
    }
    size_t lanes = (size_t)cs, room = b->m.room * lanes;
    b->x = guarded(COLUMNS * lanes * 4);
    b->out_x = guarded(COLUMNS * lanes * 4);
    b->y = guarded(room * 4);
    b->out_y = guarded(room * 4);
    b->exact = calloc(room + COLUMNS * lanes, sizeof *b->exact);
    b->size = calloc(room + COLUMNS * lanes, sizeof *b->size);
    b->terms = calloc(room + COLUMNS * lanes, sizeof *b->terms);
    for (size_t i = 0; i < COLUMNS * lanes; i++)
        b->x[i] = value(d);
    for (size_t i = 0; i < rows * lanes; i++)
        b->y[i] = value(d);
}

static void unguard(void *p, size_t bytes)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), room = (bytes + page - 1) / page * page;
    munmap((char *)p + bytes - room, room + page);
}
static void bed_free(struct bed *b)
{
    size_t slots = (size_t)b->m.slots, lanes = (size_t)b->cs;
    unguard(b->m.at, COLUMNS * slots * sizeof *b->m.at);
    unguard(b->m.w, COLUMNS * slots * rec_window_size(&b->m) + REC_WINDOWS_PAD);
    unguard(b->x, COLUMNS * lanes * 4);
    unguard(b->out_x, COLUMNS * lanes * 4);
    unguard(b->y, b->m.room * lanes * 4);
    unguard(b->out_y, b->m.room * lanes * 4);
    free(b->exact);
    free(b->size);
    free(b->terms);
}

/* Every weight of columns [q0,q1) and slots s, by (1) of windows.h: from y to a column, or to a bin. */
static void exactly(struct bed *b, struct rec_slots s, int32_t q0, int32_t q1, bool scatter)
{
    const struct rec_windows *m = &b->m;
    size_t lanes = (size_t)b->cs, n = (scatter ? m->room : COLUMNS) * lanes;
    for (size_t i = 0; i < n; i++) {
        b->exact[i] = scatter ? b->y[i] : 0;
        b->size[i] = fabs(b->exact[i]);
        b->terms[i] = 0;
    }
    for (int32_t q = q0; q < q1; q++)
        for (int32_t c = s.s0; c < s.s1; c++) {
            size_t i = (size_t)q * (size_t)m->slots + (size_t)c;
            const uint8_t *w = m->w + i * rec_window_size(m);
            for (int32_t r = 0; r < m->high; r++)
                for (int32_t k = 0; k < m->wide; k++, w++)
                    for (size_t l = 0; l < lanes && *w != 0; l++) {
                        size_t bin = (m->at[i] + (size_t)(r * m->pitch[c] + k)) * lanes + l;
                        size_t column = (size_t)q * lanes + l, to = scatter ? bin : column;
                        double p =
                            scatter ? (double)*w * b->x[column] : (double)m->unit * *w * b->y[bin];
                        b->exact[to] += p;
                        b->size[to] += fabs(p);
                        b->terms[to]++;
                    }
        }
}

static bool within(const struct bed *b, size_t i, double got, bool scatter)
{
    double n = b->terms[i] + 1, u = 0x1p-24, tiny = scatter ? 0 : 0x1p-149;
    return fabs(got - b->exact[i]) <= n * u / (1 - n * u) * b->size[i] + tiny;
}

/* The windows of columns [q0,q1), all slots, as further ones. */
static size_t further(const struct bed *b, int32_t q0, int32_t q1, struct rec_more *more)
{
    size_t n = 0, size = rec_window_size(&b->m);
    for (int32_t q = q0; q < q1; q++)
        for (uint32_t c = 0; c < (uint32_t)b->m.slots; c++) {
            size_t i = (size_t)q * (size_t)b->m.slots + c;
            if (b->m.at[i] == b->m.nowhere)
                continue;
            more[n] = (struct rec_more){(uint32_t)q, b->m.at[i], c, {0}};
            memcpy(more[n++].w, b->m.w + i * size, size);
        }
    return n;
}

/* Of a column's own windows, or of the same as further ones: those add to what is there. */
static int wrong_adjoint(struct bed *b, const struct rec_kernels *k, bool as_more,
                         struct rec_slots s, int32_t q0, int32_t q1)
{
    static struct rec_more more[COLUMNS * REC_SLOTS_MAX];
    int wrong = 0;
    size_t lanes = (size_t)b->cs;
    for (size_t i = 0; i < COLUMNS * lanes; i++)
        b->out_x[i] = as_more && i >= (size_t)q0 * lanes && i < (size_t)q1 * lanes ? 0 : 77;
    exactly(b, s, q0, q1, false);
    if (as_more)
        (b->cs == 4 ? k->adjoint4_more : k->adjoint1_more)(
            &b->m, s, (struct rec_more_run){more, more + further(b, q0, q1, more)}, b->y, b->out_x);
    else
        (b->cs == 4 ? k->adjoint4 : k->adjoint1)(&b->m, s, q0, q1, b->y, b->out_x);
    for (size_t i = 0; i < COLUMNS * lanes; i++) {
        bool in = i >= (size_t)q0 * lanes && i < (size_t)q1 * lanes;
        wrong += in ? !within(b, i, b->out_x[i], false) : !(b->out_x[i] >= 77 && b->out_x[i] <= 77);
    }
    return wrong;
}
/* A bin that has no weight keeps its bits. */
static int wrong_scatter(struct bed *b, const struct rec_kernels *k, bool as_more,
                         struct rec_slots s, int32_t q0, int32_t q1)
{
    static struct rec_more more[COLUMNS * REC_SLOTS_MAX];
    int wrong = 0;
    size_t n = b->m.room * (size_t)b->cs;
    memcpy(b->out_y, b->y, n * sizeof *b->y);
    exactly(b, s, q0, q1, true);
    if (as_more)
        (b->cs == 4 ? k->scatter4_more : k->scatter1_more)(
            &b->m, s, (struct rec_more_run){more, more + further(b, q0, q1, more)}, b->x, b->out_y);
    else
        (b->cs == 4 ? k->scatter4 : k->scatter1)(&b->m, s, q0, q1, b->x, b->out_y);
    for (size_t i = 0; i < n; i++)
        wrong += b->terms[i] > 0 ? !within(b, i, b->out_y[i], true)
                                 : !(b->out_y[i] >= b->y[i] && b->out_y[i] <= b->y[i]);
    return wrong;
}

static void check_kernels(const struct rec_kernels *k, struct bed *b)
{
    static const int32_t ranges[][2] = {
        {0, COLUMNS}, {0, 1}, {COLUMNS - 1, COLUMNS}, {3, 8}, {5, 5}};
    for (size_t r = 0; r < sizeof ranges / sizeof *ranges; r++)
        for (int32_t s0 = 0; s0 <= b->m.slots; s0++)
            for (int32_t s1 = s0; s1 <= b->m.slots; s1++) {
                const struct rec_slots s = {s0, s1};
                int32_t q0 = ranges[r][0], q1 = ranges[r][1];
                int wrong[2] = {wrong_adjoint(b, k, false, s, q0, q1),
                                wrong_scatter(b, k, false, s, q0, q1)};
                int of_more[2] = {wrong_adjoint(b, k, true, s, q0, q1),
                                  wrong_scatter(b, k, true, s, q0, q1)};
                T_CHECK_(wrong[0] == 0 && wrong[1] == 0 && of_more[0] == 0 && of_more[1] == 0,
                         "%s, %d channels, %dx%d, slots [%d,%d) of %d, columns [%d,%d): wrong in "
                         "%d of A'y, %d of A x, as further windows %d, %d",
                         pvx_cpu_name(k->cpu), b->cs, b->m.high, b->m.wide, s0, s1, b->m.slots, q0,
                         q1, wrong[0], wrong[1], of_more[0], of_more[1]);
            }
}

T_CASE(products_within_the_derived_bound)
{
    static const size_t cameras[] = {1, 4, 5, 8, 12};
    for (int level = PVX_CPU_REF; level <= (int)pvx_cpu_have(); level++) {
        struct rec_kernels k;
        rec_kernels_init(&k, (enum pvx_cpu)level);
        T_EQ_I(k.cpu, level);
        for (size_t s = 0; s < SHAPES; s++)
            for (size_t c = 0; c < sizeof cameras / sizeof *cameras; c++)
                for (int d = 0; d < N_DATA; d++)
                    for (int cs = 1; cs <= 4; cs += 3) {
                        struct bed b;
                        bed_new(&b, &shapes[s], cameras[c], (enum data)d, cs);
                        check_kernels(&k, &b);
                        bed_free(&b);
                    }
    }
}

/* What was checked above were loops of their own. */
T_CASE(vectors_are_not_the_reference)
{
    struct rec_kernels ref, k;
    rec_kernels_init(&ref, PVX_CPU_REF);
    for (int level = PVX_CPU_AVX2; level <= PVX_CPU_BEST; level++) {
        if (level > (int)pvx_cpu_have()) {
            printf("  not on this processor, so not tested here: %s\n",
                   pvx_cpu_name((enum pvx_cpu)level));
            continue;
        }
        rec_kernels_init(&k, (enum pvx_cpu)level);
        T_OK(k.adjoint1 != ref.adjoint1 && k.scatter1 != ref.scatter1);
        T_OK(k.adjoint4 != ref.adjoint4 && k.scatter4 != ref.scatter4);
        T_OK(k.adjoint1_more != ref.adjoint1_more && k.scatter1_more != ref.scatter1_more);
        T_OK(k.adjoint4_more != ref.adjoint4_more && k.scatter4_more != ref.scatter4_more);
    }
}

int main(void)
{
    unsetenv("PYROVOX_CPU");
    return t_run();
}
