/* render_options.h - the command line of `pyrovox render`. */
#ifndef RENDER_OPTIONS_H
#define RENDER_OPTIONS_H
#include <stdbool.h>
#include <stdint.h>
#include "daemon/cli/pictures/look.h"

enum render_from {
    RENDER_NOTHING,
    RENDER_CAMERA,
    RENDER_EYE,
    RENDER_ANGLE,
    RENDER_STRIP,
    RENDER_ORBIT
};

struct render_options {
    const char *rig;
    enum render_from from;
    const char *camera;                       /* RENDER_CAMERA */
    double eye[3], target[3], up[3], fov_deg; /* RENDER_EYE */
    bool target_given;                        /* else the middle of the volume */
    double deg0, deg1;                        /* RENDER_ANGLE, RENDER_STRIP */
    int views;                                /* RENDER_STRIP, RENDER_ORBIT */
    int rounds;                               /* RENDER_ORBIT; 0: until every volume was shown */
    int32_t width, height;                    /* 0 = not given */
    int sub;                                  /* rays per pixel side */
    int fps;                                  /* of a film */
    struct look look;
    enum render_format { RENDER_PNG, RENDER_NPY, RENDER_BOTH } format; /* in a folder */
    bool anew; /* trace every picture's rays anew */
    bool quiet;
    unsigned threads;
    char **source; /* volumes and folders of volumes */
    int n_sources;
    const char *out; /* file or folder */
    bool film;       /* an animation in one file */
};

/* Exits on wrong usage and on --help.  Borrows argv. */
void render_parse(int argc, char **argv, struct render_options *o);

#endif
