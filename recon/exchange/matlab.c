/* matlab.c - toStruct(stereoParameters) or toStruct(cameraParameters) of MATLAB, saved with -v7.3 (HDF5).
 *
 * HDF5 has MATLAB's columns as rows: what is read row by row here is the transposed matrix.  MATLAB's IntrinsicMatrix and
 * RotationOfCamera2 are of row vectors (x R + t), so they come out right; K (R2022b and later) has to be transposed.
 * The first pixel's centre is (1, 1).  Source: MathWorks, stereoParametersToOpenCV, cameraParameters. */
#include <hdf5.h>
#include <stdio.h>
#include <string.h>

#include "recon/exchange/fields.h"

bool exchange_is_matlab(const char *text, size_t len)
{
    return (len >= 8 && memcmp(text, "\211HDF\r\n\032\n", 8) == 0) ||
           (len >= 7 && memcmp(text, "MATLAB ", 7) == 0);
}

static bool matlab_has(hid_t at, const char *name)
{
    return H5Lexists(at, name, H5P_DEFAULT) > 0;
}

/* All numbers of a dataset of at most `room`; n 0: there is none of this name. */
static pvx_err matlab_numbers(const struct exchange_in *in, hid_t at, const char *name, size_t room,
                              double *out, size_t *n)
{
    *n = 0;
    if (!matlab_has(at, name))
        return PVX_OK;
    hid_t set = H5Dopen2(at, name, H5P_DEFAULT);
    hid_t space = set >= 0 ? H5Dget_space(set) : -1;
    hssize_t count = space >= 0 ? H5Sget_simple_extent_npoints(space) : -1;
    bool ok = count >= 0 && (size_t)count <= room && H5Aexists(set, "MATLAB_empty") <= 0;
    if (ok && count > 0)
        ok = H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, out) >= 0;
    if (space >= 0)
        H5Sclose(space);
    if (set >= 0)
        H5Dclose(set);
    if (!ok)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: %s cannot be read, or has not at most %zu numbers",
                        in->path, name, room);
    *n = (size_t)count;
    return PVX_OK;
}

static pvx_err matlab_exactly(const struct exchange_in *in, hid_t at, const char *name, size_t n,
                              double *out)
{
    size_t got;
    PVX_TRY(matlab_numbers(in, at, name, n, out, &got));
    if (got != n)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: %s is missing, or has not %zu numbers", in->path,
                        name, n);
    return PVX_OK;
}

static pvx_err matlab_unit(const struct exchange_in *in, hid_t at)
{
    static const struct {
        const char *name;
        double metres;
    } units[] = {{"millimeters", 1e-3}, {"millimetres", 1e-3}, {"mm", 1e-3},
                 {"centimeters", 1e-2}, {"centimetres", 1e-2}, {"cm", 1e-2},
                 {"meters", 1},         {"metres", 1},         {"m", 1},
                 {"inches", 0.0254},    {"in", 0.0254}};
    double v[32];
    char word[33];
    size_t n;
    PVX_TRY(matlab_numbers(in, at, "WorldUnits", 32, v, &n)); /* characters are numbers here */
    for (size_t i = 0; i < n; i++)
        word[i] = v[i] >= ' ' && v[i] < 127 ? (char)v[i] : '?';
    word[n] = '\0';
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(word, units[i].name) == 0)
            return exchange_unit(in, units[i].metres);
    return PVX_OK;
}

static pvx_err matlab_lens(const struct exchange_in *in, hid_t at, struct rec_exchange_camera *c)
{
    double v[9], K[9], radial[3] = {0}, p[2] = {0}, size[2];
    size_t n, m;
    const bool old = matlab_has(at, "IntrinsicMatrix");
    PVX_TRY(matlab_exactly(in, at, old ? "IntrinsicMatrix" : "K", 9, v));
    if (old)
        memcpy(K, v, sizeof K);
    else
        exchange_transpose(v, K);
    PVX_TRY(exchange_lens(in, 0, old ? "IntrinsicMatrix" : "K", K, 1, c));
    PVX_TRY(matlab_numbers(in, at, "RadialDistortion", 3, radial, &n));
    PVX_TRY(matlab_numbers(in, at, "TangentialDistortion", 2, p, &m));
    const double k[5] = {radial[0], radial[1], p[0], p[1], radial[2]};
    PVX_TRY(exchange_distortion(in, 0, "RadialDistortion", REC_PINHOLE, k, 5, c));
    PVX_TRY(matlab_numbers(in, at, "ImageSize", 2, size, &n));
    if (n == 2) /* rows, columns */
        PVX_TRY(exchange_size(in, 0, "ImageSize", (double[]){size[1], size[0]}, c));
    return matlab_unit(in, at);
}

