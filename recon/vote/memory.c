/* memory.c - the state that a vote keeps from earlier sets. */
#include <string.h>

#include "recon/vote/impl.h"

#define FROZEN 3   /* repeats of the same picture in a row */
#define LIT    8   /* lit bins; with fewer, an equal picture may be chance */
#define WORSE  0.5 /* of REC_VOTE_ALONE: after such a rise of R every camera is tested again */

/* FNV-1a over the places and values of the lit bins: depends on the camera's own picture alone. */
static uint64_t checksum(const rec_vote *v, size_t c)
{
    uint64_t sum = 14695981039346656037u;
    for (size_t i = v->level->row0[c]; i < v->level->row0[c + 1]; i++) {
        uint32_t value;
        if (!v->lit[i] || v->chord[i] <= 0)
            continue;
        memcpy(&value, &v->b[i], sizeof value);
        sum = (sum ^ value ^ (uint64_t)i << 32) * 1099511628211u;
    }
    return sum;
}

uint64_t rec_vote_frozen(rec_vote *v)
{
    uint64_t equal = 0, frozen = 0;
    int n = 0, moved = 0;
    for (size_t c = 0; c < v->cameras; c++) {
        if (!v->set->present[c])
            continue;
        uint64_t sum = checksum(v, c);
        bool same = sum == v->picture[c] && v->of[c].lit >= LIT;
        v->picture[c] = sum;
        equal |= (uint64_t)same << c;
        moved += !same;
        n++;
    }
    for (size_t c = 0; c < v->cameras; c++) {
        if (!v->set->present[c])
            continue;
        if (!rec_vote_has(equal, c))
            v->same[c] = 0;
        else if (2 * moved > n && v->same[c] < FROZEN)
            v->same[c]++;
        frozen |= (uint64_t)(v->same[c] == FROZEN) << c;
    }
    return frozen;
}

/* Every camera is tested in each (hold / 3)th set. */
bool rec_vote_may_wait(const rec_vote *v, double r)
{
    return v->waited + 1 < v->hold / 3 && r <= v->usual + WORSE * REC_VOTE_ALONE;
}

/* A camera that went out is back after `hold` sets in which it agrees.  The sets between two tests count too. */
static void come_and_go(rec_vote *v, const struct rec_verdict *o)
{
    bool judged = o->state >= REC_VOTE_AGREE;
    for (size_t c = 0; c < v->cameras; c++) {
        uint64_t bit = (uint64_t)1 << c;
        if (rec_vote_has(o->out, c)) {
            v->out |= bit;
            v->why[c] = o->why[c];
            v->cost[c] = o->cost[c];
            v->agreed[c] = 0;
        } else if (rec_vote_has(v->out, c) && judged && v->set->present[c]) {
            bool agrees = o->state != REC_VOTE_TORN && rec_vote_has(v->agree, c);
            v->agreed[c] = !agrees ? 0 : v->agreed[c] == 0 ? 1 : v->agreed[c] + v->waited + 1;
            if (v->agreed[c] >= v->hold)
                v->out &= ~bit;
        }
    }
}

void rec_vote_remember(rec_vote *v, struct rec_verdict *o, bool asked)
{
    if (asked)
        come_and_go(v, o);
    if (o->state >= REC_VOTE_AGREE) {
        if (asked)
            v->waited = 0;
        else if (v->waited < v->hold / 3)
            v->waited++;
        v->state = o->state == REC_VOTE_TORN ? REC_VOTE_TORN : REC_VOTE_AGREE;
    }
    for (size_t c = 0; c < v->cameras; c++)
        if (rec_vote_has(v->out, c) && v->set->present[c] && !rec_vote_has(o->out, c)) {
            o->out |= (uint64_t)1 << c;
            o->why[c] = v->why[c];
            o->cost[c] = asked ? o->cost[c] : v->cost[c];
        }
    if (o->state == REC_VOTE_AGREE && o->out != 0)
        o->state = REC_VOTE_OUT;
}
