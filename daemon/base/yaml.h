/* yaml.h - strict reading of small YAML files (rig, configuration) over libyaml.
 *
 * Every refusal reads "file:line: key: reason".  A number is the whole token, finite and in range;
 * unknown and duplicate keys are refused (duplicates already by pvx_yaml_parse).
 * A node is an int id valid as long as the document; 0 = no node.
 * Threads: a document belongs to one thread at a time.  Cost: O(bytes). */
#ifndef PVX_YAML_H
#define PVX_YAML_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

typedef struct pvx_yaml pvx_yaml;
enum pvx_yaml_kind { PVX_YAML_NONE, PVX_YAML_SCALAR, PVX_YAML_SEQ, PVX_YAML_MAP };

/* Parse one document; `name`: name of the file in messages.  Input above 4 MiB, more than 64
 * levels deep or with aliases is refused.  Errors: PVX_EFORMAT (diag filled), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err pvx_yaml_parse(const char *text, size_t len, const char *name,
                                      pvx_yaml **out, struct pvx_diag *d);
void pvx_yaml_free(pvx_yaml **y);

int pvx_yaml_root(const pvx_yaml *y); /* 0 for an empty document */
enum pvx_yaml_kind pvx_yaml_kind(const pvx_yaml *y, int node);
unsigned pvx_yaml_line(const pvx_yaml *y, int node);    /* 1-based */
const char *pvx_yaml_text(const pvx_yaml *y, int node); /* scalar's text, "" otherwise; borrowed */

size_t pvx_yaml_length(const pvx_yaml *y, int node);           /* items or pairs */
int pvx_yaml_item(const pvx_yaml *y, int seq, size_t i);       /* 0 when out of range */
int pvx_yaml_get(const pvx_yaml *y, int map, const char *key); /* 0 when absent */
const char *pvx_yaml_key(const pvx_yaml *y, int map, size_t i);
int pvx_yaml_value(const pvx_yaml *y, int map, size_t i);

/* Sets the text "name:line: key: text", returns e.  `key` is a readable path, as "cameras[2].K". */
pvx_err pvx_yaml_fail(const pvx_yaml *y, int node, const char *key, pvx_err e, struct pvx_diag *d,
                      const char *fmt, ...) PVX_PRINTF(6, 7);
#ifdef __clang_analyzer__ /* as pvx_fail in err.h */
#define pvx_yaml_fail(y, node, key, e, d, ...) (pvx_yaml_fail(y, node, key, e, d, __VA_ARGS__), (e))
#endif

/* Refuse keys of `map` that are not in `known` (space-separated); `map` must be a mapping. */
PVX_MUST_CHECK pvx_err pvx_yaml_known(const pvx_yaml *y, int map, const char *path,
                                      const char *known, struct pvx_diag *d);

/* Strict scalars in [min,max]. */
PVX_MUST_CHECK pvx_err pvx_yaml_double(const pvx_yaml *y, int node, const char *key, double min,
                                       double max, double *out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvx_yaml_int(const pvx_yaml *y, int node, const char *key, int64_t min,
                                    int64_t max, int64_t *out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvx_yaml_bool(const pvx_yaml *y, int node, const char *key, int *out,
                                     struct pvx_diag *d);
/* `n_min..n_max` numbers in a sequence, pvx_yaml_length of them. */
PVX_MUST_CHECK pvx_err pvx_yaml_doubles(const pvx_yaml *y, int node, const char *key, size_t n_min,
                                        size_t n_max, double *out, struct pvx_diag *d);

/* The same strictness for command lines: the whole of `s` is a finite number in [min,max]. */
PVX_MUST_CHECK pvx_err pvx_parse_double(const char *s, double min, double max, double *out);
PVX_MUST_CHECK pvx_err pvx_parse_int(const char *s, int64_t min, int64_t max, int64_t *out);

#endif
