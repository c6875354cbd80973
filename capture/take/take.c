/* take.c - the reading half of take.h: the files of a recording that rolled over, as one take.
 *
 * All their tables are in memory with continuous numbers: indices in `member` are those of the whole take.  Few files
 * are open at a time, because libhdf5 keeps some MB for each. */
#include <dirent.h>
#include <limits.h>
#include <malloc.h>
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/take/piece.h"

#define OPEN_MAX_FILES 8

struct open_files {
    pthread_mutex_t lock;
    unsigned n;
    uint64_t turn;
};

struct cap_take {
    struct cap_take_info info;
    struct cap_take_camera *camera; /* for info.head; strings are the pieces' */
    size_t largest[CAP_MAX_CAMERAS];
    struct piece **piece; /* [info.pieces] */
    char **note;          /* [info.notes] */
    struct open_files *open;
};

/* ---- which files ---- */

/* The files of a recording except its first. */
struct others {
    char first[PATH_MAX]; /* path of the first file; of a link, its target */
    unsigned *number;     /* ascending, 2 and more */
    size_t n;
};

static pvx_err name_other(const struct others *o, unsigned number, char path[PATH_MAX])
{
    char more[16];
    snprintf(more, sizeof more, "-%04u", number);
    return pvx_path_more(o->first, more, path, PATH_MAX);
}

static int take_by_number(const void *a, const void *b)
{
    unsigned x = *(const unsigned *)a, y = *(const unsigned *)b;
    return x < y ? -1 : x > y;
}

/* Number of the file `name` in the recording; 0 = it is not part of it. */
static unsigned take_number_of(const struct others *o, const char *name)
{
    char path[PATH_MAX];
    const char *slash = strrchr(o->first, '/'), *base = slash != NULL ? slash + 1 : o->first;
    size_t stem = 0;
    if (pvx_path_more(base, "-", path, sizeof path) != PVX_OK)
        return 0;
    while (path[stem] == base[stem])
        stem++;
    if (strncmp(name, path, stem + 1) != 0)
        return 0;
    unsigned long n = strtoul(name + stem + 1, NULL, 10);
    if (n < 2 || n > UINT_MAX || name_other(o, (unsigned)n, path) != PVX_OK)
        return 0;
    return strcmp(name, path + (base - o->first)) == 0 ? (unsigned)n : 0;
}

static pvx_err find_others(const char *path, struct others *o)
{
    struct stat st;
    char dir[PATH_MAX];
    bool link = lstat(path, &st) == 0 && S_ISLNK(st.st_mode);
    if (!link || realpath(path, o->first) == NULL)
        snprintf(o->first, sizeof o->first, "%s", path);
    const char *slash = strrchr(o->first, '/');
    snprintf(dir, sizeof dir, "%.*s", slash != NULL ? (int)(slash - o->first) + 1 : 1,
             slash != NULL ? o->first : ".");
    DIR *all = opendir(dir);
    pvx_err e = PVX_OK;
    for (struct dirent *f; all != NULL && e == PVX_OK && (f = readdir(all)) != NULL;) {
        unsigned number = take_number_of(o, f->d_name);
        if (number == 0)
            continue;
        unsigned *more = realloc(o->number, (o->n + 1) * sizeof *more);
        if (more == NULL) {
            e = PVX_ENOMEM;
            break;
        }
        o->number = more;
        o->number[o->n++] = number;
    }
    if (all != NULL)
        closedir(all);
    if (o->n > 0)
        qsort(o->number, o->n, sizeof *o->number, take_by_number);
    return e;
}

/* ---- joining the files to one take ---- */

/* Without memory only the note is lost. */
__attribute__((format(printf, 2, 3))) static void note(cap_take *t, const char *fmt, ...)
{
    va_list ap;
    char *text, **more = realloc(t->note, (t->info.notes + 1) * sizeof *more);
    if (more == NULL)
        return;
    t->note = more;
    va_start(ap, fmt);
    if (vasprintf(&text, fmt, ap) >= 0)
        t->note[t->info.notes++] = text;
    va_end(ap);
}

static bool is_first(const struct piece *p)
{
    return p->head.t_began_ns == 0 || p->head.t_began_ns == p->head.t_created_ns;
}

