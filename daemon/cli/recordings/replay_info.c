#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <time.h>

#include "daemon/cli/recordings/replay.h"

#define GAPS_SHOWN 20

static void replay_info_when(int64_t t_ns, char *out, size_t size)
{
    time_t s = (time_t)(t_ns / 1000000000);
    struct tm tm;
    if (gmtime_r(&s, &tm) == NULL || strftime(out, size, "%Y-%m-%d %H:%M:%S UTC", &tm) == 0)
        snprintf(out, size, "at %" PRId64 " ns", t_ns);
}

/* Count the frame numbers of a camera that are neither in the take nor in a gap: such frames were never received. */
static uint64_t never_received(const cap_take *t, uint32_t c)
{
    uint64_t n = 0, listed = 0;
    const struct cap_take_info *i = cap_take_info(t);
    for (uint64_t r = 1; r < i->head.camera[c].frames; r++) {
        uint64_t a = cap_take_row(t, c, r - 1)->id, b = cap_take_row(t, c, r)->id;
        n += b > a ? b - a - 1 : 0;
    }
    for (uint64_t g = 0; g < i->gaps; g++)
        listed += cap_take_gap(t, g)->camera == c ? cap_take_gap(t, g)->frames : 0;
    return n > listed ? n - listed : 0;
}

static void replay_info_print_cameras(const cap_take *t)
{
    const struct cap_take_head *h = &cap_take_info(t)->head;
    printf("\n%-16s %-14s %-11s %8s %9s %9s  %s\n", "camera", "format", "size", "frames",
           "in no set", "not seen", "source");
    for (uint32_t c = 0; c < h->n_cameras; c++) {
        const struct cap_take_camera *k = &h->camera[c];
        char size[32] = "-";
        uint64_t strays = 0;
        for (uint64_t r = 0; r < k->frames; r++)
            strays += cap_take_row(t, c, r)->set < 0;
        if (k->fmt != CAP_FMT_NONE)
            snprintf(size, sizeof size, "%dx%d", k->width, k->height);
        printf("%-16s %-14s %-11s %8" PRIu64 " %9" PRIu64 " %9" PRIu64 "  %s", k->name,
               k->fmt == CAP_FMT_NONE ? "never sent" : cap_pixfmt_name(k->fmt), size, k->frames,
               strays, never_received(t, c), k->uri);
        if (k->serial[0] != '\0')
            printf(", serial %s", k->serial);
        if (isfinite(k->temperature_c))
            printf(", %.1f C", k->temperature_c);
        printf("\n");
    }
}

static void print_gaps(const cap_take *t)
{
    const struct cap_take_info *i = cap_take_info(t);
    uint64_t frames = 0;
    for (uint64_t g = 0; g < i->gaps; g++)
        frames += cap_take_gap(t, g)->frames;
    printf("\ncould not be recorded: %" PRIu64 " frames in %" PRIu64 " gaps\n", frames, i->gaps);
    for (uint64_t g = 0; g < i->gaps && g < GAPS_SHOWN; g++) {
        const struct cap_take_gap *k = cap_take_gap(t, g);
        printf("  %-16s frames %" PRIu64 " to %" PRIu64 " (%" PRIu64 ", sets %" PRId64
               " to %" PRId64 "): %s\n",
               i->head.camera[k->camera].name, k->id_first, k->id_last, k->frames, k->set_first,
               k->set_last, cap_take_why_names[k->why]);
    }
    if (i->gaps > GAPS_SHOWN)
        printf("  and %" PRIu64 " more: h5dump -d /gaps\n", i->gaps - GAPS_SHOWN);
}

