#include "daemon/cli/reconstruct/device.h"

#include <stdio.h>

#include "daemon/cli/reconstruct/active.h"

pvx_err reconstruct_device_open(const struct reconstruct_options *o, struct dmn_compute *c,
                                struct pvx_diag *d)
{
    struct rec_frame_params p = o->frame;
    p.again = o->bars > 0;
    const struct dmn_compute_want want = {
        .word = o->compute, .what = "--compute", .refused = rec_frame_card_why_not(&p)};
    return dmn_compute_open(&want, c, d);
}

static void device_load(void *ctx, size_t k, rec_frame *f)
{
    struct frames_in *in = ctx;
    (void)frames_in_load_frame(in, reconstruct_spread(k % in->n, in->n), f);
}

pvx_err reconstruct_device_choose(struct dmn_compute *c, const struct dmn_compute_job *job,
                                  struct frames_in *in, bool quiet, struct rec_frame_params *p,
                                  struct pvx_diag *d)
{
    struct dmn_compute_job of = *job;
    of.load = device_load;
    of.ctx = in;
    PVX_TRY(dmn_compute_choose(c, &of, p, d));
    if (c->said[0] != '\0' && (c->warn || !quiet))
        fprintf(stderr, "%s\n", c->said);
    return PVX_OK;
}

void reconstruct_device_tell(dmn_pipeline *p, cJSON *report)
{
    struct dmn_compute_state s;
    dmn_pipeline_compute(p, &s);
    if (s.device[0] == '\0')
        return;
    cJSON *to = cJSON_AddObjectToObject(report, "compute");
    cJSON_AddStringToObject(to, "device", s.device);
    cJSON_AddNumberToObject(to, "sets", (double)s.there);
    cJSON_AddNumberToObject(to, "raw", (double)s.raw);
    cJSON_AddNumberToObject(to, "fell_back", (double)s.here);
    cJSON_AddStringToObject(to, "why", s.why);
    if (s.here > 0)
        fprintf(stderr, "pyrovox: %llu of %llu sets were solved on the processors, because of %s\n",
                (unsigned long long)s.here, (unsigned long long)(s.here + s.there), s.device);
}
