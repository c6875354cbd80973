/* troubles.c - what each count means for the user, and the remedy. */
#include "capture/rig/capture.h"

const struct cap_trouble_def cap_trouble_defs[CAP_N_COUNT] = {
    [CAP_INCOMPLETE] = {"frames arrive incomplete",
                        "data is lost between camera and host: check cable and switch, set a delay "
                        "between packets, raise the receive buffers (pyrovox doctor)"},
    [CAP_BAD_SIZE] = {"frames of another size are left out",
                      "set the camera's region to the rig's image size"},
    [CAP_BAD_FORMAT] = {"frames of another pixel format are left out",
                        "set pixel_format to the format that the camera sends"},
    [CAP_CLOCK_STUCK] =
        {"its time stamps do not change, its frames are left out",
         "the camera has frozen or repeats a picture. It is used again when its time "
         "stamps change; if they do not, switch it off and on"},
    [CAP_UNDERRUN] =
        {"no buffer was free for its frames",
         "frames arrive faster than the solver takes them: raise buffers, lower fps, or give the "
         "solver less work"},
    [CAP_LATE] = {"frames arrive after their set was closed",
                  "raise sync.max_wait_ms, or find out what delays this camera"},
    [CAP_ID_GAP] = {"frames that it numbered never arrived",
                    "they were lost in the camera, on the way or in the driver: check the link's "
                    "load (pyrovox doctor)"},
    [CAP_NO_TRIGGER] = {"it answers, but no pulse arrives on its trigger line",
                        "start the pulse generator; if it runs, check the cable, trigger_line and "
                        "TriggerActivation"},
    [CAP_CLOCK_JUMP] = {"its clock jumped",
                        "the camera was restarted or its clock was set; its time is mapped again"},
    [CAP_SLIP] = {"its frame numbers and times disagree",
                  "its pictures may belong to the exposure before or after. If it happens again, "
                  "check for a bouncing trigger signal and restart the camera"},
    [CAP_MISSED_TRIGGER] =
        {"it misses exposures",
         "exposure and readout must end before the next exposure begins; if a line triggers it, "
         "check that line"},
    [CAP_TRIGGER_MODE] = {"its trigger mode is not the one that was set",
                          "find out what else changes the camera: another program, a user set, a "
                          "button; the key `trigger` names the trigger that it should use"},
    [CAP_OUT_OF_STEP] = {"it is out of step",
                         "check whether it runs freely while the others are triggered, whether its "
                         "cable is in, and whether it has the others' clock"},
    [CAP_PHASE_WALK] =
        {"it runs freely",
         "give it the others' trigger (trigger: software, line or action) or clock (ptp)"},
    [CAP_RATE] = {"its frame rate is wrong",
                  "fps, the camera's own rate and the trigger's must be the same, and the exposure "
                  "must fit into it; check whether it runs freely while the others are triggered"},
    [CAP_BANDWIDTH] = {"it sends incomplete frames together with others",
                       "the link they share is at its limit: lower fps or image size, set a "
                       "delay between packets (gige.packet_delay_ns), use jumbo frames"},
    [CAP_PTP_MASTERS] =
        {"it is a PTP master, and so is another camera",
         "their clocks differ: let PTP's messages (224.0.1.129, UDP 319 and 320) pass between all "
         "cameras, in one PTP domain, or give all of them one master (capture/SYNC.md)"},
};
