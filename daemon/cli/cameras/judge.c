/* judge.c - the verdict about each camera from the numbers of a test, and the remedy. */
#include <math.h>
#include <stdarg.h>

#include <string.h>

#include "daemon/cli/cameras/camtest.h"
#include "recon/carve/clipped.h"

void camtest_add(struct camtest_series *s, double v)
{
    double delta = v - s->mean;
    if (s->n == 0 || v < s->min)
        s->min = v;
    if (s->n == 0 || v > s->max)
        s->max = v;
    s->n++;
    s->mean += delta / (double)s->n;
    s->m2 += delta * (v - s->mean);
}

double camtest_std(const struct camtest_series *s)
{
    return s->n > 1 ? sqrt(s->m2 / (double)(s->n - 1)) : 0;
}

double camtest_worst(const struct camtest_series *s)
{
    return s->n == 0 ? 0 : fmax(s->max - s->mean, s->mean - s->min);
}

static void judge_say(struct camtest_camera *c, enum camtest_verdict v, const char *remedy,
                      const char *fmt, ...) PVX_PRINTF(4, 5);
/* Set verdict and text, unless the camera has one that is as bad or worse. */
static void judge_say(struct camtest_camera *c, enum camtest_verdict v, const char *remedy,
                      const char *fmt, ...)
{
    if (v <= c->verdict)
        return;
    c->verdict = v;
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(c->what, sizeof c->what, fmt, ap);
    va_end(ap);
    snprintf(c->remedy, sizeof c->remedy, "%s", remedy);
}

/* Frames that the camera made, as far as is known. */
static double made(const struct camtest_camera *c)
{
    return (double)(c->frames + c->count[CAP_INCOMPLETE] + c->count[CAP_BAD_SIZE] +
                    c->count[CAP_BAD_FORMAT] + c->count[CAP_UNDERRUN] + c->count[CAP_ID_GAP]);
}

static void no_frames(const struct camtest *t, struct camtest_camera *c)
{
    if (c->stats.error[0] != '\0' && c->count[CAP_RECEIVED] == 0)
        judge_say(c, CAMTEST_FAIL, "", "%s", c->stats.error); /* contains its remedy */
    else if (c->count[CAP_INCOMPLETE] > 0)
        judge_say(
            c, CAMTEST_FAIL, "`pyrovox doctor` looks for the cause: MTU, socket buffers, the card",
            "not one whole frame, %llu incomplete", (unsigned long long)c->count[CAP_INCOMPLETE]);
    else if (t->triggered)
        judge_say(
            c, CAMTEST_FAIL,
            "does the trigger reach it? try --trigger free-run; capture/SYNC.md has the wiring and "
            "keys",
            "opened, but no frame came: it waits for a trigger");
    else
        judge_say(
            c, CAMTEST_FAIL,
            "a firewall lets cameras be found but keeps streams out: `pyrovox doctor`; or the "
            "camera waits for a trigger (features: TriggerMode: \"Off\")",
            "opened, but no frame came");
}

static void losses(const struct camtest_camera *in, struct camtest_camera *c)
{
    const uint64_t *n = in->count;
    double all = made(in);
    if (n[CAP_LOST_CAMERA] > 0)
        judge_say(c, CAMTEST_FAIL, "cable, power, switch; USB: autosuspend (`pyrovox doctor`)",
                  "stopped answering %llu times", (unsigned long long)n[CAP_LOST_CAMERA]);
    if (n[CAP_INCOMPLETE] > 0)
        judge_say(
            c,
            n[CAP_INCOMPLETE] > 2 && n[CAP_INCOMPLETE] > 0.01 * all ? CAMTEST_FAIL : CAMTEST_WARN,
            "`pyrovox doctor` looks for the cause; packet_delay_ns where cameras share a link",
            "%llu of %.0f frames incomplete: packets were lost",
            (unsigned long long)n[CAP_INCOMPLETE], all);
    if (n[CAP_BAD_SIZE] + n[CAP_BAD_FORMAT] > 0)
        judge_say(c, CAMTEST_FAIL, "another program changes the camera, or packets are cut (MTU)",
                  "%llu frames of another size or format",
                  (unsigned long long)n[CAP_BAD_SIZE] + n[CAP_BAD_FORMAT]);
    if (n[CAP_BAD_STAMP] > 0)
        judge_say(c, CAMTEST_FAIL, "the camera's clock is set while it runs: two PTP masters?",
                  "%llu frames with a clock that ran backwards or stood still",
                  (unsigned long long)n[CAP_BAD_STAMP]);
    if (n[CAP_UNDERRUN] + n[CAP_OVERFLOW] > 0)
        judge_say(c, CAMTEST_WARN, "this machine is busy with other things; more `buffers`",
                  "%llu frames lost here: this program was too slow",
                  (unsigned long long)n[CAP_UNDERRUN] + n[CAP_OVERFLOW]);
    if (n[CAP_ID_GAP] > 0)
        judge_say(
            c, n[CAP_ID_GAP] > 2 && n[CAP_ID_GAP] > 0.01 * all ? CAMTEST_FAIL : CAMTEST_WARN,
            "the camera could not send them: bandwidth limit of the camera or its bus; lower fps "
            "or another pixel format",
            "%llu of %.0f frames numbered by the camera never came",
            (unsigned long long)n[CAP_ID_GAP], all);
}

