/* test_config.c - pyrovoxd.yaml: the option table, strict reading, printing back, sources. */
#include "../t.h"

#include <unistd.h>

#include "base/file.h"
#include "capture/pixel/transfer.h"
#include "daemon/config/endpoints.h"
#include "daemon/config/config.h"
#include "tests/lib/scratch.h"

static struct dmn_config c;
static struct pvx_diag d;

static pvx_err parse(const char *text)
{
    d.text[0] = '\0';
    return dmn_config_parse(text, strlen(text), "test.yaml", &c, &d);
}

static void refused(const char *text, const char *says)
{
    T_OK(parse(text) != PVX_OK);
    T_CONTAINS(d.text, says);
}

T_CASE(every_default_is_read_by_the_reader)
{
    /* each default alone as a file: the reader accepts it and gives the defaults again */
    struct dmn_config want;
    dmn_config_defaults(&want);
    for (size_t i = 0; i < dmn_n_options; i++) {
        const struct dmn_option *o = &dmn_options[i];
        char text[400];
        const char *dot = strchr(o->key, '.');
        if (dot != NULL)
            snprintf(text, sizeof text, "%.*s: {%s: %s}\n", (int)(dot - o->key), o->key, dot + 1,
                     o->def);
        else
            snprintf(text, sizeof text, "%s: %s\n", o->key, o->def);
        T_EQ_I(parse(text), PVX_OK);
        T_EQ_S(d.text, "");
        T_OK(memcmp((char *)&c + o->offset, (char *)&want + o->offset, o->size) == 0);
        T_OK(strlen(o->help) > 10);
    }
    T_NEAR(want.fps, 20, 0);
    T_NEAR(want.max_wait_ms, 0, 0);
    T_EQ_I(want.keep_partial, 1);
    T_EQ_I(want.min_views, 2);
    T_EQ_I(want.log_level, 2);
}

T_CASE(five_lines_are_enough)
{
    T_EQ_I(parse("rig: rig.yaml\ncameras: \"sim:\"\nfps: 25\nsync:\n  policy: partial\n"), PVX_OK);
    T_EQ_S(c.rig, "rig.yaml");
    T_NEAR(c.fps, 25, 0);
    T_EQ_I(c.policy, CAP_POLICY_PARTIAL);
    T_EQ_I(dmn_config_channels(&c), 3);
    T_EQ_I(dmn_config_deadline(&c), 60000000);
    T_EQ_I(parse(""), PVX_OK);
    T_EQ_I(parse("# nothing but a comment\n"), PVX_OK);
}

T_CASE(wrong_files_name_line_key_and_reason)
{
    refused("rig: a\nfsp: 20\n", "test.yaml:2: fsp: unknown key");
    refused("sync:\n  policy: drop\n  tolerance: 3\n", "test.yaml:3: sync.tolerance: unknown key");
    refused("fps: 20\nfps: 21\n", "given twice");
    refused("sync: {max_wait_ms: 5, max_wait_ms: 6}\n", "given twice");
    refused("fps: fast\n", "test.yaml:1: fps: 'fast' is not a finite number");
    refused("fps: 20Hz\n", "test.yaml:1: fps:");
    refused("fps: nan\n", "test.yaml:1: fps:");
    refused("fps: 0\n", "test.yaml:1: fps:");
    refused("threads: 2.5\n", "test.yaml:1: threads: '2.5' is not a whole number");
    refused("threads: -1\n", "outside 0..256");
    refused("fps: 5\ncompute: gpu\n",
            "test.yaml:2: compute: 'gpu' is not one of auto|cpu|opencl[:NAME]");
    refused("compute: \"opencl:\"\n", "is not one of auto|cpu|opencl[:NAME]");
    refused("compute: openclx\n", "is not one of auto|cpu|opencl[:NAME]");
    refused("sync: 5\n", "test.yaml:1: sync: should be a mapping");
    refused("sync:\n  policy: sometimes\n", "test.yaml:2: sync.policy: 'sometimes' is not one of");
    refused("lossless: maybe\n", "should be true or false");
    refused("grid: [64, 64]\n", "one number or three");
    refused("grid: [64, 64, 2000]\n", "outside 1..1024");
    refused("cameras: [a, b]\n", "mapping of names to sources");
    refused("cameras: {\"a b\": \"sim:\"}\n", "letters, digits");
    refused("cameras: {cam0: \"\"}\n", "cameras.cam0: is empty");
    refused("features: 3\n", "should be a mapping");
    refused("publish: {endpoints: [a, b, c, d, e, f, g, h, i]}\n", "more than 8");
    refused("publish.hwm: 3\n", "unknown key");
    refused("- rig\n", "should be a mapping");
    refused("rig: [\n", "not valid YAML");
    refused("rig: {a: b}\n", "test.yaml:1: rig: should be a word");
    refused("rig: \"a\\nb\"\n", "control character");
}

