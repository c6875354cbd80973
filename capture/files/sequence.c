#include "capture/files/sequence.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#define MAX_WIDTH 19 /* of a pattern: the digits of INT64_MAX */
#define NONE      (-1)
#define TOO_LARGE (-2) /* a number beyond INT64_MAX */

/* The parts of "flame_%04d.png"; a plain folder has no pattern. */
struct pattern {
    const char *suffix;
    size_t prefix_len, suffix_len;
    int width; /* 0 = %d */
};

static const char *last_part(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash != NULL ? slash + 1 : path;
}

static bool sequence_has_extension(const char *path, const char *const *ext)
{
    const char *dot = strrchr(path, '.');
    for (; dot != NULL && *ext != NULL; ext++)
        if (strcasecmp(dot, *ext) == 0)
            return true;
    return false;
}

bool cap_is_image(const char *path)
{
    static const char *const ext[] = {".npy", ".png", ".tif", ".tiff", ".jpg", ".jpeg", NULL};
    return sequence_has_extension(path, ext);
}

bool cap_is_jpeg(const char *path)
{
    static const char *const ext[] = {".jpg", ".jpeg", NULL};
    return sequence_has_extension(path, ext);
}

bool cap_is_stack(const char *path)
{
    static const char *const ext[] = {".tif", ".tiff", NULL};
    return sequence_has_extension(path, ext);
}

bool cap_is_video(const char *path)
{
    static const char *const ext[] = {".mp4", ".avi", ".mkv", ".mov", ".cine", ".mraw", NULL};
    return sequence_has_extension(path, ext);
}

bool cap_is_cine(const char *path)
{
    static const char *const ext[] = {".cine", NULL};
    return sequence_has_extension(path, ext);
}

bool cap_is_raw(const char *path)
{
    static const char *const ext[] = {".cine", ".mraw", ".cih", ".cihx", NULL};
    return sequence_has_extension(path, ext);
}

bool cap_is_unknown(const char *path)
{
    static const char *const ext[] = {
        ".txt", ".log",   ".md",   ".csv", ".tsv", ".json", ".xml", ".yaml", ".yml",  ".ini",
        ".cfg", ".conf",  ".toml", ".xmp", ".cih", ".cihx", ".db",  ".htm",  ".html", ".pdf",
        ".rtf", ".doc",   ".docx", ".odt", ".xls", ".xlsx", ".ods", ".md5",  ".sha1", ".sha256",
        ".py",  ".ipynb", ".m",    ".r",   ".sh",  ".bat",  ".lnk", ".url",  NULL};
    const char *file = last_part(path);
    bool nameless = strchr(file, '.') == NULL && strpbrk(file, "0123456789") == NULL; /* README */
    return *file != '.' && !nameless && !cap_is_image(file) && !cap_is_video(file) &&
           !sequence_has_extension(file, ext);
}

static pvx_err parse_pattern(const char *name, struct pattern *p, struct pvx_diag *d)
{
    const char *at = strchr(name, '%'), *q = at + 1;
    p->prefix_len = (size_t)(at - name);
    p->width = 0;
    if (*q == '0' && isdigit((unsigned char)q[1])) {
        p->width = (int)strtol(q, (char **)&q, 10);
        if (p->width < 1 || p->width > MAX_WIDTH)
            return pvx_fail(d, PVX_EINVAL, "%s: 1 to %d digits are possible", name, MAX_WIDTH);
    }
    if (*q != 'd' || strchr(q, '%') != NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: a pattern has one %%d or %%06d in its last part and no other %%",
                        name);
    p->suffix = q + 1;
    p->suffix_len = strlen(p->suffix);
    return PVX_OK;
}

