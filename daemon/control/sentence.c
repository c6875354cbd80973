/* sentence.c - the condition of the daemon in one line: STATUS of sd_notify(3). */
#include <stdarg.h>
#include <stdio.h>

#include "daemon/control/state.h"
#include "recon/vote/wrong.h"

struct line {
    char *text;
    size_t size, n;
};

PVX_PRINTF(2, 3) static void sentence_add(struct line *l, const char *fmt, ...)
{
    va_list ap;
    va_start(ap, fmt);
    int n = l->n < l->size ? vsnprintf(l->text + l->n, l->size - l->n, fmt, ap) : 0;
    va_end(ap);
    l->n += n > 0 ? (size_t)n : 0;
}

static void add_cameras(struct line *l, const struct dmn_state *s)
{
    size_t lost = 0;
    for (size_t c = 0; c < s->n_cameras; c++)
        if (s->capture.camera[c].state == CAP_LOST || s->capture.camera[c].state == CAP_OPENING)
            sentence_add(l, "%s%s", lost++ == 0 ? "; not there: " : ", ", s->camera[c]);
    if (lost > 0)
        sentence_add(l, " (%zu of %zu cameras)", lost, s->n_cameras);
    for (size_t c = 0; c < s->n_cameras; c++)
        if ((s->votes.out >> c & 1) != 0)
            sentence_add(l, "; %s is left out (%s)", s->camera[c],
                         rec_wrong_name((enum rec_wrong)s->votes.why[c]));
        else if (s->checks.camera[c].figures.wrong != REC_WRONG_NOTHING)
            sentence_add(l, "; %s is %s", s->camera[c],
                         rec_wrong_name(s->checks.camera[c].figures.wrong));
        else if (s->rig[c].moved)
            sentence_add(l, "; %s has moved", s->camera[c]);
}

void dmn_state_sentence(const struct dmn_state *s, char *out, size_t size)
{
    struct line l = {out, size, 0};
    out[0] = '\0';
    sentence_add(&l, "%.1f sets/s, %llu published, latency p99 %.0f ms", s->sets_per_s,
                 (unsigned long long)s->published, s->latency_p99_ms);
    if (s->record.state == CAP_REC_RUNNING)
        sentence_add(&l, ", recording");
    add_cameras(&l, s);
    if (s->compute.here > 0)
        sentence_add(&l, "; sets are solved without %.60s: %.100s", s->compute.device,
                     s->compute.why);
    if (s->record.state == CAP_REC_FAILED)
        sentence_add(&l, "; recording ended: %.200s", s->record.error);
    if (s->volumes.failed)
        sentence_add(&l, "; volumes are not recorded: %.200s", s->volumes.error);
    for (char *p = out; *p != '\0'; p++)
        if (*p == '\n')
            *p = ' '; /* each line of a notification is one of its own */
}
