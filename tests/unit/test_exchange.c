/* Calibrations of other programs: what is read, and what is refused, with which words.  That conventions are right is for
 * tests/system/exchange.py, which has the other programs. */
#include "recon/exchange/exchange.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

static struct rec_exchange x; /* large */
static struct pvx_diag d;

static pvx_err parse(const char *path, const char *text)
{
    d.text[0] = '\0';
    return rec_exchange_parse(text, strlen(text), path, REC_EXCHANGE_AUTO, &x, &d);
}

static void fresh(void)
{
    memset(&x, 0, sizeof x);
}

static void refuse(const char *path, const char *text, const char *part)
{
    fresh();
    T_OK(parse(path, text) != PVX_OK);
    T_CONTAINS(d.text, part);
    T_CONTAINS(d.text, path);
}

#define K3  "[[500, 0, 300], [0, 510, 200], [0, 0, 1]]"
#define ONE "[1,0,0, 0,1,0, 0,0,1]"

T_CASE(toml_is_read)
{
    fresh();
    T_EQ_I(parse("a.toml",
                 "date = 2023-03-31T09:56:43.1 # when\r\n"
                 "[ \"cam_0\" ]\nname='A \"1\"'\nsize = [ 640, 480, ]\n"
                 "matrix = [ [ 5_00.0, 0.0, 300,],\n  # rows\n [0, 510.0, 200],[0,0,1] ]\n"
                 "distortions = [ 0.1, -0.2, 0, 0, 0.5 ]\n"
                 "rotation = [0, 0, 1.5707963267948966]\ntranslation = [1, 2, 3]\n"
                 "more = { a = 1, b.c = \"x\" }\n[metadata]\nadjusted = false\n"),
           PVX_OK);
    T_EQ_I(x.n, 1);
    T_EQ_S(x.camera[0].c.name, "A__1_");
    T_NEAR(x.camera[0].c.fx, 500, 0);
    T_NEAR(x.camera[0].c.dist[4], 0.5, 0);
    T_NEAR(x.camera[0].c.R[1], -1, 1e-15);
    T_NEAR(x.camera[0].c.t[2], 3, 0);
    T_EQ_I(x.camera[0].c.height, 480);
    T_OK(x.camera[0].lens && x.camera[0].pose && x.unit == 0);
}

T_CASE(toml_is_refused)
{
    refuse("a.toml", "[cam]\nsize = [1, 2\n", "a.toml:3: not valid TOML: here should be");
    refuse("a.toml", "[[cam]]\n", "a.toml:1: not valid TOML: arrays of tables");
    refuse("a.toml", "a = \"\"\"\n\"\"\"\n", "strings over several lines");
    refuse("a.toml", "a = 1 2\n", "the end of the line");
    refuse("a.toml", "a = 'x\n", "a string does not end on its line");
    refuse("a.toml", "= 1\n", "here should be a key");
    refuse("a.toml", "[a]\nx = 1\n[a]\ny = 1\n", "a.toml:3: a: given twice");
    refuse("a.toml", "[cam_0]\nsize = [640, 480]\n\nmatrix = [1, 2, 3]\n",
           "a.toml:4: matrix: should have 9 numbers, not 3");
    refuse("a.toml", "[metadata]\nadjusted = true\n", "holds no camera");
}

/* A camera's lens and pose in two files, in any order. */
T_CASE(lens_and_pose_apart)
{
    for (int order = 0; order < 2; order++) {
        fresh();
        for (int k = 0; k < 2; k++)
            T_EQ_I(k == order
                       ? parse("left.yml", "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n"
                                           "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 500., 0., "
                                           "300., 0., 510.,\n       200., 0., 0., 1. ]\n")
                       : parse("poses.json", "{\"left\": {\"R\": " ONE ", \"T\": [1, 2, 3]}}"),
                   PVX_OK);
        T_EQ_I(x.n, 1);
        T_OK(x.camera[0].lens && x.camera[0].pose && x.camera[0].c.width == 0);
    }
    T_EQ_I(parse("poses.json", "{\"left\": {\"R\": " ONE ", \"T\": [1, 2, 3]}}"), PVX_EINVAL);
    T_CONTAINS(d.text, "camera 'left' has its pose in two places");
    T_EQ_I(parse("left.json", "{\"K\": " K3 "}"), PVX_EINVAL);
    T_CONTAINS(d.text, "camera 'left' has its lens in two places");
}

