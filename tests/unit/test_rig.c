#include "recon/geom/rig.h"

#include "tests/t.h"

#define CAM(name, rest)                                                           \
    "  - name: " name "\n    size: [640, 480]\n    K: [500, 500, 319.5, 239.5]\n" \
    "    R: [1,0,0, 0,1,0, 0,0,1]\n    t: [0, 0, 3]\n" rest
#define HEAD                                                                                 \
    "version: 1\n"                                                                           \
    "volume: { min: [-0.5,-0.5,0], max: [0.5,0.5,1], voxels: [8,9,10], basis: trilinear }\n" \
    "cameras:\n"

static pvx_err parse(const char *text, struct rec_rig *r, struct pvx_diag *d)
{
    d->text[0] = '\0';
    return rec_rig_parse(text, strlen(text), "rig.yaml", r, d);
}

/* Refused with `e` and a message that has `part` in it. */
static void refuse(const char *text, pvx_err e, const char *part)
{
    struct rec_rig r;
    struct pvx_diag d;
    T_EQ_I(parse(text, &r, &d), e);
    T_CONTAINS(d.text, part);
    T_OK(r.cameras == NULL);
    rec_rig_fini(&r);
}

T_CASE(reads_everything)
{
    struct rec_rig r;
    struct pvx_diag d;
    T_EQ_I(parse(HEAD CAM("left", "    distortion: [1,2,3,4,5]\n    gain: [2]\n")
                     CAM("right-2.b_", "    gain: [1, 2, 0.5]\n    distortion: []\n"),
                 &r, &d),
           PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(r.n_cameras, 2);
    T_EQ_I(r.grid.n[0], 8);
    T_EQ_I(r.grid.n[1], 9);
    T_EQ_I(r.grid.n[2], 10);
    T_EQ_I(r.grid.basis, REC_TRILINEAR);
    T_NEAR(r.grid.min[1], -0.5, 0);
    T_NEAR(r.grid.max[2], 1, 0);
    T_EQ_S(r.cameras[0].name, "left");
    T_EQ_I(r.cameras[0].width, 640);
    T_EQ_I(r.cameras[0].height, 480);
    T_NEAR(r.cameras[0].fx, 500, 0);
    T_NEAR(r.cameras[0].cy, 239.5, 0);
    T_NEAR(r.cameras[0].dist[4], 5, 0);
    T_NEAR(r.cameras[0].dist[5], 0, 0);
    T_NEAR(r.cameras[0].t[2], 3, 0);
    T_NEAR(r.cameras[0].gain[2], 2, 0);
    T_NEAR(r.cameras[1].gain[2], 0.5, 0);
    T_EQ_I(rec_rig_find(&r, "right-2.b_"), 1);
    T_EQ_I(rec_rig_find(&r, "middle"), -1);
    rec_rig_fini(&r);
    T_EQ_I(
        parse("version: 1\nvolume: {min: [0,0,0], max: [1,1,1], voxels: [1,1,1]}\ncameras:\n" CAM(
                  "a", ""),
              &r, &d),
        PVX_OK);
    T_EQ_I(r.grid.basis, REC_TRILINEAR); /* the default */
    T_NEAR(r.cameras[0].gain[1], 1, 0);
    rec_rig_fini(&r);
}

#define U "    uncertainty: { px: 0.02, px_95: 0.03, voxels: 0.005, voxels_95: 0.25 }\n"

T_CASE(uncertainty_is_optional)
{
    struct rec_rig r, again;
    struct pvx_diag d;
    char *text, *second;
    size_t len, len2;
    T_EQ_I(parse(HEAD CAM("a", U) CAM("b", ""), &r, &d), PVX_OK);
    T_NEAR(r.cameras[0].uncertainty.px_95, 0.03, 0);
    T_NEAR(r.cameras[0].uncertainty.voxels_95, 0.25, 0);
    T_NEAR(r.cameras[1].uncertainty.px, 0, 0);
    T_EQ_I(rec_rig_format(&r, &text, &len), PVX_OK);
    T_CONTAINS(text, "uncertainty: { px: 0.02");
    T_EQ_I(rec_rig_parse(text, len, "again", &again, &d), PVX_OK);
    T_EQ_I(rec_rig_format(&again, &second, &len2), PVX_OK);
    T_EQ_S(second, text);
    free(second);
    T_OK(rec_rig_hash(&r) == rec_rig_hash(&again));
    again.cameras[0].uncertainty = (struct rec_uncertainty){0};
    T_OK(rec_rig_hash(&r) == rec_rig_hash(&again)); /* no system matrix depends on it */
    T_EQ_I(rec_rig_format(&again, &second, &len2), PVX_OK);
    T_OK(strstr(second, "uncertainty") == NULL); /* files of before stay as they are */
    free(second);
    free(text);
    rec_rig_fini(&again);
    rec_rig_fini(&r);
    refuse(HEAD CAM("a", "    uncertainty: { px: 1 }\n"), PVX_EFORMAT,
           "the key 'px_95' is missing");
    refuse(HEAD CAM("a", "    uncertainty: { px: -1, px_95: 0, voxels: 0, voxels_95: 0 }\n"),
           PVX_EINVAL, "px");
    refuse(HEAD CAM("a", "    uncertainty: 3\n"), PVX_EFORMAT, "uncertainty");
}

#define P(text) "    photometry: { " text " }\n"

T_CASE(photometry_reads_back)
{
    struct rec_rig r, again;
    struct pvx_diag d;
    char *text, *second;
    size_t len, len2;
    T_EQ_I(parse(HEAD CAM("a", P("serial: 'aravis:GV01', device: S7, exposure: 0.001, gain_db: 6, "
                                 "response: [0, 0.3, 1], dark: {file: maps/a.npy, hash: "
                                 "'0123456789abcdef'}, mask: m.png, matrix: [1,0,0,0,1,0,0,0,1], "
                                 "noise: {read: 0.01, gain: 0.0001}")) CAM("b", ""),
                 &r, &d),
           PVX_OK);
    const struct rec_photometry *p = &r.cameras[0].photometry;
    T_EQ_S(p->serial, "aravis:GV01");
    T_EQ_S(p->device, "S7");
    T_OK(p->has_exposure && p->has_gain && !p->has_temperature && p->has_matrix && p->has_noise);
    T_EQ_I(p->n_response, 3);
    T_NEAR(p->response[1], 0.3, 0);
    T_EQ_S(p->dark.file, "maps/a.npy");
    T_OK(p->dark.hash == 0x0123456789abcdef && p->flat.file[0] == '\0');
    T_EQ_S(p->mask, "m.png");
    T_NEAR(p->noise_gain, 1e-4, 0);
    T_OK(rec_photometry_acts(p) && !rec_photometry_acts(&r.cameras[1].photometry));
    T_EQ_I(rec_rig_format(&r, &text, &len), PVX_OK);
    T_EQ_I(rec_rig_parse(text, len, "again", &again, &d), PVX_OK);
    T_EQ_I(rec_rig_format(&again, &second, &len2), PVX_OK);
    T_EQ_S(second, text);
    T_OK(rec_rig_hash(&r) == rec_rig_hash(&again));
    again.cameras[0].photometry.has_matrix = false; /* no system matrix depends on it */
    T_OK(rec_rig_hash(&r) == rec_rig_hash(&again));
    free(second);
    free(text);
    rec_rig_fini(&again);
    rec_rig_fini(&r);
}

T_CASE(photometry_that_cannot_be)
{
    refuse(HEAD CAM("a", P("dark: {file: a.npy, hash: 12}")), PVX_EFORMAT, "16 digits");
    refuse(HEAD CAM("a", P("dark: {hash: '0123456789abcdef'}")), PVX_EFORMAT,
           "cameras[0].photometry.dark: the key 'file' is missing");
    refuse(HEAD CAM("a", P("response: [0, 0.6, 0.5, 1]")), PVX_EINVAL, "should rise from 0 to 1");
    refuse(HEAD CAM("a", P("response: [0.1, 1]")), PVX_EINVAL, "should rise from 0 to 1");
    refuse(HEAD CAM("a", P("exposure: -1")), PVX_EINVAL, "photometry.exposure");
    refuse(HEAD CAM("a", P("matrix: [1,2]")), PVX_EFORMAT, "photometry.matrix");
    refuse(HEAD CAM("a", P("noise: {read: 0.1}")), PVX_EFORMAT, "should have read and gain");
    refuse(HEAD CAM("a", P("lens: 3")), PVX_EFORMAT, "lens");
    refuse(HEAD CAM("a", P("serial: 'a\"b'")), PVX_EINVAL, "without quotes");
}

#define EIGHT "1, 2, 3, 4, 5, 6, 7, 8"
#define WIDE(name, distortion, rest)                                              \
    "  - name: " name "\n    size: [512, 512]\n    K: [191, 191, 254.9, 256.9]\n" \
    "    distortion: [" distortion "]\n" rest "    R: [1,0,0, 0,1,0, 0,0,1]\n    t: [0, 0, 3]\n"

/* OpenCV's vectors of 4 to 14 numbers, and its fisheye. */
T_CASE(distortion_models)
{
    static const char *const brown[] = {"0.1, 0.2, 0.001, 0.002", "1, 2, 3, 4, 5",
                                        "0.5, 2, 3, 4, 5, 6, 7, 8", EIGHT ", 0, 0, 0, 0",
                                        EIGHT ", 0, 0, 0, 0, 0, 0"};
    struct rec_rig r;
    struct pvx_diag d;
    char text[1000];
    for (int i = 0; i < 5; i++) {
        snprintf(text, sizeof text, HEAD CAM("a", "    distortion: [%s]\n"), brown[i]);
        T_EQ_I(parse(text, &r, &d), PVX_OK);
        T_EQ_I(r.cameras[0].model, REC_PINHOLE);
        T_NEAR(r.cameras[0].dist[3], i == 0 ? 0.002 : 4, 0);
        T_NEAR(r.cameras[0].dist[7], i < 2 ? 0 : 8, 0);
        rec_rig_fini(&r);
    }
    refuse(HEAD CAM("a", "    distortion: [-0,2, 0,1, 0,0, 0,0]\n"), PVX_EFORMAT,
           "rig.yaml:9: cameras[0].distortion: all 8 are whole numbers: write 0.5, not 0,5");
    refuse(HEAD CAM("a", "    distortion: [" EIGHT ", 0, 0.1, 0, 0]\n"), PVX_EUNSUP,
           "rig.yaml:9: cameras[0].distortion: 0.1 is of OpenCV's thin prism (s1 s2 s3 s4) model");
    refuse(HEAD CAM("a", "    distortion: [" EIGHT ", 0, 0, 0, 0, 0, 2]\n"), PVX_EINVAL,
           "rig.yaml:9: cameras[0].distortion: a sensor tilted by 0, 2: radians are wanted");
    refuse(HEAD CAM("a", "    model: pinhole\n    distortion: [" EIGHT ", 0, 0, 0, 0, 0, 0.2]\n"),
           PVX_EINVAL,
           "tx 0, ty 0.2 tilt the sensor (OpenCV's CALIB_TILTED_MODEL), and model says");
    refuse(HEAD CAM("a", "    model: scheimpflug\n    distortion: [" EIGHT "]\n"), PVX_EFORMAT,
           "of a scheimpflug should have 14 numbers, of which the last two tilt");
    refuse(HEAD CAM("a", "    model: scheimpflug\n"), PVX_EFORMAT, "should have 14 numbers");
    refuse(HEAD CAM("a", "    model: telecentric\n    distortion: [0, 0, 0, 0]\n"), PVX_EUNSUP,
           "of a telecentric lens is not supported");
    refuse(HEAD CAM("a", "    distortion: [-0.02, 0.01, -0.03, 0.001]\n"), PVX_EINVAL,
           "are these k1 k2 k3 k4 of a fisheye? Write model: fisheye");
    refuse(HEAD WIDE("a", "0.003, 0.0007, -0.002, 0.0002", ""), PVX_EINVAL,
           "are these k1 k2 k3 k4 of a fisheye? Write model: fisheye");
    refuse(HEAD CAM("a", "    model: omni\n"), PVX_EINVAL,
           "rig.yaml:9: cameras[0].model: 'omni' is not known; pinhole, fisheye");
    refuse(HEAD CAM("a", "    distortion: [1, 2, 3, 4, 5]\n    model: fisheye\n"), PVX_EFORMAT,
           "of a fisheye should have 4 numbers (k1 k2 k3 k4), not 5");
    T_EQ_I(parse(HEAD CAM("a", "    distortion: [-0.02, 0.01, -0.03, 0.001]\n    model: pinhole\n")
                     CAM("b", "    model: fisheye\n")
                         CAM("c", "    model: fisheye\n    distortion: [0.1, 0, 0.03, 0]\n")
                             WIDE("d", "0.003, 0.0007, -0.002, 0.0002", "    model: pinhole\n")
                                 WIDE("e", "0.003, 0.0007, 0, 0", "")
                                     WIDE("f", "-0.3, 0.07, -0.002, 0.0002", ""),
                 &r, &d),
           PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(r.cameras[0].model, REC_PINHOLE);
    T_EQ_I(r.cameras[1].model, REC_FISHEYE);
    T_EQ_I(r.cameras[2].model, REC_FISHEYE);
    T_NEAR(r.cameras[2].dist[2], 0.03, 0);
    struct rec_rig back;
    char *out;
    size_t len;
    T_EQ_I(rec_rig_format(&r, &out, &len), PVX_OK);
    T_EQ_I(parse(out, &back, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(memcmp(r.cameras, back.cameras, r.n_cameras * sizeof *r.cameras) == 0);
    T_OK(rec_rig_hash(&r) == rec_rig_hash(&back));
    back.cameras[1].model = REC_PINHOLE;
    T_OK(rec_rig_hash(&r) != rec_rig_hash(&back));
    free(out);
    rec_rig_fini(&r);
    rec_rig_fini(&back);
}

#define GLASS(plane, rest) "    windows:\n      - { plane: [" plane "], " rest " }\n"
#define SILICA             "thickness: 0.02, n: 1.46"

/* The camera of CAM stands at (0,0,-3) and looks along z. */
T_CASE(windows_and_other_rays)
{
    struct rec_rig r, back;
    struct pvx_diag d;
    T_EQ_I(
        parse(HEAD CAM("a", GLASS("0, 0, 2, -2", SILICA)) /* normal towards the flame, not unit */
              CAM("b", GLASS("0, 0.6, -0.8, 1.1",
                             SILICA) "      - { plane: [0, 0, 1, -2], thickness: 0.01, n: 1.5 }\n")
                  CAM("c", "    model: telecentric\n" GLASS("0, 0, 1, -1", SILICA))
                      CAM("d", "    distortion: [" EIGHT ", 0, 0, 0, 0, 0.1, -0.2]\n"
                               "    windows: []\n")
                          CAM("e", "    distortion: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]\n"
                                   "    model: scheimpflug\n"),
              &r, &d),
        PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(r.cameras[0].n_windows, 1);
    const struct rec_glass *w = &r.cameras[0].window[0];
    T_NEAR(w->normal[2], 1, 0);
    T_NEAR(w->at, -1, 0);
    T_NEAR(w->thickness, 0.02, 0);
    T_NEAR(w->index, 1.46, 0);
    T_EQ_I(r.cameras[1].n_windows, 2);
    T_NEAR(r.cameras[1].window[0].normal[1], -0.6, 1e-15); /* turned to the flame */
    T_NEAR(r.cameras[1].window[0].at, -1.1, 1e-15);
    T_EQ_I(r.cameras[2].model, REC_TELECENTRIC);
    T_EQ_I(r.cameras[3].model, REC_SCHEIMPFLUG);
    T_NEAR(r.cameras[3].tilt[1], -0.2, 0);
    T_EQ_I(r.cameras[3].n_windows, 0);
    T_EQ_I(r.cameras[4].model, REC_SCHEIMPFLUG);
    char *out;
    size_t len;
    T_EQ_I(rec_rig_format(&r, &out, &len), PVX_OK);
    T_EQ_I(parse(out, &back, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(memcmp(r.cameras, back.cameras, r.n_cameras * sizeof *r.cameras) == 0);
    uint64_t h = rec_rig_hash(&r);
    T_OK(rec_rig_hash(&back) == h);
    struct rec_camera *b = back.cameras;
    double *all[] = {&b[0].window[0].normal[0], &b[0].window[0].at, &b[1].window[1].thickness,
                     &b[2].window[0].index, &b[3].tilt[0]};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        double old = *all[i];
        *all[i] = old + 1e-9;
        T_OK(rec_rig_hash(&back) != h);
        *all[i] = old;
    }
    b[1].n_windows = 1;
    T_OK(rec_rig_hash(&back) != h);
    free(out);
    rec_rig_fini(&r);
    rec_rig_fini(&back);
    refuse(HEAD CAM("a", "    windows: 3\n"), PVX_EFORMAT,
           "rig.yaml:9: cameras[0].windows: should be a list of at most 4 windows");
    refuse(HEAD CAM("a", "    windows:\n      - { plane: [0, 0, 1, -1], n: 1.5 }\n"), PVX_EFORMAT,
           "rig.yaml:10: cameras[0].windows[0]: the key 'thickness' is missing");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, -1", "thickness: 20, n: 1.46")), PVX_EINVAL,
           "cameras[0].windows[0].thickness");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, -1", "thickness: 0.02, n: 0.7")), PVX_EINVAL,
           "cameras[0].windows[0].n");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, -1", "thickness: 0.02, n: 1.5, index: 2")), PVX_EFORMAT,
           "index: unknown key");
    refuse(HEAD CAM("a", GLASS("0, 0, 1", SILICA)), PVX_EFORMAT, "cameras[0].windows[0].plane");
    refuse(HEAD CAM("a", GLASS("0, 0, 0, 1", SILICA)), PVX_EINVAL,
           "cameras[0].windows[0].plane: should be a normal and a distance");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, -3", SILICA)), PVX_EINVAL,
           "the plane goes through camera a");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, 0.25", SILICA)), PVX_EINVAL,
           "rig.yaml:10: cameras[0].windows[0].plane: the volume reaches 0.27 m through the glass "
           "towards camera a");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, -0.01", SILICA)), PVX_EINVAL,
           "the volume reaches 0.01 m through the glass");
    refuse(HEAD CAM("a", GLASS("0, 0, 1, -4", SILICA)), PVX_EINVAL, /* behind the camera */
           "through the glass towards camera a: a window stands between camera and volume");
}

