/* source.h - a camera's settings, but for what a test is about. */
#ifndef TESTS_SOURCE_H
#define TESTS_SOURCE_H
#include "capture/source/source.h"

/* Exposure and gain as they are, eight buffers, named cam0. */
static inline struct cap_source_config source_of(const char *uri, int32_t w, int32_t h,
                                                 enum cap_pixfmt fmt, double fps)
{
    return (struct cap_source_config){.uri = uri,
                                      .name = "cam0",
                                      .width = w,
                                      .height = h,
                                      .fmt = fmt,
                                      .fps = fps,
                                      .buffers = 8,
                                      .exposure_us = -1,
                                      .gain = -1};
}
#endif