T_CASE(pixel_centres)
{
    fresh();
    x.centred = true;
    x.centre = 0.5; /* corners of a ChArUco board that are half a pixel off */
    T_EQ_I(parse("a.json", "{\"K\": " K3 "}"), PVX_OK);
    T_NEAR(x.camera[0].c.cx, 299.5, 0);
    T_NEAR(x.camera[0].c.cy, 199.5, 0);
}

T_CASE(a_tilted_sensor_is_read)
{
    fresh();
    T_EQ_I(parse("a.json", "{\"K\": " K3 ", \"D\": [0.1,0,0,0,0,0,0,0,0,0,0,0,0.02,-0.03]}"),
           PVX_OK);
    T_EQ_I(x.camera[0].c.model, REC_SCHEIMPFLUG);
    T_NEAR(x.camera[0].c.tilt[1], -0.03, 0);
}

/* Every lens in every format: written, or refused with the camera's name. */
T_CASE(written_or_refused)
{
    char path[256];
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(2, 3, 640, 480, 16, &r), PVX_OK);
    struct rec_camera *c = &r.cameras[1];
    for (int kind = 0; kind < 6; kind++) {
        c->model = kind == 1   ? REC_FISHEYE
                   : kind == 2 ? REC_SCHEIMPFLUG
                   : kind == 3 ? REC_TELECENTRIC
                               : REC_PINHOLE;
        c->n_windows = kind == 4;
        c->dist[6] = kind == 5 ? 0.1 : 0;
        for (unsigned f = REC_EXCHANGE_AUTO; f < REC_EXCHANGE_FORMATS; f++) {
            snprintf(path, sizeof path, "%s/out-%d-%u", dir, kind, f);
            d.text[0] = '\0';
            pvx_err e = rec_exchange_write(&r, (enum rec_exchange_format)f, path, &d);
            if (f == REC_EXCHANGE_AUTO || f == REC_EXCHANGE_MATLAB || f == REC_EXCHANGE_AGISOFT)
                T_EQ_I(e, PVX_EUNSUP);
            else if (e != PVX_OK)
                T_CONTAINS(d.text, r.cameras[1].name);
            T_OK(kind < 3 || kind > 4 || e == PVX_EUNSUP);
            T_OK(f != REC_EXCHANGE_OPENCV || (kind > 2 && kind < 5) || e == PVX_OK);
        }
    }
    rec_rig_fini(&r);
}

T_CASE(opencv_is_refused)
{
    refuse("a.json", "{\"K\": [[500, 0.3, 300], [0, 510, 200], [0, 0, 1]]}", "skewed pixels (0.3)");
    refuse("a.json", "{\"K\": [[500, 0, 0], [0, 510, 0], [300, 200, 1]]}", "should be fx 0 cx");
    refuse("a.json", "{\"K\": " K3 ", \"D\": [0,0,0,0,0,0,0,0,0.1,0,0,0]}", "thin prism");
    refuse("a.json", "{\"K\": " K3 ", \"D\": [1, 2, 3]}",
           "should have 0, 4, 5, 8, 12 or 14 numbers");
    refuse("a.json", "{\"K\": " K3 ", \"D\": [1,2,3,4,5], \"fisheye\": 1}",
           "4 numbers (k1 k2 k3 k4)");
    refuse("a.json", "{\"K\": " K3 ", \"camera_matrix\": " K3 "}",
           "two of these keys mean the same");
    refuse("a.json", "{\"K\": " K3 ", \"R\": " ONE "}", "has a rotation but no translation");
    refuse("a.json", "{\"K\": " K3 ", \"R\": [1,0,0, 0,1,0, 0,0,-1], \"T\": [0,0,0]}",
           "mirror image");
    refuse("a.json", "{\"K\": " K3 ", \"R\": [2,0,0, 0,1,0, 0,0,1], \"T\": [0,0,0]}",
           "not a rotation");
    refuse("a.json", "{\"K\": " K3 ", \"image_size\": [0, 3]}", "1 to 16384 pixels");
    refuse("a.yml", "K: {rows: 3, cols: 3, data: [1, 2]}\n", "has 2 numbers, not rows x cols");
    refuse("a.xml", "<opencv_storage><K><rows>3</rows></K></opencv_storage>", "rows, cols, data");
    refuse("a.xml", "<opencv_storage>\n<K>\n", "a.xml:");
    refuse("a.yml", "x: 1\n", "holds no camera that is known here");
    refuse("rig.yaml", "volume: 1\ncameras: []\n", "is a rig.yaml already");
}

