/* params.h - parameters and report of a solve: the part of solve.h that callers of rec_frame_solve (frame.h)
 * need.  The methods are listed there.
 * Threads: pure. */
#ifndef REC_SOLVE_PARAMS_H
#define REC_SOLVE_PARAMS_H
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* selfcal.h: nothing, gains alone, or gains and shifts are corrected. */
enum rec_selfcal_mode { REC_SELFCAL_OFF, REC_SELFCAL_GAIN, REC_SELFCAL_ON };

#define REC_RENEWALS 6 /* at most, of V and lambda in a solve */

enum rec_stop { REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY, REC_STOP_ITERATIONS };
/* How a solve ended.  The numbers are those of the protocol (PROTOCOL.md), where 3 was never sent. */
enum rec_status { REC_CONVERGED = 0, REC_MAX_ITER = 1, REC_DEADLINE = 2, REC_EMPTY = 4 };
const char *rec_status_name(enum rec_status s); /* "converged" "max-iter" "deadline" "empty" */

/* Called after each iteration with the current iterate, for tests and benches. */
typedef void (*rec_trace_fn)(void *ctx, uint32_t iteration, const float *x, double objective,
                             double residual_norm);

/* Whether the default solver may solve the channels as one for a while (blend.h): where its rules allow it, never, or
 * wherever it can (tests). */
enum rec_blend { REC_BLEND_AUTO, REC_BLEND_OFF, REC_BLEND_ON };

struct rec_solve_params {
    const char *solver; /* NULL or "" = default */
    enum rec_stop stop;
    uint32_t iterations; /* upper bound; 0 = the solver's default */
    float lambda;    /* weight of the smoothness term over the mean diagonal of A'WA; < 0 = auto */
    float tolerance; /* REC_STOP_AUTO: stop when x moves by less than this share of ||x|| (stop.c: a
                        good start), or the objective falls by less than half of it */
    int64_t deadline_ns; /* mono clock; return the best iterate by then; 0 = none */
    enum rec_blend blend;
    rec_trace_fn trace; /* or NULL */
    void *trace_ctx;
};
#define REC_SOLVE_DEFAULTS                                                                       \
    {                                                                                            \
        .solver = NULL, .stop = REC_STOP_AUTO, .iterations = 0, .lambda = -1, .tolerance = 4e-3f \
    }
extern const struct rec_solve_params rec_solve_defaults;

struct rec_solve_report {
    enum rec_status status;
    const char *solver;  /* static string */
    uint32_t iterations; /* done */
    uint32_t blended;    /* of these, with the channels as one (recon/solve/blend.h) */
    uint32_t best;       /* iterate returned */
    double
        rel_residual; /* ||W^(1/2)(A x - b)|| / ||W^(1/2) b|| over A's rows, all channels; 0 for b = 0 */
    double residual_norm, solution_norm;
    double objective; /* of the returned iterate; 0 where the method has none */
    double lambda;    /* absolute weight used, mean of the channels, at the end */
    /* Iterations after which the objective changed, and how many of them. */
    uint32_t renewed[REC_RENEWALS], renewals;
    double
        misfit2[4]; /* mean of w (A x - b)^2 over measured rows, per lane, if the method knows it */
    int64_t time_ns;
};

/* What is known of the cameras: of a set by itself (selfcal.h) or of many (average.h).  Errors are one sigma. */
struct rec_selfcal_camera {
    bool known;             /* it was estimated */
    float gain, gain_error; /* factor on the picture, applied only if rec_selfcal_report.gain */
    /* Raw pixels by which the flame lies further right and down than the rig says; errors 0, 0: not estimated. */
    float shift[2], shift_error[2];
    uint32_t touched; /* times that it was forgotten (average.h) */
};
struct rec_selfcal_report {
    bool gain, shift; /* these were corrected */
    uint32_t cameras; /* of the rig; 0: nothing was estimated */
    uint32_t sets;    /* that say it together; 0: one set by itself */
    double test[2];   /* how far gains, shifts lie above chance, in sigma; 0: not tested */
    struct rec_selfcal_camera camera[64]; /* REC_MAX_CAMERAS of rig.h */
};

/* Names of all solvers, NULL-terminated; the first is the default. */
const char *const *rec_solver_names(void);
bool rec_solver_is_default(const char *name); /* NULL and "" too */

#ifdef __cplusplus
}
#endif
#endif
