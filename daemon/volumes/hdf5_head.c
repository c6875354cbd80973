/* hdf5_head.c - all of an HDF5 file of volumes except the volumes (daemon/VOLUMES.md). */
#include <stdlib.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/volumes/hdf5.h"

bool vol_hdf5_head(hid_t file, const struct vol_head *h)
{
    const struct pvp_start *s = &h->start;
    char host[256] = "";
    double spacing[3];
    for (int a = 0; a < 3; a++)
        spacing[a] = (s->grid.max[a] - s->grid.min[a]) / s->grid.n[a];
    gethostname(host, sizeof host - 1);
    return take_h5_put_text(file, "format", VOL_FORMAT) &&
           take_h5_put_int(file, "version", VOL_VERSION) &&
           take_h5_put_int(file, "t_created_ns", pvx_now_real()) &&
           take_h5_put_int(file, "t_closed_ns", 0) && take_h5_put_int(file, "closed", 0) &&
           take_h5_put_attr(file, "session", H5T_STD_U64LE, &s->session) &&
           take_h5_put_attr(file, "rig_hash", H5T_STD_U64LE, &s->rig_hash) &&
           take_h5_put_attr(file, "fps", H5T_IEEE_F64LE, &s->fps) &&
           take_h5_put_int(file, "n_cameras", s->n_cameras) &&
           take_h5_put_text(file, "units", s->units) &&
           take_h5_put_text(file, "software", s->software) &&
           take_h5_put_text(file, "host", host) &&
           take_h5_put_text(file, "basis", s->grid.basis == 1 ? "trilinear" : "box") &&
           take_h5_put_list(file, "origin", H5T_IEEE_F64LE, 3, s->grid.min) &&
           take_h5_put_list(file, "spacing", H5T_IEEE_F64LE, 3, spacing) &&
           take_h5_put_long_text(file, "rig", h->rig != NULL ? h->rig : "") &&
           take_h5_put_long_text(file, "config", h->config != NULL ? h->config : "");
}

/* Centres of the voxels along one axis. */
static bool put_axis(hid_t file, const struct pvp_grid *g, int axis)
{
    const char name[2] = {"xyz"[axis], '\0'};
    double h = (g->max[axis] - g->min[axis]) / g->n[axis], *at = malloc(g->n[axis] * sizeof *at);
    hsize_t n = g->n[axis];
    if (at == NULL)
        return false;
    for (uint32_t i = 0; i < g->n[axis]; i++)
        at[i] = g->min[axis] + (i + 0.5) * h;
    hid_t space = H5Screate_simple(1, &n, NULL);
    hid_t s = H5Dcreate2(file, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = s >= 0 && H5Dwrite(s, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, at) >= 0 &&
              take_h5_put_text(s, "units", "m");
    H5Dclose(s);
    H5Sclose(space);
    free(at);
    return ok;
}

/* The names of the axes of NXdata, one for each dimension of its signal. */
static bool put_axes(hid_t group)
{
    static const char axes[VOL_RANK][8] = {"time", "z", "y", "x", "."};
    hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, sizeof axes[0]);
    bool ok = take_h5_put_list(group, "axes", type, VOL_RANK, axes);
    H5Tclose(type);
    return ok;
}

static bool also(hid_t file, const char *from, hid_t group, const char *name)
{
    return H5Lcreate_hard(file, from, group, name, H5P_DEFAULT, H5P_DEFAULT) >= 0;
}

/* NeXus groups, by which h5web, silx and NeXpy show the data by themselves. */
static bool make_entry(hid_t f)
{
    hid_t entry = H5Gcreate2(f, "entry", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    hid_t data = H5Gcreate2(f, "entry/data", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = take_h5_put_text(f, "NX_class", "NXroot") &&
              take_h5_put_text(f, "default", "entry") &&
              take_h5_put_text(entry, "NX_class", "NXentry") &&
              take_h5_put_text(entry, "default", "data") &&
              take_h5_put_text(data, "NX_class", "NXdata") &&
              take_h5_put_text(data, "signal", "emission") && put_axes(data) &&
              also(f, "/emission", data, "emission") && also(f, "/sets/time", data, "time") &&
              also(f, "/z", data, "z") && also(f, "/y", data, "y") && also(f, "/x", data, "x");
    H5Gclose(data);
    H5Gclose(entry);
    return ok;
}

bool vol_hdf5_nexus(hid_t file, const struct vol_head *h)
{
    const struct pvp_grid *g = &h->start.grid;
    hid_t emission = H5Dopen2(file, "emission", H5P_DEFAULT);
    hid_t time = H5Dopen2(file, "sets/time", H5P_DEFAULT);
    bool ok = emission >= 0 && time >= 0 && put_axis(file, g, 0) && put_axis(file, g, 1) &&
              put_axis(file, g, 2) && take_h5_put_text(emission, "units", h->start.units) &&
              take_h5_put_text(time, "units", "s") && make_entry(file);
    H5Dclose(time);
    H5Dclose(emission);
    return ok;
}
