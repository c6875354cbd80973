/* belong.h - whether pictures and rig belong together (recon/check/plausible.h), as the running daemon found it last.
 * Threads: pure. */
#ifndef DMN_BELONG_H
#define DMN_BELONG_H
#include "daemon/control/json.h"
#include "recon/check/plausible.h"

/* What a daemon was asked to do beside its frame sets: a background, a check. */
enum dmn_taking { DMN_TAKING_NONE, DMN_TAKING_NOW, DMN_TAKING_DONE, DMN_TAKING_FAILED };
extern const char *const dmn_taking_names[];

struct dmn_belong {
    uint64_t judged;                      /* times, of sets with flame */
    uint64_t set;                         /* the last one of the last time */
    struct rec_plausible_verdict verdict; /* of the last time */
};

/* `pyrovox ctl check` */
struct dmn_check_request {
    unsigned request; /* number of the last one; 0: there was none */
    enum dmn_taking state;
    struct pvx_diag why;     /* FAILED */
    struct dmn_belong found; /* DONE */
    size_t n_cameras;
    char camera[REC_MAX_CAMERAS][REC_NAME_MAX];
};

/* Members of the object that is open: "judged", "set", "good", "cause", "cameras", "text", "next" and figures. */
void dmn_belong_json(struct dmn_json *j, const struct dmn_belong *b,
                     const char (*camera)[REC_NAME_MAX], size_t n_cameras);

#endif
