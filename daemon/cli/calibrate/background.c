/* background.c - `pyrovox calibrate background`: what cameras see without a flame, for `reconstruct
 * --background` from pictures, or in a running daemon. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/ask.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/light.h"
#include "daemon/cli/common/cli.h"
#include "daemon/config/endpoints.h"

static const char doc[] =
    "Take the mean of pictures without a flame. It is subtracted from pictures with one.\v"
    "From pictures, into a folder for `pyrovox reconstruct --background` with the same rig:\n"
    "  pyrovox calibrate background --rig rig.yaml --frames empty.h5 \\\n"
    "          --out background\n"
    "\nIn a running daemon, from its next sets, until it ends or until --sets 0:\n"
    "  pyrovox calibrate background --live --sets 64\n"
    "\n"
    "It is refused if something moves in it: the flame is still there.";

enum { OPT_LIVE = 0xa00, OPT_SETS, OPT_CONTROL, OPT_KEY };

struct args {
    struct calibrate_light_args light;
    bool live;
    int64_t sets;
    const char *control, *key;
};

static error_t background_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->light; return 0;
    case OPT_LIVE: a->live = a->light.nothing = true; return 0;
    case OPT_SETS: cli_arg_int(st, "sets", arg, 0, 10000, &a->sets); return 0;
    case OPT_CONTROL: a->control = arg; return 0;
    case OPT_KEY: a->key = arg; return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

/* ---- live ---- */

#define ANSWER_MS 10000
#define ASK_NS    (100 * PVX_NS_PER_MS)

/* Wait until the daemon has done what this request asked for. */
static pvx_err await(const struct args *a, double number, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "background"};
    for (;; pvx_sleep_until_mono(pvx_now_mono() + ASK_NS)) {
        cJSON *is = NULL;
        PVX_TRY(ask(a->control, a->key, "background", ANSWER_MS, &is, d));
        const char *state = ask_text(is, "state", NULL);
        double sets = ask_num(is, "sets", NULL), have = ask_num(is, "have", NULL);
        pvx_err e = PVX_ETIMEDOUT; /* not yet */
        if (ask_num(is, "request", NULL) != number)
            e = pvx_fail(d, PVX_EBUSY, "another client asked for another background meanwhile");
        else if (strcmp(state, "done") == 0)
            e = PVX_OK;
        else if (strcmp(state, "taking") != 0)
            e = pvx_fail(d, PVX_EINVAL, "%s", ask_text(is, "why", NULL));
        cJSON_Delete(is);
        if (cli_stop || !cli_progress(&bar, sets > 0 ? have / sets : 1))
            return PVX_ECANCELED;
        if (e != PVX_ETIMEDOUT)
            return e;
    }
}

static int background_live(const struct args *a)
{
    char request[80];
    struct pvx_diag d = {""};
    cJSON *reply = NULL;
    snprintf(request, sizeof request, "{\"cmd\":\"background\",\"sets\":%lld}", (long long)a->sets);
    cli_catch_stop();
    pvx_err e = ask_request(a->control, a->key, request, ANSWER_MS, &reply, &d);
    double number = e == PVX_OK ? ask_num(reply, "request", NULL) : 0;
    cJSON_Delete(reply);
    PVX_THEN(e, await(a, number, &d));
    if (e == PVX_ECANCELED) {
        fprintf(stderr, "\npyrovox: stopped; the daemon goes on taking it (--sets 0 ends that)\n");
        return 130;
    }
    if (e != PVX_OK)
        return cli_error(&d, e);
    if (a->sets > 0)
        printf("background: the mean of %lld sets is subtracted from now on\n", (long long)a->sets);
    else
        printf("the background is removed\n");
    return 0;
}

/* ---- from pictures ---- */