T_CASE(a_pair_needs_its_cameras)
{
    fresh();
    T_EQ_I(parse("e.json", "{\"R\": " ONE ", \"T\": [1,0,0], \"R1\": " ONE "}"), PVX_OK);
    T_EQ_I(rec_exchange_end(&x, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "give the file with M1 and M2, too");
    T_EQ_I(parse("i.json", "{\"M1\": " K3 ", \"M2\": " K3 "}"), PVX_OK);
    d.text[0] = '\0';
    T_EQ_I(rec_exchange_end(&x, &d), PVX_OK);
    T_NEAR(x.camera[1].c.t[0], 1, 0);
}

T_CASE(other_formats_are_refused)
{
    refuse("k.yaml", "cam0: {camera_model: omni, intrinsics: [1,2,3,4,5]}\n",
           "'omni' is not supported");
    refuse("k.yaml",
           "cam0: {camera_model: pinhole, intrinsics: [500,500,300,200], distortion_model: fov}\n",
           "'fov' is not supported");
    refuse("k.yaml",
           "cam0: {camera_model: pinhole, intrinsics: [500,500,300,200], distortion_model: none}\n"
           "cam1: {camera_model: pinhole, intrinsics: [500,500,300,200], distortion_model: none}\n",
           "k.yaml:2: cam1: T_cn_cnm1 is missing");
    refuse("r.yaml",
           "camera_matrix: {rows: 3, cols: 3, data: [500,0,300,0,510,200,0,0,1]}\n"
           "distortion_model: scaramuzza\n",
           "'scaramuzza' is not supported");
    refuse("j.yaml", "intrinsicMatrix: " K3 "\ndistortionCoefficients: [0,0,0,0,0]\n",
           "is not transposed, as JARVIS writes it");
    refuse("b.json",
           "{\"format\": \"pyrovox-blender-cameras\", \"metres_per_unit\": 1, \"cameras\": "
           "[{\"name\": \"a\", \"type\": \"ORTHO\"}]}",
           "only PERSP is supported");
}

#define SENSOR(values)                                                                            \
    "<document>\n<chunk><sensors><sensor id=\"0\"><calibration type=\"frame\" "                   \
    "class=\"adjusted\">\n"                                                                       \
    "<resolution width=\"640\" height=\"480\"/>" values "</calibration></sensor></sensors>\n"     \
    "<cameras><camera id=\"0\" sensor_id=\"0\" label=\"a.png\"><transform>1 0 0 0 0 1 0 0 0 0 1 " \
    "0 "                                                                                          \
    "0 0 0 1</transform></camera></cameras></chunk></document>"

T_CASE(agisoft_is_refused)
{
    fresh();
    T_EQ_I(parse("m.xml", SENSOR("<f>500</f>")), PVX_OK);
    T_NEAR(x.camera[0].c.cx, 319.5, 0);
    refuse("m.xml", SENSOR("<fx>500</fx>"), "has no <f>");
    refuse("m.xml", SENSOR("<f>500</f><k4>0.1</k4>"), "m.xml:2: calibration: camera 'a' has k4");
    refuse("m.xml", SENSOR("<f>500</f><p3>0.1</p3>"), "p3 or p4");
    refuse("m.xml", SENSOR("<f>500</f><b2>0.1</b2>"), "skewed pixels");
    refuse("m.xml", SENSOR("<f>x</f>"), "'x' is not a finite number");
}

static void colmap(const char *cameras, const char *images, pvx_err want, const char *part)
{
    char path[2][256];
    const char *text[2] = {cameras, images};
    for (int i = 0; i < 2; i++) {
        snprintf(path[i], sizeof path[i], "%s/%s.txt", dir, i ? "images" : "cameras");
        FILE *f = fopen(path[i], "w");
        T_OK(f != NULL);
        if (f != NULL) {
            fputs(text[i], f);
            fclose(f);
        }
    }
    fresh();
    d.text[0] = '\0';
    T_EQ_I(rec_exchange_read(path[0], REC_EXCHANGE_AUTO, &x, &d), want);
    T_CONTAINS(d.text, part);
    unlink(path[0]);
    unlink(path[1]);
}

T_CASE(colmap_is_refused)
{
    const char *pinhole = "# comment\n1 PINHOLE 640 480 500 510 300.5 200.5\n";
    colmap(pinhole, "1 1 0 0 0 1 2 3 1 a/b c.png\n\n", PVX_OK, "");
    T_EQ_S(x.camera[0].c.name, "a_b_c");
    T_NEAR(x.camera[0].c.cx, 300, 0);
    colmap(pinhole, "1 1 0 0 0 1 2 3 7 a.png\n\n", PVX_EFORMAT,
           "images.txt:1: an image has a CAMERA_ID");
    colmap(pinhole, "1 1 1 0 0 1 2 3 1 a.png\n\n", PVX_EFORMAT, "not of unit length");
    colmap(pinhole, "1 1 0 0 0 1 2 3 1\n", PVX_EFORMAT, "images.txt:1: should be IMAGE_ID");
    colmap("1 PINHOLE 640 480 500\n", "", PVX_EFORMAT, "cameras.txt:1: has too few PARAMS");
    colmap("1 FOV 640 480 500 500 300 200 0.9\n", "1 1 0 0 0 1 2 3 1 a.png\n\n", PVX_EUNSUP,
           "camera 'a': this lens model is not supported");
    colmap("1 WHAT 640 480 500\n", "", PVX_EUNSUP, "'WHAT' is not known");
    colmap("1 PINHOLE 1 1 5 5 3 2\n1 PINHOLE 1 1 5 5 3 2\n", "", PVX_EFORMAT, "is there twice");
}

/* A model in COLMAP's binary files, cut after any byte. */
T_CASE(colmap_binary_cut_anywhere)
{
    static const double lens[8] = {500, 510, 300, 200, 0.1, 0, 0, 0},
                        pose[7] = {1, 0, 0, 0, 1, 2, 3};
    unsigned char file[2][400];
    size_t n[2] = {0, 0};
#define PUT(i, T, v) (memcpy(file[i] + n[i], &(T){v}, sizeof(T)), n[i] += sizeof(T))
    PUT(0, uint64_t, 1);
    PUT(0, uint32_t, 1);
    PUT(0, int32_t, 4);
    PUT(0, uint64_t, 640);
    PUT(0, uint64_t, 480);
    memcpy(file[0] + n[0], lens, sizeof lens);
    n[0] += sizeof lens;
    PUT(1, uint64_t, 1);
    PUT(1, uint32_t, 1);
    memcpy(file[1] + n[1], pose, sizeof pose);
    n[1] += sizeof pose;
    PUT(1, uint32_t, 1);
    memcpy(file[1] + n[1], "a.png", 6);
    n[1] += 6;
    PUT(1, uint64_t, 2); /* points of 24 bytes */
    memset(file[1] + n[1], 0, 48);
    n[1] += 48;
    for (int which = 0; which < 2; which++)
        for (size_t cut = 0; cut <= n[which]; cut++) {
            for (int i = 0; i < 2; i++) {
                char path[256];
                snprintf(path, sizeof path, "%s/%s.bin", dir, i ? "images" : "cameras");
                FILE *f = fopen(path, "wb");
                T_OK(f != NULL &&
                     fwrite(file[i], 1, i == which ? cut : n[i], f) == (i == which ? cut : n[i]));
                if (f != NULL)
                    fclose(f);
            }
            fresh();
            d.text[0] = '\0';
            pvx_err e = rec_exchange_read(dir, REC_EXCHANGE_AUTO, &x, &d);
            T_EQ_I(e, cut == n[which] ? PVX_OK : PVX_EFORMAT);
            if (e != PVX_OK)
                T_CONTAINS(d.text, "is cut off");
        }
    T_NEAR(x.camera[0].c.cx, 299.5, 0);
}

/* Cameras on a circle, with all axes through one point. */
T_CASE(where_cameras_look)
{
    static const double to[3] = {0.3, -0.2, 0.7};
    double at[3];
    fresh();
    T_OK(!rec_exchange_aim(&x, at));
    for (x.n = 0; x.n < 5; x.n++) {
        double a = 1.1 * (double)x.n, from[3] = {3 * cos(a), 2 * sin(a), 0.3 * a};
        rec_camera_look(from, to, &x.camera[x.n].c);
    }
    T_OK(rec_exchange_aim(&x, at));
    for (int k = 0; k < 3; k++)
        T_NEAR(at[k], to[k], 1e-12);
}

T_MAIN(scratch_new(), scratch_remove())
