/* report.c - the report as text for a person and as JSON. */
#include <stdio.h>
#include <string.h>

#include "daemon/control/json.h"
#include "daemon/doctor/wrap.h"
#include "daemon/doctor/doctor.h"

static const char *const words[DOC_N_VERDICT] = {
    [DOC_OK] = "OK", [DOC_WARN] = "WARN", [DOC_FAIL] = "FAIL", [DOC_UNKNOWN] = "CANNOT TELL"};
static const char *const colours[DOC_N_VERDICT] = {[DOC_OK] = "\033[32m",
                                                   [DOC_WARN] = "\033[33m",
                                                   [DOC_FAIL] = "\033[1;31m",
                                                   [DOC_UNKNOWN] = "\033[36m"};

/* A command is never broken: it is to be copied. */
static void print_fix(FILE *f, const struct doc_fix *x, int width)
{
    switch (x->kind) {
    case DOC_SYSCTL:
        fprintf(f, "             do    sysctl -w %s=%s%s%s\n", x->file,
                strchr(x->text, ' ') != NULL ? "\"" : "", x->text,
                strchr(x->text, ' ') != NULL ? "\"" : "");
        fprintf(f, "             keep  %s = %s  in /etc/sysctl.d/90-pyrovox.conf\n", x->file,
                x->text);
        break;
    case DOC_COMMAND: fprintf(f, "             do    %s\n", x->text); break;
    case DOC_LINE:
        fprintf(f, "             keep  %s\n                   in %s\n", x->text, x->file);
        break;
    case DOC_NOTE:
        fputs("             note  ", f);
        dmn_wrap(f, x->text, 19, 19, width);
        break;
    }
}

static void print_finding(FILE *f, const struct doc_finding *x, const struct doc_style *s)
{
    fprintf(f, "%s%-11s%s  ", s->colour ? colours[x->verdict] : "", words[x->verdict],
            s->colour ? "\033[0m" : "");
    dmn_wrap(f, x->what, 13, 13, s->width);
    if (x->verdict == DOC_OK)
        return;
    if (x->means[0] != '\0') {
        fputs("             ", f);
        dmn_wrap(f, x->means, 13, 13, s->width);
    }
    for (size_t i = 0; i < x->n_fix; i++)
        print_fix(f, &x->fix[i], s->width);
    fputc('\n', f);
}

void doc_print(FILE *f, const struct doctor *d, const struct doc_style *s)
{
    const struct doc_report *r = &d->report;
    dmn_wrap(f, d->load.source, 0, 2, s->width);
    for (size_t i = 0; i < d->n_links; i++)
        fprintf(f, "%s%s%s", i == 0 ? "  network: " : ", ", d->link[i].name,
                d->link[i].certain ? "" : "?");
    fputs(d->n_links > 0 ? "\n\n" : "\n", f);
    for (size_t i = 0; i < r->n; i++)
        if (r->f[i].verdict != DOC_OK || s->all)
            print_finding(f, &r->f[i], s);
    if (s->all && doc_count(r, DOC_OK) > 0)
        fputc('\n', f);
    if (r->lost > 0)
        fprintf(f, "%zu more findings than fit here\n", r->lost);
    size_t fails = doc_count(r, DOC_FAIL), warns = doc_count(r, DOC_WARN);
    fprintf(f, "%zu failure%s, %zu warning%s, %zu that cannot be told, %zu well%s\n", fails,
            fails == 1 ? "" : "s", warns, warns == 1 ? "" : "s", doc_count(r, DOC_UNKNOWN),
            doc_count(r, DOC_OK), s->all ? "" : " (--all shows them)");
}

static void json_fix(struct dmn_json *j, const struct doc_fix *x)
{
    static const char *const kinds[] = {"sysctl", "command", "line", "note"};
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "kind", kinds[x->kind]);
    if (x->kind == DOC_SYSCTL)
        dmn_json_str(j, "key", x->file);
    if (x->kind == DOC_LINE)
        dmn_json_str(j, "file", x->file);
    dmn_json_str(j, x->kind == DOC_SYSCTL ? "value" : "text", x->text);
    dmn_json_close(j, '}');
}

static void doctor_fill(struct dmn_json *j, const void *what)
{
    const struct doctor *d = what;
    static const char *const lower[DOC_N_VERDICT] = {
        [DOC_OK] = "ok", [DOC_WARN] = "warn", [DOC_FAIL] = "fail", [DOC_UNKNOWN] = "unknown"};
    const struct doc_report *r = &d->report;
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "load", d->load.source);
    dmn_json_bool(j, "configured", d->load.given);
    dmn_json_open(j, "counts", '{');
    for (int v = 0; v < DOC_N_VERDICT; v++)
        dmn_json_int(j, lower[v], (long long)doc_count(r, (enum doc_verdict)v));
    dmn_json_close(j, '}');
    dmn_json_open(j, "findings", '[');
    for (size_t i = 0; i < r->n; i++) {
        const struct doc_finding *x = &r->f[i];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "id", x->id);
        dmn_json_str(j, "verdict", lower[x->verdict]);
        dmn_json_int(j, "weight", x->weight);
        dmn_json_str(j, "what", x->what);
        dmn_json_str(j, "means", x->means);
        dmn_json_open(j, "remedies", '[');
        for (size_t k = 0; k < x->n_fix; k++)
            json_fix(j, &x->fix[k]);
        dmn_json_close(j, ']');
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

pvx_err doc_print_json(FILE *f, const struct doctor *d, struct pvx_diag *why)
{
    return dmn_json_print(f, doctor_fill, d, why);
}