/* Number of n digits at s, NONE or TOO_LARGE. */
static int64_t sequence_digits(const char *s, size_t n)
{
    int64_t v = n > 0 ? 0 : NONE;
    for (size_t i = 0; i < n; i++) {
        if (!isdigit((unsigned char)s[i]))
            return NONE;
        if (v > (INT64_MAX - (s[i] - '0')) / 10)
            v = TOO_LARGE;
        if (v >= 0)
            v = v * 10 + (s[i] - '0');
    }
    return v;
}

/* The number of a file whose name is exactly what printf gives for it: %06d gives neither "12" nor "0000012".
 * NONE: there is none.  TOO_LARGE. */
static int64_t fits_pattern(const char *file, const char *name, const struct pattern *p)
{
    size_t len = strlen(file);
    if (len <= p->prefix_len + p->suffix_len || strncmp(file, name, p->prefix_len) != 0 ||
        strcmp(file + len - p->suffix_len, p->suffix) != 0)
        return NONE;
    const char *s = file + p->prefix_len;
    size_t n = len - p->prefix_len - p->suffix_len;
    size_t least = p->width > 0 ? (size_t)p->width : 1;
    if (n < least || (n > least && s[0] == '0'))
        return NONE;
    return sequence_digits(s, n);
}

static int64_t last_digits(const char *file)
{
    const char *end = strrchr(file, '.');
    if (end == NULL)
        end = file + strlen(file);
    while (end > file && !isdigit((unsigned char)end[-1]))
        end--;
    const char *s = end;
    while (s > file && isdigit((unsigned char)s[-1]))
        s--;
    return sequence_digits(s, (size_t)(end - s));
}

static pvx_err sequence_add(struct cap_sequence *s, size_t *room, int64_t number, const char *dir,
                            const char *file, struct pvx_diag *d)
{
    if (number == TOO_LARGE)
        return pvx_fail(d, PVX_ERANGE,
                        "%s%s: its number is beyond %lld; the last run of digits in a file's name "
                        "is its number",
                        dir, file, (long long)INT64_MAX);
    if (s->n == *room) {
        size_t more = *room == 0 ? 64 : *room * 2;
        void *item = realloc(s->item, more * sizeof *s->item);
        if (item == NULL)
            return PVX_ENOMEM;
        s->item = item;
        *room = more;
    }
    char *path;
    if (asprintf(&path, "%s%s", dir, file) < 0)
        return PVX_ENOMEM;
    if (number == NONE && s->unnumbered++ > 0) {
        free(path);
    } else if (number == NONE) {
        s->first_unnumbered = path;
    } else {
        s->item[s->n++] = (struct cap_sequence_item){number, path};
    }
    return PVX_OK;
}

/* Count a file that may be a picture, but is not of a type that is read.  A folder is none. */
static pvx_err sequence_note(struct cap_sequence *s, const char *dir, const char *file)
{
    struct stat st;
    char *path;
    if (!cap_is_unknown(file))
        return PVX_OK;
    if (asprintf(&path, "%s%s", dir, file) < 0)
        return PVX_ENOMEM;
    if ((stat(path, &st) == 0 && S_ISDIR(st.st_mode)) || s->unknown++ > 0)
        free(path);
    else
        s->first_unknown = path;
    return PVX_OK;
}