/* Why the piece does not continue the take; NULL: it does. */
static const char *not_of_it(const cap_take *t, const struct piece *p)
{
    const struct cap_take_head *a = &t->info.head, *b = &p->head;
    if (a->session != b->session || a->t_began_ns != b->t_began_ns)
        return "is of another recording";
    bool same = a->n_cameras == b->n_cameras && strcmp(a->rig, b->rig) == 0;
    for (uint32_t c = 0; same && c < a->n_cameras; c++)
        same = strcmp(a->camera[c].name, p->camera[c].c.name) == 0;
    if (!same)
        return "has other cameras or another rig";
    if (t->info.sets > 0 && p->sets > 0 &&
        p->set[0].number <= cap_take_set(t, t->info.sets - 1, NULL)->number)
        return "has sets that do not go on from those before";
    return NULL;
}

/* Leave out of a piece a camera whose pictures differ from those before in size or format.  The piece's sets are then
 * without it, as when this happens within a file. */
static pvx_err leave_out_camera(cap_take *t, struct piece *p, uint32_t c)
{
    struct piece_camera *k = &p->camera[c];
    const struct cap_take_camera *was = &t->camera[c];
    const struct cap_take_row *a = k->row, *b = a + k->c.frames - 1;
    struct cap_take_gap *gap = realloc(p->gap, (p->gaps + 1) * sizeof *gap);
    PVX_NEED(gap);
    p->gap = gap;
    gap[p->gaps++] = (struct cap_take_gap){.camera = c,
                                           .why = CAP_TAKE_UNFIT,
                                           .frames = k->c.frames,
                                           .id_first = a->id,
                                           .id_last = b->id,
                                           .set_first = a->set,
                                           .set_last = b->set,
                                           .t_first_ns = a->t_exposure_ns,
                                           .t_last_ns = b->t_exposure_ns};
    note(t, "%s: the %llu frames of camera %s are left out: %s, %dx%d there, %s, %dx%d before",
         p->path, (unsigned long long)k->c.frames, k->c.name, cap_pixfmt_name(k->c.fmt), k->c.width,
         k->c.height, cap_pixfmt_name(was->fmt), was->width, was->height);
    for (uint64_t i = 0; i < p->sets; i++) {
        int64_t *row = &p->member[i * p->head.n_cameras + c];
        if (*row < 0)
            continue;
        *row = -1;
        p->set[i].n--;
        p->set[i].mask &= ~(1ull << c);
    }
    k->c.frames = 0;
    return PVX_OK;
}

static pvx_err take_add_camera(cap_take *t, struct piece *p, uint32_t c)
{
    struct cap_take_camera *all = &t->camera[c];
    struct piece_camera *k = &p->camera[c];
    if (all->fmt == CAP_FMT_NONE) {
        all->fmt = k->c.fmt;
        all->width = k->c.width;
        all->height = k->c.height;
        all->yuv = k->c.yuv;
    } else if (k->c.frames > 0 &&
               (k->c.fmt != all->fmt || k->c.width != all->width || k->c.height != all->height)) {
        PVX_TRY(leave_out_camera(t, p, c));
    }
    if (k->c.serial != NULL && k->c.serial[0] != '\0')
        all->serial = k->c.serial;
    if (isfinite(k->c.temperature_c))
        all->temperature_c = k->c.temperature_c;
    if (k->c.frames > 0 && k->largest > t->largest[c])
        t->largest[c] = k->largest;
    p->first[c] = all->frames;
    all->frames += k->c.frames;
    for (uint64_t i = 0; i < p->sets; i++) {
        int64_t *row = &p->member[i * p->head.n_cameras + c];
        *row += *row >= 0 ? (int64_t)p->first[c] : 0;
    }
    return PVX_OK;
}

