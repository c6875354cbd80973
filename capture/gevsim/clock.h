/* clock.h - a simulated camera's clock: its own oscillator, dev0 + (t - host0)(1 + drift), or PTP. */
#ifndef CAP_GVCAM_CLOCK_H
#define CAP_GVCAM_CLOCK_H
#include "capture/gevsim/gvcam.h"

struct gvcam_clock {
    uint64_t tick_hz; /* without PTP */
    int64_t settle_ns, tai_ns;
    uint32_t seed; /* of a slave's wander */
    int64_t host0, dev0;
    double drift_ppm, skew_us;
    bool stuck;
    int64_t stuck_ns;
    bool no_ptp_master, ptp_master;
    double ptp_offset_us;
    int64_t ptp_since; /* host time of PtpEnable; 0 = off */
    bool ptp_locked;   /* was Slave at the last look */
};
enum gvcam_ptp {
    GVCAM_PTP_INITIALIZING = 1,
    GVCAM_PTP_DISABLED = 3,
    GVCAM_PTP_LISTENING = 4,
    GVCAM_PTP_MASTER = 6,
    GVCAM_PTP_UNCALIBRATED = 8,
    GVCAM_PTP_SLAVE = 9
};
/* Start as after power-up; faults stay. */
void gvcam_clock_start(struct gvcam_clock *k, const struct cap_gvcam_config *c, int64_t now);
int64_t gvcam_clock_ns(struct gvcam_clock *k, int64_t now); /* device time */
uint64_t gvcam_clock_ticks(const struct gvcam_clock *k, int64_t dev_ns);
uint64_t gvcam_clock_hz(const struct gvcam_clock *k);
void gvcam_clock_faults(struct gvcam_clock *k, const struct cap_gvcam_fault *f, int64_t now);
void gvcam_clock_jump(struct gvcam_clock *k, int64_t now, int64_t ns);
bool gvcam_clock_reset(struct gvcam_clock *k, int64_t now); /* to 0; false: PTP holds it */
void gvcam_ptp_enable(struct gvcam_clock *k, int64_t now, bool on);
enum gvcam_ptp gvcam_ptp_status(const struct gvcam_clock *k, int64_t now);
int64_t gvcam_ptp_offset_ns(struct gvcam_clock *k, int64_t now); /* camera - master */
#endif