static void timing(const struct camtest *t, struct camtest_camera *c)
{
    double period = t->fps > 0 ? 1 / t->fps : c->device.mean;
    const struct cap_health *h = &c->stats.health;
    if (t->fps > 0 && c->frames > 10 && c->hz < 0.97 * t->fps)
        judge_say(
            c, CAMTEST_WARN,
            "exposure longer than the period, a format too large for the link, or a rate that the "
            "camera does not have (`pyrovox cameras -l`)",
            "%.2f Hz instead of %.2f", c->hz, t->fps);
    if (t->fps > 0 && c->frames > 10 && c->hz > 1.03 * t->fps)
        judge_say(c, CAMTEST_WARN,
                  "the camera ignores the rate that it is given; set its own feature "
                  "(AcquisitionFrameRateEnable), or trigger it",
                  "%.2f Hz instead of %.2f", c->hz, t->fps);
    if (c->device.n > 10 && camtest_worst(&c->device) > 0.2 * period)
        judge_say(c, CAMTEST_WARN,
                  "auto exposure or a software trigger; a hardware line or PTP is steady "
                  "(capture/SYNC.md)",
                  "its exposures come up to %.1f ms off their rhythm",
                  camtest_worst(&c->device) * 1e3);
    if (isfinite(h->temperature_c) && h->temperature_c >= 70)
        judge_say(c, h->temperature_c >= 85 ? CAMTEST_FAIL : CAMTEST_WARN,
                  "mount it on metal, or give it air: noise doubles every 6 to 8 degrees",
                  "%.0f degrees Celsius", h->temperature_c);
    double mbps = c->hz * (c->frames > 0 ? (double)c->bytes / (double)c->frames : 0) * 8e-6;
    if (isfinite(h->link_mbps) && h->link_mbps > 0 && mbps > 0.9 * h->link_mbps)
        judge_say(c, CAMTEST_WARN, "lower fps, a packed or Bayer format, or a faster link",
                  "its link is full: %.0f of %.0f Mb/s", mbps, h->link_mbps);
}

static void blacks(struct camtest_camera *c)
{
    char text[REC_PHOTO_CUT_TEXT];
    if (!rec_photo_say_cut(c->cut, c->pedestal, text))
        return;
    char *cure = strstr(text, "; ");
    judge_say(c, CAMTEST_WARN, cure + 2, "%.*s", (int)(cure - text), text);
}

/* Judge the troubles that capture found itself: slips, missed triggers, a wrong clock ... */
static void judge_troubles(struct camtest_camera *c)
{
    for (uint32_t i = 0; i < c->stats.n_troubles && i < CAP_TROUBLES_MAX; i++) {
        const struct cap_trouble *k = &c->stats.trouble[i];
        const struct cap_trouble_def *def = &cap_trouble_defs[k->cause];
        if (def->what != NULL && k->cause >= CAP_CLOCK_STUCK)
            judge_say(c, CAMTEST_WARN, def->remedy, "%s%s%s", def->what,
                      k->detail[0] != '\0' ? ": " : "", k->detail);
    }
}

static void judge_sets(struct camtest *t)
{
    double tolerance = t->fps > 0 ? 0.25 / t->fps : 0;
    t->verdict = CAMTEST_OK;
    t->what[0] = t->remedy[0] = '\0';
    uint32_t working = 0;
    for (uint32_t i = 0; i < t->n; i++)
        working += t->camera[i].frames > 0;
    t->whole = 0;
    for (uint32_t k = working; k <= t->n; k++)
        t->whole += t->by_size[k];
    if (working < 2 || t->sets == 0)
        return;
    double missing = (double)(t->sets - t->whole) / (double)t->sets;
    if (missing > 0.02) {
        t->verdict = missing > 0.5 ? CAMTEST_FAIL : CAMTEST_WARN;
        snprintf(t->what, sizeof t->what, "%.0f %% of the sets lack a camera", missing * 100);
        snprintf(
            t->remedy, sizeof t->remedy,
            missing > 0.5
                ? "the cameras do not expose together: set a trigger or PTP up (capture/SYNC.md)"
                : "frames were lost (above), or cameras drift apart: capture/SYNC.md");
    } else if (t->spread.n > 0 && t->spread.mean > 0.5 * tolerance) {
        t->verdict = CAMTEST_WARN;
        snprintf(t->what, sizeof t->what,
                 "exposures of a set lie %.1f ms apart, a quarter of the period is %.1f",
                 t->spread.mean * 1e3, tolerance * 1e3);
        snprintf(t->remedy, sizeof t->remedy,
                 "cameras run freely: synchronize them (capture/SYNC.md), or live with a flame "
                 "that moves meanwhile");
    }
}

void camtest_judge(struct camtest *t)
{
    for (uint32_t i = 0; i < t->n; i++) {
        struct camtest_camera *c = &t->camera[i];
        c->verdict = CAMTEST_OK;
        c->what[0] = c->remedy[0] = '\0';
        double s = (double)(c->last_mono_ns - c->first_mono_ns) * 1e-9;
        c->hz = c->frames > 1 && s > 0 ? (double)(c->frames - 1) / s : 0;
        /* the camera also made the frames that were lost: its own stamps give the true rate */
        if (c->device.n > 2 && c->device.mean > 0)
            c->hz = 1 / c->device.mean;
        if (c->frames == 0)
            no_frames(t, c);
        else {
            losses(c, c);
            judge_troubles(c);
            timing(t, c);
            blacks(c);
        }
    }
    judge_sets(t);
}
