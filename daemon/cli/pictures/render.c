/* render.c - `pyrovox render`: views of volumes from a camera of the rig, any place, or a turntable.
 * Writes one picture, or many (movie.h). */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/pictures/movie.h"
#include "daemon/cli/pictures/strip.h"
#include "daemon/pipeline/volume_file.h"
#include "daemon/volumes/folder.h"
#include "recon/view/render.h"

/* Paths of the volumes to show, in order. */
struct sources {
    char **path;
    size_t n;
};

static bool is_folder(const char *path)
{
    struct stat st;
    return stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

static pvx_err render_add(struct sources *s, const char *dir, const char *name)
{
    char **path = realloc(s->path, (s->n + 1) * sizeof *path);
    PVX_NEED(path);
    s->path = path;
    if (asprintf(&path[s->n], "%s%s%s", dir, *dir != '\0' ? "/" : "", name) < 0)
        return PVX_ENOMEM;
    s->n++;
    return PVX_OK;
}

/* All .npy of a folder, by number. */
static pvx_err render_add_folder(struct sources *s, const char *dir, struct pvx_diag *d)
{
    struct vol_folder f;
    pvx_err e = vol_folder_list(dir, ".npy", &f, d);
    if (e == PVX_OK && f.n == 0)
        e = pvx_fail(d, PVX_ENOENT, "%s: no volumes (.npy) in it", dir);
    for (size_t i = 0; i < f.n && e == PVX_OK; i++)
        e = render_add(s, dir, f.name[i]);
    vol_folder_free(&f);
    return e;
}

/* Whether the volume DIR/NAME.npy is described by its .json. */
static bool render_described(const char *dir, const char *name)
{
    char json[PATH_MAX];
    int n = snprintf(json, sizeof json, "%s%.*s.json", dir, (int)strlen(name) - 4, name);
    return n < (int)sizeof json && access(json, F_OK) == 0;
}

/* Refuse a volume without .json beside others that have one: its box was lost, and the rig's may be another. */
static pvx_err render_check(const char *path, struct pvx_diag *d)
{
    char dir[PATH_MAX];
    const char *slash = strrchr(path, '/');
    struct vol_folder f;
    pvx_err e = PVX_OK;
    if (render_described("", path) || access(path, F_OK) != 0)
        return PVX_OK;
    snprintf(dir, sizeof dir, "%.*s", slash != NULL ? (int)(slash + 1 - path) : 2,
             slash != NULL ? path : "./");
    bool listed = vol_folder_list(dir, ".npy", &f, NULL) == PVX_OK;
    for (size_t i = 0; listed && i < f.n && e == PVX_OK; i++)
        if (render_described(dir, f.name[i]))
            e = pvx_fail(d, PVX_ENOENT,
                         "%s: has no .json with its box, as %s%s has; bring the .json back, or "
                         "move the .npy to a folder of its own, where the rig's box is its box",
                         path, dir, f.name[i]);
    vol_folder_free(&f);
    return e;
}

static pvx_err find_sources(const struct render_options *o, struct sources *s, struct pvx_diag *d)
{
    for (int i = 0; i < o->n_sources; i++) {
        pvx_err e = is_folder(o->source[i]) ? render_add_folder(s, o->source[i], d)
                    : pvx_path_ends(o->source[i], ".npy")
                        ? render_add(s, "", o->source[i])
                        : pvx_fail(d, PVX_EINVAL,
                                   "%s: a volume is a .npy file or a folder of them; of a "
                                   "recording `pyrovox convert --format npy` makes such a folder",
                                   o->source[i]);
        if (e != PVX_OK)
            return e;
    }
    for (size_t i = 0; i < s->n; i++)
        PVX_TRY(render_check(s->path[i], d));
    return PVX_OK;
}

static void free_sources(struct sources *s)
{
    for (size_t i = 0; i < s->n; i++)
        free(s->path[i]);
    free(s->path);
}

/* The rig's camera of the name asked for.  NULL: none is asked for. */
static pvx_err render_find_camera(const struct render_options *o, const struct rec_rig *rig,
                                  const struct rec_camera **out, struct pvx_diag *d)
{
    *out = NULL;
    if (o->from != RENDER_CAMERA)
        return PVX_OK;
    int k = rec_rig_find(rig, o->camera);
    if (k >= 0) {
        *out = &rig->cameras[k];
        return PVX_OK;
    }
    char names[400] = "";
    for (size_t i = 0; i < rig->n_cameras && strlen(names) < 300; i++)
        snprintf(names + strlen(names), sizeof names - strlen(names), " %s", rig->cameras[i].name);
    return pvx_fail(d, PVX_ENOENT, "%s: no camera '%s'; it has%s", o->rig, o->camera, names);
}

static pvx_err render_one(const struct render_options *o, const struct rec_eye *eye,
                          const struct rec_grid *g, const float *dense, int nch, pvx_pool *pool,
                          struct pvx_diag *d)
{
    const struct rec_camera *c = eye->camera;
    size_t n = (size_t)c->width * (size_t)c->height * (size_t)nch;
    float *image = pvx_calloc(n, sizeof *image);
    if (image == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the image", o->out);
    pvx_err e = rec_render(g, dense, nch, eye, pool, image);
    struct look look = o->look;
    bool png = pvx_path_ends(o->out, ".png");
    if (e == PVX_OK && png && look.exposure == 0) {
        e = dmn_auto_exposure(image, n, &look.exposure);
        look.exposure *= look_headroom(&look);
    }
    if (e != PVX_OK)
        pvx_fail(d, e, "%s: %s", o->out, pvx_strerror(e));
    else if (png)
        e = look_save(&look, o->out, image, c->width, c->height, nch, d);
    else
        e = cap_image_save(o->out, image, c->width, c->height, nch, d);
    free(image);
    return e;
}

/* One volume, one file. */
static pvx_err single(const struct render_options *o, const struct rec_rig *rig,
                      const struct rec_camera *camera, const char *path, pvx_pool *pool,
                      struct pvx_diag *d)
{
    struct rec_grid g = rig->grid;
    struct rec_camera ideal;
    struct rec_eye eye = {.camera = camera, .bodies = &rig->bodies, .sub = o->sub};
    float *dense;
    int nch;
    PVX_TRY(dmn_volume_load(path, &g, &nch, &dense, d));
    pvx_err e;
    if (camera != NULL) {
        e = render_one(o, &eye, &g, dense, nch, pool, d);
    } else if (o->from == RENDER_EYE) {
        e = render_eye(o, &g, &ideal, d);
        eye.camera = &ideal;
        PVX_THEN(e, render_one(o, &eye, &g, dense, nch, pool, d));
    } else {
        struct dmn_strip_params p = {.deg0 = o->deg0,
                                     .deg1 = o->deg1,
                                     .views = o->from == RENDER_STRIP ? o->views : 1,
                                     .width = o->width,
                                     .height = o->height,
                                     .sub = o->sub,
                                     .look = o->look,
                                     .bodies = &rig->bodies};
        e = dmn_strip_save(&g, dense, nch, &p, pool, o->out, d);
    }
    free(dense);
    return e;
}

static pvx_err pictures_render(const struct render_options *o, const struct rec_rig *rig,
                               const struct sources *s, pvx_pool *pool, struct pvx_diag *d)
{
    const struct rec_camera *camera;
    PVX_TRY(render_find_camera(o, rig, &camera, d));
    bool file = pvx_path_ends(o->out, ".png") || pvx_path_ends(o->out, ".npy");
    static const char *const others[] = {".gif", ".avi", ".jpg", ".jpeg", ".tif", ".tiff", ".webp"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (pvx_path_ends(o->out, others[i]) && !is_folder(o->out))
            return pvx_fail(d, PVX_EINVAL,
                            "%s: a picture is a .png, a film an .apng, .mp4, .mov, .mkv or .webm; "
                            "other programs make %s of them",
                            o->out, others[i]);
    bool many = s->n != 1 || o->from == RENDER_ORBIT;
    if (o->from == RENDER_STRIP && s->n > 1)
        return pvx_fail(d, PVX_EINVAL,
                        "--strip shows one volume, %s has %zu; --orbit N steps through them",
                        o->source[0], s->n);
    if (o->from == RENDER_STRIP && o->film)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: --strip is one picture, a .png; --orbit N is an animation", o->out);
    if (many && file && !is_folder(o->out))
        return pvx_fail(
            d, PVX_EINVAL,
            "%s: these are several pictures: name a folder, an .apng or a video, or for one view "
            "of one volume a .npy and --camera, --eye or --angle",
            o->out);
    if (many || o->film || (is_folder(o->out) && o->from != RENDER_STRIP))
        return render_movie(o, rig, camera, s->path, s->n, pool, d);
    return single(o, rig, camera, s->path[0], pool, d);
}

static int render_run(int argc, char **argv)
{
    struct render_options o;
    render_parse(argc, argv, &o);
    cli_catch_stop();
    struct pvx_diag d = {""};
    struct rec_rig rig = {.grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {1, 1, 1}, REC_BOX}};
    struct sources s = {0};
    pvx_pool *pool = NULL;
    pvx_err e = o.rig != NULL ? rec_rig_load(o.rig, &rig, &d) : PVX_OK;
    PVX_THEN(e, find_sources(&o, &s, &d));
    PVX_THEN(e, pvx_pool_new(o.threads, "render", &pool));
    PVX_THEN(e, pictures_render(&o, &rig, &s, pool, &d));
    pvx_pool_free(&pool);
    free_sources(&s);
    rec_rig_fini(&rig);
    return cli_end(&d, e, false);
}

const struct cli_command cmd_render = {
    "render", "views of volumes from a camera, any place or a turntable; animations", render_run};