static pvx_err matlab_one(const struct exchange_in *in, hid_t at, const char *group,
                          const char *name, struct rec_exchange_camera **c)
{
    hid_t g = H5Gopen2(at, group, H5P_DEFAULT);
    if (g < 0)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: %s is not a structure", in->path, group);
    pvx_err e = exchange_camera(in->x, in->path, name, c, in->d);
    PVX_THEN(e, matlab_lens(in, g, *c));
    H5Gclose(g);
    return e;
}

static pvx_err matlab_pair(const struct exchange_in *in, hid_t at)
{
    static const double one[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, zero[3];
    struct rec_exchange_camera *a, *b;
    double R[9], t[3];
    PVX_TRY(matlab_one(in, at, "CameraParameters1", "cam1", &a));
    PVX_TRY(matlab_one(in, at, "CameraParameters2", "cam2", &b));
    if (!matlab_has(at, "RotationOfCamera2"))
        return pvx_fail(in->d, PVX_EFORMAT,
                        "%s: RotationOfCamera2 is missing: in MATLAB, [~,~,~,~,R,T] = "
                        "stereoParametersToOpenCV(stereoParams); s.RotationOfCamera2 = R'; "
                        "s.TranslationOfCamera2 = T; and save s again",
                        in->path);
    PVX_TRY(matlab_exactly(in, at, "RotationOfCamera2", 9, R));
    PVX_TRY(matlab_exactly(in, at, "TranslationOfCamera2", 3, t));
    PVX_TRY(exchange_pose(in, 0, "CameraParameters1", one, zero, a));
    return exchange_pose(in, 0, "RotationOfCamera2", R, t, b);
}

/* What is at the root, or in the first structure in it that is a camera's or a pair's. */
struct matlab_find {
    hid_t found;
    bool object;
};

static herr_t matlab_visit(hid_t root, const char *name, const H5L_info_t *info, void *ctx)
{
    struct matlab_find *f = ctx;
    (void)info;
    if (strcmp(name, "#subsystem#") == 0)
        f->object = true;
    hid_t g = strchr(name, '#') == NULL ? H5Oopen(root, name, H5P_DEFAULT) : -1;
    if (g < 0)
        return 0;
    if (H5Iget_type(g) == H5I_GROUP && f->found < 0 &&
        (matlab_has(g, "CameraParameters1") || matlab_has(g, "IntrinsicMatrix") ||
         (matlab_has(g, "K") && matlab_has(g, "RadialDistortion"))))
        f->found = g;
    else
        H5Oclose(g);
    return 0;
}

static pvx_err matlab_file(const struct exchange_in *in, hid_t file)
{
    struct matlab_find f = {-1, false};
    struct rec_exchange_camera *c;
    char name[REC_NAME_MAX];
    hid_t root = H5Gopen2(file, "/", H5P_DEFAULT);
    if (root < 0)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: cannot be read as HDF5", in->path);
    const bool here = matlab_has(root, "CameraParameters1") || matlab_has(root, "IntrinsicMatrix");
    if (!here)
        (void)H5Literate(root, H5_INDEX_NAME, H5_ITER_INC, NULL, matlab_visit, &f);
    hid_t at = here ? root : f.found;
    pvx_err e;
    if (at < 0)
        e = pvx_fail(in->d, PVX_EFORMAT,
                     "%s: holds no structure of camera parameters%s: in MATLAB, s = "
                     "toStruct(stereoParams); save('rig.mat', 's', '-v7.3')",
                     in->path, f.object ? " but an object, which only MATLAB can read" : "");
    else if (matlab_has(at, "CameraParameters1"))
        e = matlab_pair(in, at);
    else {
        exchange_stem(in->path, name);
        e = exchange_camera(in->x, in->path, name, &c, in->d);
        PVX_THEN(e, matlab_lens(in, at, c));
    }
    if (f.found >= 0)
        H5Oclose(f.found);
    H5Gclose(root);
    return e;
}

pvx_err exchange_read_matlab(const struct exchange_in *in)
{
    pvx_err e = PVX_OK;
    H5E_auto2_t old;
    void *old_data;
    H5Eget_auto2(H5E_DEFAULT, &old, &old_data);
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL); /* no trace of the library's on stderr */
    hid_t file = H5Fis_hdf5(in->path) > 0 ? H5Fopen(in->path, H5F_ACC_RDONLY, H5P_DEFAULT) : -1;
    if (file < 0)
        e = pvx_fail(in->d, PVX_EFORMAT,
                     "%s: is not HDF5: in MATLAB, save it with '-v7.3', as s = "
                     "toStruct(stereoParams); save('rig.mat', 's', '-v7.3')",
                     in->path);
    else {
        e = matlab_file(in, file);
        H5Fclose(file);
    }
    H5Eset_auto2(H5E_DEFAULT, old, old_data);
    return e;
}
