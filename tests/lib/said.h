/* said.h - what a listener of votes.h was told, for tests of who tells it. */
#ifndef TESTS_SAID_H
#define TESTS_SAID_H
#include <stdio.h>
#include <string.h>

#include "daemon/control/votes.h"

static char said[4096]; /* a sentence a line, until it is emptied */
static int bad_ones;

static void say(void *ctx, bool bad, const struct pvx_about *about, const char *sentence)
{
    (void)ctx;
    (void)about;
    bad_ones += bad;
    size_t n = strlen(said);
    snprintf(said + n, sizeof said - n, "%s\n", sentence);
}

static const struct dmn_votes_listener listener = {say, NULL};

#endif