/* What began the take, and what it lacks besides the gaps. */
static void print_triggers(const cap_take *t)
{
    const struct cap_take_info *i = cap_take_info(t);
    char when[64];
    uint64_t frames = 0;
    for (uint64_t k = 0; k < i->triggers; k++) {
        const struct cap_take_trigger *g = cap_take_trigger(t, k);
        replay_info_when(g->t_ns, when, sizeof when);
        printf("trigger   %s at %s", g->name, when);
        if (g->set >= 0)
            printf(", set %" PRId64 ", %.1f ms after its exposure", g->set,
                   (double)g->latency_ns * 1e-6);
        printf("; from %.3f s before to %.3f s after\n", (double)(g->t_ns - g->t_from_ns) * 1e-9,
               (double)(g->t_to_ns - g->t_ns) * 1e-9);
    }
    for (uint64_t k = 0; k < i->lost; k++)
        frames += cap_take_lost(t, k)->frames;
    if (i->head.triggered)
        printf("lost      %" PRIu64 " frames, in %" PRIu64 " rows\n", frames, i->lost);
    for (uint64_t k = 0; k < i->lost && k < GAPS_SHOWN; k++) {
        const struct cap_take_lost *l = cap_take_lost(t, k);
        printf("          %s: %" PRIu64 ", %s", i->head.camera[l->camera].name, l->frames, l->why);
        if (l->id_last > 0)
            printf(", numbers %" PRIu64 " to %" PRIu64, l->id_first, l->id_last);
        printf("\n");
    }
    if (i->lost > GAPS_SHOWN)
        printf("          and %" PRIu64 " more rows: h5dump -d /lost\n", i->lost - GAPS_SHOWN);
}

static void print_pieces(const cap_take *t)
{
    const struct cap_take_info *i = cap_take_info(t);
    if (i->pieces > 1)
        printf("files     %" PRIu64 "\n", i->pieces);
    for (uint64_t k = 0; k < i->pieces && i->pieces > 1; k++) {
        struct cap_take_piece p = cap_take_piece(t, k);
        printf("          %s: ", p.path);
        if (p.sets > 0)
            printf("sets %" PRIu64 " to %" PRIu64 ", ", cap_take_set(t, p.first, NULL)->number,
                   cap_take_set(t, p.first + p.sets - 1, NULL)->number);
        printf("%" PRIu64 " complete%s\n", p.sets, p.closed ? "" : ", not closed");
    }
    for (uint64_t k = 0; k < i->notes; k++)
        printf("%s %s\n", k == 0 ? "note     " : "         ", cap_take_note(t, k));
}

int replay_info(const char *path, const cap_take *t)
{
    const struct cap_take_info *i = cap_take_info(t);
    uint64_t whole = 0, bytes = 0;
    for (uint64_t k = 0; k < i->sets; k++)
        whole += cap_take_set(t, k, NULL)->n == i->head.n_cameras;
    for (uint32_t c = 0; c < i->head.n_cameras; c++)
        for (uint64_t r = 0; r < i->head.camera[c].frames; r++)
            bytes += cap_take_row(t, c, r)->bytes;
    char created[64];
    replay_info_when(i->head.t_created_ns, created, sizeof created);
    printf("%s\n", path);
    printf("recorded  %s on %s by %s, session %016" PRIx64 "\n", created, i->head.host,
           i->head.software, i->head.session);
    if (i->head.t_began_ns != 0 && i->head.t_began_ns != i->head.t_created_ns) {
        replay_info_when(i->head.t_began_ns, created, sizeof created);
        printf("began     %s, in a file before this one\n", created);
    }
    printf("state     %s\n", i->closed ? "closed in order" : "cut off, or still being recorded");
    printf("sets      %" PRIu64 ", of these %" PRIu64 " with all %u cameras; %" PRIu64
           " more are not complete and left out\n",
           i->sets, whole, i->head.n_cameras, i->sets_lost);
    if (i->sets > 0) {
        const struct cap_take_set *a = cap_take_set(t, 0, NULL);
        const struct cap_take_set *b = cap_take_set(t, i->sets - 1, NULL);
        double s = (double)(b->t_exposure_ns - a->t_exposure_ns) * 1e-9;
        printf("numbers   %" PRIu64 " to %" PRIu64 ", %.3f s, %.2f sets/s (nominal %g)\n",
               a->number, b->number, s, s > 0 ? (double)(i->sets - 1) / s : 0, i->head.fps);
    }
    printf("pixels    %.1f MB\n", (double)bytes * 1e-6);
    print_triggers(t);
    print_pieces(t);
    replay_info_print_cameras(t);
    print_gaps(t);
    return 0;
}
