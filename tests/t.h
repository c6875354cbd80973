/* t.h - the test harness: named cases, checks that print both values, PASS/FAIL/SKIP lines.
 *
 *   T_CASE(rays_on_faces) { T_EQ_I(count, 3); T_NEAR(sum, 1.0, 1e-6); }
 *
 * tests/lib/main.c runs them; T_MAIN(begin, end) where something is set up before and cleared away after them.
 * One line per case: "PASS test_x:case" / "FAIL ..." / "SKIP ... (reason)"; exit 1 when any failed.
 * T_ONLY=a,b runs only these cases.
 * Random data comes from t_rand(), seeded by T_SEED (printed on failure). */
#ifndef T_H
#define T_H
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "base/random.h"

__attribute__((unused)) static int t_fails, t_case_fails;
__attribute__((unused)) static const char *t_skip_reason;
/* Set before t_run: why no case of this program can be run here. */
__attribute__((unused)) static const char *t_skip_all;
static uint64_t t_state;
static uint64_t t_seed;

__attribute__((unused)) static uint64_t t_rand(void)
{
    if (t_state == 0) {
        const char *s = getenv("T_SEED");
        t_seed = s != NULL ? strtoull(s, NULL, 0) : 1;
        t_state = t_seed * 0x9E3779B97F4A7C15u + 1;
    }
    return pvx_random(&t_state);
}
__attribute__((unused)) static double t_uniform(double lo, double hi)
{
    return lo + (hi - lo) * (double)(t_rand() >> 11) * 0x1p-53;
}
__attribute__((unused)) static double t_normal(void)
{
    return sqrt(-2 * log(t_uniform(1e-300, 1))) * cos(6.283185307179586 * t_uniform(0, 1));
}

