#include "recon/vote/wrong.h"

static const struct {
    const char *name, *remedy;
} list[REC_N_WRONG] = {
    [REC_WRONG_NOTHING] = {"", ""},
    [REC_WRONG_DARK] = {"dark", "take the cap off the lens, look at its exposure and its cable"},
    [REC_WRONG_FLOODED] = {"flooded", "shade the lens, or close it and shorten the exposure"},
    [REC_WRONG_MOVED] = {"moved", "calibrate it again: pyrovox calibrate live --keep --recover"},
    [REC_WRONG_MIRRORED] = {"mirrored", "switch its mirroring (ReverseX, ReverseY) off"},
    [REC_WRONG_LATE] = {"late", "look at its trigger and its clock: pyrovox cameras test"},
    [REC_WRONG_BLURRED] = {"blurred", "focus it and clean the lens"},
    [REC_WRONG_GAIN] = {"gain", "look at exposure, gain and filter: pyrovox calibrate gain"},
    [REC_WRONG_DISAGREES] = {"disagrees", "compare it with the others: pyrovox calibrate check"},
};

const char *rec_wrong_name(enum rec_wrong w)
{
    return list[w].name;
}

const char *rec_wrong_remedy(enum rec_wrong w)
{
    return list[w].remedy;
}
