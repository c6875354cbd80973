/* link.h - shared by the cameras of one simulation: the switch, the trigger line, the scene. */
#ifndef CAP_GVCAM_LINK_H
#define CAP_GVCAM_LINK_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct gvcam_link {
    double bytes_per_ns; /* 0 = no limit */
    size_t buffer;
    double level; /* bytes in the buffer */
    int64_t at;   /* time of that level */
    int64_t silent_until;
    uint32_t line_level;
    int64_t shown; /* 1 + image that all cameras show; 0: the image of the instant */
};
bool gvcam_link_silent(const struct gvcam_link *l, int64_t now);
/* Whether a packet of this many bytes may go out.  If not, adds one to *cut. */
bool gvcam_link_pass(struct gvcam_link *l, size_t bytes, int64_t now, uint64_t *cut);
#endif