T_CASE(triggers_are_read_strictly_and_printed_back)
{
    T_EQ_I(parse("record: { ring: { seconds: 5, memory: 8GB } }\n"
                 "triggers:\n"
                 "  - { name: a, when: light, above: 2, box: [0, 0, 0, 1, 1, 0.5], pre: 1 }\n"
                 "  - { name: b, at: '2026-12-01T12:00:00Z' }\n"
                 "  - { name: c, when: vanishes, above: 3, release: 9, agree: 4, hold_off: 0 }\n"
                 "  - { name: d }\n"
                 "  - { name: e, when: change, above: 20 }\n"
                 "  - { name: f, when: line, camera: cam2, line: 63, hold_off: 0.5 }\n"),
           PVX_OK);
    T_EQ_S(d.text, "");
    T_NEAR(c.ring.memory, 8e9, 0);
    T_NEAR(c.ring.pre, 2, 0);
    T_EQ_I(c.triggers.n, 6);
    const struct dmn_trigger *t = c.triggers.item;
    T_EQ_I(t[0].when, DMN_WHEN_LIGHT);
    T_NEAR(t[0].release, 1.6, 1e-12);
    T_NEAR(t[0].box[5], 0.5, 0);
    T_EQ_I(t[0].agree, 2);
    T_EQ_I(t[1].at_ns, 1796126400000000000LL);
    T_NEAR(t[2].release, 9, 0);
    T_EQ_I(t[3].when, DMN_WHEN_ORDER);
    T_EQ_I(t[4].agree, 1);
    T_EQ_I(t[5].when, DMN_WHEN_LINE);
    T_EQ_S(t[5].camera, "cam2");
    T_EQ_I(t[5].line, 63);
    T_NEAR(t[5].hold_off, 0.5, 0);
    const struct dmn_config was = c;
    char *text = dmn_config_format(&c);
    T_EQ_I(parse(text), PVX_OK);
    T_OK(memcmp(&was.triggers, &c.triggers, sizeof c.triggers) == 0);
    T_OK(memcmp(&was.ring, &c.ring, sizeof c.ring) == 0);
    free(text);

    refused("record: { ring: { seconds: 5 } }\n",
            "test.yaml:1: record.ring: needs seconds and memory");
    refused("record: { ring: { seconds: 5, memory: 8TB } }\n",
            "record.ring.memory: '8TB' is not a size");
    refused("record: { ring: { seconds: 5, memory: 0 } }\n", "is not a size");
    refused("record: { ring: { second: 5, memory: 8GB } }\n",
            "second: unknown key; known here: seconds memory");
    refused("record:\n  ring: 5\n", "test.yaml:2: record.ring: should be a mapping");
    refused("triggers: 5\n", "test.yaml:1: triggers: should be a list");
    refused("triggers:\n  - { when: appears }\n", "test.yaml:2: triggers[0]: has no name");
    refused("triggers: [{ name: a/b }]\n", "letters, digits");
    refused("triggers: [{ name: a }, { name: a }]\n", "triggers[1]: 'a' is the name of another");
    refused("triggers: [{ name: a, when: dark }]\n", "'dark' is not one of order, line, light");
    refused("triggers: [{ name: a, when: light }]\n", "when: light needs a level: add above");
    refused("triggers: [{ name: a, above: 3 }]\n", "above needs a condition");
    refused("triggers: [{ name: a, when: line }]\n", "when: line needs a camera: add camera: NAME");
    refused("triggers: [{ name: a, when: line, camera: c }]\n", "when: line needs a line");
    refused("triggers: [{ name: a, when: line, camera: 'c d', line: 1 }]\n", "is not a name");
    refused("triggers: [{ name: a, when: line, camera: c, line: 64 }]\n", "triggers[0].line");
    refused("triggers: [{ name: a, when: line, camera: c, line: 1, agree: 2 }]\n",
            "when: line has no agree: leave it out");
    refused("triggers: [{ name: a, when: line, camera: c, line: 1, release: 2 }]\n",
            "when: line has no release: leave it out");
    refused("triggers: [{ name: a, camera: c }]\n", "camera needs when: line");
    refused("triggers: [{ name: a, when: appears, line: 1 }]\n", "line needs when: line");
    refused("triggers: [{ name: a, when: light, above: 3, release: 4 }]\n", "lower it");
    refused("triggers: [{ name: a, when: vanishes, above: 3, release: 2 }]\n", "raise it");
    refused("triggers: [{ name: a, when: light, above: 3, box: [1, 0, 0, 0, 1, 1] }]\n", "lower");
    refused("triggers: [{ name: a, when: light, at: x }]\n", "has when and at");
    refused("triggers: [{ name: a, at: tomorrow }]\n", "is not a time in UTC");
    refused("triggers: [{ name: a, at: '9999-12-31T23:59:59Z' }]\n", "is not a time in UTC");
    refused("triggers: [{ name: a, pre: -1 }]\n", "triggers[0].pre");
    refused("triggers: [{ name: a, colour: red }]\n", "colour: unknown key");
}