/* All images of folder `dir` ("" or with its slash) that fit `p`, or all when it is NULL. */
static pvx_err from_folder(const char *dir, const char *name, const struct pattern *p,
                           struct cap_sequence *s, struct pvx_diag *d)
{
    DIR *h = opendir(*dir != '\0' ? dir : ".");
    if (h == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    size_t room = 0;
    pvx_err e = PVX_OK;
    struct dirent *f;
    while (e == PVX_OK && (f = readdir(h)) != NULL) {
        int64_t number = p != NULL ? fits_pattern(f->d_name, name, p) : last_digits(f->d_name);
        bool is = p != NULL ? number != NONE : cap_is_image(f->d_name);
        if (is && f->d_name[0] != '.') /* hidden: macOS leaves ._1.png beside 1.png */
            e = sequence_add(s, &room, number, dir, f->d_name, d);
        else if (p == NULL)
            e = sequence_note(s, dir, f->d_name);
    }
    closedir(h);
    return e;
}

static pvx_err from_glob(const char *name, struct cap_sequence *s, struct pvx_diag *d)
{
    glob_t g;
    int r = glob(name, GLOB_NOSORT, NULL, &g);
    if (r == GLOB_NOMATCH)
        return PVX_OK;
    if (r != 0)
        return pvx_fail(d, r == GLOB_NOSPACE ? PVX_ENOMEM : PVX_EIO, "%s: cannot be searched",
                        name);
    size_t room = 0;
    pvx_err e = PVX_OK;
    for (size_t i = 0; e == PVX_OK && i < g.gl_pathc; i++) {
        const char *file = last_part(g.gl_pathv[i]);
        if (cap_is_image(file) && *file != '.')
            e = sequence_add(s, &room, last_digits(file), "", g.gl_pathv[i], d);
        else
            e = sequence_note(s, "", g.gl_pathv[i]);
    }
    globfree(&g);
    return e;
}

static pvx_err sequence_find(const char *name, struct cap_sequence *s, struct pvx_diag *d)
{
    const char *last = last_part(name);
    struct stat st;
    bool there = stat(name, &st) == 0;
    char dir[4096];
    int n;
    if (there && S_ISDIR(st.st_mode)) {
        n = snprintf(dir, sizeof dir, "%s%s", name, *last == '\0' ? "" : "/");
        if (n >= (int)sizeof dir)
            return pvx_fail(d, PVX_EINVAL, "%.80s...: name too long", name);
        return from_folder(dir, NULL, NULL, s, d);
    }
    if (there) { /* one image; its name may contain a * */
        size_t room = 0;
        int64_t number = last_digits(last);
        return sequence_add(s, &room, number < 0 ? 0 : number, "", name, d);
    }
    if (strchr(last, '%') != NULL) {
        struct pattern p;
        PVX_TRY(parse_pattern(last, &p, d));
        n = snprintf(dir, sizeof dir, "%.*s", (int)(last - name), name);
        if (n >= (int)sizeof dir)
            return pvx_fail(d, PVX_EINVAL, "%.80s...: name too long", name);
        return from_folder(dir, last, &p, s, d);
    }
    if (strpbrk(name, "*?[") != NULL)
        return from_glob(name, s, d);
    return pvx_fail(d, PVX_ENOENT, "%s: no such file or folder", name);
}

static int sequence_by_number(const void *a, const void *b)
{
    int64_t x = ((const struct cap_sequence_item *)a)->number;
    int64_t y = ((const struct cap_sequence_item *)b)->number;
    return x < y ? -1 : x > y;
}

/* How many characters from s on are digits.  *value: where they begin without zeros. */
static size_t sequence_run(const char *s, const char **value, size_t *n)
{
    size_t all = strspn(s, "0123456789");
    for (*value = s, *n = all; *n > 0 && **value == '0'; ++*value)
        --*n;
    return all;
}

/* Whether two names differ in their digits only, and the first digits that differ put a after b. */
static bool sequence_backwards(const char *a, const char *b)
{
    int order = 0;
    while (*a != '\0' && *b != '\0') {
        const char *va, *vb;
        size_t na, nb, ra = sequence_run(a, &va, &na), rb = sequence_run(b, &vb, &nb);
        if (ra == 0 && (rb > 0 || *a++ != *b++))
            return false;
        if (order == 0 && ra > 0 && rb > 0)
            order = na != nb ? (na > nb) - (na < nb) : strncmp(va, vb, na);
        if (ra > 0 && rb == 0)
            return false;
        a += ra;
        b += rb;
    }
    return order > 0 && *a == *b;
}

static bool sequence_alike(const char *a, const char *b)
{
    const char *enda = strrchr(a, '.'), *endb = strrchr(b, '.');
    while (a != enda && b != endb && *a != '\0' && *b != '\0') {
        size_t na = strspn(a, "0123456789"), nb = strspn(b, "0123456789");
        if ((na == 0) != (nb == 0) || (na == 0 && *a != *b))
            return false;
        a += na > 0 ? na : 1;
        b += nb > 0 ? nb : 1;
    }
    return a == enda && b == endb;
}

/* The second of the day, where a name ends in a time: 12-00-05-250, 12_00_05.250, 12h00m05s250.  -1: else. */
static int sequence_second(const char *file)
{
    static const int most[] = {60, 60, 24}, weight[] = {1, 60, 3600};
    const char *end = strrchr(file, '.'), *s;
    int second = 0;
    while (end > file && !isdigit((unsigned char)end[-1]))
        end--;
    for (s = end; s > file && isdigit((unsigned char)s[-1]);)
        s--;
    for (int k = 0; k < 3; k++, s -= 3) {
        int64_t two =
            s - file < 3 || strchr("-_.:hms ", s[-1]) == NULL ? NONE : sequence_digits(s - 3, 2);
        if (two < 0 || two >= most[k])
            return -1;
        second += (int)two * weight[k];
    }
    return s > file && isdigit((unsigned char)s[-1]) ? -1 : second;
}

/* Refuse what a number alone does not tell: two files of one number, and names like 12-00-01.050 after 12-00-00.950,
 * where the last run of digits starts again. */
static pvx_err sequence_check(struct cap_sequence *s, struct pvx_diag *d)
{
    for (size_t i = 1; i < s->n; i++) {
        const char *a = s->item[i - 1].path, *b = s->item[i].path;
        int one = sequence_second(last_part(a)), other = sequence_second(last_part(b));
        if (one >= 0 && other >= 0 && one != other)
            return pvx_fail(d, PVX_EINVAL,
                            "%.300s and %.300s: their names end in a time of day, of which the "
                            "last digits alone would be the frame number; rename the files to the "
                            "second of the day and these digits in one number, as %d%03lld, and "
                            "say --numbers ms, us or ns",
                            a, b, other, (long long)s->item[i].number);
        if (s->item[i].number == s->item[i - 1].number)
            return pvx_fail(d, PVX_EINVAL,
                            "%.300s and %.300s have the same frame number (the last run of digits "
                            "in a file's name)",
                            a, b);
        if (s->odd == 0 && !sequence_alike(last_part(s->item[0].path), last_part(b)))
            s->odd = i;
        if (sequence_backwards(last_part(a), last_part(b)))
            return pvx_fail(d, PVX_EINVAL,
                            "%.300s and %.300s: the last run of digits in a file's name is its "
                            "number, but other digits in these names put them in another order; "
                            "rename the files such that one number counts them",
                            a, b);
    }
    return PVX_OK;
}

pvx_err cap_sequence_find(const char *name, struct cap_sequence *out, struct pvx_diag *d)
{
    *out = (struct cap_sequence){0};
    pvx_err e = *name == '\0' ? pvx_fail(d, PVX_EINVAL, "files: needs a pattern, folder or file")
                              : sequence_find(name, out, d);
    PVX_TRY(e);
    if (out->n == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no numbered image fits (" CAP_IMAGES ")%s%s%s%s", name,
                        out->unnumbered > 0 ? "; there is no number in the name of " : "",
                        out->unnumbered > 0 ? last_part(out->first_unnumbered) : "",
                        out->unknown > 0 ? "; save as one of these types: " : "",
                        out->unknown > 0 ? last_part(out->first_unknown) : "");
    qsort(out->item, out->n, sizeof *out->item, sequence_by_number);
    return sequence_check(out, d);
}

void cap_sequence_free(struct cap_sequence *s)
{
    for (size_t i = 0; i < s->n; i++)
        free(s->item[i].path);
    free(s->item);
    free(s->first_unnumbered);
    free(s->first_unknown);
    *s = (struct cap_sequence){0};
}
