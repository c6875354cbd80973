#include "daemon/volumes/numbered.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cjson/cJSON.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/control/json.h"

const char *const vol_gap_names[VOL_GAPS] = {"lost", "queue", "unreadable", "unsolved"};

#define FILE_MAX ((size_t)1 << 36)

struct shown { /* frames first to last show this set */
    uint64_t first, last, set, session;
    int64_t t_ns;
};

struct vol_numbered {
    char dir[PATH_MAX - 300], name[200];
    const char *ext;
    struct pvp_start start;
    struct vol_options o;
    struct shown *shown;
    size_t n_shown, cap_shown;
    struct vol_gap *gap;
    size_t n_gaps, cap_gaps;
    uint64_t base, base_set, session; /* the frame from which is counted */
    int64_t base_t_ns;
    uint64_t bytes, left_out;
    bool closed;
};

static const struct shown *numbered_newest(const struct vol_numbered *n)
{
    return n->n_shown > 0 ? &n->shown[n->n_shown - 1] : NULL;
}

static void file_name(const struct vol_numbered *n, uint64_t frame, char path[PATH_MAX])
{
    snprintf(path, PATH_MAX, "%s/%s_%04llu.%s", n->dir, n->name, (unsigned long long)frame, n->ext);
}

/* The frame of v; 0 = it is left out.  *anew: counting begins again there. */
static uint64_t frame_of(const struct vol_numbered *n, const struct pvp_volume *v, bool *anew)
{
    const struct shown *s = numbered_newest(n);
    *anew = s == NULL || v->session != n->session ||
            (n->o.fps > 0 && v->t_exposure_ns < s->t_ns); /* the clock was set back */
    if (*anew)
        return s == NULL ? 1 : s->last + 1;
    /* Subtract before there are doubles, which take large numbers that are close for one. */
    double ahead = -1;
    if (n->o.fps > 0)
        ahead = round((double)(v->t_exposure_ns - n->base_t_ns) * 1e-9 * n->o.fps);
    else if (v->set > n->base_set)
        ahead = (double)(v->set - n->base_set);
    double frame = (double)n->base + ahead;
    if (!(frame > (double)s->last))
        return 0;
    *anew = frame > (double)s->last + VOL_HOLE_MAX;
    return *anew ? s->last + 1 : (uint64_t)frame;
}

bool vol_numbered_wants(const vol_numbered *n, const struct pvp_volume *v)
{
    bool anew;
    return frame_of(n, v, &anew) != 0;
}

static pvx_err write_list(const struct vol_numbered *n, struct pvx_diag *d);

/* ---- opening ------------------------------------------------------------------------------------ */

static pvx_err set_names(struct vol_numbered *n, const char *dir, struct pvx_diag *d)
{
    size_t len = strlen(dir);
    while (len > 1 && dir[len - 1] == '/')
        len--;
    if (len == 0 || len >= sizeof n->dir)
        return pvx_fail(d, PVX_EINVAL, "%s: empty or over-long path", dir);
    snprintf(n->dir, sizeof n->dir, "%.*s", (int)len, dir);
    const char *slash = strrchr(n->dir, '/'), *name = slash != NULL ? slash + 1 : n->dir;
    if (*name == '\0' || strcmp(name, ".") == 0 || strcmp(name, "..") == 0)
        name = "volume";
    if (strlen(name) >= sizeof n->name)
        return pvx_fail(d, PVX_EINVAL, "%s: over-long name", dir);
    snprintf(n->name, sizeof n->name, "%s", name);
    return PVX_OK;
}

