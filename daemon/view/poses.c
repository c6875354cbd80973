#include "daemon/view/poses.h"

#include <stdlib.h>

#include "daemon/control/json.h"
#include "recon/geom/rig.h"

#define CAMERA_TEXT 768 /* bytes that one camera takes at most */

static void poses_point(struct dmn_json *j, const char *key, const double v[3])
{
    dmn_json_open(j, key, '[');
    for (int a = 0; a < 3; a++)
        dmn_json_num(j, NULL, v[a]);
    dmn_json_close(j, ']');
}

static void poses_camera(struct dmn_json *j, const struct rec_camera *c)
{
    double eye[3], dir[4][3];
    int n = 0;
    for (int i = 0; i < 4; i++) {
        double u = i == 1 || i == 2 ? c->width - 0.5 : -0.5, v = i >= 2 ? c->height - 0.5 : -0.5;
        n += rec_camera_ray(c, u, v, eye, dir[i]);
    }
    rec_camera_centre(c, eye);
    for (int i = 0; i < 4 && c->model >= REC_TELECENTRIC; i++) { /* drawn from its middle */
        double u = i == 1 || i == 2 ? c->width - 0.5 : -0.5, v = i >= 2 ? c->height - 0.5 : -0.5;
        double o[3];
        if (rec_camera_ray(c, u, v, o, dir[i]))
            for (int a = 0; a < 3; a++)
                dir[i][a] += o[a] - eye[a];
    }
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "name", c->name);
    poses_point(j, "eye", eye);
    dmn_json_open(j, "corner", '[');
    for (int i = 0; n == 4 && i < 4; i++) /* a lens that folds back before the corner has none */
        poses_point(j, NULL, dir[i]);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

pvx_err view_poses(const char *yaml, size_t len, char **out, struct pvx_diag *d)
{
    struct rec_rig rig;
    struct dmn_json j;
    *out = NULL;
    PVX_TRY(rec_rig_parse(yaml, len, "rig", &rig, d));
    size_t size = CAMERA_TEXT * (rig.n_cameras + 1);
    *out = malloc(size);
    if (*out != NULL) {
        dmn_json_init(&j, *out, size);
        dmn_json_open(&j, NULL, '{');
        dmn_json_open(&j, "rig", '{');
        dmn_json_open(&j, "cameras", '[');
        for (size_t i = 0; i < rig.n_cameras; i++)
            poses_camera(&j, &rig.cameras[i]);
        dmn_json_close(&j, ']');
        dmn_json_close(&j, '}');
        dmn_json_close(&j, '}');
    }
    rec_rig_fini(&rig);
    return *out == NULL ? PVX_ENOMEM : PVX_OK;
}
