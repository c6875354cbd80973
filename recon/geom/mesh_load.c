/* Mesh files by libassimp: it reads STL and PLY, as text and binary, either byte order, is in every
 * distribution, and has a fuzzer of its own running on it day and night (OSS-Fuzz).  Loaded where a rig names a mesh: who
 * has none does not need it. */
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include <assimp/cimport.h>
#include <assimp/scene.h>

#include "base/mem.h"
#include "recon/geom/body.h"

/* A million triangles as text; ten million do not get as far as memory. */
#define FILE_MAX (300L << 20)

struct assimp {
    const struct aiScene *(*import)(const char *, unsigned);
    void (*release)(const struct aiScene *);
    const char *(*why)(void);
};

static bool find(struct assimp *a)
{
    void *so = dlopen("libassimp.so.5", RTLD_NOW | RTLD_LOCAL); /* never unloaded */
    if (so == NULL)
        return false;
    *(void **)&a->import = dlsym(so, "aiImportFile");
    *(void **)&a->release = dlsym(so, "aiReleaseImport");
    *(void **)&a->why = dlsym(so, "aiGetErrorString");
    return a->import != NULL && a->release != NULL && a->why != NULL;
}

/* Of a face with so many corners; a point or a line covers nothing. */
static size_t triangles(const struct aiFace *f)
{
    return f->mNumIndices >= 3 ? f->mNumIndices - 2 : 0;
}

static size_t count(const struct aiScene *s)
{
    size_t n = 0;
    for (unsigned i = 0; i < s->mNumMeshes; i++)
        for (unsigned f = 0; f < s->mMeshes[i]->mNumFaces; f++)
            n += triangles(&s->mMeshes[i]->mFaces[f]);
    return n;
}

/* assimp takes a PLY's faces as they are written, and its own cutting into triangles ends the program where none is one. */
static pvx_err check_faces(const struct aiScene *s, struct pvx_diag *d)
{
    for (unsigned i = 0; i < s->mNumMeshes; i++) {
        const struct aiMesh *m = s->mMeshes[i];
        for (unsigned f = 0; f < m->mNumFaces; f++) {
            if (m->mFaces[f].mNumIndices > 4)
                return pvx_fail(d, PVX_EFORMAT,
                                "a face has %u corners; export the mesh as triangles, which are "
                                "never bent inwards",
                                m->mFaces[f].mNumIndices);
            for (unsigned k = 0; k < m->mFaces[f].mNumIndices; k++)
                if (m->mFaces[f].mIndices[k] >= m->mNumVertices)
                    return pvx_fail(d, PVX_EFORMAT,
                                    "a face has a corner that is not among the vertices; export "
                                    "the mesh again");
        }
    }
    return PVX_OK;
}

/* Corners of all triangles; returns how many triangles. */
static size_t gather(const struct aiScene *s, double scale, double *out)
{
    size_t n = 0;
    for (unsigned i = 0; i < s->mNumMeshes; i++) {
        const struct aiMesh *m = s->mMeshes[i];
        for (unsigned f = 0; f < m->mNumFaces; f++)
            for (size_t t = 0; t < triangles(&m->mFaces[f]); t++, n++)
                for (size_t k = 0; k < 3; k++) { /* 0 1 2, 0 2 3 */
                    const struct aiVector3D *v =
                        &m->mVertices[m->mFaces[f].mIndices[k > 0 ? t + k : 0]];
                    out[9 * n + 3 * k] = scale * (double)v->x;
                    out[9 * n + 3 * k + 1] = scale * (double)v->y;
                    out[9 * n + 3 * k + 2] = scale * (double)v->z;
                }
    }
    return n;
}

static pvx_err convert(const struct aiScene *s, double scale, struct rec_mesh **out,
                       struct pvx_diag *d)
{
    size_t n = count(s);
    if (n > REC_MESH_MAX) /* without a copy: says the same */
        return rec_mesh_new(NULL, n, out, d);
    double *corner = pvx_calloc(9 * (n > 0 ? n : 1), sizeof *corner);
    if (corner == NULL)
        return PVX_ENOMEM;
    n = gather(s, scale, corner);
    pvx_err e = rec_mesh_new(corner, n, out, d);
    PVX_FREE(corner);
    return e;
}