T_CASE(blur_is_sigma_or_a_lens)
{
    struct rec_rig r, back;
    struct pvx_diag d;
    T_EQ_I(parse(HEAD CAM("a", "    blur: { sigma: 1.5 }\n")
                     CAM("b", "    blur: { aperture: 0.01, focus: 2.5 }\n")
                         CAM("c", "    model: telecentric\n    blur: { sigma: 2 }\n") CAM("d", ""),
                 &r, &d),
           PVX_OK);
    T_EQ_S(d.text, "");
    T_NEAR(r.cameras[0].blur.sigma, 1.5, 0);
    T_NEAR(r.cameras[1].blur.aperture, 0.01, 0);
    T_NEAR(r.cameras[1].blur.focus, 2.5, 0);
    char *out;
    size_t len;
    T_EQ_I(rec_rig_format(&r, &out, &len), PVX_OK);
    T_EQ_I(parse(out, &back, &d), PVX_OK);
    T_OK(memcmp(r.cameras, back.cameras, r.n_cameras * sizeof *r.cameras) == 0);
    uint64_t h = rec_rig_hash(&r);
    T_OK(rec_rig_hash(&back) == h);
    double *all[] = {&back.cameras[0].blur.sigma, &back.cameras[1].blur.aperture,
                     &back.cameras[1].blur.focus, &back.cameras[3].blur.sigma};
    for (size_t i = 0; i < 4; i++) {
        double old = *all[i];
        *all[i] = old + 1e-9;
        T_OK(rec_rig_hash(&back) != h);
        *all[i] = old;
    }
    free(out);
    rec_rig_fini(&r);
    rec_rig_fini(&back);
    refuse(HEAD CAM("a", "    blur: 2\n"), PVX_EFORMAT, "rig.yaml:9: cameras[0].blur");
    refuse(HEAD CAM("a", "    blur: { aperture: 0.01 }\n"), PVX_EFORMAT,
           "should have the key 'sigma' (px), or both 'aperture' and 'focus' (m)");
    refuse(HEAD CAM("a", "    blur: { sigma: 1, focus: 2 }\n"), PVX_EFORMAT, "not both");
    refuse(HEAD CAM("a", "    blur: { sigma: 17 }\n"), PVX_EINVAL, "cameras[0].blur.sigma");
    refuse(HEAD CAM("a", "    blur: { aperture: 1, focus: 2 }\n"), PVX_EINVAL,
           "points of the volume become discs of radius");
    refuse(HEAD CAM("a", "    model: fisheye\n    blur: { aperture: 0.01, focus: 2 }\n"),
           PVX_EUNSUP,
           "an aperture is for model pinhole and scheimpflug; model fisheye has sigma only");
}

