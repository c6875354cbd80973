#include "recon/geom/photometry_text.h"

#include <math.h>
#include <string.h>

bool rec_photometry_acts(const struct rec_photometry *p)
{
    return p->n_response > 0 || p->dark.file[0] != '\0' || p->flat.file[0] != '\0' ||
           p->mask[0] != '\0' || p->has_matrix;
}

/* ---- reading ---- */

struct reader {
    const pvx_yaml *y;
    const char *path;
    struct pvx_diag *d;
};

bool rec_photometry_plain(const char *s)
{
    for (; *s != '\0'; s++)
        if ((unsigned char)*s < 32 || *s == '"' || *s == '\\' || *s == 127)
            return false;
    return true;
}

static pvx_err geom_text(const struct reader *r, int map, const char *key, char *out, size_t size)
{
    int node = pvx_yaml_get(r->y, map, key);
    const char *s = pvx_yaml_text(r->y, node);
    if (node == 0)
        return PVX_OK;
    if (*s == '\0' || strlen(s) >= size || !rec_photometry_plain(s))
        return pvx_yaml_fail(r->y, node, r->path, PVX_EINVAL, r->d,
                             "%s should be a text of 1 to %zu characters without quotes", key,
                             size - 1);
    snprintf(out, size, "%s", s);
    return PVX_OK;
}

static pvx_err photometry_number(const struct reader *r, int map, const char *key, double lo,
                                 double hi, bool *has, double *out)
{
    char full[128];
    int node = pvx_yaml_get(r->y, map, key);
    snprintf(full, sizeof full, "%s.%s", r->path, key);
    *has = node != 0;
    return node == 0 ? PVX_OK : pvx_yaml_double(r->y, node, full, lo, hi, out, r->d);
}

static bool photometry_hex(const char *s, uint64_t *out)
{
    *out = 0;
    if (strlen(s) != 16 || strspn(s, "0123456789abcdef") != 16)
        return false;
    for (; *s != '\0'; s++)
        *out = *out << 4 | (uint64_t)(*s <= '9' ? *s - '0' : *s - 'a' + 10);
    return true;
}

static pvx_err map_file(const struct reader *r, int map, const char *key, struct rec_map *out)
{
    char full[128];
    int node = pvx_yaml_get(r->y, map, key);
    snprintf(full, sizeof full, "%s.%s", r->path, key);
    if (node == 0)
        return PVX_OK;
    PVX_TRY(pvx_yaml_known(r->y, node, full, "file hash", r->d));
    const struct reader of = {r->y, full, r->d};
    PVX_TRY(geom_text(&of, node, "file", out->file, sizeof out->file));
    if (out->file[0] == '\0')
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d, "the key 'file' is missing");
    if (!photometry_hex(pvx_yaml_text(r->y, pvx_yaml_get(r->y, node, "hash")), &out->hash))
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d,
                             "hash should be 16 digits 0-9 a-f, in quotes");
    return PVX_OK;
}

static pvx_err photometry_response(const struct reader *r, int map, struct rec_photometry *p)
{
    char full[128];
    int node = pvx_yaml_get(r->y, map, "response");
    snprintf(full, sizeof full, "%s.response", r->path);
    if (node == 0)
        return PVX_OK;
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, 2, REC_RESPONSE_MAX, p->response, r->d));
    p->n_response = (int)pvx_yaml_length(r->y, node);
    bool good = p->response[0] == 0 && p->response[p->n_response - 1] == 1;
    for (int i = 1; i < p->n_response; i++)
        good &= p->response[i] >= p->response[i - 1];
    return good ? PVX_OK
                : pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d,
                                "should rise from 0 to 1: light at samples 0 to full scale");
}

static pvx_err matrix(const struct reader *r, int map, struct rec_photometry *p)
{
    char full[128];
    int node = pvx_yaml_get(r->y, map, "matrix");
    snprintf(full, sizeof full, "%s.matrix", r->path);
    p->has_matrix = node != 0;
    if (node == 0)
        return PVX_OK;
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, 9, 9, p->matrix, r->d));
    for (int i = 0; i < 9; i++)
        if (fabs(p->matrix[i]) > 100)
            return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d, "%g is outside -100..100",
                                 p->matrix[i]);
    return PVX_OK;
}

