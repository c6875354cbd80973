/* check_say.h - the result of a check as text, JSON and a page. */
#ifndef CHECK_SAY_H
#define CHECK_SAY_H
#include <stdio.h>

#include "daemon/cli/common/flame_sets.h"
#include "daemon/control/check_words.h"
#include "recon/check/plausible.h"

struct check_result {
    const char *rig, *frames; /* as they were named */
    const struct flame_sets *sets;
    rec_check *check;
    const struct rec_check_verdict *verdict;
    const struct rec_plausible_verdict *belong; /* do pictures and rig belong together? */
};

/* A mistake was found in the rig or in the pictures, so what is said of cameras is its consequence. */
bool check_explained(const struct check_result *r);

#define CHECK_SENTENCE REC_PLAUSIBLE_LINE
/* What is wrong with camera c, by how much, and what to do about it.  "": nothing is wrong. */
void check_sentence(const struct check_result *r, size_t c, char out[CHECK_SENTENCE]);
/* The conclusion about all cameras together. */
void check_conclusion(const struct check_result *r, char out[CHECK_SENTENCE]);
/* Print on stdout a line per camera, then the sentences. */
void check_print(const struct check_result *r);
/* Write the report of a struct check_result (page/check.c).  Errors: those of rec_check_look. */
void check_json(struct dmn_json *j, const void *result);
PVX_MUST_CHECK pvx_err check_html(FILE *f, const void *result);

#endif