T_CASE(messages_name_the_place)
{
    refuse("", PVX_EFORMAT, "rig.yaml:1: rig: should be a mapping");
    refuse("version: 2\nvolume: {}\ncameras: []\n", PVX_EVERSION, "rig.yaml:1: version: 2 is not");
    refuse("version: 1\ncameras: []\n", PVX_EFORMAT, "rig: the key 'volume' is missing");
    refuse(HEAD, PVX_EFORMAT, "cameras: should be a list");
    refuse(HEAD "  []\n", PVX_EFORMAT, "cameras: should be a list");
    refuse(HEAD CAM("a", "    color: red\n"), PVX_EFORMAT, "rig.yaml:9: color: unknown key");
    refuse(HEAD CAM("a", "    t: [0,0,0]\n"), PVX_EFORMAT, "rig.yaml:9: t: given twice");
    refuse(HEAD CAM("a", "") CAM("a", ""), PVX_EINVAL,
           "rig.yaml:9: cameras[1].name: 'a' is used twice");
    refuse(HEAD CAM("a/b", ""), PVX_EINVAL, "rig.yaml:4: cameras[0].name: should be");
    refuse(HEAD CAM("..", ""), PVX_EINVAL, "cameras[0].name");
    refuse(HEAD CAM("\"\"", ""), PVX_EINVAL, "cameras[0].name");
    refuse(HEAD CAM("a", "    distortion: [1,2,3]\n"), PVX_EFORMAT,
           "rig.yaml:9: cameras[0].distortion: should have 0, 4, 5, 8, 12 or 14 numbers");
    refuse(HEAD CAM("a", "    distortion: [1,2,3,x]\n"), PVX_EFORMAT, "'x' is not a finite number");
    refuse(HEAD CAM("a", "    distortion: [1,2,3,.nan]\n"), PVX_EFORMAT, "not a finite number");
    refuse(HEAD CAM("a", "    gain: [1,2]\n"), PVX_EFORMAT, "cameras[0].gain: should have 1 or 3");
    refuse(HEAD CAM("a", "    gain: [0]\n"), PVX_EINVAL, "cameras[0].gain: 0 is outside");
}

