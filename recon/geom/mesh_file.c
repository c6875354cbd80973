#include "recon/geom/mesh_file.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "recon/geom/body.h"

#define WORD_MAX 63 /* characters of a number; a double needs 24 */

static bool blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

struct rec_word rec_mesh_word(struct rec_mesh_file *f)
{
    while (f->at < f->end && blank(*f->at))
        f->at++;
    struct rec_word w = {f->at, 0};
    while (f->at < f->end && !blank(*f->at) && *f->at != '\n')
        f->at++;
    w.len = (size_t)(f->at - w.at);
    return w.len > 0 ? w : (struct rec_word){NULL, 0};
}

void rec_mesh_skip_space(struct rec_mesh_file *f)
{
    while (f->at < f->end && (blank(*f->at) || *f->at == '\n'))
        f->at++;
}

struct rec_word rec_mesh_word_below(struct rec_mesh_file *f)
{
    rec_mesh_skip_space(f);
    return rec_mesh_word(f);
}

bool rec_word_is(struct rec_word w, const char *text)
{
    return w.at != NULL && w.len == strlen(text) && strncasecmp(w.at, text, w.len) == 0;
}

/* Numbers are in the C locale: the program never calls setlocale(). */
bool rec_word_number(struct rec_word w, bool single, double *out)
{
    char text[WORD_MAX + 1], *end;
    if (w.at == NULL || w.len > WORD_MAX)
        return false;
    memcpy(text, w.at, w.len);
    text[w.len] = '\0';
    *out = single ? (double)strtof(text, &end) : strtod(text, &end);
    return end == text + w.len;
}

void rec_mesh_skip_line(struct rec_mesh_file *f)
{
    const char *newline = memchr(f->at, '\n', (size_t)(f->end - f->at));
    f->at = newline != NULL ? newline + 1 : f->end;
}

const uint8_t *rec_mesh_bytes(struct rec_mesh_file *f, size_t n)
{
    const char *p = f->at;
    if (n > (size_t)(f->end - p))
        return NULL;
    f->at += n;
    return (const uint8_t *)p;
}

uint32_t rec_mesh_u32(const uint8_t *p, size_t bytes, bool big)
{
    uint32_t v = 0;
    for (size_t i = 0; i < bytes; i++)
        v |= (uint32_t)p[i] << 8 * (big ? bytes - 1 - i : i);
    return v;
}

float rec_mesh_f32(const uint8_t *p, bool big)
{
    uint32_t bits = rec_mesh_u32(p, 4, big);
    float v;
    memcpy(&v, &bits, sizeof v);
    return v;
}

pvx_err rec_mesh_put(struct rec_mesh_file *f, const double *a, const double *b, const double *c)
{
    const double *from[3] = {a, b, c};
    if (f->n >= REC_MESH_MAX) {
        f->n++;
        return PVX_OK;
    }
    if (f->n == f->room) {
        size_t room = f->room > 0 ? 2 * f->room : 1024;
        double *more = realloc(f->corner, room * 9 * sizeof *more);
        if (more == NULL)
            return PVX_ENOMEM;
        f->corner = more;
        f->room = room;
    }
    double *to = f->corner + 9 * f->n++;
    for (int i = 0; i < 9; i++)
        to[i] = f->scale * from[i / 3][i % 3];
    return PVX_OK;
}

pvx_err rec_mesh_bad(const struct rec_mesh_file *f, const char *what)
{
    size_t place = 1;
    if (f->counted)
        place += (size_t)(f->at - f->start);
    for (const char *p = f->start; !f->counted && p < f->at; p++)
        place += *p == '\n';
    return pvx_fail(f->d, PVX_EFORMAT, "%s %zu: %s; export the mesh again",
                    f->counted ? "byte" : "line", place, what);
}
