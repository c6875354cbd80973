/* certificate.h - reads a TLS certificate and its key, and checks them before they are used. */
#ifndef VIEW_CERTIFICATE_H
#define VIEW_CERTIFICATE_H
#include <gnutls/gnutls.h>
#include "base/err.h"

/* Owner of *out: caller, gnutls_certificate_free_credentials(); NULL on error.  PVX_ESTALE: expired, or not yet
 * valid; PVX_EFORMAT: not PEM, or the key is of another certificate; PVX_EPERM: others may read the key. */
PVX_MUST_CHECK pvx_err view_certificate(const char *cert_file, const char *key_file,
                                        gnutls_certificate_credentials_t *out, struct pvx_diag *d);
#endif
