#include "daemon/cli/experiment/state.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"

#define STATE_MAX ((size_t)1 << 28)

static pvx_err state_keep(struct experiment_state *s, const struct experiment_unit *u)
{
    for (size_t i = 0; i < s->n; i++)
        if (strcmp(s->unit[i].key, u->key) == 0) { /* the later one counts */
            s->unit[i] = *u;
            return PVX_OK;
        }
    if (s->n == s->room) {
        size_t room = 2 * s->room + 64;
        struct experiment_unit *more = realloc(s->unit, room * sizeof *more);
        PVX_NEED(more);
        s->unit = more;
        s->room = room;
    }
    s->unit[s->n++] = *u;
    return PVX_OK;
}

/* Read a line (1).  false: it is no such line. */
static bool read_line(char *line, struct experiment_unit *u)
{
    char *at = strchr(line, ',');
    if (at == NULL || at == line || (size_t)(at - line) >= sizeof u->key)
        return false;
    *at = '\0';
    snprintf(u->key, sizeof u->key, "%s", line);
    for (int i = 0; i < EXPERIMENT_VALUES; i++) {
        char *end;
        u->v[i] = strtod(at + 1, &end);
        if (end == at + 1 || *end != (i + 1 < EXPERIMENT_VALUES ? ',' : '\0'))
            return false;
        at = end;
    }
    return true;
}

static pvx_err read_done(struct experiment_state *s, const char *path, struct pvx_diag *d)
{
    char *text, *line;
    size_t len;
    struct pvx_diag why = {""};
    pvx_err e = pvx_file_read(path, STATE_MAX, &text, &len, &why);
    if (e != PVX_OK)
        return e == PVX_ENOENT ? PVX_OK : pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
    line = text;
    for (char *end; e == PVX_OK && (end = strchr(line, '\n')) != NULL; line = end + 1) {
        struct experiment_unit u;
        *end = '\0';
        if (read_line(line, &u))
            e = state_keep(s, &u);
    }
    free(text);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
}

/* Check that the results in `out` belong to these arguments.  Without results, or with anew, start with them. */
static pvx_err check_arguments(const char *out, const char *arguments, bool anew,
                               struct pvx_diag *d)
{
    char path[4300], done[4300], *was = NULL;
    size_t len;
    snprintf(path, sizeof path, "%s/state/arguments", out);
    snprintf(done, sizeof done, "%s/state/done.csv", out);
    struct pvx_diag why = {""};
    pvx_err e = pvx_file_read(path, STATE_MAX, &was, &len, &why);
    if (e != PVX_OK && e != PVX_ENOENT)
        return pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
    bool same = e == PVX_OK && strcmp(was, arguments) == 0, other = e == PVX_OK && !same;
    free(was);
    if (other && !anew)
        return pvx_fail(d, PVX_EINVAL,
                        "%s holds an experiment with other arguments or on another recording; give "
                        "--anew to replace it, or another --out",
                        out);
    if (!same || anew)
        if (remove(done) != 0 && errno != ENOENT)
            return pvx_fail(d, PVX_EIO, "%s: %s", done, strerror(errno));
    return same ? PVX_OK : pvx_file_write(path, arguments, strlen(arguments), d);
}

/* Write the units that were read again, without the incomplete line that a crash may have left.  The old file stays
 * until all of the new one is written, because the disk may be full. */
static pvx_err rewrite(struct experiment_state *s, const char *path, struct pvx_diag *d)
{
    char beside[4310];
    size_t n = s->n;
    pvx_err e = PVX_OK;
    snprintf(beside, sizeof beside, "%s.tmp", path);
    s->file = fopen(beside, "we");
    if (s->file == NULL)
        return pvx_fail(d, PVX_EIO, "%s: %s", beside, strerror(errno));
    s->n = 0;
    for (size_t i = 0; i < n && e == PVX_OK; i++) {
        struct experiment_unit u = s->unit[i];
        e = experiment_state_add(s, u.key, u.v, d);
    }
    if (e == PVX_OK && rename(beside, path) != 0)
        e = pvx_fail(d, PVX_EIO, "%s: %s", path, strerror(errno));
    if (e != PVX_OK)
        unlink(beside);
    return e;
}

pvx_err experiment_state_open(struct experiment_state *s, const char *out, const char *arguments,
                              bool anew, struct pvx_diag *d)
{
    char path[4300];
    *s = (struct experiment_state){0};
    snprintf(path, sizeof path, "%s/state", out);
    PVX_TRY(pvx_mkdirs(path, d));
    PVX_TRY(check_arguments(out, arguments, anew, d));
    snprintf(path, sizeof path, "%s/state/done.csv", out);
    PVX_TRY(read_done(s, path, d));
    return rewrite(s, path, d);
}

void experiment_state_close(struct experiment_state *s)
{
    if (s->file != NULL)
        fclose(s->file);
    PVX_FREE(s->unit);
    *s = (struct experiment_state){0};
}

const double *experiment_state_find(const struct experiment_state *s, const char *key)
{
    for (size_t i = 0; i < s->n; i++)
        if (strcmp(s->unit[i].key, key) == 0)
            return s->unit[i].v;
    return NULL;
}

pvx_err experiment_state_add(struct experiment_state *s, const char *key,
                             const double v[EXPERIMENT_VALUES], struct pvx_diag *d)
{
    struct experiment_unit u;
    snprintf(u.key, sizeof u.key, "%s", key);
    memcpy(u.v, v, sizeof u.v);
    fputs(u.key, s->file);
    for (int i = 0; i < EXPERIMENT_VALUES; i++)
        fprintf(s->file, ",%.9g", v[i]);
    if (fputc('\n', s->file) == EOF || fflush(s->file) != 0)
        return pvx_fail(d, PVX_EIO, "state/done.csv: %s", strerror(errno));
    if (state_keep(s, &u) != PVX_OK)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for what was measured");
    return PVX_OK;
}