pvx_err vol_numbered_check(const char *dir, struct pvx_diag *d)
{
    PVX_TRY(pvx_mkdirs(dir, d));
    DIR *f = opendir(dir);
    if (f == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    bool full = false;
    for (const struct dirent *e; !full && (e = readdir(f)) != NULL;)
        full = strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0;
    closedir(f);
    return full ? pvx_fail(d, PVX_EBUSY,
                           "%s: there is something in it, and nothing is written over; name "
                           "another folder",
                           dir)
                : PVX_OK;
}

static pvx_err numbered_put_text(const struct vol_numbered *n, const char *name, const char *text,
                                 struct pvx_diag *d)
{
    char path[PATH_MAX];
    if (text == NULL)
        return PVX_OK;
    snprintf(path, sizeof path, "%s/%s", n->dir, name);
    return pvx_file_write(path, text, strlen(text), d);
}

pvx_err vol_numbered_new(const char *dir, const char *ext, const struct vol_head *head,
                         const struct vol_options *o, vol_numbered **out, struct pvx_diag *d)
{
    *out = NULL;
    struct vol_numbered *n = calloc(1, sizeof *n);
    PVX_NEED(n);
    n->ext = ext;
    n->start = head->start;
    n->o = *o;
    pvx_err e = set_names(n, dir, d);
    PVX_THEN(e, vol_numbered_check(n->dir, d));
    PVX_THEN(e, numbered_put_text(n, "rig.yaml", head->rig, d));
    PVX_THEN(e, numbered_put_text(n, "pyrovoxd.yaml", head->config, d));
    PVX_THEN(e, write_list(n, d));
    if (e == PVX_OK)
        *out = n;
    else
        free(n);
    return e;
}

/* ---- frames ------------------------------------------------------------------------------------- */

static pvx_err numbered_grow(void **array, size_t n, size_t *cap, size_t one)
{
    if (n < *cap)
        return PVX_OK;
    size_t more = *cap > 0 ? 2 * *cap : 256;
    void *p = realloc(*array, more * one);
    PVX_NEED(p);
    memset((char *)p + n * one, 0, (more - n) * one);
    *array = p;
    *cap = more;
    return PVX_OK;
}

/* Repeat the file of frame `from`: as a link, or as a copy if no (more) links are possible. */
static pvx_err numbered_again(struct vol_numbered *n, uint64_t from, uint64_t frame,
                              struct pvx_diag *d)
{
    char old[PATH_MAX], new[PATH_MAX], *data;
    size_t len;
    file_name(n, from, old);
    file_name(n, frame, new);
    if (link(old, new) == 0)
        return PVX_OK;
    PVX_TRY(pvx_file_read(old, FILE_MAX, &data, &len, d));
    pvx_err e = PVX_OK;
    PVX_THEN(e, pvx_file_write(new, data, len, d));
    free(data);
    n->bytes += e == PVX_OK ? len : 0;
    return e;
}

/* Fill the missing frames before `frame` with the set before. */
static pvx_err numbered_fill(struct vol_numbered *n, uint64_t frame, struct pvx_diag *d)
{
    struct shown *before = n->n_shown > 0 ? &n->shown[n->n_shown - 1] : NULL;
    while (before != NULL && before->last + 1 < frame) {
        PVX_TRY(numbered_again(n, before->first, before->last + 1, d));
        before->last++;
    }
    return PVX_OK;
}

pvx_err vol_numbered_put(vol_numbered *n, const struct pvp_volume *v, const void *data, size_t len,
                         struct pvx_diag *d)
{
    char path[PATH_MAX];
    bool anew;
    uint64_t frame = frame_of(n, v, &anew);
    if (frame == 0) {
        n->left_out++;
        return PVX_OK;
    }
    PVX_TRY(numbered_grow((void **)&n->shown, n->n_shown, &n->cap_shown, sizeof *n->shown));
    PVX_TRY(numbered_fill(n, frame, d));
    file_name(n, frame, path);
    PVX_TRY(pvx_file_write(path, data, len, d));
    n->shown[n->n_shown++] = (struct shown){frame, frame, v->set, v->session, v->t_exposure_ns};
    n->bytes += len;
    if (anew) {
        n->base = frame;
        n->base_set = v->set;
        n->base_t_ns = v->t_exposure_ns;
        n->session = v->session;
    }
    return PVX_OK;
}

pvx_err vol_numbered_gap(vol_numbered *n, const struct vol_gap *g)
{
    PVX_TRY(numbered_grow((void **)&n->gap, n->n_gaps, &n->cap_gaps, sizeof *n->gap));
    n->gap[n->n_gaps++] = *g;
    return PVX_OK;
}

uint64_t vol_numbered_bytes(const vol_numbered *n)
{
    return n->bytes;
}

/* ---- what is there already ---------------------------------------------------------------------- */

static void take_rate(struct vol_numbered *n)
{
    char path[PATH_MAX], *text;
    size_t len;
    snprintf(path, sizeof path, "%s/%s.json", n->dir, n->name);
    if (pvx_file_read(path, FILE_MAX, &text, &len, NULL) != PVX_OK)
        return;
    cJSON *o = cJSON_ParseWithLength(text, len);
    const cJSON *fps = cJSON_GetObjectItemCaseSensitive(o, "fps");
    if (cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(o, "resampled")) && cJSON_IsNumber(fps) &&
        isfinite(fps->valuedouble))
        n->o.fps = fps->valuedouble;
    cJSON_Delete(o);
    free(text);
}