/* Takes ownership of the piece in any case. */
static pvx_err take_add(cap_take *t, struct piece *p)
{
    struct cap_take_info *i = &t->info;
    struct piece **more = realloc(t->piece, (i->pieces + 1) * sizeof *more);
    if (more == NULL) {
        piece_free(&p);
        return PVX_ENOMEM;
    }
    t->piece = more;
    t->piece[i->pieces++] = p;
    if (i->pieces == 1) {
        i->head = p->head;
        i->head.camera = t->camera;
        for (uint32_t c = 0; c < p->head.n_cameras; c++)
            t->camera[c] = (struct cap_take_camera){.name = p->camera[c].c.name,
                                                    .uri = p->camera[c].c.uri,
                                                    .settings = p->camera[c].c.settings,
                                                    .serial = "",
                                                    .temperature_c = NAN};
    }
    for (uint32_t c = 0; c < p->head.n_cameras; c++)
        PVX_TRY(take_add_camera(t, p, c));
    p->first[PIECE_SETS] = i->sets;
    p->first[PIECE_GAPS] = i->gaps;
    i->sets += p->sets;
    i->gaps += p->gaps;
    if (i->pieces == 1) {
        i->triggers = p->triggers;
        i->lost = p->losses;
    }
    i->sets_lost += p->sets_lost;
    if (++t->open->n > OPEN_MAX_FILES) {
        piece_shut(p);
        t->open->n--;
    }
    return PVX_OK;
}

/* Count and note the sets that are lost between the last set of the take and the first of the piece. */
static void lose_between(cap_take *t, const struct piece *p)
{
    if (t->info.sets == 0 || p->sets == 0)
        return;
    uint64_t last = cap_take_set(t, t->info.sets - 1, NULL)->number, next = p->set[0].number;
    if (next - last < 2)
        return;
    t->info.sets_lost += next - last - 1;
    note(t, "%s: sets %llu to %llu, before it, are lost", p->path, (unsigned long long)last + 1,
         (unsigned long long)next - 1);
}

/* Note that the files [from, to] are missing. */
static void take_note_missing(cap_take *t, const struct others *o, unsigned from, unsigned to)
{
    char a[PATH_MAX], b[PATH_MAX];
    if (to < from || name_other(o, from, a) != PVX_OK || name_other(o, to, b) != PVX_OK)
        return;
    if (from == to)
        note(t, "%s: is missing", a);
    else
        note(t, "%s to %s: are missing", a, b);
}

/* Add the other files of the recording.  *last: number of the last file in the take.  *broken: a file after it cannot
 * be read. */
static pvx_err add_others(cap_take *t, const struct others *o, unsigned *last, bool *broken)
{
    size_t since = 0; /* index of the first file after `last` */
    for (size_t i = 0; i < o->n; i++) {
        char path[PATH_MAX];
        struct pvx_diag d = {""};
        struct piece *p;
        PVX_TRY(name_other(o, o->number[i], path));
        pvx_err e = piece_open(path, &p, &d);
        if (e == PVX_ENOMEM)
            return e;
        const char *why = e == PVX_OK && t->info.pieces > 0 ? not_of_it(t, p) : NULL;
        if (e != PVX_OK)
            note(t, "%s; it is left out", pvx_diag_text(&d, e));
        else if (why != NULL)
            note(t, "%s: %s; it is left out", path, why);
        *broken = *broken || e != PVX_OK;
        if (e != PVX_OK || why != NULL) {
            piece_free(&p);
            continue;
        }
        for (; since <= i; since++)
            take_note_missing(t, o, since > 0 ? o->number[since - 1] + 1 : 2, o->number[since] - 1);
        if (o->number[i] > *last + 1)
            lose_between(t, p);
        *last = o->number[i];
        *broken = false;
        PVX_TRY(take_add(t, p));
    }
    return PVX_OK;
}

static void note_states(cap_take *t)
{
    for (uint64_t i = 0; i < t->info.pieces; i++) {
        const struct piece *p = t->piece[i];
        if (!p->closed)
            note(t, "%s: was cut off%s: %llu complete sets, %llu lost", p->path,
                 i + 1 == t->info.pieces ? ", or is being recorded" : "",
                 (unsigned long long)p->sets, (unsigned long long)p->sets_lost);
        else if (p->sets_lost > 0)
            note(t, "%s: is damaged: %llu complete sets, %llu lost", p->path,
                 (unsigned long long)p->sets, (unsigned long long)p->sets_lost);
    }
}

