/* syncnumber.c - frame numbers against sets: slips and missed triggers (syncwatch.h). */
#include <math.h>
#include <stdio.h>

#include "capture/sync/syncwatch_int.h"

#define RENUMBERED 1000 /* instants: numbers that are this far off were started again */

/* Number of this instant, by a vote of the members (frame number + offset).  *sure: more than half of the votes
 * agree, or the time since the last set confirms one of them. */
static int64_t name_instant(const struct cap_syncwatch *w, const struct cap_set *s, bool *sure)
{
    int64_t say[CAP_MAX_CAMERAS], best = 0;
    unsigned n = 0, most = 0;
    for (uint32_t c = 0; c < w->p.cameras; c++)
        if (s->frame[c] != NULL && w->camera[c].numbered)
            say[n++] = cap_sync_plus((int64_t)s->frame[c]->id, w->camera[c].offset);
    for (unsigned i = 0; i < n; i++) {
        unsigned votes = 0;
        for (unsigned j = 0; j < n; j++)
            votes += say[j] == say[i];
        if (votes > most) {
            most = votes;
            best = say[i];
        }
    }
    *sure = 2 * most > n;
    if (*sure)
        return best;
    double steps = w->p.period_ns > 0
                       ? (double)(s->t_exposure_ns - w->t_set_ns) / (double)w->p.period_ns
                       : NAN;
    int64_t by_time = cap_sync_plus(w->instant, steps > 0 ? llrint(steps) : 1);
    if (n == 0)
        return by_time;
    for (unsigned i = 0; i < n; i++)
        *sure |= say[i] == by_time && fabs(steps - rint(steps)) < CAP_SYNC_ROUND_OFF;
    return *sure ? by_time : best;
}

static void disagrees(struct cap_syncwatch *w, uint32_t c, int64_t by)
{
    struct cap_sync_camera *k = &w->camera[c];
    char text[96];
    if (by > -RENUMBERED && by < RENUMBERED) {
        if (by < 0 && k->away >= -by) {
            snprintf(text, sizeof text, "it took %lld picture(s) fewer than there were instants",
                     (long long)-by);
            cap_sync_found(w, c, CAP_MISSED_TRIGGER, (uint64_t)-by, text);
        } else {
            snprintf(text, sizeof text, "its frame numbers went %+lld against its times",
                     (long long)by);
            cap_sync_found(w, c, CAP_SLIP, 1, text);
        }
    }
    k->offset = cap_sync_minus(k->offset, by);
}

void cap_syncwatch_set(struct cap_syncwatch *w, const struct cap_set *s)
{
    bool sure = false;
    int64_t instant = w->any_set ? name_instant(w, s, &sure) : 0;
    w->instant = instant;
    w->t_set_ns = s->t_exposure_ns;
    w->any_set = true;
    for (uint32_t c = 0; c < w->p.cameras; c++) {
        const struct cap_frame *f = s->frame[c];
        struct cap_sync_camera *k = &w->camera[c];
        if (f == NULL || f->id == 0) /* a source without numbers */
            continue;
        int64_t by =
            k->numbered ? cap_sync_minus(cap_sync_plus((int64_t)f->id, k->offset), instant) : 0;
        if (!k->numbered) {
            k->numbered = true;
            k->offset = cap_sync_minus(instant, (int64_t)f->id);
        } else if (by != 0 && sure && by == k->doubt) {
            disagrees(w, c, by);
            by = 0;
        }
        k->away = cap_sync_plus(cap_sync_minus(instant, k->last_instant),
                                cap_sync_plus(-1, k->doubt != 0 ? k->away : 0));
        k->doubt = sure ? by : 0;
        k->last_instant = instant;
    }
}