/* Where a file's number begins; NULL: it has none. */
static const char *numbered_number_in(const char *name)
{
    const char *p = strrchr(name, '_');
    return p != NULL && p > name && p[1] >= '0' && p[1] <= '9' ? p + 1 : NULL;
}

pvx_err vol_numbered_again(const char *dir, const char *any, const char *ext,
                           const struct vol_head *head, const struct vol_options *o,
                           vol_numbered **out, struct pvx_diag *d)
{
    *out = NULL;
    struct vol_numbered *n = calloc(1, sizeof *n);
    PVX_NEED(n);
    n->ext = ext;
    n->start = head->start;
    n->o = *o;
    const char *number = numbered_number_in(any);
    pvx_err e = set_names(n, dir, d);
    if (e == PVX_OK && number != NULL && (size_t)(number - any) <= sizeof n->name)
        snprintf(n->name, sizeof n->name, "%.*s", (int)(number - 1 - any), any);
    take_rate(n);
    if (e == PVX_OK)
        *out = n;
    else
        free(n);
    return e;
}

pvx_err vol_numbered_found(vol_numbered *n, const char *name, const struct pvp_volume *v,
                           struct pvx_diag *d)
{
    const char *number = numbered_number_in(name);
    const struct shown *s = numbered_newest(n);
    uint64_t frame = number != NULL ? strtoull(number, NULL, 10) : 0;
    if (frame == 0 || (s != NULL && (frame <= s->last || frame > s->last + VOL_HOLE_MAX)))
        return pvx_fail(d, PVX_EFORMAT, "%s/%s: is not numbered as the files of this recording",
                        n->dir, name);
    PVX_TRY(numbered_grow((void **)&n->shown, n->n_shown, &n->cap_shown, sizeof *n->shown));
    PVX_TRY(numbered_fill(n, frame, d));
    if (n->n_shown > 0 && numbered_newest(n)->session == v->session) {
        struct shown *before = &n->shown[n->n_shown - 1];
        const struct vol_gap g = {
            .why = VOL_GAP_LOST, .set_first = before->set + 1, .set_last = v->set - 1};
        if (before->set == v->set) {
            before->last = frame;
            return PVX_OK;
        }
        if (g.set_first <= g.set_last && !(n->o.fps > 0))
            PVX_TRY(vol_numbered_gap(n, &g));
    }
    n->shown[n->n_shown++] = (struct shown){frame, frame, v->set, v->session, v->t_exposure_ns};
    return PVX_OK;
}

/* ---- the list ----------------------------------------------------------------------------------- */

