#include "daemon/cli/reconstruct/slurm.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <wordexp.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/spawn.h"
#include "daemon/cli/reconstruct/options.h"

#define SAID 4000

/* Print a word quoted so that the shell reads it as it is. */
static void put_word(FILE *f, const char *word)
{
    fputc('\'', f);
    for (; *word != '\0'; word++)
        if (*word == '\'')
            fputs("'\\''", f);
        else
            fputc(*word, f);
    fputc('\'', f);
}

static pvx_err put_program(FILE *f, struct pvx_diag *d)
{
    char dir[3000], path[3100];
    pvx_err e = pvx_exe_dir(dir, sizeof dir);
    if (e != PVX_OK)
        return pvx_fail(d, e, "the folder of this program is not known");
    snprintf(path, sizeof path, "%s/pyrovox", dir);
    put_word(f, path);
    fputs(" reconstruct", f);
    return PVX_OK;
}

static pvx_err slurm_write_script(const struct parts_job *j, int argc, char **argv,
                                  const char *path, struct pvx_diag *d)
{
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    PVX_NEED(f);
    /* a signal a minute before the time limit: the part ends in order and --resume continues it */
    fprintf(f,
            "#!/bin/sh\n"
            "# Part $SLURM_ARRAY_TASK_ID of %u of %s; written by pyrovox reconstruct --slurm.\n"
            "#SBATCH --job-name=pyrovox\n"
            "#SBATCH --requeue\n"
            "#SBATCH --open-mode=append\n"
            "#SBATCH --signal=B:TERM@60\n"
            "exec ",
            j->n, j->out);
    pvx_err e = put_program(f, d);
    for (int i = 1; i < argc && e == PVX_OK; i++) {
        int skip = reconstruct_about_jobs(argv[i]);
        if (skip == 0) {
            fputc(' ', f);
            put_word(f, argv[i]);
        }
        i += skip > 1;
    }
    fprintf(f, " --array \"$SLURM_ARRAY_TASK_ID/%u\" --resume --quiet\n", j->n);
    bool ok = fclose(f) == 0;
    PVX_THEN(e, ok ? pvx_file_write(path, text, len, d) : PVX_ENOMEM);
    free(text);
    return e;
}

/* Keep only the last line: the lines before are warnings. */
static void keep_last_line(char *said)
{
    size_t n = strlen(said);
    while (n > 0 && said[n - 1] == '\n')
        said[--n] = '\0';
    const char *line = strrchr(said, '\n');
    if (line != NULL)
        memmove(said, line + 1, strlen(line));
    said[strcspn(said, ";")] = '\0'; /* "17;cluster" */
}

/* said: the number of the job. */
static pvx_err sbatch(const char *const argv[], char said[SAID], struct pvx_diag *d)
{
    int ends[2], status = 0, nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
    size_t n = 0;
    pid_t pid;
    said[0] = '\0';
    if (nothing < 0 || pipe2(ends, O_CLOEXEC) != 0) {
        close(nothing);
        return PVX_EIO;
    }
    int err = pvx_spawn(argv, nothing, ends[1], &pid);
    close(nothing);
    close(ends[1]);
    for (ssize_t k; err == 0 && n < SAID - 1 && (k = read(ends[0], said + n, SAID - 1 - n)) != 0;)
        if (k > 0)
            n += (size_t)k;
        else if (errno != EINTR)
            break;
    close(ends[0]);
    said[n] = '\0';
    if (err != 0)
        return pvx_fail(d, pvx_err_from_errno(err),
                        "sbatch: %s; package slurm-client, or --array I/N for another scheduler",
                        strerror(err));
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    bool ok = WIFEXITED(status) && WEXITSTATUS(status) == 0;
    if (ok)
        keep_last_line(said);
    for (char *c = said; *c != '\0'; c++)
        *c = (char)(*c == '\n' ? ' ' : *c);
    return ok ? PVX_OK : pvx_fail(d, PVX_EINVAL, "sbatch refuses: %.600s", said);
}

/* List the parts to be solved as "1-4,7" and return how many they are. */
static unsigned slurm_choose(const struct parts_job *j, bool resume, char *list, size_t size)
{
    struct part_status s;
    unsigned n = 0;
    size_t len = 0;
    list[0] = '\0';
    for (unsigned i = 1, from = 0; i <= j->n + 1; i++) {
        bool wanted = i <= j->n;
        if (wanted && resume) {
            parts_status(j, i, &s);
            wanted = s.state != PART_DONE && s.state != PART_RUNNING;
        }
        n += wanted;
        if (wanted && from == 0)
            from = i;
        if (wanted || from == 0)
            continue;
        if (len < size)
            len += (size_t)snprintf(list + len, size - len, "%s%u", len > 0 ? "," : "", from);
        if (len < size && i - 1 > from)
            len += (size_t)snprintf(list + len, size - len, "-%u", i - 1);
        from = 0;
    }
    return n;
}

