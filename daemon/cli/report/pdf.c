#include "daemon/cli/report/pdf.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/spawn.h"
#include "daemon/cli/common/cli.h"

/* Run weasyprint.  Returns its exit code, or -1 - errno. */
static int weasyprint(const char *html, const char *pdf)
{
    const char *const argv[] = {"weasyprint", "--quiet", html, pdf, NULL};
    pid_t pid;
    int status;
    int err = pvx_spawn(argv, STDIN_FILENO, STDERR_FILENO, &pid);
    if (err != 0)
        return -1 - err;
    while (waitpid(pid, &status, 0) < 0) {
        if (errno != EINTR)
            return 1;
        if (cli_stop) /* a terminal's Ctrl-C does not reach it */
            kill(pid, SIGTERM);
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

pvx_err report_pdf(const char *dir)
{
    char html[4300], pdf[4300], part[4300];
    snprintf(html, sizeof html, "%s/report.html", dir);
    snprintf(pdf, sizeof pdf, "%s/report.pdf", dir);
    snprintf(part, sizeof part, "%s/report.pdf.tmp", dir);
    int rc = weasyprint(html, part);
    if (rc == 0 && rename(part, pdf) == 0)
        return PVX_OK;
    unlink(part);
    if (cli_stop)
        return PVX_ECANCELED;
    unlink(pdf); /* an older PDF would show other figures */
    fprintf(stderr,
            rc < 0
                ? "pyrovox: no report.pdf: weasyprint is not installed; `apt install weasyprint` "
                  "and run the same command again, or print %s from a browser\n"
                : "pyrovox: no report.pdf: weasyprint could not make it; print %s from a browser\n",
            html);
    return PVX_OK;
}
