/* take_notes.h - what a take is not as it was recorded, on stderr, a line each. */
#ifndef TAKE_NOTES_H
#define TAKE_NOTES_H
#include "capture/take/take.h"

void take_notes(const cap_take *t);
#endif
