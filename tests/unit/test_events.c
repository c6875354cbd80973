/* What has happened, as told by one look after another. */
#include <string.h>

#include "base/clock.h"
#include "daemon/pipeline/events.h"
#include "tests/t.h"

static struct dmn_events events;
static struct dmn_state state;
static char said[8192];
static int n_said;
static int64_t mono;

static void say(void *ctx, const char *json)
{
    (void)ctx;
    n_said++;
    snprintf(said + strlen(said), sizeof said - strlen(said), "%s\n", json);
}

/* Another look, 200 ms later; how many events it gave. */
static int look(void)
{
    said[0] = '\0';
    n_said = 0;
    mono += 200 * PVX_NS_PER_MS;
    dmn_events_look(&events, &state, 1767225600123456789, mono,
                    &(struct dmn_events_listener){say, NULL});
    return n_said;
}

static void begin(void)
{
    memset(&events, 0, sizeof events);
    memset(&state, 0, sizeof state);
    state.n_cameras = 3;
    for (size_t c = 0; c < 3; c++) {
        snprintf(state.camera[c], sizeof state.camera[c], "cam%zu", c);
        state.capture.camera[c].state = CAP_OPENING;
    }
    T_EQ_I(look(), 0);
    for (size_t c = 0; c < 3; c++)
        state.capture.camera[c].state = CAP_RUNNING;
    T_EQ_I(look(), 0); /* that they come up is none */
}

T_CASE(a_camera_goes_and_comes)
{
    begin();
    state.capture.camera[1].state = CAP_LOST;
    snprintf(state.capture.camera[1].error, 256, "unplugged \"here\"");
    T_EQ_I(look(), 1);
    T_EQ_S(said, "{\"version\":1,\"time_ns\":1767225600123456789,\"kind\":\"camera_lost\","
                 "\"camera\":\"cam1\",\"why\":\"unplugged \\\"here\\\"\"}\n");
    T_EQ_I(look(), 0);
    state.capture.camera[1].state = CAP_OPENING;
    T_EQ_I(look(), 0);
    state.capture.camera[1].state = CAP_RUNNING;
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"camera_back\",\"camera\":\"cam1\"}");
}

T_CASE(a_camera_is_voted_out)
{
    begin();
    state.votes.out = 4;
    state.votes.why[2] = REC_WRONG_MOVED;
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"camera_voted_out\",\"camera\":\"cam2\",\"why\":");
    T_EQ_I(look(), 0);
    state.votes.out = 1;
    T_EQ_I(look(), 2);
    T_CONTAINS(said, "\"camera_believed\",\"camera\":\"cam2\"");
    T_CONTAINS(said, "\"camera_voted_out\",\"camera\":\"cam0\"");
}

T_CASE(a_recording_begins_and_ends)
{
    begin();
    state.record.state = CAP_REC_RUNNING;
    snprintf(state.record.path, sizeof state.record.path, "a.h5");
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"recording_begun\",\"path\":\"a.h5\"");
    snprintf(state.record.path, sizeof state.record.path, "b.h5"); /* within a look */
    T_EQ_I(look(), 2);
    T_CONTAINS(said, "\"recording_ended\",\"path\":\"a.h5\"");
    T_CONTAINS(said, "\"recording_begun\",\"path\":\"b.h5\"");
    state.record.state = CAP_REC_IDLE;
    state.record.sets = 17;
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"recording_ended\",\"path\":\"b.h5\",\"what\":\"raw\",\"sets\":17");
    state.record.state = CAP_REC_RUNNING;
    T_EQ_I(look(), 1);
    state.record.state = CAP_REC_FAILED;
    snprintf(state.record.error, sizeof state.record.error,
             "b.h5: the disk is full: 3 MB are left, 100 stay free");
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"disk_full\",\"path\":\"b.h5\"");
}

T_CASE(the_recorder_beside_dies_and_is_begun_again)
{
    begin();
    state.volumes.running = true;
    snprintf(state.volumes.path, sizeof state.volumes.path, "v.h5");
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"recording_begun\",\"path\":\"v.h5\",\"what\":\"volumes\"");
    state.volumes.running = false;
    state.volumes.failed = true;
    state.volumes.written = 5;
    snprintf(state.volumes.error, sizeof state.volumes.error, "ended by signal 9");
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"recording_ended\",\"path\":\"v.h5\",\"what\":\"volumes\",\"sets\":5");
    T_CONTAINS(said, "\"why\":\"ended by signal 9\"");
    state.volumes.running = true;
    snprintf(state.volumes.path, sizeof state.volumes.path, "v-2.h5");
    T_EQ_I(look(), 1);
    T_CONTAINS(said, "\"path\":\"v-2.h5\"");
}

T_CASE(what_there_is_much_of)
{
    begin();
    int all = 0;
    for (int i = 0; i < 50; i++) { /* ten seconds of a stranger at the door, and of drops */
        state.connections_refused += 20;
        state.dropped[DMN_DROP_SOLVE] += i < 25 ? 2 : 0;
        all += look();
    }
    T_LE(all, 10 + 6);
    T_LE(9 + 4, all);
    state.dropped[DMN_DROP_STALE] += DMN_EVENTS_DROPS - 1; /* no burst */
    for (int i = 0; i < 6; i++)
        T_OK(look() == 0 || strstr(said, "drops") == NULL);
}
