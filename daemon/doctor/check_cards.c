/* check_cards.c - graphics cards and other OpenCL devices, and whether the configured one can be used. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/config/compute.h"
#include "daemon/doctor/checks.h"

static bool card_can(const struct doc_card *c)
{
    return c->info.why_not[0] == '\0' && c->slow[0] == '\0';
}

/* Whether `compute: opencl:NAME` means it; without NAME, any card. */
static bool card_is_meant(const struct doc_card *c, const char *name)
{
    return name[0] == '\0' ? c->info.kind == REC_CL_GPU
                           : strcasestr(c->info.name, name) != NULL ||
                                 strcasestr(c->info.platform, name) != NULL;
}

static void cards_missing(struct doctor *d, const char *name, const struct pvx_diag *why)
{
    char which[300] = "graphics card";
    if (name[0] != '\0')
        snprintf(which, sizeof which, "OpenCL device named %.200s", name);
    struct doc_finding *f =
        doc_say(d, DOC_FAIL, 90, "compute.device", "there is no %s that can be used", which);
    doc_means(f, "the daemon does not start, because its configuration asks for one (compute: %s)",
              d->load.compute);
    if (why->text[0] != '\0')
        doc_note(f, "%.300s", why->text);
    doc_note(f, "or say compute: auto, which takes the processors where there is no card");
}

/* With a configuration that asks for a device, whether it is there. */
static void check_cards_wanted(struct doctor *d, const struct doc_card *card, size_t n,
                               const struct pvx_diag *why)
{
    enum dmn_compute_where where;
    const char *name;
    if (!dmn_compute_parse(d->load.compute, &where, &name) || where != DMN_COMPUTE_OPENCL)
        return;
    for (size_t i = 0; i < n; i++)
        if (card_is_meant(&card[i], name) && card_can(&card[i]))
            return;
    cards_missing(d, name, why);
}

void doc_check_cards(struct doctor *d)
{
    struct pvx_diag why = {""};
    char line[320];
    struct doc_card *card = d->host->cards != NULL ? pvx_calloc(REC_CL_MOST, sizeof *card) : NULL;
    if (card == NULL)
        return;
    size_t n = d->host->cards(d->host, card, &why);
    for (size_t i = 0; i < n; i++) {
        doc_card_line(&card[i], line, sizeof line);
        doc_say(d, DOC_OK, 20, "compute.card", "%s", line);
    }
    if (n == 0)
        doc_say(d, DOC_OK, 20, "compute.card", "sets are solved on the processors alone: %.240s",
                why.text);
    check_cards_wanted(d, card, n, &why);
    free(card);
}
