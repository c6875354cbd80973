/* t.h - the test harness: named cases, checks that print both values, PASS/FAIL/SKIP lines.
 *
 *   static void rays_on_faces(void) { T_EQ_I(count, 3); T_NEAR(sum, 1.0, 1e-6); }
 *   int main(int argc, char **argv) { T_RUN(rays_on_faces); return t_done(); }
 *
 * One line per case: "PASS test_x:case" / "FAIL ..." / "SKIP ... (reason)"; exit 1 when any failed.
 * Random data comes from t_rand(), seeded by T_SEED (printed on failure). */
#ifndef T_H
#define T_H
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int t_fails, t_case_fails, t_cases, t_skipped;
static const char *t_skip_reason;
static uint64_t t_state;
static uint64_t t_seed;

__attribute__((unused)) static uint64_t t_rand(void) /* xorshift64*, never 0 */
{
    if (t_state == 0) {
        const char *s = getenv("T_SEED");
        t_seed = s != NULL ? strtoull(s, NULL, 0) : 1;
        t_state = t_seed * 0x9E3779B97F4A7C15u + 1;
    }
    t_state ^= t_state >> 12;
    t_state ^= t_state << 25;
    t_state ^= t_state >> 27;
    return t_state * 0x2545F4914F6CDD1Du;
}
__attribute__((unused)) static double t_uniform(double lo, double hi)
{
    return lo + (hi - lo) * (double)(t_rand() >> 11) * 0x1p-53;
}
__attribute__((unused)) static double t_normal(void)
{
    return sqrt(-2 * log(t_uniform(1e-300, 1))) * cos(6.283185307179586 * t_uniform(0, 1));
}

#define T_CHECK_(ok, ...)                            \
    do {                                             \
        if (!(ok)) {                                 \
            t_case_fails++;                          \
            printf("  %s:%d: ", __FILE__, __LINE__); \
            printf(__VA_ARGS__);                     \
            printf("\n");                            \
        }                                            \
    } while (0)
#define T_OK(cond) T_CHECK_((cond), "failed: %s", #cond)
#define T_EQ_I(a, b)                                                     \
    do {                                                                 \
        long long a_ = (long long)(a), b_ = (long long)(b);              \
        T_CHECK_(a_ == b_, "%s = %lld, want %s = %lld", #a, a_, #b, b_); \
    } while (0)
#define T_EQ_S(a, b)                                                           \
    do {                                                                       \
        const char *a_ = (a), *b_ = (b);                                       \
        T_CHECK_(strcmp(a_, b_) == 0, "%s = \"%s\", want \"%s\"", #a, a_, b_); \
    } while (0)
#define T_CONTAINS(text, part)                                                      \
    do {                                                                            \
        const char *a_ = (text), *b_ = (part);                                      \
        T_CHECK_(strstr(a_, b_) != NULL, "\"%s\" does not contain \"%s\"", a_, b_); \
    } while (0)
#define T_NEAR(a, b, tol)                                                                       \
    do {                                                                                        \
        double a_ = (a), b_ = (b), t_ = (tol);                                                  \
        T_CHECK_(fabs(a_ - b_) <= t_, "%s = %.12g, want %s = %.12g +- %g", #a, a_, #b, b_, t_); \
    } while (0)
#define T_LE(a, b)                                                            \
    do {                                                                      \
        double a_ = (double)(a), b_ = (double)(b);                            \
        T_CHECK_(a_ <= b_, "%s = %.12g, want <= %s = %.12g", #a, a_, #b, b_); \
    } while (0)
#define T_SKIP(reason)            \
    do {                          \
        t_skip_reason = (reason); \
        return;                   \
    } while (0)
#define T_RUN(fn)                                                                         \
    do {                                                                                  \
        t_case_fails = 0;                                                                 \
        t_skip_reason = NULL;                                                             \
        t_cases++;                                                                        \
        fn();                                                                             \
        const char *base_ = strrchr(__FILE__, '/');                                       \
        base_ = base_ != NULL ? base_ + 1 : __FILE__;                                     \
        if (t_case_fails > 0) {                                                           \
            t_fails++;                                                                    \
            printf("FAIL %s:%s (T_SEED=%llu)\n", base_, #fn, (unsigned long long)t_seed); \
        } else if (t_skip_reason != NULL) {                                               \
            t_skipped++;                                                                  \
            printf("SKIP %s:%s (%s)\n", base_, #fn, t_skip_reason);                       \
        } else {                                                                          \
            printf("PASS %s:%s\n", base_, #fn);                                           \
        }                                                                                 \
        fflush(stdout);                                                                   \
    } while (0)
__attribute__((unused)) static int t_done(void)
{
    return t_fails > 0 ? 1 : 0;
}
#endif
