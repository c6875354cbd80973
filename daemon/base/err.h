/* err.h - the one error enum of the product, and the text that goes with an error.
 *
 * A fallible function returns pvx_err and is PVX_MUST_CHECK.  Parsers and file formats also take
 * a `struct pvx_diag *` (may be NULL) and put one line into it: file, line,
 * key or camera, reason, remedy.  The function that finds the cause fills it.  Callers pass it on unchanged.
 * Threads: everything here is re-entrant; a pvx_diag belongs to one thread at a time. */
#ifndef PVX_ERR_H
#define PVX_ERR_H
#ifdef __cplusplus
extern "C" {
#endif

#define PVX_MUST_CHECK   __attribute__((warn_unused_result))
#define PVX_PRINTF(f, a) __attribute__((format(printf, f, a)))

typedef enum pvx_err {
    PVX_OK = 0,
    PVX_EINVAL,    /* an argument or a configured value is outside its documented range */
    PVX_ENOMEM,    /* out of memory */
    PVX_EIO,       /* read, write or device failed */
    PVX_ENOENT,    /* no such file, camera, key */
    PVX_EFORMAT,   /* input is not in the format it should be in */
    PVX_ECORRUPT,  /* checksum or internal consistency is wrong */
    PVX_ESTALE,    /* made for another rig, grid or version of the inputs */
    PVX_EVERSION,  /* a newer or unknown format version */
    PVX_ERANGE,    /* does not fit the fixed size chosen at start-up */
    PVX_EBUSY,     /* in use by another program: port, device, lock file */
    PVX_ETIMEDOUT, /* nothing arrived in time: a state, not a fault */
    PVX_ECANCELED, /* stopped on request */
    PVX_ENOSPC,    /* disk full */
    PVX_EPERM,     /* not allowed */
    PVX_ENODEV,    /* device is gone or does not answer */
    PVX_EUNSUP,    /* known but not supported here */
    PVX_ECLOSED,   /* the other end has been closed: end of stream */
    PVX_N_ERR
} pvx_err;

/* Short English text of `e`, static storage, never NULL. */
const char *pvx_strerror(pvx_err e);

/* The pvx_err that fits an errno value; PVX_EIO if no other fits. */
pvx_err pvx_err_from_errno(int errnum);

/* Return from the calling function when `expr` is not PVX_OK. */
#define PVX_TRY(expr)                \
    do {                             \
        pvx_err pvx_try_e_ = (expr); \
        if (pvx_try_e_ != PVX_OK)    \
            return pvx_try_e_;       \
    } while (0)

#define PVX_DIAG_MAX 768
struct pvx_diag {
    char text[PVX_DIAG_MAX]; /* one line, no newline, "" when there is no text */
};

/* Set the text (first cause wins: a diag that already has text is left alone) and return `e`.
 * `d` may be NULL. */
pvx_err pvx_fail(struct pvx_diag *d, pvx_err e, const char *fmt, ...) PVX_PRINTF(3, 4);
#ifdef __clang_analyzer__ /* reads one file at a time, so the returned value must stand here */
#define pvx_fail(d, e, ...) (pvx_fail(d, e, __VA_ARGS__), (e))
#endif

/* The diag's text, or pvx_strerror(e) when it has none. */
const char *pvx_diag_text(const struct pvx_diag *d, pvx_err e);

/* Return PVX_ENOMEM from the calling function when `memory` is NULL. */
#define PVX_NEED(memory)       \
    do {                       \
        if (!(memory))         \
            return PVX_ENOMEM; \
    } while (0)
/* The next step: e = expr, unless an earlier step failed. */
#define PVX_THEN(e, expr)  \
    do {                   \
        if ((e) == PVX_OK) \
            (e) = (expr);  \
    } while (0)

#ifdef __cplusplus
}
#endif
#endif
