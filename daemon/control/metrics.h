/* metrics.h - the counters for Prometheus (text format 0.0.4), GET /metrics on a port of this host.
 *
 * Names, HELP and TYPE come from the tables of counters (state.h, capture).  Counters end in _total.
 * Threads: one of its own, of lowest priority; at most DMN_METRICS_CLIENTS connections, each closed after
 * DMN_METRICS_PATIENCE_S of silence, so that a silent client holds no connection. */
#ifndef DMN_METRICS_H
#define DMN_METRICS_H
#include "daemon/config/config.h"
#include "daemon/control/state.h"

#define DMN_METRICS_CLIENTS    256
#define DMN_METRICS_PATIENCE_S 1

/* s as text.  Owner: caller, free(); NULL when out of memory. */
char *dmn_metrics_text(const struct dmn_state *s);

typedef struct dmn_metrics dmn_metrics;
/* state is called from this thread; false = the daemon is still starting.  Errors, diag filled: PVX_EINVAL (not
 * ADDRESS:PORT, or an address that other hosts reach without `insecure`), PVX_EBUSY (in use), PVX_EIO. */
PVX_MUST_CHECK pvx_err dmn_metrics_new(const char *endpoint, bool insecure,
                                       bool (*state)(void *ctx, struct dmn_state *out), void *ctx,
                                       dmn_metrics **out, struct pvx_diag *d);
void dmn_metrics_free(dmn_metrics **m);

#endif
