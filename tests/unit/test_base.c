/* test_base.c - the promises of daemon/base: queue, pool, yaml, hist, numbers. */
#include "../t.h"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/cpu.h"
#include "base/file.h"
#include "base/hist.h"
#include "base/pool.h"
#include "base/queue.h"
#include "base/yaml.h"
#include "tests/lib/scratch.h"

T_CASE(threads_are_as_many_as_may_run)
{
    cpu_set_t all, one;
    pvx_pool *p;
    T_EQ_I(sched_getaffinity(0, sizeof all, &all), 0);
    T_EQ_I(pvx_cpu_count(), CPU_COUNT(&all));
    CPU_ZERO(&one);
    CPU_SET(sched_getcpu(), &one);
    T_EQ_I(sched_setaffinity(0, sizeof one, &one), 0);
    T_EQ_I(pvx_cpu_count(), 1);
    T_EQ_I(pvx_pool_new(0, "one", &p), PVX_OK);
    T_EQ_I(pvx_pool_threads(p), 1);
    pvx_pool_free(&p);
    T_EQ_I(sched_setaffinity(0, sizeof all, &all), 0);
}

T_CASE(more_in_a_path)
{
    static const char *const cases[][2] = {
        {"b.h5", "b-2.h5"}, {"/a.x/b.h5", "/a.x/b-2.h5"}, {"a.x/b", "a.x/b-2"},
        {".h5", ".h5-2"},   {"a/.h5", "a/.h5-2"},         {"a.b.c", "a.b-2.c"},
    };
    char out[16];
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        T_EQ_I(pvx_path_more(cases[i][0], "-2", out, sizeof out), PVX_OK);
        T_EQ_S(out, cases[i][1]);
    }
    T_OK(pvx_path_ends("a/b.h5", ".h5") && !pvx_path_ends(".h5", ".h5") &&
         !pvx_path_ends("5", ".h5"));
    T_EQ_I(pvx_path_more("a.h5", "-2", out, 7), PVX_OK);
    T_EQ_I(pvx_path_more("a.h5", "-2", out, 6), PVX_ERANGE);
}

T_CASE(queue_drops_oldest_and_counts)
{
    pvx_queue *q;
    int v[5];
    T_EQ_I(pvx_queue_new(3, &q), PVX_OK);
    void *gone;
    for (int i = 0; i < 3; i++) {
        pvx_queue_put(q, &v[i], &gone);
        T_OK(gone == NULL);
    }
    pvx_queue_put(q, &v[3], &gone);
    T_OK(gone == &v[0]);
    void *item;
    for (int i = 1; i < 4; i++) {
        T_EQ_I(pvx_queue_pop(q, 0, &item), PVX_OK);
        T_OK(item == &v[i]);
    }
    T_EQ_I(pvx_queue_pop(q, 1000000, &item), PVX_ETIMEDOUT);
    pvx_queue_close(q);
    T_EQ_I(pvx_queue_pop(q, -1, &item), PVX_ECLOSED);
    pvx_queue_put(q, &v[4], &gone);
    T_OK(gone == &v[4]);
    T_EQ_I(pvx_queue_put_wait(q, &v[4]), PVX_ECLOSED);
    pvx_queue_free(&q);
}

struct traffic {
    pvx_queue *q;
    size_t displaced;
};
static void *producer(void *arg)
{
    static int items[20000];
    struct traffic *t = arg;
    for (int i = 0; i < 20000; i++) {
        void *gone;
        pvx_queue_put(t->q, &items[i], &gone);
        if (gone != NULL)
            t->displaced++;
    }
    pvx_queue_close(t->q);
    return NULL;
}
T_CASE(queue_put_equals_popped_plus_displaced)
{
    struct traffic t = {0};
    T_EQ_I(pvx_queue_new(8, &t.q), PVX_OK);
    pthread_t th;
    pthread_create(&th, NULL, producer, &t);
    size_t popped = 0;
    void *item;
    while (pvx_queue_pop(t.q, -1, &item) == PVX_OK)
        popped++;
    pthread_join(th, NULL);
    T_EQ_I(popped + t.displaced, 20000);
    pvx_queue_free(&t.q);
}