static pvx_err of_this_size(const struct rec_mesh *m, double side, struct pvx_diag *d)
{
    double min[3], max[3], longest = 0;
    rec_mesh_box(m, min, max);
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, max[a] - min[a]);
    if (longest <= 100 * side)
        return PVX_OK;
    return pvx_fail(
        d, PVX_EINVAL,
        "it is %.4g m long, over a hundred times the volume's %.4g m; is it in millimetres? "
        "scale: 0.001",
        longest, side);
}

/* Only what a maker of scans and a maker of parts write; assimp would read forty more formats. */
static pvx_err readable(const char *path, struct pvx_diag *d)
{
    struct stat st;
    const char *dot = strrchr(path, '.');
    if (dot == NULL || (strcasecmp(dot, ".stl") != 0 && strcasecmp(dot, ".ply") != 0))
        return pvx_fail(d, PVX_EFORMAT,
                        "should end with .stl or .ply; export the mesh as one of these");
    if (stat(path, &st) != 0 || !S_ISREG(st.st_mode))
        return pvx_fail(d, PVX_ENOENT,
                        "there is no such file; a path is relative to the rig's folder");
    if (st.st_size > FILE_MAX)
        return pvx_fail(
            d, PVX_EINVAL,
            "%lld MiB are more than %d triangles take; simplify the mesh, a voxel sees no "
            "more",
            (long long)(st.st_size >> 20), REC_MESH_MAX);
    return PVX_OK;
}

/* A PLY says how many elements follow, and assimp makes room for them before it looks: of a byte each at least, they have
 * to fit into the file.  In a head without an end it would look for one for ever. */
static pvx_err elements_fit(const char *path, struct pvx_diag *d)
{
    char line[256];
    long long n = 0, bytes = 0;
    bool ends = false;
    FILE *f = fopen(path, "rb");
    if (f == NULL)
        return pvx_fail(d, PVX_ENOENT, "cannot be opened: %s", strerror(errno));
    for (int i = 0; i < 1000 && !ends && fgets(line, sizeof line, f) != NULL; i++) {
        char *count = strncmp(line, "element ", 8) == 0 ? strchr(line + 8, ' ') : NULL;
        long long some = count != NULL ? strtoll(count, NULL, 10) : 0;
        n = some > LLONG_MAX - n ? LLONG_MAX : n + some;
        if (some < 0)
            n = LLONG_MAX;
        ends = strcmp(line, "end_header\n") == 0 || strcmp(line, "end_header\r\n") == 0;
    }
    bool known = fseek(f, 0, SEEK_END) == 0 && (bytes = ftell(f)) >= 0;
    fclose(f);
    return ends && known && n <= bytes
               ? PVX_OK
               : pvx_fail(d, PVX_EFORMAT,
                          "its head has no end, or says more vertices and faces than "
                          "its %lld bytes can hold: it was cut off; export the mesh "
                          "again",
                          bytes);
}

pvx_err rec_mesh_load(const char *path, double scale, double side, struct rec_mesh **out,
                      struct pvx_diag *d)
{
    struct assimp a;
    *out = NULL;
    PVX_TRY(readable(path, d));
    if (!find(&a))
        return pvx_fail(d, PVX_EUNSUP,
                        "meshes are read by libassimp 5, which is not installed; apt install "
                        "libassimp5, or use boxes and cylinders");
    if (strcasecmp(strrchr(path, '.'), ".ply") == 0)
        PVX_TRY(elements_fit(path, d));
    const struct aiScene *s = a.import(path, 0);
    if (s == NULL)
        return pvx_fail(d, PVX_EFORMAT, "cannot be read: %s; export the mesh again", a.why());
    pvx_err e = check_faces(s, d);
    if (e == PVX_OK)
        e = convert(s, scale, out, d);
    a.release(s);
    if (e == PVX_OK && (e = of_this_size(*out, side, d)) != PVX_OK)
        rec_mesh_free(out);
    return e;
}
