/* hdf5_head.c - all of an HDF5 file of volumes except the volumes (daemon/VOLUMES.md). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/volumes/hdf5.h"

/* A number as text too: programs that know only doubles lose its last digits. */
static bool put_id(hid_t file, const char *name, uint64_t id)
{
    char text[24];
    snprintf(text, sizeof text, "%llu", (unsigned long long)id);
    return take_h5_put_attr(file, name, H5T_STD_U64LE, &id) &&
           take_h5_put_long_text(file, name, text);
}

bool vol_hdf5_triple(hid_t at, const char *name, double out[3])
{
    if (H5Aexists(at, name) <= 0)
        return false;
    hid_t a = H5Aopen(at, name, H5P_DEFAULT), type = H5Aget_type(a), space = H5Aget_space(a);
    bool ok = H5Tget_class(type) == H5T_FLOAT && H5Sget_simple_extent_npoints(space) == 3 &&
              H5Aread(a, H5T_NATIVE_DOUBLE, out) >= 0;
    H5Sclose(space);
    H5Tclose(type);
    H5Aclose(a);
    for (int i = 0; i < 3 && ok; i++)
        ok = isfinite(out[i]) && fabs(out[i]) < 1e9;
    return ok;
}

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
           put_id(file, "session", s->session) && put_id(file, "rig_hash", s->rig_hash) &&
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

/* What HDF5's high-level library calls a dimension scale, as netCDF and xarray look for it. */
static bool put_scale(hid_t set, const char *name)
{
    return take_h5_put_text(set, "CLASS", "DIMENSION_SCALE") && take_h5_put_text(set, "NAME", name);
}

/* Tell which scale belongs to which dimension of /emission, or of one channel of it. */
static bool put_scales(hid_t file, hid_t set, hsize_t rank)
{
    static const char *const scale[VOL_RANK] = {"time", "z", "y", "x", "channel"};
    hobj_ref_t ref[VOL_RANK];
    hvl_t list[VOL_RANK];
    bool ok = true;
    for (hsize_t a = 0; a < rank; a++) {
        ok = ok && H5Rcreate(&ref[a], file, scale[a], H5R_OBJECT, -1) >= 0;
        list[a] = (hvl_t){1, &ref[a]};
    }
    hid_t type = H5Tvlen_create(H5T_STD_REF_OBJ);
    ok = ok && take_h5_put_list(set, "DIMENSION_LIST", type, rank, list);
    H5Tclose(type);
    return ok;
}

/* Centres of the voxels along one axis; axis 3: numbers of the channels. */
static bool put_axis(hid_t file, const struct pvp_grid *g, int axis)
{
    static const char *const names[] = {"x", "y", "z", "channel"};
    const char *name = names[axis];
    hsize_t n = axis < 3 ? g->n[axis] : g->channels;
    double h = axis < 3 ? (g->max[axis] - g->min[axis]) / g->n[axis] : 1;
    double *at = malloc(n * sizeof *at);
    if (at == NULL)
        return false;
    for (uint32_t i = 0; i < n; i++)
        at[i] = axis < 3 ? g->min[axis] + (i + 0.5) * h : i;
    hid_t space = H5Screate_simple(1, &n, NULL);
    hid_t s = H5Dcreate2(file, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = s >= 0 && H5Dwrite(s, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, at) >= 0 &&
              (axis == 3 || take_h5_put_text(s, "units", "m")) && put_scale(s, name);
    H5Dclose(s);
    H5Sclose(space);
    free(at);
    return ok;
}

/* The names of the axes of NXdata, one for each dimension of its signal. */
static bool put_axes(hid_t group, hsize_t rank)
{
    static const char axes[VOL_RANK][8] = {"time", "z", "y", "x", "channel"};
    hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, sizeof axes[0]);
    bool ok = take_h5_put_list(group, "axes", type, rank, axes);
    H5Tclose(type);
    return ok;
}

static bool also(hid_t file, const char *from, hid_t group, const char *name)
{
    return H5Lcreate_hard(file, from, group, name, H5P_DEFAULT, H5P_DEFAULT) >= 0;
}

hid_t vol_hdf5_group(hid_t at, const char *name)
{
    enum { MOST = 64, NAME = 16 }; /* links, letters of their names */
    hid_t p = H5Pcreate(H5P_GROUP_CREATE);
    H5Pset_link_phase_change(p, MOST, 0);
    H5Pset_est_link_info(p, MOST, NAME);
    hid_t g = H5Gcreate2(at, name, H5P_DEFAULT, p, H5P_DEFAULT);
    H5Pclose(p);
    return g;
}

