#include "daemon/cli/common/cli.h"

#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "base/clock.h"

volatile sig_atomic_t cli_stop;

static void on_stop(int sig)
{
    (void)sig;
    cli_stop = 1;
}

void cli_catch_stop(void)
{
    struct sigaction sa = {.sa_handler = on_stop}; /* no SA_RESTART: blocking calls wake */
    sigaction(SIGINT, &sa, NULL);
    sigaction(SIGTERM, &sa, NULL);
}

int cli_error(const struct pvx_diag *d, pvx_err e)
{
    fprintf(stderr, "pyrovox: %s\n", pvx_diag_text(d, e));
    return 1;
}

int cli_end(const struct pvx_diag *d, pvx_err e, bool nothing_written)
{
    if (e == PVX_OK)
        return 0;
    if (e != PVX_ECANCELED)
        return cli_error(d, e);
    fprintf(stderr,
            nothing_written ? "\npyrovox: stopped; nothing was written\n" : "pyrovox: stopped\n");
    return 130;
}

pvx_err cli_may_write(const char *path, bool force, struct pvx_diag *d)
{
    if (path == NULL || force || access(path, F_OK) != 0)
        return PVX_OK;
    return pvx_fail(d, PVX_EBUSY, "%s is there already; --force writes over it", path);
}

bool cli_progress(void *ctx, double done)
{
    struct cli_progress *p = ctx;
    if (p->quiet)
        return !cli_stop;
    int tty = isatty(STDERR_FILENO);
    if (p->t0 == 0)
        p->t0 = pvx_now_mono();
    double s = cli_seconds_since(p->t0);
    if (done < 1 && done - p->last < (tty ? 0.005 : 0.1))
        return !cli_stop;
    p->last = done;
    if (tty) {
        char bar[41];
        int n = (int)(done * 40);
        memset(bar, '.', 40);
        memset(bar, '#', (size_t)(n < 0 ? 0 : n > 40 ? 40 : n));
        bar[40] = '\0';
        fprintf(stderr, "\r%-18s [%s] %3.0f %%  %.1f s%s", p->label, bar, done * 100, s,
                done >= 1 ? "\n" : "");
    } else {
        fprintf(stderr, "%s: %.0f %%, %.1f s\n", p->label, done * 100, s);
    }
    return !cli_stop;
}

double cli_seconds_since(int64_t t0)
{
    return (double)(pvx_now_mono() - t0) * 1e-9;
}

const char *cli_duration(double s, char out[32])
{
    bool min = s >= 120, h = s >= 7200;
    snprintf(out, 32, "%.3g %s", h ? s / 3600 : min ? s / 60 : s, h ? "h" : min ? "min" : "s");
    return out;
}

int cli_columns(int max)
{
    struct winsize w;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &w) != 0 || w.ws_col < 40)
        return max < 100 ? max : 100;
    return w.ws_col < max ? w.ws_col : max;
}