static void put_frames(struct dmn_json *j, const struct vol_numbered *n)
{
    char session[20];
    dmn_json_open(j, "shown", '[');
    for (size_t i = 0; i < n->n_shown; i++) {
        const struct shown *s = &n->shown[i];
        snprintf(session, sizeof session, "%016llx", (unsigned long long)s->session);
        dmn_json_open(j, NULL, '{');
        dmn_json_int(j, "frame", (long long)s->first);
        dmn_json_int(j, "repeated", (long long)(s->last - s->first));
        dmn_json_int(j, "set", (long long)s->set);
        dmn_json_int(j, "t_exposure_ns", s->t_ns);
        dmn_json_str(j, "session", session);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

static void numbered_put_gaps(struct dmn_json *j, const struct vol_numbered *n)
{
    dmn_json_open(j, "gaps", '[');
    for (size_t i = 0; i < n->n_gaps; i++) {
        const struct vol_gap *g = &n->gap[i];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "why", vol_gap_names[g->why]);
        dmn_json_int(j, "set_first", (long long)g->set_first);
        dmn_json_int(j, "set_last", (long long)g->set_last);
        dmn_json_int(j, "volumes", (long long)g->volumes);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

static void numbered_put_list(struct dmn_json *j, const void *what)
{
    const struct vol_numbered *n = what;
    const struct pvp_grid *g = &n->start.grid;
    const struct shown *s = numbered_newest(n);
    char hash[20];
    snprintf(hash, sizeof hash, "%016llx", (unsigned long long)n->start.rig_hash);
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "format", "pyrovox numbered volumes");
    dmn_json_int(j, "version", 1);
    dmn_json_bool(j, "closed", n->closed);
    dmn_json_str(j, "file", n->ext);
    dmn_json_int(j, "frames", s != NULL ? (long long)s->last : 0);
    dmn_json_num(j, "fps", n->o.fps > 0 ? n->o.fps : n->start.fps);
    dmn_json_bool(j, "resampled", n->o.fps > 0);
    dmn_json_int(j, "left_out", (long long)n->left_out);
    dmn_json_str(j, "up", n->o.y_up ? "y" : "z");
    dmn_json_num(j, "unit_m", n->o.unit_m > 0 ? n->o.unit_m : 1);
    dmn_json_open(j, "n", '[');
    for (int a = 0; a < 3; a++)
        dmn_json_int(j, NULL, g->n[a]);
    dmn_json_close(j, ']');
    dmn_json_open(j, "min_m", '[');
    for (int a = 0; a < 3; a++)
        dmn_json_num(j, NULL, g->min[a]);
    dmn_json_close(j, ']');
    dmn_json_open(j, "max_m", '[');
    for (int a = 0; a < 3; a++)
        dmn_json_num(j, NULL, g->max[a]);
    dmn_json_close(j, ']');
    dmn_json_str(j, "basis", g->basis == 1 ? "trilinear" : "box");
    dmn_json_str(j, "units", n->start.units);
    dmn_json_str(j, "rig_hash", hash);
    dmn_json_str(j, "software", n->start.software);
    put_frames(j, n);
    numbered_put_gaps(j, n);
    dmn_json_close(j, '}');
}

static pvx_err write_list(const struct vol_numbered *n, struct pvx_diag *d)
{
    char path[PATH_MAX], *text = NULL;
    size_t len = 0;
    snprintf(path, sizeof path, "%s/%s.json", n->dir, n->name);
    FILE *f = open_memstream(&text, &len);
    PVX_NEED(f);
    pvx_err e = dmn_json_print(f, numbered_put_list, n, d);
    if (fclose(f) != 0 && e == PVX_OK)
        e = PVX_ENOMEM;
    PVX_THEN(e, pvx_file_write(path, text, len, d));
    free(text);
    return e;
}

pvx_err vol_numbered_close(vol_numbered **np, struct pvx_diag *d)
{
    struct vol_numbered *n = *np;
    if (n == NULL)
        return PVX_OK;
    n->closed = true;
    pvx_err e = write_list(n, d);
    vol_numbered_drop(np);
    return e;
}

void vol_numbered_drop(vol_numbered **np)
{
    if (*np == NULL)
        return;
    free((*np)->shown);
    free((*np)->gap);
    PVX_FREE(*np);
}