T_CASE(who_is_let_in)
{
    static const struct {
        const char *endpoint;
        enum dmn_reach reach;
    } rows[] = {
        {"", DMN_REACH_FILE},
        {"ipc:///run/pyrovox/volumes", DMN_REACH_FILE},
        {"ipc://@pyrovox", DMN_REACH_HOST},
        {"tcp://127.0.0.1:5555", DMN_REACH_HOST},
        {"tcp://127.9.8.7:5555", DMN_REACH_HOST},
        {"tcp://localhost:5555", DMN_REACH_HOST},
        {"tcp://lo:*", DMN_REACH_HOST},
        {"tcp://[::1]:5555", DMN_REACH_HOST},
        {"tcp://*:5555", DMN_REACH_NET},
        {"tcp://0.0.0.0:5555", DMN_REACH_NET},
        {"tcp://[::]:5555", DMN_REACH_NET},
        {"tcp://[::1%lo]:5555", DMN_REACH_NET},
        {"tcp://[2001:db8::1]:5555", DMN_REACH_NET},
        {"tcp://[::ffff:10.0.0.1]:5555", DMN_REACH_NET},
        {"tcp://192.168.1.7:5555", DMN_REACH_NET},
        {"tcp://eth0:5555", DMN_REACH_NET},
        {"tcp://127.0.0.1.example.org:5555", DMN_REACH_NET},
        {"tcp://127.0.0.1", DMN_REACH_NET},
        {"udp://127.0.0.1:5555", DMN_REACH_NET},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        T_EQ_I(dmn_endpoint_reach(rows[i].endpoint), rows[i].reach);
    const char *open;
    T_EQ_I(parse("publish: {endpoints: ['ipc:///tmp/x', 'tcp://127.0.0.1:1']}\n"), PVX_OK);
    T_EQ_I(dmn_endpoints_allowed(&c, &open, &d), PVX_OK);
    T_OK(open == NULL);
    T_EQ_I(parse("publish: {endpoints: ['tcp://*:1', 'ipc:///tmp/x']}\n"), PVX_OK);
    T_EQ_I(dmn_endpoints_allowed(&c, &open, &d), PVX_EPERM);
    T_CONTAINS(d.text, "tcp://*:1");
    T_EQ_I(parse("publish: {previews: 'tcp://*:1'}\n"), PVX_OK);
    T_EQ_I(dmn_endpoints_allowed(&c, &open, &d), PVX_EPERM);
    T_CONTAINS(d.text, "publish.previews");
    T_EQ_I(parse("publish: {temperature: 'tcp://*:1'}\n"), PVX_OK);
    T_EQ_I(dmn_endpoints_allowed(&c, &open, &d), PVX_EPERM);
    T_CONTAINS(d.text, "publish.temperature: tcp://*:1");
    T_EQ_I(parse("control: {endpoint: 'ipc://@x'}\n"), PVX_OK);
    T_EQ_I(dmn_endpoints_allowed(&c, &open, &d), PVX_EPERM);
    T_EQ_I(parse("control: {endpoint: 'ipc://@x'}\ninsecure: true\n"), PVX_OK);
    T_EQ_I(dmn_endpoints_allowed(&c, &open, &d), PVX_OK);
    T_EQ_S(open, "ipc://@x");
}

T_CASE(what_goes_to_other_hosts_is_compressed)
{
    static const struct {
        const char *yaml;
        enum pvp_compress comp;
    } rows[] = {
        {"{}\n", PVP_RAW},
        {"publish: {endpoints: ['ipc:///tmp/x', 'tcp://127.0.0.1:1']}\n", PVP_RAW},
        {"publish: {endpoints: ['ipc:///tmp/x', 'tcp://*:1']}\n", PVP_LZ4},
        {"publish: {previews: 'tcp://*:1'}\n", PVP_RAW},    /* which are JPEG */
        {"publish: {temperature: 'tcp://*:1'}\n", PVP_RAW}, /* by itself: below */
        {"publish: {endpoints: ['tcp://*:1'], compress: none}\n", PVP_RAW},
        {"publish: {endpoints: ['tcp://*:1'], compress: zstd}\n", PVP_ZSTD},
        {"publish: {compress: lz4}\n", PVP_LZ4},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        T_EQ_I(parse(rows[i].yaml), PVX_OK);
        T_EQ_I(dmn_endpoints_compress(&c), rows[i].comp);
    }
    T_EQ_I(parse("publish: {endpoints: ['tcp://*:1'], temperature: 'ipc:///tmp/x'}\n"), PVX_OK);
    T_EQ_I(dmn_endpoint_compress(&c, c.temperature), PVP_RAW);
    T_EQ_I(parse("publish: {temperature: 'tcp://*:1'}\n"), PVX_OK);
    T_EQ_I(dmn_endpoint_compress(&c, c.temperature), PVP_LZ4);
}

T_CASE(printing_gives_back_the_same)
{
    T_EQ_I(parse("rig: \"a \\\"b\\\" \\\\ c.yaml\"\ncameras: {cam0: \"aravis:GV01\", c.1: 'sim:'}\n"
                 "grid: [3, 4, 5]\nfps: 29.97002997002997\nfeatures: {GainAuto: 'Off'}\n"
                 "publish: {endpoints: ['tcp://127.0.0.1:5555', 'ipc:///tmp/x']}\n"
                 "photometry: {floor: 0.1}\n"),
           PVX_OK);
    char *text = dmn_config_format(&c);
    struct dmn_config first = c;
    T_EQ_I(parse(text), PVX_OK);
    T_EQ_S(d.text, "");
    for (size_t i = 0; i < dmn_n_options; i++)
        T_OK(memcmp((char *)&c + dmn_options[i].offset, (char *)&first + dmn_options[i].offset,
                    dmn_options[i].size) == 0);
    for (const char *line = text; line != NULL && *line != '\0';) {
        size_t n = strcspn(line, "\n");
        T_LE(n, 100);
        line = line[n] == '\n' ? line + n + 1 : NULL;
    }
    free(text);
}

/* One file of the repository; tests run from its top. */
static char *repo_file(const char *path)
{
    char *text = NULL;
    size_t len;
    T_EQ_I(pvx_file_read(path, 1 << 20, &text, &len, &d), PVX_OK);
    return text;
}

T_CASE(the_example_is_what_print_config_prints)
{
    char *example = repo_file("daemon/config/pyrovoxd.example.yaml");
    if (example == NULL)
        return;
    T_EQ_I(parse(example), PVX_OK);
    T_EQ_S(d.text, "");
    char *text = dmn_config_format(&c);
    const char *body = strstr(example, "\n\n"); /* its own heading ends with a blank line */
    T_OK(body != NULL);
    if (body != NULL)
        T_EQ_S(body + 2, text);
    free(text);
    free(example);
}

T_CASE(the_manual_has_every_key)
{
    char *man = repo_file("daemon/man/pyrovoxd.yaml.5");
    if (man == NULL)
        return;
    for (size_t i = 0; i < dmn_n_options; i++) {
        char item[128];
        snprintf(item, sizeof item, ".It Cm %s", dmn_options[i].key);
        T_CONTAINS(man, item);
        /* with its choices, in their order */
        const char *p = strstr(man, item), *end = p != NULL ? strstr(p + 1, "\n.It ") : NULL;
        char word[64];
        for (int k = 0; dmn_options[i].choices != NULL && p != NULL; k++) {
            dmn_choice_word(dmn_options[i].choices, k, word, sizeof word);
            if (word[0] == '\0')
                break;
            snprintf(item, sizeof item, "\n.Cm %s ", word);
            p = strstr(p + 1, item);
            T_CHECK_(p != NULL && (end == NULL || p < end), "%s: %s", dmn_options[i].key, word);
        }
    }
    /* and no key that is not in the table */
    for (const char *p = man; (p = strstr(p, ".It Cm ")) != NULL; p++) {
        char key[64];
        T_EQ_I(sscanf(p, ".It Cm %63s", key), 1);
        int known = 0;
        for (size_t i = 0; i < dmn_n_options; i++)
            known |= strcmp(dmn_options[i].key, key) == 0;
        T_CHECK_(known, "the manual has %s", key);
    }
    free(man);
}

static void source_is(size_t index, const char *name, const char *want)
{
    char uri[DMN_WORD_MAX];
    d.text[0] = '\0';
    T_EQ_I(dmn_config_source(&c, name, index, uri, sizeof uri, &d), PVX_OK);
    T_EQ_S(uri, want);
}

T_CASE(sources)
{
    char uri[DMN_WORD_MAX];
    T_EQ_I(parse("cameras: \"aravis:127.0.0.2+\"\n"), PVX_OK);
    source_is(0, "a", "aravis:127.0.0.2");
    source_is(7, "h", "aravis:127.0.0.9");
    T_OK(dmn_config_source(&c, "z", 253, uri, sizeof uri, &d) != PVX_OK);
    T_CONTAINS(d.text, "runs past .254");
    T_EQ_I(parse("cameras: \"aravis:GV08+\"\n"), PVX_OK);
    source_is(3, "a", "aravis:GV11");
    T_EQ_I(parse("cameras: \"aravis:+\"\n"), PVX_OK);
    T_OK(dmn_config_source(&c, "a", 0, uri, sizeof uri, &d) != PVX_OK);
    T_EQ_I(parse("cameras: \"files:/d/{name}/%06d.png\"\n"), PVX_OK);
    source_is(0, "left", "files:/d/left/%06d.png");
    T_EQ_I(parse("cameras: {cam1: \"files:rec/cam1/%06d.png\"}\n"), PVX_OK);
    snprintf(c.dir, sizeof c.dir, "/conf");
    source_is(1, "cam1", "files:/conf/rec/cam1/%06d.png");
    source_is(0, "cam0", "");
    /* a source that grows past its room is refused, not cut */
    char text[400];
    snprintf(text, sizeof text, "cameras: \"files:/%0220d/{name}{name}{name}\"\n", 1);
    T_EQ_I(parse(text), PVX_OK);
    T_EQ_I(dmn_config_source(&c, "a-camera-with-a-name", 0, uri, sizeof uri, &d), PVX_ERANGE);
}

/* The rig that a file of the scratch folder asks for. */
static pvx_err rig_of(const char *text, struct rec_rig *rig)
{
    T_EQ_I(parse(text), PVX_OK);
    snprintf(c.dir, sizeof c.dir, "%s", dir);
    return dmn_config_rig(&c, rig, &d);
}

T_CASE(rig_with_overrides)
{
    scratch_new();
    struct rec_rig ring, rig;
    char *text;
    size_t len;
    T_EQ_I(rec_rig_ring(4, 2.0, 64, 48, 16, &ring), PVX_OK);
    T_EQ_I(rec_rig_format(&ring, &text, &len), PVX_OK);
    T_EQ_I(pvx_file_write(at("rig.yaml"), text, len, &d), PVX_OK);
    T_EQ_I(rig_of("rig: rig.yaml\ncameras: \"sim:\"\ngrid: 32\nbasis: trilinear\n", &rig), PVX_OK);
    T_EQ_I(rig.n_cameras, 4);
    T_EQ_I(rig.grid.n[2], 32);
    T_EQ_I(rig.grid.basis, REC_TRILINEAR);
    rec_rig_fini(&rig);
    char map[300];
    snprintf(map, sizeof map, "rig: rig.yaml\ncameras: {%s: \"sim:\", %s: \"sim:\"}\n",
             ring.cameras[3].name, ring.cameras[1].name);
    T_EQ_I(rig_of(map, &rig), PVX_OK);
    T_EQ_I(rig.n_cameras, 2);
    T_EQ_S(rig.cameras[0].name, ring.cameras[1].name);
    rec_rig_fini(&rig);
    T_EQ_I(rig_of("rig: rig.yaml\ncameras: {nobody: \"sim:\"}\n", &rig), PVX_ENOENT);
    T_CONTAINS(d.text, "cameras.nobody");
    T_OK(rig_of("cameras: \"sim:\"\n", &rig) != PVX_OK);
    scratch_remove();
    free(text);
    rec_rig_fini(&ring);
}

T_CASE(values_reach_recon)
{
    struct rec_frame_params p;
    T_EQ_I(parse("channels: 1\nphotometry: {threshold: 0.25, saturation: 0}\n"
                 "solver: {name: mlem, stop: iterations, iterations: 7, deadline_ms: 12}\n"),
           PVX_OK);
    dmn_config_frame(&c, &p);
    T_EQ_I(p.nch, 1);
    T_NEAR(p.photo.threshold, 0.25, 0);
    T_OK(p.photo.saturation > 1e29f);
    T_EQ_S(p.solve.solver, "mlem");
    T_EQ_I(p.solve.stop, REC_STOP_ITERATIONS);
    T_EQ_I(p.solve.iterations, 7);
    T_EQ_I(dmn_config_deadline(&c), 12000000);
    T_EQ_I(parse("lossless: true\ncameras: \"files:a/{name}/%06d.npy\"\n"), PVX_OK);
    dmn_config_frame(&c, &p);
    T_OK(p.photo.saturation < 0); /* as each image is */
    T_EQ_I(dmn_config_deadline(&c), 0);
    T_EQ_I(dmn_config_warm(&c), 0);
    T_EQ_I(parse("solver: {warm_start: on}\nlossless: true\n"), PVX_OK);
    T_EQ_I(dmn_config_warm(&c), 1);
    T_EQ_I(parse("fps: 20\n"), PVX_OK);
    T_EQ_I(dmn_config_warm(&c), 1);
    T_EQ_I(parse("pixel_format: Mono8\n"), PVX_OK);
    T_EQ_I(dmn_config_channels(&c), 1);
    T_EQ_I(dmn_config_pixfmt(&c), CAP_GREY8);
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++) {
        char text[64];
        snprintf(text, sizeof text, "pixel_format: %s\n", cap_pixfmt_name(f));
        T_EQ_I(parse(text), PVX_OK);
        T_EQ_I(dmn_config_pixfmt(&c), f);
        char *printed = dmn_config_format(&c); /* and comes back */
        T_EQ_I(parse(printed), PVX_OK);
        T_EQ_I(dmn_config_pixfmt(&c), f);
        free(printed);
    }
    T_EQ_I(parse("pixel_format: YUYV\n"), PVX_OK);
    T_EQ_I(dmn_config_pixfmt(&c), CAP_YUYV);
    T_EQ_I(parse("pixel_format: auto\ntransfer: bt709\n"), PVX_OK);
    T_EQ_I(dmn_config_pixfmt(&c), CAP_FMT_NONE);
    T_EQ_I(c.transfer, CAP_TRANSFER_BT709);
    refused("pixel_format: Mono9\n",
            "test.yaml:1: pixel_format: 'Mono9' is not auto or one of Mono8 ");
    refused("pixel_format: Mono9\n", "BayerRG12csi (and GR, GB, BG in the place of RG)");
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        char text[64];
        snprintf(text, sizeof text, "solver: {name: %s}\n", *name);
        T_EQ_I(parse(text), PVX_OK);
        dmn_config_frame(&c, &p);
        T_EQ_S(p.solve.solver, *name);
    }
}

T_CASE(what_a_running_daemon_takes)
{
    static const char *const live[] = {"log_level",   "publish.compress",   "solver.lambda",
                                       "solver.stop", "solver.deadline_ms", "photometry.margin"};
    static const char *const restart[] = {"solver.name", "fps", "publish.sample", "hull.min_views",
                                          "rig"};
    for (size_t i = 0; i < sizeof live / sizeof *live; i++)
        T_OK(dmn_option_live(dmn_option_find(live[i])));
    for (size_t i = 0; i < sizeof restart / sizeof *restart; i++)
        T_OK(!dmn_option_live(dmn_option_find(restart[i])));
    T_OK(dmn_option_find("solver") == NULL && dmn_option_find("") == NULL);
    T_EQ_S(dmn_option_nearest("photometry.flor"), "photometry.floor");
    T_EQ_S(dmn_option_nearest("lambda"), "solver.lambda");
    T_EQ_S(dmn_option_nearest("loglevel"), "log_level");
    char long_one[300];
    memset(long_one, 'x', sizeof long_one - 1);
    long_one[sizeof long_one - 1] = '\0';
    T_OK(dmn_option_nearest(long_one)[0] != '\0');
}
