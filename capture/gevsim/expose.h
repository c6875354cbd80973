/* expose.h - when a frame is exposed, and its content. */
#ifndef CAP_GVCAM_EXPOSE_H
#define CAP_GVCAM_EXPOSE_H
#include "capture/gevsim/gvcam.h"
#include "capture/wire/gvcp.h"

#define GVCAM_ACTIONS 16 /* scheduled actions that wait */

struct gvcam_expose {
    bool acquiring;
    uint64_t id;
    int64_t tick; /* number of the last free-run tick */
    double tick_rate;
    int64_t last_moment;                  /* host ns of the last frame */
    int64_t busy_until;                   /* exposure */
    int64_t trigger_at;                   /* delayed trigger; GVCAM_NEVER = none */
    uint32_t frames_left;                 /* single, multi */
    uint32_t frame_count;                 /* since the start */
    int64_t past[CAP_GVCAM_LATE_MAX + 1]; /* image of frame n, at n modulo the length */
    bool frozen, held;                    /* the stamp is frozen; the image is held */
    int64_t held_index;
    uint64_t frozen_ticks;
    int64_t action[GVCAM_ACTIONS]; /* device ns */
    size_t n_actions;
};
enum gvcam_trigger { GVCAM_SOFTWARE, GVCAM_LINE1, GVCAM_ACTION1 };
void gvcam_expose_start(struct cap_gvcam *c, int64_t now);
void gvcam_expose_stop(struct cap_gvcam *c);
void gvcam_expose_restart_ids(struct cap_gvcam *c, uint64_t first); /* 0 = 1 */
int64_t gvcam_expose_step(struct cap_gvcam *c, int64_t now); /* when it wants to be called next */
double gvcam_expose_rate(const struct cap_gvcam *c);         /* free run, frames per second */
void gvcam_trigger(struct cap_gvcam *c, enum gvcam_trigger source, int64_t at);
/* An action command that may be for this camera.  Returns enum cap_gvcp_status. */
uint16_t gvcam_action(struct cap_gvcam *c, const struct cap_gvcp_action *a, int64_t now);
#endif