static void count_task(void *ctx, size_t i)
{
    __atomic_fetch_add(&((int *)ctx)[i], 1, __ATOMIC_RELAXED);
}
T_CASE(pool_runs_each_task_once)
{
    for (unsigned threads = 1; threads <= 5; threads++) {
        pvx_pool *p;
        T_EQ_I(pvx_pool_new(threads, "t", &p), PVX_OK);
        for (int round = 0; round < 200; round++) {
            int hits[37] = {0};
            pvx_pool_run(p, 37, count_task, hits);
            for (int i = 0; i < 37; i++)
                T_EQ_I(hits[i], 1);
        }
        pvx_pool_free(&p);
    }
}
static void *second_caller(void *arg)
{
    for (int round = 0; round < 300; round++) {
        int hits[11] = {0};
        pvx_pool_run(arg, 11, count_task, hits);
        for (int i = 0; i < 11; i++)
            if (hits[i] != 1)
                return arg;
    }
    return NULL;
}
T_CASE(pool_serves_two_callers_at_once)
{
    pvx_pool *p;
    T_EQ_I(pvx_pool_new(3, "t", &p), PVX_OK);
    pthread_t th;
    pthread_create(&th, NULL, second_caller, p);
    T_OK(second_caller(p) == NULL);
    void *r;
    pthread_join(th, &r);
    T_OK(r == NULL);
    pvx_pool_free(&p);
}