/* One camera with one of its lines replaced. */
static void with(const char *size, const char *K, const char *R, pvx_err e, const char *part)
{
    char text[2000];
    snprintf(text, sizeof text,
             HEAD "  - name: a\n    size: %s\n    K: %s\n    R: %s\n"
                  "    t: [0,0,1]\n",
             size, K, R);
    refuse(text, e, part);
}

T_CASE(impossible_cameras)
{
    const char *I = "[1,0,0,0,1,0,0,0,1]", *K = "[5,5,0,0]", *S = "[4,4]";
    with("[0,4]", K, I, PVX_EINVAL, "rig.yaml:5: cameras[0].size: 0 is outside");
    with("[4,16385]", K, I, PVX_EINVAL, "16385 is outside");
    with("[4]", K, I, PVX_EFORMAT, "cameras[0].size: should be a list of 2 whole numbers");
    with("[4.5,4]", K, I, PVX_EFORMAT, "'4.5' is not a whole number");
    with(S, "[0,5,0,0]", I, PVX_EINVAL, "rig.yaml:6: cameras[0].K: the focal lengths");
    with(S, "[5,-5,0,0]", I, PVX_EINVAL, "cameras[0].K: the focal lengths");
    with(S, "[5,5,0]", I, PVX_EFORMAT, "cameras[0].K: should be a list of 4 numbers");
    with(S, K, "[1,0,0,0,1,0,0,0,2]", PVX_EINVAL, "rig.yaml:7: cameras[0].R: is not a rotation");
    with(S, K, "[1,0,0,0,1,0,0,0,-1]", PVX_EINVAL, "is a mirror image");
    with(S, K, "[0,0,0,0,0,0,0,0,0]", PVX_EINVAL, "is not a rotation");
    with(S, K, "[1,0,0,0,1,0,0.002,0,1]", PVX_EINVAL, "is not a rotation");
}