/* Colours at a pixel of a Bayer picture: its own sample, and for the other colours the mean over its neighbours. */
static void colours_at(const struct rec_light_picture *p, int32_t x, int32_t y, float out[3])
{
    double sum[3] = {0}, count[3] = {0};
    size_t w = (size_t)p->width;
    int own = p->cell[y % 2 * 2 + x % 2];
    for (int32_t v = y - 1; v <= y + 1; v++)
        for (int32_t u = x - 1; u <= x + 1; u++) {
            if (u < 0 || v < 0 || u >= p->width || v >= p->height)
                continue;
            int c = p->cell[v % 2 * 2 + u % 2];
            float s = p->mean[(size_t)v * w + (size_t)u];
            if (isfinite(s) && (c != own || (u == x && v == y))) {
                sum[c] += (double)s;
                count[c]++;
            }
        }
    for (int c = 0; c < 3; c++)
        out[c] = count[c] > 0 ? (float)(sum[c] / count[c]) : 0;
}

static pvx_err background_write_one(const struct calibrate_light *l, size_t c, struct pvx_diag *d)
{
    const struct rec_light_picture *p = &calibrate_light_stack(l, 0, c)->picture;
    size_t n = (size_t)p->width * (size_t)p->height, ch = p->cell != NULL ? 3 : (size_t)p->channels;
    size_t shape[3] = {(size_t)p->height, (size_t)p->width, ch};
    char path[PATH_MAX];
    float *v = pvx_calloc(n * ch, sizeof *v);
    PVX_NEED(v);
    for (size_t i = 0; i < n && p->cell != NULL; i++)
        colours_at(p, (int32_t)(i % shape[1]), (int32_t)(i / shape[1]), v + 3 * i);
    for (size_t i = 0; i < n * ch && p->cell == NULL; i++)
        v[i] = isfinite(p->mean[i]) ? p->mean[i] : 0;
    snprintf(path, sizeof path, "%s/%s.npy", l->a->out, l->rig.cameras[c].name);
    pvx_err e = cap_npy_save(path, v, shape, ch == 1 ? 2 : 3, d);
    free(v);
    return e;
}

static pvx_err background_step(struct calibrate_light *l, struct pvx_diag *d)
{
    if (l->a->n != 1)
        return pvx_fail(d, PVX_EINVAL, "a background is of one scene: give one --frames");
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        const struct calibrate_stack *s = calibrate_light_stack(l, 0, c);
        double by;
        int region = rec_light_moves(&s->still, &by);
        if (s->picture.n < 2)
            return pvx_fail(d, PVX_EINVAL,
                            "camera %s: %u pictures in %s; 2 or more make a background",
                            l->rig.cameras[c].name, s->picture.n, l->a->frames[0]);
        if (region >= 0)
            return pvx_fail(
                d, PVX_EINVAL,
                "camera %s: something moves in %s (8ths of the picture: column %d, row %d; "
                "by %.4f of full scale): a background has no flame in it",
                l->rig.cameras[c].name, l->a->frames[0], region % 8 + 1, region / 8 + 1, by);
    }
    PVX_TRY(pvx_mkdirs(l->a->out, d));
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        PVX_TRY(background_write_one(l, c, d));
    fprintf(stderr, "%s: backgrounds of %zu cameras\n", l->a->out, l->rig.n_cameras);
    return PVX_OK;
}

int calibrate_background(int argc, char **argv)
{
    static const struct argp_option options[] = {
        {"live", OPT_LIVE, NULL, 0, "take it in the running daemon", 0},
        {"sets", OPT_SETS, "N", 0, "with --live: the mean of so many sets (64; 0 removes it)", 0},
        {"control", OPT_CONTROL, "ENDPOINT", 0, "the daemon's control socket", 0},
        {"key", OPT_KEY, "FILE", 0,
         "your .key file of `pyrovox keygen`, for a daemon that asks for one (with --live)", 0},
        {0}};
    const struct argp_child children[] = {{&calibrate_light_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {
        .options = options, .parser = background_parse, .doc = doc, .children = children};
    struct args a = {.sets = 64, .control = dmn_client_endpoint(DMN_CONTROL)};
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    return a.live ? background_live(&a)
                  : calibrate_light_run(&a.light, DMN_LIGHT_ALL, background_step);
}
