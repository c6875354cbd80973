#include "base/err.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>

#include "base/log.h"

static const char *const texts[PVX_N_ERR] = {
    [PVX_OK] = "ok",
    [PVX_EINVAL] = "invalid value",
    [PVX_ENOMEM] = "out of memory",
    [PVX_EIO] = "input/output error",
    [PVX_ENOENT] = "not found",
    [PVX_EFORMAT] = "malformed input",
    [PVX_ECORRUPT] = "corrupt data",
    [PVX_ESTALE] = "stale: made from other inputs",
    [PVX_EVERSION] = "unknown format version",
    [PVX_ERANGE] = "does not fit the size fixed at start-up",
    [PVX_EBUSY] = "in use",
    [PVX_ETIMEDOUT] = "timed out",
    [PVX_ECANCELED] = "cancelled",
    [PVX_ENOSPC] = "no space left",
    [PVX_EPERM] = "not permitted",
    [PVX_ENODEV] = "device is gone or does not answer",
    [PVX_EUNSUP] = "not supported",
    [PVX_ECLOSED] = "closed",
};

const char *pvx_strerror(pvx_err e)
{
    if ((int)e < 0 || e >= PVX_N_ERR || texts[e] == NULL)
        return "unknown error";
    return texts[e];
}

pvx_err pvx_err_from_errno(int errnum)
{
    switch (errnum) {
    case 0: return PVX_OK;
    case EINVAL: return PVX_EINVAL;
    case ENOMEM: return PVX_ENOMEM;
    case ENOENT:
    case ENOTDIR: return PVX_ENOENT;
    case EBUSY:
    case EADDRINUSE:
    case EEXIST: return PVX_EBUSY;
    case ETIMEDOUT:
    case EAGAIN: return PVX_ETIMEDOUT;
    case ECANCELED:
    case EINTR: return PVX_ECANCELED;
    case ENOSPC:
    case EDQUOT:
    case EFBIG: return PVX_ENOSPC;
    case EPERM:
    case EACCES:
    case EROFS: return PVX_EPERM;
    case ENODEV:
    case ENXIO: return PVX_ENODEV;
    case ENOTSUP:
    case ENOSYS: return PVX_EUNSUP;
    case ERANGE:
    case EOVERFLOW: return PVX_ERANGE;
    default: return PVX_EIO;
    }
}

pvx_err(pvx_fail)(struct pvx_diag *d, pvx_err e, const char *fmt, ...)
{
    if (d == NULL || d->text[0] != '\0')
        return e;
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(d->text, sizeof d->text, fmt, ap);
    va_end(ap);
    pvx_one_line(d->text);
    return e;
}

const char *pvx_diag_text(const struct pvx_diag *d, pvx_err e)
{
    return d != NULL && d->text[0] != '\0' ? d->text : pvx_strerror(e);
}