/* Split the text of --sbatch into words as a shell would. */
static pvx_err slurm_split(const char *options, wordexp_t *w, struct pvx_diag *d)
{
    static const char *const why[] = {
        [WRDE_BADCHAR] = "a character of | & ; < > ( ) { }, or a new line, is not quoted",
        [WRDE_BADVAL] = "a variable in it is not set",
        [WRDE_CMDSUB] = "it would run a command",
        [WRDE_SYNTAX] = "a quote is not closed"};
    int err = wordexp(options, w, WRDE_NOCMD | WRDE_UNDEF);
    if (err == WRDE_NOSPACE)
        return PVX_ENOMEM;
    return err == 0 ? PVX_OK : pvx_fail(d, PVX_EINVAL, "--sbatch %s: %s", options, why[err]);
}

static pvx_err submit(const struct parts_job *j, const char *list, const char *script,
                      const wordexp_t *more, bool *begun, struct pvx_diag *d)
{
    char array[8100], output[4500], after[4100], join[8300], dir[3000], said[SAID], id[64];
    const char **argv = pvx_calloc(more->we_wordc + 10, sizeof *argv);
    size_t n = 0;
    PVX_NEED(argv);
    argv[n++] = "sbatch";
    argv[n++] = "--parsable";
    for (size_t i = 0; i < more->we_wordc; i++)
        argv[n++] = more->we_wordv[i];
    size_t given = n;
    snprintf(array, sizeof array, "--array=%s", list);
    snprintf(output, sizeof output, "--output=%s.parts/slurm-%%A-%%a.log", j->out);
    argv[n++] = array;
    argv[n++] = output;
    argv[n++] = script;
    pvx_err e = sbatch(argv, said, d);
    *begun = e == PVX_OK;
    if (e == PVX_OK) {
        snprintf(id, sizeof id, "%.60s", said);
        printf("job %s: parts %s of %u; squeue -j %s shows them\n", id, list, j->n, id);
        n = given;
        e = pvx_exe_dir(dir, sizeof dir);
        snprintf(after, sizeof after, "--dependency=afterany:%s", id);
        snprintf(output, sizeof output, "--output=%s.parts/slurm-%%j-join.log", j->out);
        snprintf(join, sizeof join, "--wrap=exec '%s/pyrovox' reconstruct --join --out '%s'", dir,
                 j->out);
        argv[n++] = "--job-name=pyrovox-join";
        argv[n++] = "--cpus-per-task=1"; /* if an option is given twice, sbatch uses the later */
        argv[n++] = after;
        argv[n++] = output;
        argv[n++] = join;
        argv[n] = NULL;
        PVX_THEN(e, sbatch(argv, said, d));
        if (e == PVX_OK)
            printf("job %.60s: joins them into %s when they have ended\n", said, j->out);
    }
    free(argv);
    return e;
}

static bool slurm_is_fresh(const struct parts_job *j)
{
    char path[4500];
    bool none = true;
    for (unsigned i = 1; i <= j->n && none; i++) {
        parts_path(j, i, "lock", path, sizeof path);
        none = access(path, F_OK) != 0;
    }
    return none;
}

/* Delete a job that was not submitted, so that it can be begun in another number of parts. */
static void slurm_delete(const struct parts_job *j)
{
    static const char *const files[] = {"/job.sh", "/job.json", ""};
    char path[4500];
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        snprintf(path, sizeof path, "%s.parts%s", j->out, files[i]);
        (void)!remove(path);
    }
}

static pvx_err hand_out(const struct parts_job *j, const char *list, int argc, char **argv,
                        const char *options, bool *begun, struct pvx_diag *d)
{
    char script[4500];
    wordexp_t words = {0};
    if (strchr(j->out, '\'') != NULL || strchr(j->out, '%') != NULL)
        return pvx_fail(d, PVX_EINVAL, "%s: Slurm cannot take a name with ' or %%", j->out);
    PVX_TRY(slurm_split(options != NULL ? options : "", &words, d));
    snprintf(script, sizeof script, "%s.parts/job.sh", j->out);
    pvx_err e = slurm_write_script(j, argc, argv, script, d);
    if (e == PVX_OK && chmod(script, 0755) != 0)
        e = pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", script, strerror(errno));
    PVX_THEN(e, submit(j, list, script, &words, begun, d));
    wordfree(&words);
    return e;
}

pvx_err reconstruct_slurm(const struct parts_job *j, bool resume, int argc, char **argv,
                          const char *options, struct pvx_diag *d)
{
    char script[4500], list[8000];
    snprintf(script, sizeof script, "%s.parts/job.sh", j->out);
    bool fresh = slurm_is_fresh(j), begun = access(script, F_OK) == 0;
    if (!resume && (begun || !fresh))
        return pvx_fail(d, PVX_EBUSY,
                        "%s.parts: exists already: --resume submits what is not done; squeue "
                        "shows what still waits",
                        j->out);
    unsigned n = slurm_choose(j, resume, list, sizeof list);
    if (n == 0)
        return pvx_fail(d, PVX_EBUSY,
                        "%s: every part is done or running: `pyrovox reconstruct --join --out "
                        "%s` shows them",
                        j->out, j->out);
    if (strlen(list) > sizeof list - 20)
        return pvx_fail(d, PVX_ERANGE, "%u parts in too many runs for one job array", n);
    pvx_err e = hand_out(j, list, argc, argv, options, &begun, d);
    if (e != PVX_OK && fresh && !begun)
        slurm_delete(j);
    return e;
}