/* NeXus groups, by which h5web, silx and NeXpy show the data by themselves: `entry`, and what is shown in it. */
static hid_t make_entry(hid_t f, const char *name, const char *signal, hsize_t rank)
{
    hid_t entry = H5Gcreate2(f, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    hid_t data = vol_hdf5_group(entry, "data");
    bool ok =
        take_h5_put_text(f, "default", name) && take_h5_put_text(entry, "NX_class", "NXentry") &&
        take_h5_put_text(entry, "default", "data") &&
        take_h5_put_text(data, "NX_class", "NXdata") && take_h5_put_text(data, "signal", signal) &&
        put_axes(data, rank) && also(f, "/sets/time", data, "time") && also(f, "/z", data, "z") &&
        also(f, "/y", data, "y") && also(f, "/x", data, "x");
    H5Gclose(entry);
    if (ok)
        return data;
    H5Gclose(data);
    return -1;
}

/* One channel of all sets, [set][z][y][x], without a copy. */
static bool put_channel(hid_t file, hid_t data, const char *of, const char *name,
                        const struct pvp_grid *g, uint64_t sets, uint32_t channel)
{
    const hsize_t all[VOL_RANK] = {sets, g->n[2], g->n[1], g->n[0], g->channels};
    const hsize_t n[VOL_RANK] = {sets, g->n[2], g->n[1], g->n[0], 1},
                  at[VOL_RANK] = {[4] = channel};
    hid_t from = H5Screate_simple(VOL_RANK, all, NULL), to = H5Screate_simple(4, all, NULL);
    hid_t p = H5Pcreate(H5P_DATASET_CREATE);
    bool ok = H5Sselect_hyperslab(from, H5S_SELECT_SET, at, NULL, n, NULL) >= 0 &&
              H5Pset_virtual(p, to, ".", of, from) >= 0;
    hid_t s = ok ? H5Dcreate2(data, name, H5T_IEEE_F32LE, to, H5P_DEFAULT, p, H5P_DEFAULT) : -1;
    ok = s >= 0 && put_scales(file, s, 4);
    if (s >= 0)
        H5Dclose(s);
    H5Pclose(p);
    H5Sclose(from);
    H5Sclose(to);
    return ok;
}

/* Viewers show the last two dimensions, which are x and channel in /emission.  Here they are y and x. */
bool vol_hdf5_flame(hid_t file, const struct pvp_grid *g, uint64_t sets)
{
    static const char colour[3][8] = {"red", "green", "blue"};
    const bool grey = g->channels == 1;
    hid_t data = make_entry(file, "flame", grey ? "density" : colour[0], 4), type = -1;
    bool ok = data >= 0;
    const bool bars = H5Lexists(file, "emission_sd", H5P_DEFAULT) > 0;
    for (uint32_t c = 0; c < g->channels && ok; c++) {
        const char *name = grey ? "density" : colour[c];
        char errors[24];
        snprintf(errors, sizeof errors, "%s_errors", name);
        ok = put_channel(file, data, "/emission", name, g, sets, c) &&
             (!bars || put_channel(file, data, "/emission_sd", errors, g, sets, c));
    }
    if (ok && !grey) {
        type = H5Tcopy(H5T_C_S1);
        H5Tset_size(type, sizeof colour[0]);
        ok = take_h5_put_list(data, "auxiliary_signals", type, 2, colour + 1);
        H5Tclose(type);
    }
    H5Gclose(data);
    return ok;
}

bool vol_hdf5_nexus(hid_t file, const struct vol_head *h)
{
    const struct pvp_grid *g = &h->start.grid;
    hid_t emission = H5Dopen2(file, "emission", H5P_DEFAULT);
    hid_t time = H5Dopen2(file, "sets/time", H5P_DEFAULT);
    bool ok = emission >= 0 && time >= 0 && put_axis(file, g, 0) && put_axis(file, g, 1) &&
              put_axis(file, g, 2) && put_axis(file, g, 3) &&
              also(file, "/sets/time", file, "time") && put_scale(time, "time") &&
              put_scales(file, emission, VOL_RANK) &&
              take_h5_put_text(emission, "units", h->start.units) &&
              take_h5_put_text(time, "units", "s") && take_h5_put_text(file, "NX_class", "NXroot");
    hid_t data = ok ? make_entry(file, "entry", "emission", VOL_RANK) : -1;
    ok = data >= 0 && also(file, "/emission", data, "emission") &&
         also(file, "/channel", data, "channel");
    H5Gclose(data);
    H5Dclose(time);
    H5Dclose(emission);
    return ok;
}

bool vol_hdf5_errors(hid_t file, hid_t sd, const struct vol_head *h)
{
    hid_t data = H5Gopen2(file, "entry/data", H5P_DEFAULT);
    bool ok = data >= 0 && put_scales(file, sd, VOL_RANK) &&
              take_h5_put_text(sd, "units", h->start.units) &&
              take_h5_put_text(sd, "long_name", "one standard deviation of emission") &&
              H5Olink(sd, data, "emission_errors", H5P_DEFAULT, H5P_DEFAULT) >= 0;
    H5Gclose(data);
    return ok;
}
