/* follow.h - a subscriber that watches a daemon: rate, gaps, latency, and the error of the volumes
 * against a known flame.
 *
 * The known flame is the one that `sim:` cameras or `pyrovox simcams` show at the volume's exposure time.  Once every
 * FOLLOW_UNPACK_NS a volume is unpacked and compared.  All other volumes are only counted.
 * Threads: one. */
#ifndef FOLLOW_H
#define FOLLOW_H
#include <cjson/cJSON.h>
#include <stdbool.h>
#include "base/hist.h"
#include "proto/clients/sub.h"
#include "recon/view/flame.h"

#define FOLLOW_UNPACK_NS 500000000LL

struct follow_truth {
    bool known;
    uint32_t seed;
    double period_s;
    double ring_fps; /* simcams: pictures are of the instants i/ring_fps; 0 = continuous */
};

struct follow {
    pvp_sub *sub;
    struct follow_truth truth;
    uint64_t volumes; /* since follow_mark */
    uint64_t missing; /* sets without a volume: gaps in the exposure times */
    uint64_t lost;    /* messages that this subscriber lost */
    int64_t mark_ns;  /* mono clock */
    struct pvx_hist latency;
    double error, error_sum, error_worst; /* relative L2 of the volume; -1 = not known yet */
    uint64_t error_n;
    struct pvp_volume last;
    cJSON *status; /* the daemon's latest, or NULL */
    bool ended;
    char end_reason[PVP_REASON_MAX];
    float *dense; /* latest unpacked volume, [nz][ny][nx][channels] */
    bool have_dense;
    /* own */
    pvp_decoder *decoder;
    float *want;
    size_t dense_n, want_n;
    int64_t last_exposure_ns, next_unpack_ns;
    uint64_t session, lost_base;
};

/* key: a .key file, NULL none.  Errors: PVX_EINVAL (endpoint), those of the key. */
PVX_MUST_CHECK pvx_err follow_init(struct follow *f, const char *endpoint, const char *key,
                                   const struct follow_truth *truth, struct pvx_diag *d);
void follow_fini(struct follow *f);
/* Wait at most timeout_ns for a message, and take all messages that are there then. */
PVX_MUST_CHECK pvx_err follow_poll(struct follow *f, int64_t timeout_ns, struct pvx_diag *d);
/* Start counts, latency and errors anew. */
void follow_mark(struct follow *f);
/* Volumes per second since the mark. */
double follow_rate(const struct follow *f);
/* Box of the volumes; false before the first start message. */
bool follow_grid(const struct follow *f, struct rec_grid *out, int *channels);
#endif
