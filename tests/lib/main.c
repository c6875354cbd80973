/* main.c - main() of the tests that have nothing to set up; and which programs start a thread.
 * Those that start none are in tests/not-under-tsan.txt and are not built under ThreadSanitizer.  tests/run.sh looks in
 * the file that T_THREADS names whether that list is still right.  Threads of C++ (Ceres' pool) do not count: they run
 * nothing that is instrumented. */
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int t_run(void); /* t.h */

__attribute__((weak)) int main(void)
{
    return t_run();
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) /* these have their own */
/* A test may have one of its own. */
__attribute__((weak)) int pthread_create(pthread_t *thread, const pthread_attr_t *attr,
                                         void *(*run)(void *), void *arg)
{
    typedef int create(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    union {
        void *object;
        create *function;
        void *(*run)(void *);
    } next = {dlsym(RTLD_NEXT, "pthread_create")}, body = {.run = run};
    Dl_info of;
    bool counts = dladdr(body.object, &of) == 0 || strstr(of.dli_fname, "/libstdc++") == NULL;
    const char *path = getenv("T_THREADS");
    FILE *file = counts && path != NULL ? fopen(path, "ae") : NULL;
    if (file != NULL) {
        fprintf(file, "%s\n", program_invocation_short_name);
        fclose(file);
    }
    return next.function(thread, attr, run, arg);
}
#endif