#ifdef __clang_analyzer__ /* what comes after a failed check is not judged */
#define T_FAILED_() abort()
#else
#define T_FAILED_() (t_case_fails++)
#endif
#define T_CHECK_(ok, ...)                            \
    do {                                             \
        if (!(ok)) {                                 \
            T_FAILED_();                             \
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
#define T_CONTAINS(text, part)                                                           \
    do {                                                                                 \
        const char *a_ = (text), *b_ = (part);                                           \
        T_CHECK_(a_ != NULL && strstr(a_, b_) != NULL, "\"%s\" does not contain \"%s\"", \
                 a_ != NULL ? a_ : "nothing", b_);                                       \
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

/* `make test-all` runs every case (T_LONG=1).  CI and `make test` leave those out that say T_ONLY_LONG(). */
__attribute__((unused)) static bool t_long(void)
{
    return getenv("T_LONG") != NULL;
}
#define T_ONLY_LONG()                         \
    do {                                      \
        if (!t_long())                        \
            T_SKIP("long: in make test-all"); \
    } while (0)

/* It has no threads, or they do what another case's do. */
#define T_NO_THREADS "no threads, or those of another case"
#if defined(__SANITIZE_THREAD__)
#define T_TSAN             true
#define T_NOT_UNDER_TSAN() T_SKIP(T_NO_THREADS)
#else
#define T_TSAN             false
#define T_NOT_UNDER_TSAN() ((void)0)
#endif

/* More of the arithmetic of a case that runs.  T_SANITIZED: where fewer rounds of the same do. */
#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
#define T_NOT_UNDER_SANITIZERS() T_SKIP("another case goes the same way")
#define T_SANITIZED              1
#else
#define T_NOT_UNDER_SANITIZERS() ((void)0)
#define T_SANITIZED              0
#endif

/* A case is run because it is written: no list to keep.  Where cases are written T_CASE_OF_THREADS, ThreadSanitizer runs
 * these alone: the others have no threads, or those of another case. */
struct t_case {
    const char *name;
    void (*fn)(void);
    bool threads;
    struct t_case *next;
};
__attribute__((unused)) static bool t_threads; /* is one so written? */
__attribute__((unused)) static struct t_case *t_first, **t_end = &t_first;
#define T_CASE_(name_, threads_)                                    \
    static void name_(void);                                        \
    __attribute__((constructor)) static void t_enlist_##name_(void) \
    {                                                               \
        static struct t_case c_ = {#name_, name_, threads_, NULL};  \
        *t_end = &c_;                                               \
        t_end = &c_.next;                                           \
        t_threads |= c_.threads;                                    \
    }                                                               \
    static void name_(void)
#define T_CASE(name_)            T_CASE_(name_, false)
#define T_CASE_OF_THREADS(name_) T_CASE_(name_, true)

__attribute__((unused)) static int t_done(void)
{
    return t_fails > 0 ? 1 : 0;
}
struct t_clock {
    double wall_s, cpu_s; /* cpu_s: of this process and of its children that have ended */
};
__attribute__((unused)) static struct t_clock t_now(void)
{
    struct timespec ts;
    struct rusage u[2];
    struct t_clock now = {0, 0};
    clock_gettime(CLOCK_MONOTONIC, &ts);
    now.wall_s = (double)ts.tv_sec + 1e-9 * (double)ts.tv_nsec;
    getrusage(RUSAGE_SELF, &u[0]);
    getrusage(RUSAGE_CHILDREN, &u[1]);
    for (int i = 0; i < 2; i++)
        now.cpu_s += (double)(u[i].ru_utime.tv_sec + u[i].ru_stime.tv_sec) +
                     1e-6 * (double)(u[i].ru_utime.tv_usec + u[i].ru_stime.tv_usec);
    return now;
}
/* tests/run.sh lists the longest cases from these lines. */
__attribute__((unused)) static void t_note_time(const char *base, const char *name,
                                                struct t_clock from)
{
    const char *path = getenv("T_TIMES");
    FILE *file = path != NULL ? fopen(path, "ae") : NULL;
    struct t_clock now = t_now();
    if (file == NULL)
        return;
    fprintf(file, "%.2f %.2f %s:%s\n", now.wall_s - from.wall_s, now.cpu_s - from.cpu_s, base,
            name);
    fclose(file);
}

/* $T_ONLY names the cases that are run, "a,b"; NULL: all. */
__attribute__((unused)) static bool t_is_wanted(const char *name)
{
    const char *only = getenv("T_ONLY");
    size_t n = strlen(name);
    if (only == NULL)
        return true;
    for (const char *at = only; (at = strstr(at, name)) != NULL; at += n)
        if ((at == only || at[-1] == ',') && (at[n] == ',' || at[n] == '\0'))
            return true;
    return false;
}

/* All cases, in the order in which they are written. */
int t_run(void);
int t_run(void)
{
    const char *slash = strrchr(__BASE_FILE__, '/'),
               *base = slash != NULL ? slash + 1 : __BASE_FILE__;
    for (const struct t_case *c = t_first; c != NULL; c = c->next) {
        if (!t_is_wanted(c->name))
            continue;
        t_case_fails = 0;
        t_skip_reason = t_skip_all;
        if (T_TSAN && t_threads && !c->threads)
            t_skip_reason = T_NO_THREADS;
        struct t_clock from = t_now();
        if (t_skip_reason == NULL)
            c->fn();
        t_note_time(base, c->name, from);
        if (t_case_fails > 0) {
            t_fails++;
            printf("FAIL %s:%s (T_SEED=%llu)\n", base, c->name, (unsigned long long)t_seed);
        } else if (t_skip_reason != NULL) {
            printf("SKIP %s:%s (%s)\n", base, c->name, t_skip_reason);
        } else {
            printf("PASS %s:%s\n", base, c->name);
        }
        fflush(stdout);
    }
    return t_done();
}
#define T_MAIN(begin, end) \
    int main(void)         \
    {                      \
        begin;             \
        t_run();           \
        end;               \
        return t_done();   \
    }
#endif