static pvx_err take_do_read_all(cap_take *t, const char *path, struct pvx_diag *d)
{
    struct others o = {.n = 0};
    struct piece *p;
    unsigned last = 1;
    pvx_err first = piece_open(path, &p, d), e = PVX_OK;
    if (first != PVX_OK && first != PVX_EFORMAT)
        return first;
    bool broken = first != PVX_OK, whole = broken || is_first(p);
    if (first == PVX_OK)
        e = take_add(t, p);
    else
        note(t, "%s; it is left out", pvx_diag_text(d, first));
    if (e == PVX_OK && whole)
        e = find_others(path, &o);
    PVX_THEN(e, add_others(t, &o, &last, &broken));
    if (e == PVX_OK && t->info.pieces == 0)
        e = first;
    if (e == PVX_OK) {
        const struct piece *end = t->piece[t->info.pieces - 1];
        char next[PATH_MAX];
        bool goes_on = whole && end->goes_on;
        note_states(t);
        t->info.closed = end->closed && !goes_on && !broken;
        last++;
        if (goes_on && !broken && name_other(&o, last, next) == PVX_OK &&
            (o.n == 0 || bsearch(&last, o.number, o.n, sizeof last, take_by_number) == NULL))
            note(t, "%s: is %s", next,
                 access(next, F_OK) != 0 ? "missing, in which the recording went on"
                                         : "not read: it was begun meanwhile");
    }
    free(o.number);
    return e;
}

pvx_err cap_take_open(const char *path, cap_take **out, struct pvx_diag *d)
{
    take_h5_init();
    *out = NULL;
    cap_take *t = pvx_calloc(1, sizeof *t);
    PVX_NEED(t);
    t->camera = pvx_calloc(CAP_MAX_CAMERAS, sizeof *t->camera);
    t->open = pvx_calloc(1, sizeof *t->open);
    pvx_err e = PVX_ENOMEM;
    if (t->open != NULL)
        pthread_mutex_init(&t->open->lock, NULL);
    if (t->camera != NULL && t->open != NULL)
        e = take_do_read_all(t, path, d);
    if (e != PVX_OK)
        cap_take_free(&t);
    *out = t;
    return e;
}

void cap_take_free(cap_take **tp)
{
    cap_take *t = *tp;
    if (t == NULL)
        return;
    *tp = NULL;
    take_h5_init();
    for (uint64_t i = 0; i < t->info.pieces; i++)
        piece_free(&t->piece[i]);
    for (uint64_t k = 0; k < t->info.notes; k++)
        free(t->note[k]);
    if (t->open != NULL)
        pthread_mutex_destroy(&t->open->lock);
    free(t->open);
    free(t->piece);
    free(t->note);
    free(t->camera);
    free(t);
}

/* ---- the tables ---- */

const struct cap_take_info *cap_take_info(const cap_take *t)
{
    return &t->info;
}

const char *cap_take_note(const cap_take *t, uint64_t k)
{
    return t->note[k];
}

struct cap_take_piece cap_take_piece(const cap_take *t, uint64_t k)
{
    const struct piece *p = t->piece[k];
    return (struct cap_take_piece){p->path, p->first[PIECE_SETS], p->sets, p->closed};
}

int cap_take_find(const cap_take *t, const char *camera)
{
    for (uint32_t c = 0; c < t->info.head.n_cameras; c++)
        if (strcmp(t->camera[c].name, camera) == 0)
            return (int)c;
    return -1;
}

/* The piece that has this row of a table: the last piece that begins at or before the row. */
static struct piece *take_piece_of(const cap_take *t, int table, uint64_t row)
{
    uint64_t lo = 0, hi = t->info.pieces;
    while (hi - lo > 1) {
        uint64_t mid = lo + (hi - lo) / 2;
        if (t->piece[mid]->first[table] <= row)
            lo = mid;
        else
            hi = mid;
    }
    return t->piece[lo];
}

const struct cap_take_set *cap_take_set(const cap_take *t, uint64_t k, const int64_t **member)
{
    const struct piece *p = take_piece_of(t, PIECE_SETS, k);
    k -= p->first[PIECE_SETS];
    if (member != NULL)
        *member = &p->member[k * t->info.head.n_cameras];
    return &p->set[k];
}

