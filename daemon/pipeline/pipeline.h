/* pipeline.h - frame sets in, volumes out; live and offline differ in source and sink only.
 *
 *     source -> [carve] -> queue -> [solve] -> queue -> [sink]
 *     carve = photometry + hull + restricted system; each [stage] is a thread of its own and shares
 *     one pool of workers for its loops
 *
 * While set k is solved, k+1 is carved and k-1 goes out.  A slot holds the data of one frame set and is used again
 * after it; work areas belong to the stages, and restricted systems circulate between carve and solve.  Sets come out
 * in the order of the source.  Once started, it allocates nothing.
 * Live: newest wins - a full queue gives up its oldest set, counted by cause.
 * Lossless: a full queue holds the stage before it, back to the source, and every set reaches the sink,
 * also one that could not be solved.
 * Threads: new/start/join/free from one thread, the rest from any. */
#ifndef DMN_PIPELINE_H
#define DMN_PIPELINE_H
#include "daemon/control/state.h"
#include "daemon/pipeline/deadline.h"
#include "recon/frame/bars.h"
#include "recon/solve/average.h"

/* The machine may do something else for a moment, whose length does not depend on the cameras' rate.  Sets that come
 * within DMN_HICCUP_NS wait for the solver, DMN_WAITING_MAX at most, and are not stale.  The solver then takes half a
 * period for each (deadline.h). */
#define DMN_HICCUP_NS   (60 * PVX_NS_PER_MS)
#define DMN_WAITING_MAX 3
/* One being carved, some waiting and one in the solver, one waiting and one in the sink, and one more so
 * that carve never waits for a slot while older sets could be given up. */
#define DMN_N_SLOTS (5 + DMN_WAITING_MAX)
/* Lossless gives up no set: one slot in each stage keeps all three at work, and one waits for the slowest. */
#define DMN_N_SLOTS_LOSSLESS 4
/* Restricted systems: of the set that is carved, of those that wait for the solver and of the one in it.  Lossless,
 * none but the next waits: it is carved while this one is solved. */
#define DMN_N_SYSTEMS          (2 + DMN_WAITING_MAX)
#define DMN_N_SYSTEMS_LOSSLESS 2
/* One more of each with live error bars, for the set that is solved once more (draws.h). */
#define DMN_N_AGAIN 1

/* One frame set on its way; the stage that holds the pointer owns it. */
struct dmn_slot {
    rec_frame *frame;
    uint64_t set; /* its number */
    int64_t t_exposure_ns, spread_ns;
    int64_t t_last_mono_ns; /* when its last frame came */
    int64_t bin_ns;         /* time to make pixels of its images */
    uint64_t passed_over;   /* sets that were too old when this one was taken instead */
    uint32_t n_present;     /* cameras, and their bits: */
    uint64_t mask;
    enum dmn_drop why;         /* DMN_N_DROP, or why there is no volume of it */
    struct pvx_diag problem;   /* the first problem of its images, "" = none */
    struct rec_bars_view bars; /* error bars of its volume; sd NULL: none */
    bool again;                /* it will be solved once more (draws.h), */
    unsigned age;              /* by settings of this age */
};

/* Where sets come from; called by the carve stage. */
struct dmn_source {
    /* Fill s with the next set: all but `frame`, whose inputs get the pixels, and `why`, which becomes
     * DMN_DROP_IMAGES when too few can be used.  PVX_ETIMEDOUT: none within DMN_STAGE_WAIT_NS;
     * PVX_ECLOSED: there will be none. */
    pvx_err (*next)(void *ctx, struct dmn_slot *s);
    void *ctx;
};

/* Where volumes go to; called by the last stage. */
struct dmn_sink {
    const char *name;                                 /* the stage's */
    bool (*put)(void *ctx, const struct dmn_slot *s); /* false: it did not go out */
    void (*tick)(void *ctx); /* after each set, and while there is none; or NULL */
    void (*end)(void *ctx);  /* after the last; or NULL */
    void *ctx;
};

struct dmn_pipeline_params { /* all pointers borrowed */
    const rec_sysmat *S;
    const struct rec_rig *rig;
    pvx_pool *pool;
    struct rec_frame_params frame;
    rec_average *average; /* corrections of the cameras for all sets; NULL: each set by itself */
    float *const *background; /* [cameras] as for rec_carver_background, copied; or NULL */
    bool lossless, warm;      /* warm: a solve starts from the volume before */
    uint32_t bars; /* solves for the error bars of each volume, by the solve stage; 0: none */
    bool draws;    /* error bars by draws.h; not with lossless, and only by the default solver */
    int64_t period_ns; /* of the sets, for draws */
    size_t waiting;    /* sets before the solver, 1..DMN_WAITING_MAX; 0 is 1 */
    struct dmn_deadline
        deadline; /* counts from the set's last frame; lossless, from the solve's begin */
    struct dmn_source source;
    struct dmn_sink sink;
    void (*carved)(void *ctx,
                   const struct dmn_slot *s); /* looks at a set after its hull; or NULL */
    void *carved_ctx;
};

/* What may change while it runs. */
struct dmn_tuning {
    struct rec_photo_params photo;
    struct rec_solve_params solve; /* all except the method */
    bool warm;
    int64_t limit_ns, period_ns; /* of the deadline */
};

typedef struct dmn_pipeline dmn_pipeline;
/* Errors: those of rec_carver_new and rec_frame_new, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_pipeline_new(const struct dmn_pipeline_params *params,
                                        dmn_pipeline **out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err dmn_pipeline_start(dmn_pipeline *p, struct pvx_diag *d);
/* The source has ended and every set is out. */
bool dmn_pipeline_finished(dmn_pipeline *p);
/* Waits until then; also after a start that failed half-way. */
void dmn_pipeline_join(dmn_pipeline *p);
void dmn_pipeline_free(dmn_pipeline **p);

/* Exchanges a camera's background from the next set on (rec_carver_exchange_background).  Call only from the source's
 * `next`. */
void dmn_pipeline_background(dmn_pipeline *p, size_t camera, float **bg);

/* Each stage takes the tuning before its next set, and never waits for it.  Any thread. */
void dmn_pipeline_tune(dmn_pipeline *p, const struct dmn_tuning *t);

/* Fills produced, published, inside, dropped and the stages of out. */
void dmn_pipeline_counts(dmn_pipeline *p, struct dmn_state *out);
/* Where sets were solved. */
void dmn_pipeline_compute(dmn_pipeline *p, struct dmn_compute_state *out);
/* Of the solves for live error bars. */
void dmn_pipeline_draws(dmn_pipeline *p, struct dmn_draws_state *out);
/* How long the solver has waited for sets, since its first. */
int64_t dmn_pipeline_waited_ns(dmn_pipeline *p);
/* Longest time since a stage's last heartbeat, ns. */
int64_t dmn_pipeline_stuck_ns(dmn_pipeline *p);
#endif
