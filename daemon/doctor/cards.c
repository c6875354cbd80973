/* cards.c - OpenCL devices of this host with their rates, beside those of the processors. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "base/pool.h"
#include "daemon/doctor/host.h"

#define COPY_BYTES (64u << 20)
#define COPY_TASKS 64
#define COPY_NS    (60 * PVX_NS_PER_MS)

size_t doc_real_cards(struct doc_host *h, struct doc_card out[REC_CL_MOST], struct pvx_diag *d)
{
    struct rec_cl_info info[REC_CL_MOST];
    (void)h;
    size_t n = rec_cl_list(info, d);
    for (size_t i = 0; i < n; i++) {
        struct pvx_diag why = {""};
        out[i] = (struct doc_card){.info = info[i]};
        if (info[i].why_not[0] != '\0')
            continue;
        pvx_err e = rec_cl_measure(i, &out[i].rates, &why);
        if (e != PVX_OK)
            snprintf(out[i].slow, sizeof out[i].slow, "%.150s", pvx_diag_text(&why, e));
    }
    return n;
}

struct copying {
    char *to, *from;
};

static void copy_piece(void *ctx, size_t k)
{
    const struct copying *c = ctx;
    const size_t bytes = COPY_BYTES / COPY_TASKS;
    memcpy(c->to + k * bytes, c->from + k * bytes, bytes);
}

double doc_copy_rate(void)
{
    struct copying c = {pvx_calloc(COPY_BYTES, 1), pvx_calloc(COPY_BYTES, 1)};
    pvx_pool *pool = NULL;
    double rate = 0;
    if (c.to != NULL && c.from != NULL && pvx_pool_new(0, "copy", &pool) == PVX_OK) {
        int64_t begin = pvx_now_mono(), least = INT64_MAX;
        memset(c.from, 1, COPY_BYTES); /* else all of it is one page */
        pvx_pool_run(pool, COPY_TASKS, copy_piece, &c);
        for (int i = 0; i < 4 || pvx_now_mono() - begin < COPY_NS; i++) {
            int64_t t0 = pvx_now_mono();
            pvx_pool_run(pool, COPY_TASKS, copy_piece, &c);
            int64_t ns = pvx_now_mono() - t0;
            least = ns < least ? ns : least;
        }
        rate = 2e9 * COPY_BYTES / (double)(least > 0 ? least : 1);
    }
    pvx_pool_free(&pool);
    free(c.to);
    free(c.from);
    return rate;
}

void doc_card_line(const struct doc_card *c, char *out, size_t size)
{
    static const char *const kinds[] = {[REC_CL_GPU] = "graphics card",
                                        [REC_CL_CPU] = "a processor, used only by its name",
                                        [REC_CL_OTHER] = "another device, used only by its name"};
    const struct rec_cl_info *o = &c->info;
    int n = snprintf(out, size, "%s: %s, %.0f GB, %s, driver %s", o->name, kinds[o->kind],
                     (double)o->memory * 1e-9, o->platform, o->driver);
    if (n < 0 || (size_t)n >= size)
        return;
    if (o->why_not[0] != '\0')
        snprintf(out + n, size - (size_t)n, "; it cannot be used: %s", o->why_not);
    else if (c->slow[0] != '\0')
        snprintf(out + n, size - (size_t)n, "; it cannot be used: %s", c->slow);
    else
        snprintf(out + n, size - (size_t)n,
                 "; copies %.1f GB/s, %.1f GB/s from the host, %.1f GB/s to it",
                 c->rates.copy * 1e-9, c->rates.up * 1e-9, c->rates.down * 1e-9);
}
