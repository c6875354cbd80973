/* script.c - all remedies as one shell script. */
#include <stdio.h>
#include <string.h>

#include "daemon/doctor/doctor.h"

/* Was the same remedy there before?  For sysctl the same key: the first finding is the weightiest. */
static bool seen_before(const struct doctor *d, size_t finding, size_t fix)
{
    const struct doc_fix *x = &d->report.f[finding].fix[fix];
    for (size_t i = 0; i <= finding; i++) {
        const struct doc_finding *f = &d->report.f[i];
        size_t n = i < finding ? f->n_fix : fix;
        if (f->verdict != DOC_WARN && f->verdict != DOC_FAIL)
            continue;
        for (size_t k = 0; k < n; k++)
            if (f->fix[k].kind == x->kind && strcmp(f->fix[k].file, x->file) == 0 &&
                (x->kind == DOC_SYSCTL || strcmp(f->fix[k].text, x->text) == 0))
                return true;
    }
    return false;
}

/* Of two values for one key the larger one counts. */
static const char *script_largest(const struct doctor *d, const char *key, const char *first)
{
    const char *best = first;
    long long top = -1;
    for (size_t i = 0; i < d->report.n; i++) {
        const struct doc_finding *f = &d->report.f[i];
        for (size_t k = 0; k < f->n_fix && f->verdict != DOC_OK; k++) {
            long long v = 0;
            if (f->fix[k].kind == DOC_SYSCTL && strcmp(f->fix[k].file, key) == 0 &&
                sscanf(f->fix[k].text, "%lld", &v) == 1 && v > top) {
                top = v;
                best = f->fix[k].text;
            }
        }
    }
    return best;
}

typedef void emit(FILE *f, const struct doctor *d, const struct doc_finding *x,
                  const struct doc_fix *fix);
/* e NULL = only count them. */
static size_t each(FILE *f, const struct doctor *d, enum doc_fix_kind kind, emit *e)
{
    size_t n = 0;
    for (size_t i = 0; i < d->report.n; i++) {
        const struct doc_finding *x = &d->report.f[i];
        for (size_t k = 0; k < x->n_fix; k++)
            if ((x->verdict == DOC_WARN || x->verdict == DOC_FAIL) && x->fix[k].kind == kind &&
                !seen_before(d, i, k)) {
                n++;
                if (e != NULL)
                    e(f, d, x, &x->fix[k]);
            }
    }
    return n;
}

static void sysctl_line(FILE *f, const struct doctor *d, const struct doc_finding *x,
                        const struct doc_fix *fix)
{
    fprintf(f, "# %s\n%s = %s\n", x->what, fix->file, script_largest(d, fix->file, fix->text));
}

/* A word in capitals, as INTERFACE, stands for something that only a person knows. */
static bool for_a_person(const char *command)
{
    return strstr(command, "INTERFACE") != NULL || strstr(command, "NAME") != NULL;
}

static void command_line(FILE *f, const struct doctor *d, const struct doc_finding *x,
                         const struct doc_fix *fix)
{
    (void)d;
    if (for_a_person(fix->text))
        fprintf(f, "\n# %s\n# by hand: %s\n", x->what, fix->text);
    else
        fprintf(f, "\n# %s\ntry <<'END'\n%s\nEND\n", x->what, fix->text);
}

static void file_line(FILE *f, const struct doctor *d, const struct doc_finding *x,
                      const struct doc_fix *fix)
{
    (void)d;
    bool drop_in = strstr(fix->file, ".service.d/") != NULL;
    fprintf(f, "\n# %s\nline %s %s <<'END'\n%s\nEND\n", x->what, fix->file,
            drop_in ? "'[Service]'" : "''", fix->text);
}

static void note_line(FILE *f, const struct doctor *d, const struct doc_finding *x,
                      const struct doc_fix *fix)
{
    (void)d;
    fprintf(f, "# %s:\n#     %s\n", x->what, fix->text);
}

void doc_script(FILE *f, const struct doctor *d)
{
    fputs(
        "#!/bin/sh\n"
        "# Remedies found by `pyrovox doctor`.  Read before running as root.  What is written to\n"
        "# files stays; commands hold until the next boot: run this again then.\n"
        "# ROOT=DIR writes the files under DIR, for an image.\n"
        "set -u\n"
        "failed=0\n"
        "if [ -z \"${ROOT:-}\" ] && [ \"$(id -u)\" != 0 ]; then\n"
        "    echo \"run as root: sudo sh $0\" >&2\n"
        "    exit 1\n"
        "fi\n"
        "try() { # a command on standard input; the others go on when it fails\n"
        "    command=$(cat)\n"
        "    echo \"+ $command\"\n"
        "    sh -c \"$command\" </dev/null || { echo \"  failed\" >&2; failed=$((failed + 1)); }\n"
        "}\n"
        "line() { # file, its first line or '': the line on standard input, once\n"
        "    text=$(cat); file=${ROOT:-}$1\n"
        "    mkdir -p \"$(dirname \"$file\")\" || exit 1\n"
        "    [ -e \"$file\" ] || [ -z \"$2\" ] || echo \"$2\" > \"$file\"\n"
        "    grep -qxF -e \"$text\" \"$file\" 2>/dev/null || printf '%s\\n' \"$text\" >> "
        "\"$file\"\n"
        "    echo \"$file: $text\"\n"
        "}\n",
        f);
    if (each(f, d, DOC_SYSCTL, NULL) > 0) {
        fputs("\nmkdir -p \"${ROOT:-}/etc/sysctl.d\" || exit 1\n"
              "cat > \"${ROOT:-}/etc/sysctl.d/90-pyrovox.conf\" <<'END'\n",
              f);
        each(f, d, DOC_SYSCTL, sysctl_line);
        fputs("END\n[ -n \"${ROOT:-}\" ] || echo 'sysctl -q -p /etc/sysctl.d/90-pyrovox.conf' | "
              "try\n",
              f);
    }
    each(f, d, DOC_LINE, file_line);
    each(f, d, DOC_COMMAND, command_line);
    fputs("\n# What a script cannot do:\n", f);
    each(f, d, DOC_NOTE, note_line);
    fputs("echo \"done, $failed failed\"\n[ \"$failed\" = 0 ]\n", f);
}
