#include "daemon/view/certificate.h"

#include <gnutls/crypto.h>
#include <gnutls/x509.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "base/file.h"

#define PEM_MAX ((size_t)1 << 18)

static pvx_err certificate_when(const char *file, gnutls_x509_crt_t crt, struct pvx_diag *d)
{
    time_t now = time(NULL), from = gnutls_x509_crt_get_activation_time(crt);
    time_t to = gnutls_x509_crt_get_expiration_time(crt);
    char day[32] = "";
    struct tm tm;
    if (now >= from && now <= to)
        return PVX_OK;
    time_t t = now > to ? to : from;
    strftime(day, sizeof day, "%Y-%m-%d", gmtime_r(&t, &tm));
    return pvx_fail(d, PVX_ESTALE, "%s: the certificate %s %s; %s", file,
                    now > to ? "expired on" : "is valid from", day,
                    now > to ? "make a new one" : "is this host's clock right?");
}

/* Whether certificate and key, both read, belong together and are valid today. */
static pvx_err certificate_look(const char *cert_file, const char *key_file, const char *cert,
                                const char *key, gnutls_certificate_credentials_t *out,
                                struct pvx_diag *d)
{
    const gnutls_datum_t cert_pem = {(void *)cert, (unsigned)strlen(cert)};
    const gnutls_datum_t key_pem = {(void *)key, (unsigned)strlen(key)};
    gnutls_x509_crt_t crt;
    if (gnutls_x509_crt_init(&crt) != 0)
        return PVX_ENOMEM;
    pvx_err e = gnutls_x509_crt_import(crt, &cert_pem, GNUTLS_X509_FMT_PEM) == 0
                    ? certificate_when(cert_file, crt, d)
                    : pvx_fail(d, PVX_EFORMAT, "%s: not a certificate in PEM", cert_file);
    gnutls_x509_crt_deinit(crt);
    PVX_TRY(e);
    if (gnutls_certificate_allocate_credentials(out) != 0) {
        *out = NULL;
        return PVX_ENOMEM;
    }
    int bad = gnutls_certificate_set_x509_key_mem(*out, &cert_pem, &key_pem, GNUTLS_X509_FMT_PEM);
    if (bad >= 0)
        return PVX_OK;
    gnutls_certificate_free_credentials(*out);
    *out = NULL;
    return pvx_fail(d, PVX_EFORMAT, "%s: not the key of %s: %s", key_file, cert_file,
                    gnutls_strerror(bad));
}

pvx_err view_certificate(const char *cert_file, const char *key_file,
                         gnutls_certificate_credentials_t *out, struct pvx_diag *d)
{
    char *cert = NULL, *key = NULL;
    struct stat st;
    size_t n;
    *out = NULL;
    pvx_err e = pvx_file_read(cert_file, PEM_MAX, &cert, &n, d);
    PVX_THEN(e, pvx_file_read(key_file, PEM_MAX, &key, &n, d));
    if (e == PVX_OK && stat(key_file, &st) == 0 && (st.st_mode & 0007) != 0)
        e = pvx_fail(d, PVX_EPERM, "%s: others may read the key; chmod o= %s", key_file, key_file);
    PVX_THEN(e, certificate_look(cert_file, key_file, cert, key, out, d));
    free(cert);
    if (key != NULL)
        gnutls_memset(key, 0, n);
    free(key);
    return e;
}