T_CASE(impossible_volumes)
{
    static const struct {
        const char *v;
        pvx_err e;
        const char *part;
    } bad[] = {
        {"{ min: [0,0,0], max: [1,0,1], voxels: [4,4,4] }", PVX_EINVAL, "empty along y"},
        {"{ min: [0,0,2], max: [1,1,1], voxels: [4,4,4] }", PVX_EINVAL, "empty along z"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [4,0,4] }", PVX_EINVAL, "volume.voxels: 0"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [4,1025,4] }", PVX_EINVAL, "1025 is outside"},
        {"{ min: [0,0,0], max: [1,1,1e9], voxels: [4,4,4] }", PVX_EINVAL, "1e+09 is outside"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [4,4,4], basis: cubic }", PVX_EINVAL,
         "volume.basis: should be box or trilinear"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: fine }", PVX_EFORMAT,
         "volume.voxels: should be a list of 3 whole numbers or auto"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [auto, 4, 4] }", PVX_EFORMAT,
         "'auto' is not a whole number"},
        {"{ min: [0,0,-9], max: [1,1,-8], voxels: auto }", PVX_EINVAL,
         "volume.voxels: auto: no camera sees the volume"},
        {"{ min: [0,0,0], max: [1,1,1] }", PVX_EFORMAT, "volume: the key 'voxels' is missing"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [4,4,4], basis: }", PVX_EINVAL,
         "volume.basis: should be box or trilinear"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [4,4,4], basis: [box] }", PVX_EINVAL,
         "volume.basis: should be box or trilinear"},
        {"{ min: [0,0,0], max: [1,1,1], voxels: [4,4,4], basis: box, basis: box }", PVX_EFORMAT,
         "basis"},
        {"[1,2,3]", PVX_EFORMAT, "volume: should be a mapping"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char text[2000];
        snprintf(text, sizeof text, "version: 1\nvolume: %s\ncameras:\n" CAM("a", ""), bad[i].v);
        refuse(text, bad[i].e, bad[i].part);
    }
}

