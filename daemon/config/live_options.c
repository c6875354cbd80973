/* live_options.c - which options a running daemon takes, and the option that is nearest to a mistyped one. */
#include <stdint.h>
#include <string.h>

#include "daemon/config/options.h"

const struct dmn_option *dmn_option_find(const char *key)
{
    for (size_t i = 0; i < dmn_n_options; i++)
        if (strcmp(dmn_options[i].key, key) == 0)
            return &dmn_options[i];
    return NULL;
}

bool dmn_option_live(const struct dmn_option *o)
{
    /* not solver.name: work areas depend on it, and whether Bayer pixels are taken as they are */
    return strcmp(o->key, "log_level") == 0 || strcmp(o->key, "publish.compress") == 0 ||
           strncmp(o->key, "photometry.", 11) == 0 ||
           (strncmp(o->key, "solver.", 7) == 0 && strcmp(o->key, "solver.name") != 0);
}

/* Letters to add, take away or change (Levenshtein, Sov. Phys. Dokl. 10:707, 1966). */
static size_t config_distance(const char *a, const char *b)
{
    enum { MOST = 64 };
    size_t row[MOST + 1], n = strnlen(b, MOST);
    for (size_t k = 0; k <= n; k++)
        row[k] = k;
    for (size_t i = 0; a[i] != '\0' && i < MOST; i++) {
        size_t diagonal = row[0];
        row[0] = i + 1;
        for (size_t k = 0; k < n; k++) {
            size_t change = diagonal + (a[i] != b[k]);
            size_t other = (row[k] < row[k + 1] ? row[k] : row[k + 1]) + 1;
            diagonal = row[k + 1];
            row[k + 1] = change < other ? change : other;
        }
    }
    return row[n];
}

const char *dmn_option_nearest(const char *key)
{
    size_t best = SIZE_MAX;
    const char *name = "";
    for (size_t i = 0; i < dmn_n_options; i++) {
        const char *dot = strchr(dmn_options[i].key, '.');
        size_t d = config_distance(key, dmn_options[i].key);
        if (dot != NULL && strchr(key, '.') == NULL && strcmp(dot + 1, key) == 0)
            d = 0; /* the section was left out */
        if (d < best) {
            best = d;
            name = dmn_options[i].key;
        }
    }
    return name;
}
