/* troubles.c - what each count means for the user, and the remedy. */
#include "capture/rig/capture.h"

const struct cap_trouble_def cap_trouble_defs[CAP_N_COUNT] = {
    [CAP_INCOMPLETE] = {"frames arrive incomplete",
                        "data is lost on the way: check cable and switch, let the camera pause "
                        "between packets, raise the receive buffers (pyrovox doctor)"},
    [CAP_BAD_SIZE] = {"frames of another size are left out",
                      "the camera's region must be the rig's image size"},
    [CAP_BAD_FORMAT] = {"frames of another pixel format are left out", "set pixel_format"},
    [CAP_CLOCK_STUCK] = {"its time stands still, its frames are left out",
                         "the camera has frozen or repeats a picture: it is used again as soon as "
                         "its stamps move; switch it off and on if they do not"},
    [CAP_UNDERRUN] =
        {"no buffer was free for its frames",
         "they come faster than the solver uses them: raise buffers, lower fps, or give the "
         "solver less work"},
    [CAP_LATE] = {"frames come after their set was closed",
                  "raise sync.max_wait_ms, or look for what delays this camera"},
    [CAP_ID_GAP] = {"frames that it numbered never came",
                    "they were lost in the camera, on the way or in the driver: check the link's "
                    "load (pyrovox doctor)"},
    [CAP_NO_TRIGGER] = {"it answers, but no pulse comes on its trigger line",
                        "start the pulse generator; if it runs, check the cable, trigger_line and "
                        "TriggerActivation"},
    [CAP_CLOCK_JUMP] = {"its clock jumped",
                        "the camera was restarted or its clock was set; its time is mapped again"},
    [CAP_SLIP] = {"its frame numbers and times disagree",
                  "its pictures may belong to the instant before or after: if it happens again, "
                  "look for bouncing triggers, and restart the camera"},
    [CAP_MISSED_TRIGGER] =
        {"it misses exposures",
         "exposure and readout must end before the next exposure begins; if a line triggers it, "
         "look at that line"},
    [CAP_TRIGGER_MODE] = {"its trigger mode is not the one that was set",
                          "look for what else changes the camera: another program, a user set, a "
                          "button; `trigger` says what it should wait for"},
    [CAP_OUT_OF_STEP] = {"it is out of step",
                         "is it running freely while the others are triggered, without its cable, "
                         "or without the others' clock?"},
    [CAP_PHASE_WALK] =
        {"it runs by itself",
         "give it the others' trigger (trigger: software, line or action) or clock (ptp)"},
    [CAP_RATE] = {"its frame rate is wrong",
                  "fps, the camera's own rate and the trigger's must be the same, and the exposure "
                  "must fit into it; does it run freely while the others are triggered?"},
    [CAP_BANDWIDTH] = {"it sends incomplete frames together with others",
                       "the link they share is at its limit: lower fps or image size, let the "
                       "cameras pause between packets (gige.packet_delay_ns), use jumbo frames"},
    [CAP_PTP_MASTERS] =
        {"it keeps PTP time by itself, and another camera too",
         "their clocks are not one time: let PTP's messages (224.0.1.129, UDP 319 and 320) pass "
         "between all cameras, in one PTP domain, or give all one master (capture/SYNC.md)"},
};