/* n cameras that see `px` pixels to the metre at the middle of a box of these sides. */
static struct rec_rig looks_at(struct rec_camera *camera, size_t n, double px, const double side[3])
{
    struct rec_rig r = {.n_cameras = n, .cameras = camera};
    for (size_t i = 0; i < n; i++)
        camera[i] = (struct rec_camera){
            .fx = 2 * px, .fy = 2 * px, .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .t = {0, 0, 2}};
    for (int a = 0; a < 3; a++) {
        r.grid.min[a] = -0.5 * side[a];
        r.grid.max[a] = 0.5 * side[a];
    }
    return r;
}

static void finest(size_t cameras, double px, const double side[3], int32_t binning, int32_t x,
                   int32_t y, int32_t z)
{
    struct rec_camera camera[16];
    struct rec_rig r = looks_at(camera, cameras, px, side);
    int32_t n[3];
    T_EQ_I(rec_rig_finest(&r, binning, n), PVX_OK);
    T_EQ_I(n[0], x);
    T_EQ_I(n[1], y);
    T_EQ_I(n[2], z);
}

T_CASE(finest_grid)
{
    static const double cube[3] = {1, 1, 1}, brick[3] = {1, 0.5, 2}, flat[3] = {1, 1, 0.001};
    finest(8, 50, cube, 1, 68, 68, 68);     /* 50 / 0.7 = 71, in fours: half a pixel's diagonal */
    finest(8, 50, cube, 2, 34, 34, 34);     /* a bin's, in twos */
    finest(8, 50, brick, 1, 68, 34, 136);   /* voxels are cubes */
    finest(1, 30, cube, 1, 30, 30, 30);     /* 3/2 30^2 values, 30^3 unknowns: 20 to one */
    finest(8, 240, cube, 1, 240, 240, 240); /* 12 240^2 values */
    finest(16, 900, cube, 1, 256, 256, 256);
    finest(16, 900, brick, 1, 128, 64, 256); /* the longest side is limited, the others with it */
    finest(8, 50, flat, 1, 68, 68, 1);

    struct rec_camera camera[3];
    struct rec_rig r = looks_at(camera, 3, 40, cube);
    int32_t n[3], aside[3];
    T_EQ_I(rec_rig_finest(&r, 1, n), PVX_OK);
    for (int c = 0; c < 3;
         c++) { /* a fisheye sees it 60 degrees off axis as large as in the middle */
        const double z = camera[c].t[2],
                     turned[9] = {0.5, 0, sqrt(0.75), 0, 1, 0, -sqrt(0.75), 0, 0.5};
        camera[c].model = REC_FISHEYE;
        memcpy(camera[c].R, turned, sizeof turned);
        camera[c].t[0] = sqrt(0.75) * z;
        camera[c].t[2] = 0.5 * z;
    }
    T_EQ_I(rec_rig_finest(&r, 1, aside), PVX_OK);
    T_OK(memcmp(n, aside, sizeof n) == 0);
    r = looks_at(camera, 3, 40, cube);
    camera[1].t[2] = -2; /* sees nothing of it and does not count */
    T_EQ_I(rec_rig_finest(&r, 1, n), PVX_OK);
    T_EQ_I(n[0], 44); /* of two: (60 40^2)^(1/3) = 45.8 */
    camera[0].t[2] = camera[2].t[2] = 0;
    T_EQ_I(rec_rig_finest(&r, 1, n), PVX_EINVAL);
    r.n_cameras = 0;
    T_EQ_I(rec_rig_finest(&r, 1, n), PVX_EINVAL);
}