int64_t cap_take_find_set(const cap_take *t, int64_t number)
{
    uint64_t lo = 0, hi = t->info.sets;
    while (lo < hi) {
        uint64_t mid = lo + (hi - lo) / 2;
        if (cap_take_set(t, mid, NULL)->number < (uint64_t)number)
            lo = mid + 1;
        else
            hi = mid;
    }
    return number >= 0 && lo < t->info.sets && cap_take_set(t, lo, NULL)->number == (uint64_t)number
               ? (int64_t)lo
               : -1;
}

const struct cap_take_row *cap_take_row(const cap_take *t, uint32_t camera, uint64_t row)
{
    const struct piece *p = take_piece_of(t, (int)camera, row);
    return &p->camera[camera].row[row - p->first[camera]];
}

const struct cap_take_gap *cap_take_gap(const cap_take *t, uint64_t k)
{
    const struct piece *p = take_piece_of(t, PIECE_GAPS, k);
    return &p->gap[k - p->first[PIECE_GAPS]];
}

const struct cap_take_trigger *cap_take_trigger(const cap_take *t, uint64_t k)
{
    return &t->piece[0]->trigger[k];
}

const struct cap_take_lost *cap_take_lost(const cap_take *t, uint64_t k)
{
    return &t->piece[0]->lost[k];
}

size_t cap_take_frame_max(const cap_take *t, uint32_t camera)
{
    return t->largest[camera];
}

void cap_take_only(cap_take *t, uint64_t first, uint64_t end)
{
    for (uint64_t i = 0; i < t->info.pieces; i++) {
        struct piece *p = t->piece[i];
        if (p->first[PIECE_SETS] < end && p->first[PIECE_SETS] + p->sets > first)
            continue;
        t->open->n -= p->file >= 0;
        piece_shut(p);
        for (uint32_t c = 0; c < p->head.n_cameras; c++)
            PVX_FREE(p->camera[c].row);
    }
    malloc_trim(0); /* small tables lie between other blocks, so libc would keep their pages */
}

/* ---- pixels ---- */

/* Open the piece's file, if it is closed; another may be closed for it.  Under the lock. */
static void take_reach(const cap_take *t, struct piece *p)
{
    struct open_files *o = t->open;
    struct piece *oldest = NULL;
    p->used = ++o->turn;
    if (p->file >= 0)
        return;
    for (uint64_t i = 0; i < t->info.pieces && o->n >= OPEN_MAX_FILES; i++)
        if (t->piece[i]->file >= 0 && (oldest == NULL || t->piece[i]->used < oldest->used))
            oldest = t->piece[i];
    if (oldest != NULL) {
        piece_shut(oldest);
        o->n--;
    }
    o->n += piece_reopen(p);
}

pvx_err cap_take_read(const cap_take *t, uint32_t camera, uint64_t row, void *mem, size_t size,
                      struct cap_image *img, struct pvx_diag *d)
{
    take_h5_init();
    const char *name = t->camera[camera].name;
    if (row >= t->camera[camera].frames)
        return pvx_fail(d, PVX_EINVAL, "%s: camera %s has no frame in place %llu",
                        t->piece[0]->path, name, (unsigned long long)row);
    struct piece *p = take_piece_of(t, (int)camera, row);
    row -= p->first[camera];
    const struct cap_take_row *r = &p->camera[camera].row[row];
    if (r->bytes > size)
        return pvx_fail(d, PVX_ERANGE, "%s: a frame of camera %s has %llu bytes, room is for %zu",
                        p->path, name, (unsigned long long)r->bytes, size);
    pthread_mutex_lock(&t->open->lock);
    take_reach(t, p);
    bool fetched = piece_fetch(p, camera, row, mem);
    pthread_mutex_unlock(&t->open->lock);
    if (!fetched || !piece_is(p, camera, row, mem, img))
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: camera %s, frame %llu (place %llu): its pixels are cut off or damaged",
                        p->path, name, (unsigned long long)r->id, (unsigned long long)row);
    return PVX_OK;
}
