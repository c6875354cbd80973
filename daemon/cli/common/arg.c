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

enum cap_pixfmt cli_arg_pixfmt(struct argp_state *st, const char *text)
{
    char names[CAP_PIXFMT_NAMES_MAX];
    enum cap_pixfmt f = cap_pixfmt_parse(text);
    cap_pixfmt_names(names, sizeof names);
    if (f == CAP_FMT_NONE)
        argp_error(st, "--pixel-format %s: should be one of %s", text, names);
    return f;
}

enum cap_transfer cli_arg_transfer(struct argp_state *st, const char *text)
{
    static const char *const names[] = {"auto", "linear", "srgb", "bt709", NULL};
    return (enum cap_transfer)cli_arg_choice(st, "transfer", text, names);
}

void cli_arg_one(struct argp_state *st, const char *what, const char *text, const char **out)
{
    if (*out != NULL)
        argp_error(st, "'%s': one %s at a time", text, what);
    *out = text;
}