T_CASE(voxels_auto)
{
    struct rec_rig r;
    struct pvx_diag d;
    T_EQ_I(parse("version: 1\nvolume: {min: [0,0,0], max: [1,1,1], voxels: auto}\ncameras:\n" CAM(
                     "a", ""),
                 &r, &d),
           PVX_OK);
    T_EQ_I(r.grid.n[0], 84); /* one camera of 500 px at 3.5 m: (30 (500/3.5)^2)^(1/3) = 84.9 */
    T_EQ_I(r.grid.n[1], 84);
    T_EQ_I(r.grid.n[2], 84);
    rec_rig_fini(&r);
}

T_CASE(too_many_cameras)
{
    static char text[40000];
    size_t n = (size_t)snprintf(text, sizeof text, HEAD);
    for (int i = 0; i < REC_MAX_CAMERAS + 1; i++)
        n += (size_t)snprintf(text + n, sizeof text - n,
                              "  - {name: c%d, size: [4,4], K: [5,5,1,1], "
                              "R: [1,0,0,0,1,0,0,0,1], t: [0,0,1]}\n",
                              i);
    refuse(text, PVX_EINVAL, "65 cameras; at most 64");
}

T_CASE(near_rotations_are_repaired)
{
    struct rec_rig r;
    struct pvx_diag d;
    T_EQ_I(parse(HEAD "  - name: a\n    size: [4,4]\n    K: [5,5,1,1]\n    t: [0,0,1]\n"
                      "    R: [0.8661,-0.5,0, 0.5,0.866,0, 0,0,1.0001]\n",
                 &r, &d),
           PVX_OK);
    const double *R = r.cameras[0].R;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            T_NEAR(R[3 * i] * R[3 * j] + R[3 * i + 1] * R[3 * j + 1] + R[3 * i + 2] * R[3 * j + 2],
                   i == j, 1e-14);
    T_NEAR(R[0], 0.866, 3e-4);
    rec_rig_fini(&r);
}

