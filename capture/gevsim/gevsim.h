/* gevsim.h - the parts of a simulated camera (private to this folder).
 *
 * Only the file with a part's name changes that part (gvcam.c sets all of them up).  A part calls only the parts
 * before it.
 * One net thread runs everything.  Every function of a part is called with the net's lock held. */
#ifndef CAP_GVCAM_INT_H
#define CAP_GVCAM_INT_H
#include <string.h>

#include "base/random.h"
#include "capture/gevsim/clock.h"
#include "capture/gevsim/control.h"
#include "capture/gevsim/expose.h"
#include "capture/gevsim/link.h"
#include "capture/gevsim/reg.h"
#include "capture/gevsim/send.h"
#include "capture/wire/be.h"
#include "capture/wire/gvsp.h"

#define GVCAM_NEVER INT64_MAX

struct cap_gvcam {
    cap_gvnet *net;
    struct cap_gvcam *next;
    struct cap_gvcam_config c;
    char *strings[3];
    const void **ring;
    struct in_addr addr, mask;
    unsigned ifindex;
    uint64_t rng;
    struct cap_gvcam_fault fault;
    struct cap_gvcam_stats stats; /* each part writes the counts about itself */

    struct gvcam_link *link; /* shared by all cameras */
    struct gvcam_clock clock;
    struct gvcam_image image;
    struct gvcam_send send;
    struct gvcam_expose expose;
    struct gvcam_reg reg;
    struct gvcam_control control;
};

/* LineStatusAll. */
static inline uint32_t gvcam_lines(const struct cap_gvcam *c)
{
    return c->link->line_level | (uint32_t)c->fault.inputs;
}
static inline bool gvcam_chance(struct cap_gvcam *c, double share)
{
    return share > 0 && pvx_uniform(&c->rng) < share;
}
static inline float gvcam_float(const struct cap_gvcam *c, enum gvcam_feature f)
{
    float v;
    memcpy(&v, &c->reg.v[f], sizeof v);
    return v;
}

/* gvcam.c: a camera without a network, which can already answer commands (fuzz target). */
PVX_MUST_CHECK pvx_err gvcam_build(struct gvcam_link *link, const struct cap_gvcam_config *config,
                                   struct cap_gvcam **out);
void gvcam_destroy(struct cap_gvcam *c);
#endif
