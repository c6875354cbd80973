/* take.h - what stands at the front of a test's take. */
#ifndef TESTS_TAKE_H
#define TESTS_TAKE_H
#include "capture/take/take.h"

static inline struct cap_take_head take_head(const struct cap_take_camera *camera, uint32_t n)
{
    return (struct cap_take_head){.rig = "rig",
                                  .config = "config",
                                  .software = "test",
                                  .host = "",
                                  .base = "/",
                                  .t_created_ns = 1,
                                  .fps = 20,
                                  .n_cameras = n,
                                  .camera = camera};
}
#endif
