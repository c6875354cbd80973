#include "daemon/cli/common/arg.h"

#include <stdio.h>
#include <string.h>

#include "base/yaml.h"

void cli_arg_int(struct argp_state *st, const char *name, const char *text, int64_t lo, int64_t hi,
                 int64_t *out)
{
    if (pvx_parse_int(text, lo, hi, out) != PVX_OK)
        argp_error(st, "--%s %s: should be a whole number from %lld to %lld", name, text,
                   (long long)lo, (long long)hi);
}

int64_t cli_arg_whole(struct argp_state *st, const char *name, const char *text, int64_t lo,
                      int64_t hi)
{
    int64_t v = lo;
    cli_arg_int(st, name, text, lo, hi, &v);
    return v;
}

double cli_arg_double(struct argp_state *st, const char *name, const char *text, double lo,
                      double hi)
{
    double v = lo;
    if (pvx_parse_double(text, lo, hi, &v) != PVX_OK)
        argp_error(st, "--%s %s: should be a number from %.10g to %.10g", name, text, lo, hi);
    return v;
}

void cli_arg_size(struct argp_state *st, const char *name, const char *text, int32_t lo, int32_t hi,
                  int32_t *width, int32_t *height)
{
    char copy[32];
    int64_t w = 0, h = 0;
    snprintf(copy, sizeof copy, "%s", text);
    char *x = strchr(copy, 'x');
    if (x != NULL)
        *x++ = '\0';
    if (x == NULL || strlen(text) >= sizeof copy || pvx_parse_int(copy, lo, hi, &w) != PVX_OK ||
        pvx_parse_int(x, lo, hi, &h) != PVX_OK)
        argp_error(st, "--%s %s: should be WIDTHxHEIGHT with %d to %d pixels each", name, text, lo,
                   hi);
    *width = (int32_t)w;
    *height = (int32_t)h;
}

int cli_arg_choice(struct argp_state *st, const char *name, const char *text,
                   const char *const *words)
{
    char list[300] = "";
    for (int k = 0; words[k] != NULL; k++) {
        if (strcmp(words[k], text) == 0)
            return k;
        snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", k == 0 ? "" : ", ",
                 words[k]);
    }
    argp_error(st, "--%s %s: should be one of %s", name, text, list);
    return 0;
}

int cli_arg_word(struct argp_state *st, const char *name, const char *text, const char *words)
{
    char list[300] = "", *rest, *word;
    int k = 0;
    snprintf(list, sizeof list, "%s", words);
    for (rest = list; (word = strsep(&rest, "|")) != NULL; k++)
        if (strcmp(word, text) == 0)
            return k;
    list[0] = '\0';
    for (const char *w = words; *w != '\0'; w++)
        snprintf(list + strlen(list), sizeof list - strlen(list), "%c%s", *w == '|' ? ',' : *w,
                 *w == '|' ? " " : "");
    argp_error(st, "--%s %s: should be one of %s", name, text, list);
    return 0;
}

#define ARG_ROW_KEY \
    0x10000 /* to 0x1ffff; letters and a command's own keys are below, argp's above */

#define ARG_ALL_KEY 0x20000

static bool arg_has_letter(const struct cli_row *r)
{
    return r->name != NULL && r->name[1] == '|';
}
static const char *arg_name(const struct cli_row *r)
{
    return arg_has_letter(r) ? r->name + 2 : r->name;
}

/* A number within the row's limits, or the value that its word stands for. */
static double arg_number(struct argp_state *st, const struct cli_row *r, const char *text)
{
    const char *word = strchr(r->arg, '|');
    if (!(r->hi > r->lo))
        return cli_arg_word(st, arg_name(r), text, r->arg);
    if (word != NULL && strcmp(word + 1, text) == 0)
        return r->lo - 1;
    if (r->type == CLI_FLOAT || r->type == CLI_DOUBLE)
        return cli_arg_double(st, arg_name(r), text, r->lo, r->hi);
    return (double)cli_arg_whole(st, arg_name(r), text, (int64_t)r->lo, (int64_t)r->hi);
}

static const char *arg_first; /* options that --help lists; NULL: all */

bool cli_help_all(int argc, char **argv, const char *first)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (strcmp(argv[i], "--help-all") == 0) {
            argv[i][strlen("--help")] = '\0';
            return true;
        }
    arg_first = first;
    return false;
}

