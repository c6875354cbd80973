/* take_notes.h - print on stderr what is missing or damaged in a take, a line each. */
#ifndef TAKE_NOTES_H
#define TAKE_NOTES_H
#include "capture/take/take.h"

void take_notes(const cap_take *t);
#endif