T_CASE(yaml_names_file_line_key)
{
    static const char text[] = "a: 1\nb:\n  c: [1, 2, x]\n";
    pvx_yaml *y;
    struct pvx_diag d = {""};
    T_EQ_I(pvx_yaml_parse(text, sizeof text - 1, "f.yaml", &y, &d), PVX_OK);
    double v[3];
    int c = pvx_yaml_get(y, pvx_yaml_get(y, pvx_yaml_root(y), "b"), "c");
    T_EQ_I(pvx_yaml_doubles(y, c, "b.c", 3, 3, v, &d), PVX_EFORMAT);
    T_EQ_S(d.text, "f.yaml:3: b.c: 'x' is not a finite number");
    d.text[0] = '\0';
    T_EQ_I(pvx_yaml_known(y, pvx_yaml_root(y), "file", "a", &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "f.yaml:2: b: unknown key");
    pvx_yaml_free(&y);
}
T_CASE(yaml_refuses)
{
    static const char *const bad[] = {"a: 1\na: 2\n", "a: &x [1]\nb: *x\n", "a: [1\n",
                                      "a: 1\n---\nb: 2\n"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        pvx_yaml *y;
        struct pvx_diag d = {""};
        T_EQ_I(pvx_yaml_parse(bad[i], strlen(bad[i]), "f", &y, &d), PVX_EFORMAT);
        T_CONTAINS(d.text, "f:");
        T_OK(y == NULL);
    }
}
T_CASE(yaml_says_tabs_and_decimal_commas)
{
    static const char *const bad[][2] = {
        {"a:\n\tb: 1\n", "f:2: a tab begins this line: indent by spaces"},
        {"a:\n  b: 1\n \tc: 2\n", "f:3: a tab begins"},
        {"a: {b: 0,02}\n", "f:1: 02: a number is no key; numbers have a decimal point"},
        {"a: 15,5\n", "f:1: a: '15,5' is not a finite number; numbers have a decimal point"},
        {"a: [0,5, 0,5, 1]\n", "f:1: a: should be a list of 3 numbers; numbers have a decimal"},
        {"a: [0,05, 1]\n", "f:1: a: '05' begins with 0; numbers have a decimal point"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        pvx_yaml *y;
        struct pvx_diag d = {""};
        double v[3];
        pvx_err e = pvx_yaml_parse(bad[i][0], strlen(bad[i][0]), "f", &y, &d);
        int a = e == PVX_OK ? pvx_yaml_get(y, pvx_yaml_root(y), "a") : 0;
        if (e == PVX_OK && pvx_yaml_kind(y, a) == PVX_YAML_SEQ)
            e = pvx_yaml_doubles(y, a, "a", 3, 3, v, &d);
        else if (e == PVX_OK)
            e = pvx_yaml_double(y, a, "a", 0, 100, v, &d);
        T_EQ_I(e, PVX_EFORMAT);
        T_CONTAINS(d.text, bad[i][1]);
        if (y != NULL)
            pvx_yaml_free(&y);
    }
    pvx_yaml *y; /* in braces a tab is allowed, and a number may be a camera's name */
    static const char good[] = "a: {\n\tb: 1 }\nc: {0: \"sim:\"}\n";
    T_EQ_I(pvx_yaml_parse(good, sizeof good - 1, "f", &y, NULL), PVX_OK);
    pvx_yaml_free(&y);
}
T_CASE(numbers_are_the_whole_token)
{
    double v;
    int64_t k;
    static const char *const bad[] = {"",    " 1",   "1 ",    "1x",  "nan",
                                      "inf", "0x10", "1e999", "--1", "."};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        T_OK(pvx_parse_double(bad[i], -1e300, 1e300, &v) != PVX_OK);
    T_EQ_I(pvx_parse_double("-1.5e3", -1e4, 0, &v), PVX_OK);
    T_NEAR(v, -1500, 0);
    T_EQ_I(pvx_parse_double("2", 0, 1, &v), PVX_ERANGE);
    T_EQ_I(pvx_parse_int("12", 0, 100, &k), PVX_OK);
    T_EQ_I(k, 12);
    T_EQ_I(pvx_parse_int("1.0", 0, 100, &k), PVX_EFORMAT);
    T_EQ_I(pvx_parse_int("99999999999999999999", 0, 100, &k), PVX_ERANGE);
}
T_CASE(hist_quantiles)
{
    static struct pvx_hist h;
    for (int i = 1; i <= 1000; i++)
        pvx_hist_add(&h, i * 100000LL);
    T_NEAR((double)pvx_hist_quantile(&h, 0.5), 50e6, 0.05 * 50e6);
    T_NEAR((double)pvx_hist_quantile(&h, 0.99), 99e6, 0.05 * 99e6);
    T_EQ_I(h.max_ns, 100000000);
}
T_CASE(file_write_is_atomic_and_reads_back)
{
    char path[64];
    snprintf(path, sizeof path, "/tmp/pvx-test-%ld", (long)getpid());
    struct pvx_diag d = {""};
    T_EQ_I(pvx_file_write(path, "hello", 5, &d), PVX_OK);
    char *t;
    size_t n;
    T_EQ_I(pvx_file_read(path, 5, &t, &n, &d), PVX_OK);
    T_EQ_S(t, "hello");
    free(t);
    T_EQ_I(pvx_file_read(path, 4, &t, &n, &d), PVX_ERANGE);
    unlink(path);
    d.text[0] = '\0';
    T_EQ_I(pvx_file_read(path, 4, &t, &n, &d), PVX_ENOENT);
    T_CONTAINS(d.text, path);
    d.text[0] = '\0';
    T_EQ_I(pvx_file_write("/dev/full/x", "hello", 5, &d), PVX_ENOENT);
}

/* What may never end is refused before it is opened; a pipe that was handed over is read, a named one where that is meant. */
T_CASE(files_that_may_never_end)
{
    static const struct {
        const char *name, *says;
    } refused[] = {{"pipe", "pipe: is a named pipe"},
                   {"socket", "socket: is a socket"},
                   {"/dev/zero", "/dev/zero: is a device"},
                   {".", "is a folder"}};
    struct pvx_diag d;
    char path[128], *t;
    size_t n;
    int fd, ends[2];
    scratch_new();
    T_EQ_I(mkfifo(at("pipe"), 0600), 0);
    T_EQ_I(mknod(at("socket"), S_IFSOCK | 0600, 0), 0);
    for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
        const char *p = refused[i].name[0] == '/' ? refused[i].name : at("%s", refused[i].name);
        for (int how = 0; how < 3; how++) {
            d.text[0] = '\0';
            pvx_err e = how == 0   ? pvx_file_check(p, &d)
                        : how == 1 ? pvx_file_open(p, &fd, &d)
                                   : pvx_file_read(p, 5, &t, &n, &d);
            T_EQ_I(e, PVX_EFORMAT);
            T_CONTAINS(d.text, refused[i].says);
        }
    }
    T_EQ_I(pvx_file_await("/dev/zero", 5, &t, &n, &d), PVX_EFORMAT);
    T_EQ_I(pipe(ends), 0);
    T_EQ_I(write(ends[1], "hello", 5), 5);
    close(ends[1]);
    snprintf(path, sizeof path, "/proc/self/fd/%d", ends[0]); /* what <(...) and /dev/stdin are */
    T_EQ_I(pvx_file_read(path, 5, &t, &n, &d), PVX_OK);
    T_EQ_S(t, "hello");
    free(t);
    close(ends[0]);
    pid_t writer = fork();
    if (writer == 0) {
        int to = open(at("pipe"), O_WRONLY);
        _exit(write(to, "frame", 5) == 5 ? 0 : 1);
    }
    T_EQ_I(pvx_file_await(at("pipe"), 5, &t, &n, &d), PVX_OK);
    T_EQ_S(t, "frame");
    free(t);
    waitpid(writer, NULL, 0);
    scratch_remove();
}
T_CASE(both_clocks_at_one_instant)
{
    for (int i = 0; i < 100; i++) {
        int64_t before = pvx_now_mono(), real = 0, mono = 0, real0 = pvx_now_real();
        pvx_now_both(&real, &mono);
        T_OK(mono >= before && mono <= pvx_now_mono());
        T_OK(real >= real0 && real <= pvx_now_real());
    }
}
