#include "daemon/cli/arg.h"

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
