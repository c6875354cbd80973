/* test_sources.c - what the configuration says about cameras arrives at capture. */
#include "../t.h"

#include "capture/rig/capture.h"
#include "daemon/pipeline/sources.h"

static struct dmn_config c;
static struct dmn_sources s;
static struct rec_rig rig;
static struct rec_camera camera[2];
static struct pvx_diag d;

static pvx_err read_config(const char *text)
{
    d.text[0] = '\0';
    pvx_err e = dmn_config_parse(text, strlen(text), "test.yaml", &c, &d);
    return e == PVX_OK ? dmn_sources_init(&s, &c, &rig, NULL, &d) : e;
}

T_CASE(defaults)
{
    T_EQ_I(read_config("rig: r\ncameras: \"aravis:127.0.0.2+\"\n"), PVX_OK);
    T_EQ_S(d.text, "");
    const struct cap_source_config *k = &s.source[1];
    T_EQ_S(k->uri, "aravis:127.0.0.3");
    T_EQ_S(k->name, "cam1");
    T_EQ_I(k->trigger, CAP_TRIGGER_FREE_RUN);
    T_EQ_I(s.capture.trigger, CAP_TRIGGER_FREE_RUN);
    T_OK(!k->ptp && !k->chunks && !k->gige.no_packet_socket);
    T_EQ_I(k->n_features, 0);
    T_EQ_I(k->gige.resend, CAP_RESEND_AUTO);
    T_EQ_I(k->gige.packet_size, 0);
    T_EQ_I(k->gige.socket_buffer, 8 << 20);
    T_EQ_I(k->gige.rt_priority, 10);
    T_NEAR(k->gige.frame_retention_ms, 50, 0);
}

T_CASE(network_and_triggers)
{
    T_EQ_I(read_config("rig: r\ncameras: \"aravis:127.0.0.2+\"\ntrigger: action\nptp: true\n"
                       "ptp_offset_us: 2.5\nchunks: true\ntrigger_line: Line4\n"
                       "action: {device_key: 51966, group_key: 2, group_mask: 4294967295, "
                       "addresses: [127.255.255.255, 10.0.0.1], lead_ms: 12.5, "
                       "acknowledge: false}\n"
                       "gige: {packet_size: 8000, packet_delay_ns: 700, resend: never, "
                       "socket_buffer: 65536, frame_retention_ms: 20, packet_timeout_ms: 3, "
                       "rt_priority: 0, packet_socket: false}\n"),
           PVX_OK);
    T_EQ_S(d.text, "");
    const struct cap_source_config *k = &s.source[0];
    T_EQ_I(k->trigger, CAP_TRIGGER_ACTION);
    T_EQ_S(k->trigger_line, "Line4");
    T_OK(k->ptp && k->chunks && k->gige.no_packet_socket);
    T_NEAR(k->ptp_offset_us, 2.5, 0);
    T_EQ_I(k->gige.packet_size, 8000);
    T_EQ_I(k->gige.packet_delay, 700);
    T_EQ_I(k->gige.resend, CAP_RESEND_NEVER);
    T_EQ_I(k->gige.socket_buffer, 65536);
    T_EQ_I(k->gige.rt_priority, -1);
    T_NEAR(k->gige.frame_retention_ms, 20, 0);
    T_NEAR(k->gige.packet_timeout_ms, 3, 0);
    const struct cap_action_config *a = &s.capture.action;
    T_EQ_I(s.capture.trigger, CAP_TRIGGER_ACTION);
    T_EQ_I(a->keys.device_key, 51966);
    T_EQ_I(a->keys.group_key, 2);
    T_EQ_I(a->keys.group_mask, 4294967295u);
    T_EQ_I(a->n_addresses, 2);
    T_EQ_I(a->address[0], 0x7FFFFFFF);
    T_EQ_I(a->address[1], 0x0A000001);
    T_EQ_I(a->lead_ns, 12500000);
    T_OK(!a->acknowledge);
    T_OK(
        read_config("rig: r\ncameras: \"aravis:127.0.0.2+\"\naction: {addresses: [elsewhere]}\n") ==
        PVX_EINVAL);
    T_CONTAINS(d.text, "action.addresses: 'elsewhere' is not an IPv4 address");
}

#define RING "rig: r\nrecord: {ring: {seconds: 5, memory: 8GB}}\n"
T_CASE(lines_of_the_cameras_that_triggers_name)
{
    T_EQ_I(read_config(RING "cameras: \"aravis:127.0.0.2+\"\n"
                            "triggers: [{name: a, when: line, camera: cam1, line: 2}]\n"),
           PVX_OK);
    T_OK(!s.source[0].lines && s.source[1].lines);
    T_EQ_I(read_config(RING "cameras: \"aravis:127.0.0.2+\"\n"
                            "triggers: [{name: a, when: line, camera: cam7, line: 2}]\n"),
           PVX_EINVAL);
    T_CONTAINS(d.text, "triggers: a: there is no camera 'cam7': name one of the rig");
    T_EQ_I(read_config(RING "cameras: {cam0: \"aravis:127.0.0.2\", cam1: \"sim:\"}\n"
                            "triggers: [{name: a, when: line, camera: cam1, line: 2}]\n"),
           PVX_EINVAL);
    T_CONTAINS(d.text, "triggers: a: cam1 is 'sim:', and only aravis: cameras");
}

T_CASE(features_for_all_and_for_one)
{
    T_EQ_I(read_config("rig: r\ncameras: \"aravis:127.0.0.2+\"\n"
                       "features: {GainAuto: 'Off'}\n"
                       "camera_features: {cam1.TriggerDelay: '3', cam1.Gain: '6'}\n"),
           PVX_OK);
    T_EQ_I(s.source[0].n_features, 1);
    T_EQ_S(s.source[0].features[0].name, "GainAuto");
    T_EQ_I(s.source[1].n_features, 3);
    T_EQ_S(s.source[1].features[0].name, "GainAuto");
    T_EQ_S(s.source[1].features[1].name, "TriggerDelay");
    T_EQ_S(s.source[1].features[1].value, "3");
    T_EQ_S(s.source[1].features[2].name, "Gain");
    T_OK(read_config("rig: r\ncameras: \"aravis:127.0.0.2+\"\n"
                     "camera_features: {cam7.Gain: '6'}\n") == PVX_EINVAL);
    T_CONTAINS(d.text, "camera_features.cam7.Gain");
}

int main(void)
{
    for (int i = 0; i < 2; i++) {
        snprintf(camera[i].name, sizeof camera[i].name, "cam%d", i);
        camera[i].width = 64;
        camera[i].height = 48;
    }
    rig.cameras = camera;
    rig.n_cameras = 2;
    return t_run();
}