T_CASE(format_reads_back)
{
    struct rec_rig a, b;
    struct pvx_diag d;
    char *text;
    size_t len;
    T_EQ_I(rec_rig_ring(7, 2.2, 641, 479, 33, &a), PVX_OK);
    a.grid.basis = REC_TRILINEAR;
    a.grid.min[0] = -1.0 / 3;
    a.cameras[2].gain[1] = 0.7f;
    for (int i = 0; i < 8; i++)
        a.cameras[3].dist[i] = 0.1 / (i + 3);
    memset(a.cameras[4].dist, 0, sizeof a.cameras[4].dist);
    T_EQ_I(rec_rig_format(&a, &text, &len), PVX_OK);
    T_EQ_I(strlen(text), len);
    T_EQ_I(parse(text, &b, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(b.n_cameras, 7);
    T_OK(memcmp(&a.grid, &b.grid, sizeof a.grid) == 0);
    T_OK(memcmp(a.cameras, b.cameras, 7 * sizeof *a.cameras) == 0);
    T_OK(rec_rig_hash(&a) == rec_rig_hash(&b));
    free(text);
    rec_rig_fini(&a);
    rec_rig_fini(&b);
}

T_CASE(hash_sees_geometry_only)
{
    struct rec_rig a;
    T_EQ_I(rec_rig_ring(3, 2, 64, 48, 8, &a), PVX_OK);
    uint64_t h = rec_rig_hash(&a);
    a.cameras[1].gain[0] = 3;
    snprintf(a.cameras[1].name, sizeof a.cameras[1].name, "other");
    T_OK(rec_rig_hash(&a) == h);
    double *all[] = {&a.grid.min[1],        &a.grid.max[2],     &a.cameras[0].fx,  &a.cameras[1].cy,
                     &a.cameras[2].dist[7], &a.cameras[2].R[8], &a.cameras[0].t[1]};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        double old = *all[i];
        *all[i] = old + 1e-9;
        T_OK(rec_rig_hash(&a) != h);
        *all[i] = old;
    }
    a.grid.basis = REC_TRILINEAR;
    T_OK(rec_rig_hash(&a) != h);
    a.grid.basis = REC_BOX;
    a.cameras[2].width++;
    T_OK(rec_rig_hash(&a) != h);
    a.cameras[2].width--;
    a.grid.min[2] = -0.0;
    T_OK(rec_rig_hash(&a) == h);
    rec_rig_fini(&a);
}

T_CASE(select_keeps_rig_order)
{
    struct rec_rig a, b;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_ring(5, 2, 64, 48, 8, &a), PVX_OK);
    T_EQ_I(rec_rig_copy(&a, &b), PVX_OK);
    T_EQ_I(rec_rig_select(&b, "cam3,cam0", &d), PVX_OK);
    T_EQ_I(b.n_cameras, 2);
    T_EQ_S(b.cameras[0].name, "cam0");
    T_EQ_S(b.cameras[1].name, "cam3");
    T_EQ_I(a.n_cameras, 5); /* the copy is its own */
    T_EQ_I(rec_rig_select(&a, "cam1,cam9", &d), PVX_ENOENT);
    T_CONTAINS(d.text, "no camera 'cam9' in the rig; it has: cam0 cam1");
    T_EQ_I(a.n_cameras, 5);
    T_EQ_I(rec_rig_select(&a, "", NULL), PVX_ENOENT);
    T_EQ_I(rec_rig_select(&a, "cam1,", NULL), PVX_ENOENT);
    rec_rig_fini(&a);
    rec_rig_fini(&b);
}

T_CASE(ring_is_a_sound_rig)
{
    static const struct {
        size_t n;
        double r;
        int32_t w, h;
    } rigs[] = {
        {8, 2, 640, 480}, {1, 2, 160, 120}, {2, 3, 48, 64}, {3, 1.6, 20, 20}, {64, 5, 300, 40}};
    for (size_t k = 0; k < sizeof rigs / sizeof rigs[0]; k++) {
        struct rec_rig r;
        T_EQ_I(rec_rig_ring(rigs[k].n, rigs[k].r, rigs[k].w, rigs[k].h, 64, &r), PVX_OK);
        double lo = 1e9, hi = -1e9, widest = 0;
        double shorter = rigs[k].w < rigs[k].h ? rigs[k].w : rigs[k].h;
        for (size_t i = 0; i < r.n_cameras; i++) {
            const struct rec_camera *c = &r.cameras[i];
            double x[3], uv[2] = {0}, top[2] = {0}, above[3] = {0, 0, 0.6}, mid[3] = {0, 0, 0.5};
            rec_camera_centre(c, x);
            T_NEAR(hypot(x[0], x[1]), rigs[k].r, 1e-9);
            lo = fmin(lo, x[2]);
            hi = fmax(hi, x[2]);
            T_OK(rec_camera_project(c, mid, uv) && rec_camera_project(c, above, top));
            T_NEAR(uv[0], c->cx, 1e-6);
            T_NEAR(uv[1], c->cy, 1e-6);
            T_OK(top[1] < uv[1]);         /* z is up in the picture */
            for (int m = 0; m < 8; m++) { /* the whole volume is in the picture */
                double X[3] = {m & 1 ? .5 : -.5, m & 2 ? .5 : -.5, m & 4 ? 1 : 0};
                T_OK(rec_camera_project(c, X, uv));
                T_OK(uv[0] > 0 && uv[0] < c->width - 1 && uv[1] > 0 && uv[1] < c->height - 1);
                widest = fmax(widest, fmax(fabs(uv[0] - c->cx), fabs(uv[1] - c->cy)));
            }
        }
        T_NEAR(2 * widest / shorter, 0.75, 0.05);
        if (rigs[k].n > 1)
            T_NEAR(hi - lo, 0.3, 1e-9);
        rec_rig_fini(&r);
    }
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(0, 2, 64, 48, 8, &r), PVX_EINVAL);
    T_EQ_I(rec_rig_ring(65, 2, 64, 48, 8, &r), PVX_EINVAL);
    T_EQ_I(rec_rig_ring(8, NAN, 64, 48, 8, &r), PVX_EINVAL);
    T_EQ_I(rec_rig_ring(8, 2, 0, 48, 8, &r), PVX_EINVAL);
    T_EQ_I(rec_rig_ring(8, 2, 64, 48, 1025, &r), PVX_EINVAL);
}

T_CASE(missing_file)
{
    struct rec_rig r;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_load("/nonexistent/rig.yaml", &r, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "/nonexistent/rig.yaml");
}
