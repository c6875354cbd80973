/* hdf5_vtk.c - /VTKHDF: an image of points at the voxels' centres.
 *
 * One volume: version 1.0 of that format, which every reader knows, [z][y][x][c]: a virtual dataset on the only set.
 * Several: version 2.0, in which an image's arrays have time before z, as /emission has, so /emission is linked. */
#include <stdio.h>
#include <string.h>

#include "daemon/volumes/hdf5.h"

/* ASCII, without the terminating 0, as the reader of this format compares the length too. */
static bool put_type(hid_t at)
{
    static const char image[] = "ImageData";
    hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, sizeof image - 1);
    H5Tset_strpad(type, H5T_STR_NULLPAD);
    bool ok = take_h5_put_attr(at, "Type", type, image);
    H5Tclose(type);
    return ok;
}

static bool put_image(hid_t at, const struct pvp_grid *g, bool several)
{
    const int64_t version[2] = {several ? 2 : 1, 0};
    const double turn[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    int64_t extent[6];
    double first[3], spacing[3];
    for (int a = 0; a < 3; a++) {
        spacing[a] = (g->max[a] - g->min[a]) / g->n[a];
        first[a] = g->min[a] + spacing[a] / 2;
        extent[2 * a] = 0;
        extent[2 * a + 1] = (int64_t)g->n[a] - 1;
    }
    return take_h5_put_list(at, "Version", H5T_STD_I64LE, 2, version) && put_type(at) &&
           take_h5_put_list(at, "WholeExtent", H5T_STD_I64LE, 6, extent) &&
           take_h5_put_list(at, "Origin", H5T_IEEE_F64LE, 3, first) &&
           take_h5_put_list(at, "Spacing", H5T_IEEE_F64LE, 3, spacing) &&
           take_h5_put_list(at, "Direction", H5T_IEEE_F64LE, 9, turn);
}

/* Set 0 of /emission or /emission_sd without its first dimension; without its last one too when there is one colour. */
static bool put_only_set(hid_t points, const char *name, const struct pvp_grid *g)
{
    const hsize_t all[VOL_RANK] = {1, g->n[2], g->n[1], g->n[0], g->channels};
    const hsize_t at[VOL_RANK] = {0};
    hid_t from = H5Screate_simple(VOL_RANK, all, NULL);
    hid_t to = H5Screate_simple(g->channels == 1 ? 3 : 4, all + 1, NULL);
    hid_t p = H5Pcreate(H5P_DATASET_CREATE);
    char path[32];
    snprintf(path, sizeof path, "/%s", name);
    bool ok = H5Sselect_hyperslab(from, H5S_SELECT_SET, at, NULL, all, NULL) >= 0 &&
              H5Pset_virtual(p, to, ".", path, from) >= 0;
    hid_t s = ok ? H5Dcreate2(points, name, H5T_IEEE_F32LE, to, H5P_DEFAULT, p, H5P_DEFAULT) : -1;
    if (s >= 0)
        H5Dclose(s);
    H5Pclose(p);
    H5Sclose(from);
    H5Sclose(to);
    return s >= 0;
}

static bool put_steps(hid_t file, hid_t vtk, uint64_t sets)
{
    hid_t steps = H5Gcreate2(vtk, "Steps", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = steps >= 0 && take_h5_put_int(steps, "NSteps", (int64_t)sets) &&
              H5Lcreate_hard(file, "/sets/time", steps, "Values", H5P_DEFAULT, H5P_DEFAULT) >= 0;
    H5Gclose(steps);
    return ok;
}

static bool also_points(hid_t file, const char *from, hid_t points, const char *name)
{
    return H5Lcreate_hard(file, from, points, name, H5P_DEFAULT, H5P_DEFAULT) >= 0;
}

bool vol_hdf5_vtk(hid_t file, const struct pvp_grid *g, uint64_t sets)
{
    if (sets == 0)
        return true;
    if (!vol_hdf5_flame(file, g, sets))
        return false;
    /* h5repack -f NONE (1.10.8) crashes unless it meets the volumes as /emission first, and then what is virtual.  It
     * goes by names and does not follow soft links. */
    hid_t vtk = H5Gcreate2(file, "vtkhdf", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    hid_t points = H5Gcreate2(file, "vtkhdf/PointData", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = vtk >= 0 && points >= 0 &&
              H5Lcreate_soft("/vtkhdf", file, "VTKHDF", H5P_DEFAULT, H5P_DEFAULT) >= 0 &&
              put_image(vtk, g, sets > 1);
    const bool bars = H5Lexists(file, "emission_sd", H5P_DEFAULT) > 0;
    if (ok && sets == 1)
        ok = put_only_set(points, "emission", g) &&
             (!bars || put_only_set(points, "emission_sd", g));
    else if (ok)
        ok = also_points(file, "/emission", points, "emission") &&
             (!bars || also_points(file, "/emission_sd", points, "emission_sd")) &&
             put_steps(file, vtk, sets);
    H5Gclose(points);
    H5Gclose(vtk);
    return ok;
}