static bool arg_is_first(const char *name)
{
    size_t n = strlen(name);
    for (const char *p = arg_first; p != NULL && (p = strstr(p, name)) != NULL; p += n)
        if ((p == arg_first || p[-1] == ' ') && (p[n] == ' ' || p[n] == '\0'))
            return true;
    return arg_first == NULL;
}

const struct argp_option *cli_rows(const struct cli_row *rows, struct argp_option *room)
{
    int group = 0, heading = 1, n = 0;
    for (int i = 0; rows[i].help != NULL; i++) {
        const struct cli_row *r = &rows[i];
        bool optional = r->arg != NULL && *r->arg == '=';
        if (r->name == NULL)
            group = ++heading;
        if (r->name == NULL && arg_first != NULL)
            continue; /* of so few options no heading is needed */
        room[n++] = (struct argp_option){
            .name = arg_name(r),
            .key = r->name == NULL      ? 0
                   : r->type == CLI_OWN ? (int)r->at
                   : arg_has_letter(r)  ? r->name[0]
                                        : ARG_ROW_KEY + i,
            .arg = optional ? r->arg + 1 : r->arg,
            .flags = (optional ? OPTION_ARG_OPTIONAL : 0) |
                     (r->name == NULL || arg_is_first(arg_name(r)) ? 0 : OPTION_HIDDEN),
            .doc = r->help,
            .group = arg_first != NULL ? 0 : group,
        };
    }
    room[n] = (struct argp_option){0};
    return room;
}

error_t cli_row(const struct cli_row *rows, int key, const char *text, struct argp_state *st,
                void *out)
{
    const struct cli_row *r = rows;
    while (r->help != NULL && !(arg_has_letter(r) && r->type != CLI_OWN && r->name[0] == key) &&
           ARG_ROW_KEY + (r - rows) != key)
        r++;
    if (r->help == NULL)
        return ARGP_ERR_UNKNOWN;
    void *at = (char *)out + r->at;
    switch (r->type) {
    case CLI_BOOL:
        *(bool *)at = r->arg == NULL || cli_arg_word(st, arg_name(r), text, r->arg) == 1;
        break;
    case CLI_TEXT: *(const char **)at = text; break;
    case CLI_INT: *(int32_t *)at = (int32_t)arg_number(st, r, text); break;
    case CLI_UINT: *(uint32_t *)at = (uint32_t)arg_number(st, r, text); break;
    case CLI_INT64: /* not through a double */
        *(int64_t *)at = r->hi > r->lo && strchr(r->arg, '|') == NULL
                             ? cli_arg_whole(st, arg_name(r), text, (int64_t)r->lo, (int64_t)r->hi)
                             : (int64_t)arg_number(st, r, text);
        break;
    case CLI_FLOAT: *(float *)at = (float)arg_number(st, r, text); break;
    case CLI_DOUBLE: *(double *)at = arg_number(st, r, text); break;
    case CLI_PIXFMT: *(enum cap_pixfmt *)at = cli_arg_pixfmt(st, text); break;
    case CLI_OWN: return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

void cli_parse(const struct cli_row *rows, const struct argp *like, unsigned flags, int argc,
               char **argv, void *out)
{
    static const struct argp_option all = {.name = "help-all",
                                           .key = ARG_ALL_KEY,
                                           .doc = "Give all options, and more examples",
                                           .group = -1};
    struct argp_option room[66];
    struct argp argp = *like;
    argp.options = cli_rows(rows, room);
    if (arg_first != NULL) {
        size_t n = 0;
        while (room[n].name != NULL)
            n++;
        room[n] = all;
        room[n + 1] = (struct argp_option){0};
    }
    (void)argp_parse(&argp, argc, argv, flags, NULL, out); /* does not return from an error */
}

enum cap_pixfmt cli_arg_pixfmt(struct argp_state *st, const char *text)
{
    char names[CAP_PIXFMT_NAMES_MAX];
    enum cap_pixfmt f = cap_pixfmt_parse(text);
    cap_pixfmt_names(names, sizeof names);
    if (f == CAP_FMT_NONE)
        argp_error(st, "--pixel-format %s: should be one of %s", text, names);
    return f;
}

void cli_arg_one(struct argp_state *st, const char *what, const char *text, const char **out)
{
    if (*out != NULL)
        argp_error(st, "'%s': one %s at a time", text, what);
    *out = text;
}