pvx_err rec_photometry_read(const pvx_yaml *y, int node, const char *path,
                            struct rec_photometry *out, struct pvx_diag *d)
{
    char full[128];
    const struct reader r = {y, path, d};
    bool gain = false;
    *out = (struct rec_photometry){0};
    PVX_TRY(pvx_yaml_known(
        y, node, path,
        "serial device exposure gain_db temperature response dark flat mask matrix noise", d));
    PVX_TRY(geom_text(&r, node, "serial", out->serial, sizeof out->serial));
    PVX_TRY(geom_text(&r, node, "device", out->device, sizeof out->device));
    PVX_TRY(photometry_number(&r, node, "exposure", 1e-9, 1e6, &out->has_exposure, &out->exposure));
    PVX_TRY(photometry_number(&r, node, "gain_db", -1e3, 1e3, &out->has_gain, &out->gain_db));
    PVX_TRY(photometry_number(&r, node, "temperature", -273.15, 1e3, &out->has_temperature,
                              &out->temperature));
    PVX_TRY(photometry_response(&r, node, out));
    PVX_TRY(map_file(&r, node, "dark", &out->dark));
    PVX_TRY(map_file(&r, node, "flat", &out->flat));
    PVX_TRY(geom_text(&r, node, "mask", out->mask, sizeof out->mask));
    PVX_TRY(matrix(&r, node, out));
    int noise = pvx_yaml_get(y, node, "noise");
    if (noise == 0)
        return PVX_OK;
    snprintf(full, sizeof full, "%s.noise", path);
    const struct reader of = {y, full, d};
    PVX_TRY(pvx_yaml_known(y, noise, full, "read gain", d));
    PVX_TRY(photometry_number(&of, noise, "read", 0, 1, &out->has_noise, &out->read_noise));
    PVX_TRY(photometry_number(&of, noise, "gain", 0, 1, &gain, &out->noise_gain));
    if (!out->has_noise || !gain)
        return pvx_yaml_fail(y, noise, full, PVX_EFORMAT, d, "should have read and gain");
    return PVX_OK;
}

/* ---- writing ---- */

static void put_numbers(FILE *f, const char *key, const double *v, int n)
{
    fprintf(f, "      %s: [", key);
    for (int i = 0; i < n; i++)
        fprintf(f, "%s%.17g", i == 0 ? "" : ", ", v[i]);
    fputs("]\n", f);
}

static void put_map(FILE *f, const char *key, const struct rec_map *m)
{
    if (m->file[0] != '\0')
        fprintf(f, "      %s: { file: \"%s\", hash: \"%016llx\" }\n", key, m->file,
                (unsigned long long)m->hash);
}

void rec_photometry_write(FILE *f, const struct rec_photometry *p)
{
    if (!rec_photometry_acts(p) && !p->has_noise && p->serial[0] == '\0' && p->device[0] == '\0' &&
        !p->has_exposure && !p->has_gain && !p->has_temperature)
        return;
    fputs("    photometry:\n", f);
    if (p->serial[0] != '\0')
        fprintf(f, "      serial: \"%s\"\n", p->serial);
    if (p->device[0] != '\0')
        fprintf(f, "      device: \"%s\"\n", p->device);
    if (p->has_exposure)
        fprintf(f, "      exposure: %.17g\n", p->exposure);
    if (p->has_gain)
        fprintf(f, "      gain_db: %.17g\n", p->gain_db);
    if (p->has_temperature)
        fprintf(f, "      temperature: %.17g\n", p->temperature);
    if (p->n_response > 0)
        put_numbers(f, "response", p->response, p->n_response);
    put_map(f, "dark", &p->dark);
    put_map(f, "flat", &p->flat);
    if (p->mask[0] != '\0')
        fprintf(f, "      mask: \"%s\"\n", p->mask);
    if (p->has_matrix)
        put_numbers(f, "matrix", p->matrix, 9);
    if (p->has_noise)
        fprintf(f, "      noise: { read: %.17g, gain: %.17g }\n", p->read_noise, p->noise_gain);
}
