#include "daemon/volumes/openvdb_shim.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <istream>
#include <map>
#include <memory>
#include <new>
#include <sstream>
#include <streambuf>
#include <string>
#include <vector>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>

#include <nanovdb/util/GridChecksum.h>
#include <nanovdb/util/GridValidator.h>
#include <nanovdb/util/IO.h>

#include "base/guarded.hpp"
#include "daemon/volumes/nanovdb_grids.h"

namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::GridBase;
using openvdb::Vec3f;
using openvdb::Vec3SGrid;

using vol::CELLS;
using vol::leaf_cell;
using vol::SIDE;
constexpr float MOST_HALF = 65504;

/* Runs f(); what it throws is an error of the file. */
template <typename F> int vdb_guarded(char *err, size_t err_size, F f) noexcept
{
    return guarded(
        err, err_size,
        [&]() -> int {
            /* vdb_child.c forks.  A child has no threads of TBB, and would wait for those that its parent had. */
            static const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
            openvdb::initialize();
            try {
                return f();
            } catch (const std::length_error &) {
                return fail(PVX_EFORMAT, err, err_size, "a length in it cannot be");
            }
        },
        PVX_EFORMAT);
}

/* ---- bricks to leaves --------------------------------------------------------------------------- */

Coord coord(const vol::Index &at)
{
    return Coord(at.x, at.y, at.z);
}

/* A leaf for each brick that has a voxel with flame; `get`: the leaf's value of a voxel's channels. */
template <typename GridT, typename F>
GridBase::Ptr make_grid(const vol_vdb_bricks &v, const char *name, F get)
{
    using Leaf = typename GridT::TreeType::LeafNodeType;
    auto grid = GridT::create();
    for (uint32_t b = 0; b < v.n_bricks; b++) {
        auto leaf = std::make_unique<Leaf>(coord(vol::leaf_origin(v, v.ids[b])));
        auto *out = leaf->buffer().data();
        const float *in = v.brick + static_cast<size_t>(b) * CELLS * v.channels;
        for (int k = 0; k < SIDE; k++)
            for (int j = 0; j < SIDE; j++)
                for (int i = 0; i < SIDE; i++, in += v.channels) {
                    if (in[0] == 0 && (v.channels == 1 || (in[1] == 0 && in[2] == 0)))
                        continue;
                    const unsigned cell = leaf_cell(i, j, k, v.y_up != 0);
                    out[cell] = get(in);
                    leaf->setValueOn(cell);
                }
        if (!leaf->isEmpty())
            grid->tree().addLeaf(leaf.release());
    }
    openvdb::Mat4d m = openvdb::Mat4d::identity();
    for (int a = 0; a < 3; a++) {
        m(a, a) = v.spacing[a];
        m(3, a) = v.origin[a];
    }
    grid->setTransform(openvdb::math::Transform::createLinearTransform(m));
    grid->setName(name);
    grid->setCreator("pyrovox " PVX_VERSION);
    grid->setSaveFloatAsHalf(true);
    return grid;
}

/* Deviations.  Those of channels are added as the luminance adds them: whatever the channels' errors have in common, the
 * luminance's deviation is not above. */
std::vector<GridBase::Ptr> make_bars(const vol_vdb_bricks &v)
{
    vol_vdb_bricks of = v;
    of.brick = v.sd;
    auto cut = [](float x) { return std::min(x, MOST_HALF); };
    std::vector<GridBase::Ptr> all;
    auto scalar = [&](const char *name, auto get) {
        all.push_back(make_grid<FloatGrid>(of, name, get));
        all.back()->setGridClass(openvdb::GRID_FOG_VOLUME);
    };
    if (v.channels == 1)
        scalar("emission_sd", [=](const float *p) { return cut(p[0]); });
    else if (!v.split) {
        scalar("emission_sd",
               [=](const float *p) { return cut(vol::luminance(p[0], p[1], p[2])); });
        all.push_back(make_grid<Vec3SGrid>(
            of, "rgb_sd", [=](const float *p) { return Vec3f(cut(p[0]), cut(p[1]), cut(p[2])); }));
        all.back()->setVectorType(openvdb::VEC_INVARIANT);
    } else {
        scalar("red_sd", [=](const float *p) { return cut(p[0]); });
        scalar("green_sd", [=](const float *p) { return cut(p[1]); });
        scalar("blue_sd", [=](const float *p) { return cut(p[2]); });
    }
    return all;
}

std::vector<GridBase::Ptr> make_grids(const vol_vdb_bricks &v)
{
    const unsigned channels = v.channels;
    auto cut = [](float x) { return std::min(std::max(x, -MOST_HALF), MOST_HALF); };
    std::vector<GridBase::Ptr> all;
    auto scalar = [&](const char *name, auto get) {
        all.push_back(make_grid<FloatGrid>(v, name, get));
        all.back()->setGridClass(openvdb::GRID_FOG_VOLUME);
    };
    scalar("density", [=](const float *p) {
        return cut(channels == 1 ? p[0] : vol::luminance(p[0], p[1], p[2]));
    });
    if (channels == 3 && v.split) {
        scalar("red", [=](const float *p) { return cut(p[0]); });
        scalar("green", [=](const float *p) { return cut(p[1]); });
        scalar("blue", [=](const float *p) { return cut(p[2]); });
    } else if (channels == 3) {
        all.push_back(make_grid<Vec3SGrid>(
            v, "emission", [=](const float *p) { return Vec3f(cut(p[0]), cut(p[1]), cut(p[2])); }));
        all.back()->setVectorType(openvdb::VEC_INVARIANT);
    }
    if (v.sd != nullptr)
        for (auto &grid : make_bars(v))
            all.push_back(grid);
    if (v.kelvin != nullptr) {
        vol_vdb_bricks of = v;
        of.brick = v.kelvin;
        of.channels = 1;
        all.push_back(make_grid<FloatGrid>(of, "temperature", [](const float *p) { return p[0]; }));
        all.back()->setGridClass(openvdb::GRID_FOG_VOLUME);
        all.back()->setSaveFloatAsHalf(false); /* a half has steps of 1 K */
    }
    return all;
}

/* ---- metadata ----------------------------------------------------------------------------------- */

openvdb::MetaMap make_meta(const vol_vdb_bricks &v)
{
    openvdb::MetaMap m;
    for (size_t i = 0; i < v.n_notes; i++) {
        const vol_vdb_note &n = v.notes[i];
        switch (n.kind) {
        case VOL_VDB_TEXT: m.insertMeta(n.key, openvdb::StringMetadata(n.text)); break;
        case VOL_VDB_INT: m.insertMeta(n.key, openvdb::Int64Metadata(n.i)); break;
        case VOL_VDB_REAL: m.insertMeta(n.key, openvdb::DoubleMetadata(n.x[0])); break;
        default:
            m.insertMeta(n.key, openvdb::Vec3DMetadata(openvdb::Vec3d(n.x[0], n.x[1], n.x[2])));
        }
    }
    return m;
}

/* ---- files in memory ---------------------------------------------------------------------------- */

struct Bytes : std::stringbuf {
    Bytes() : std::stringbuf(std::ios::in | std::ios::out | std::ios::binary)
    {
    }
    int take(std::streamoff n, vol_vdb_bytes *out)
    {
        out->data = n > 0 ? malloc(static_cast<size_t>(n)) : nullptr;
        if (out->data == nullptr)
            return PVX_ENOMEM;
        out->size = static_cast<size_t>(n);
        memcpy(out->data, pbase(), out->size);
        return PVX_OK;
    }
};

struct View : std::streambuf {
    View(const void *p, size_t n)
    {
        char *c = static_cast<char *>(const_cast<void *>(p));
        setg(c, c, c + n);
    }

  protected:
    pos_type seekoff(off_type off, std::ios_base::seekdir way, std::ios_base::openmode) override
    {
        const off_type size = egptr() - eback(), from = way == std::ios_base::beg ? 0
                                                        : way == std::ios_base::cur
                                                            ? gptr() - eback()
                                                            : size;
        if (off < -from || off > size - from)
            return pos_type(off_type(-1));
        setg(eback(), eback() + from + off, egptr());
        return pos_type(from + off);
    }
    pos_type seekpos(pos_type pos, std::ios_base::openmode which) override
    {
        return seekoff(off_type(pos), std::ios_base::beg, which);
    }
};

/* io::File writes by itself and does not see a full disk.  Without grid offsets, readers take the grids in this order
 * and not by name, so a program that shows the first one shows density. */
struct Archive : openvdb::io::Archive {
    void put(std::ostream &os, const std::vector<GridBase::Ptr> &grids,
             const openvdb::MetaMap &meta) const
    {
        openvdb::io::Archive::write(os, grids, false, meta);
    }
};

int write_vdb(const vol_vdb_bricks *v, vol_vdb_bytes *out, char *err, size_t err_size) noexcept
{
    return vdb_guarded(err, err_size, [&]() -> int {
        Bytes bytes;
        std::ostream os(&bytes);
        os.exceptions(std::ios::badbit);
        Archive().put(os, make_grids(*v), make_meta(*v));
        os.seekp(0, std::ios::end);
        return bytes.take(os.tellp(), out);
    });
}

using Nano = nanovdb::GridHandle<nanovdb::HostBuffer>;

std::string notes_of(const vol_vdb_bricks &v)
{
    std::ostringstream notes;
    make_meta(v).writeMeta(notes);
    return notes.str();
}

size_t nano_room(const vol_vdb_bricks *v) noexcept
{
    return vol::nano_room(*v, VOL_VDB_NOTES_MAX * (sizeof(vol_vdb_note) + 64));
}

int nano_make(const vol_vdb_bricks *v, void *out, size_t *size, char *err, size_t err_size) noexcept
{
    return vdb_guarded(err, err_size, [&]() -> int {
        *size = vol::nano_make(*v, notes_of(*v), out);
        return PVX_OK;
    });
}

/* Copy one grid of several into a handle of its own, with its checksum. */
Nano alone(const nanovdb::GridData *from)
{
    auto buffer = nanovdb::HostBuffer::create(from->mGridSize);
    memcpy(buffer.data(), from, from->mGridSize);
    auto *to = reinterpret_cast<nanovdb::GridData *>(buffer.data());
    to->mGridIndex = 0;
    to->mGridCount = 1;
    Nano grid(std::move(buffer));
    if (to->mGridType == nanovdb::GridType::Float)
        nanovdb::updateChecksum(*grid.grid<float>());
    else
        nanovdb::updateChecksum(*grid.grid<nanovdb::Vec3f>());
    return grid;
}

int write_nvdb(const vol_vdb_bricks *v, vol_vdb_bytes *out, char *err, size_t err_size) noexcept
{
    return vdb_guarded(err, err_size, [&]() -> int {
        const std::string notes = notes_of(*v);
        std::vector<Nano> all;
        auto take = [&](const nanovdb::HostBuffer &made, size_t n) {
            for (size_t at = 0; at < n; at += all.back().size())
                all.push_back(alone(reinterpret_cast<const nanovdb::GridData *>(made.data() + at)));
        };
        auto made = nanovdb::HostBuffer::create(vol::nano_room(*v, notes.size()));
        take(made, vol::nano_make(*v, notes, made.data()));
        Bytes bytes;
        std::ostream os(&bytes);
        os.exceptions(std::ios::badbit);
        /* The header is written last, over a hole that must already exist in a stream in memory. */
        os << std::string(4096, '\0');
        os.seekp(0);
        nanovdb::io::writeGrids(os, all);
        return bytes.take(os.tellp(), out);
    });
}

/* ---- leaves to bricks --------------------------------------------------------------------------- */

/* false: outside the grid. */
bool brick_id(const vol_vdb_bricks &v, const Coord &at, uint32_t *id)
{
    const int64_t p[3] = {at.x(), v.y_up ? -SIDE - static_cast<int64_t>(at.z()) : at.y(),
                          v.y_up ? at.y() : at.z()};
    uint32_t nb[3];
    for (int a = 0; a < 3; a++) {
        nb[a] = (v.n[a] + SIDE - 1) / SIDE;
        if (p[a] < 0 || p[a] / SIDE >= nb[a])
            return false;
    }
    *id = static_cast<uint32_t>((p[2] / SIDE * nb[1] + p[1] / SIDE) * nb[0] + p[0] / SIDE);
    return true;
}

using Bricks = std::map<uint32_t, std::vector<float>>; /* by id, ascending */

bool finite(float x)
{
    return std::isfinite(x);
}
template <typename Vector> bool finite(const Vector &x)
{
    return std::isfinite(x[0]) && std::isfinite(x[1]) && std::isfinite(x[2]);
}
void put(float x, float *to)
{
    to[0] = x;
}
template <typename Vector> void put(const Vector &x, float *to)
{
    for (int a = 0; a < 3; a++)
        to[a] = x[a];
}

/* Put the values of one leaf into channel `c` (and the next ones) of its brick; `on` and `value` ask for a cell. */
template <typename On, typename Value>
int take_leaf(const vol_vdb_bricks &v, const Coord &at, unsigned c, On on, Value value, Bricks *all,
              char *err, size_t err_size)
{
    uint32_t id;
    if (!brick_id(v, at, &id))
        return fail(PVX_ECORRUPT, err, err_size, "has voxels outside its grid");
    auto &brick = (*all)[id];
    brick.resize(static_cast<size_t>(CELLS) * v.channels);
    const uint32_t nx = (v.n[0] + SIDE - 1) / SIDE, ny = (v.n[1] + SIDE - 1) / SIDE;
    const uint32_t first[3] = {id % nx * SIDE, id / nx % ny * SIDE, id / nx / ny * SIDE};
    for (uint32_t k = 0; k < SIDE && first[2] + k < v.n[2]; k++)
        for (uint32_t j = 0; j < SIDE && first[1] + j < v.n[1]; j++)
            for (uint32_t i = 0; i < SIDE && first[0] + i < v.n[0]; i++) {
                const unsigned cell = leaf_cell(static_cast<int>(i), static_cast<int>(j),
                                                static_cast<int>(k), v.y_up != 0);
                if (!on(cell))
                    continue;
                if (!finite(value(cell)))
                    return fail(PVX_ECORRUPT, err, err_size, "has a value that is not finite");
                put(value(cell), brick.data() + ((k * SIDE + j) * SIDE + i) * v.channels + c);
            }
    return PVX_OK;
}

int no_grid(const char *name, char *err, size_t err_size)
{
    return fail(PVX_EFORMAT, err, err_size,
                (std::string("has no grid ") + name + " as pyrovox writes it").c_str());
}

/* Whether a grid lies where its file's notes say; other programs move, scale and turn grids by their transform. */
bool placed(const GridBase &grid, const vol_vdb_bricks &v)
{
    bool same = grid.transform().isLinear();
    for (int k = 0; k < 4 && same; k++) { /* the corner and the ends of three axes */
        openvdb::Vec3d at(0, 0, 0);
        if (k < 3)
            at[k] = 1000;
        const openvdb::Vec3d world = grid.transform().indexToWorld(at);
        for (int a = 0; a < 3; a++)
            same &= std::fabs(world[a] - v.origin[a] - v.spacing[a] * at[a]) <= 1e-3 * v.spacing[a];
    }
    return same;
}

/* A .vdb's grids.  take puts all leaves of one grid into channel c (and the next ones) of the bricks. */
struct Open {
    openvdb::GridPtrVecPtr grids;

    bool has(const char *name) const
    {
        return openvdb::findGridByName(*grids, name) != nullptr;
    }
    template <typename T>
    int take(const vol_vdb_bricks &v, const char *name, unsigned c, Bricks *out, char *err,
             size_t err_size) const
    {
        using Grid = openvdb::Grid<typename openvdb::tree::Tree4<T, 5, 4, 3>::Type>;
        const auto grid = openvdb::gridPtrCast<Grid>(openvdb::findGridByName(*grids, name));
        if (!grid)
            return no_grid(name, err, err_size);
        if (grid->tree().activeTileCount() != 0)
            return fail(PVX_EUNSUP, err, err_size, "has tiles: another program made it anew");
        if (std::count_if(grids->begin(), grids->end(),
                          [name](const GridBase::Ptr &g) { return g->getName() == name; }) > 1)
            return fail(PVX_EUNSUP, err, err_size,
                        "has several grids of one name: another program added them");
        if (!placed(*grid, v))
            return fail(PVX_EUNSUP, err, err_size,
                        "its grid is not where its metadata say: another program moved, scaled or "
                        "turned it");
        if (grid->background() != openvdb::zeroVal<T>())
            return fail(PVX_EUNSUP, err, err_size,
                        "its background is not 0: another program changed it");
        int e = PVX_OK;
        for (auto leaf = grid->tree().cbeginLeaf(); leaf && e == PVX_OK; ++leaf)
            e = take_leaf(
                v, leaf->origin(), c, [&](unsigned cell) { return leaf->isValueOn(cell); },
                [&](unsigned cell) { return leaf->getValue(cell); }, out, err, err_size);
        return e;
    }
    using Vector = Vec3f;
};

/* The same for a .nvdb, whose leaves lie one behind the other. */
struct Flat {
    std::vector<Nano> grids;

    bool has(const char *name) const
    {
        return std::any_of(grids.begin(), grids.end(), [name](const Nano &g) {
            return strcmp(g.gridMetaData()->shortGridName(), name) == 0;
        });
    }
    template <typename T>
    int take(const vol_vdb_bricks &v, const char *name, unsigned c, Bricks *out, char *err,
             size_t err_size) const
    {
        const nanovdb::NanoGrid<T> *grid = nullptr;
        for (const Nano &g : grids)
            if (g.grid<T>() != nullptr && strcmp(g.grid<T>()->gridName(), name) == 0)
                grid = g.grid<T>();
        if (grid == nullptr)
            return no_grid(name, err, err_size);
        if (!nanovdb::isValid(*grid, true))
            return fail(PVX_ECORRUPT, err, err_size, "its grids and their checksums do not agree");
        const uint32_t n = grid->tree().nodeCount(0);
        const auto *leaf = grid->tree().template getFirstNode<0>();
        int e = PVX_OK;
        for (uint32_t k = 0; k < n && e == PVX_OK; k++, leaf++) {
            const auto at = leaf->origin();
            e = take_leaf(
                v, Coord(at[0], at[1], at[2]), c,
                [&](unsigned cell) { return leaf->isActive(cell); },
                [&](unsigned cell) { return leaf->getValue(cell); }, out, err, err_size);
        }
        return e;
    }
    using Vector = nanovdb::Vec3f;
};

/* Grids of the emission, or of its error bars: of one channel, of vectors, of three channels. */
struct Names {
    const char *one, *vectors, *three[3];
};
constexpr Names EMISSION = {"density", "emission", {"red", "green", "blue"}};
constexpr Names BARS = {"emission_sd", "rgb_sd", {"red_sd", "green_sd", "blue_sd"}};

template <typename Grids>
int take_all(const Grids &g, const vol_vdb_bricks &v, const Names &names, Bricks *all, char *err,
             size_t err_size)
{
    if (v.channels == 1)
        return g.template take<float>(v, names.one, 0, all, err, err_size);
    if (!v.split)
        return g.template take<typename Grids::Vector>(v, names.vectors, 0, all, err, err_size);
    int e = PVX_OK;
    for (unsigned c = 0; c < 3 && e == PVX_OK; c++)
        e = g.template take<float>(v, names.three[c], c, all, err, err_size);
    return e;
}

/* One plane of the bricks in `order`, those that it lacks as 0. */
int give_plane(const Bricks &from, const std::vector<uint32_t> &order, unsigned channels,
               const float **out)
{
    const size_t one = static_cast<size_t>(CELLS) * channels;
    auto *brick = static_cast<float *>(calloc(order.size() * one + 1, sizeof(float)));
    *out = brick;
    for (size_t k = 0; k < order.size() && brick != nullptr; k++) {
        const auto found = from.find(order[k]);
        if (found != from.end())
            memcpy(brick + k * one, found->second.data(), one * sizeof(float));
    }
    return brick != nullptr ? PVX_OK : PVX_ENOMEM;
}

/* What was read of a file: its planes, of which only the first must be there. */
struct Planes {
    Bricks emission, sd, kelvin;
    bool barred, hot;

    int give(vol_vdb_bricks *v) const
    {
        std::vector<uint32_t> order;
        for (const Bricks *plane : {&emission, &sd, &kelvin})
            for (const auto &b : *plane)
                order.push_back(b.first);
        std::sort(order.begin(), order.end());
        order.erase(std::unique(order.begin(), order.end()), order.end());
        auto *ids = static_cast<uint32_t *>(malloc((order.size() + 1) * sizeof(uint32_t)));
        int e = ids != nullptr ? give_plane(emission, order, v->channels, &v->brick) : PVX_ENOMEM;
        if (e == PVX_OK && barred)
            e = give_plane(sd, order, v->channels, &v->sd);
        if (e == PVX_OK && hot)
            e = give_plane(kelvin, order, 1, &v->kelvin);
        if (e == PVX_OK)
            std::copy(order.begin(), order.end(), ids);
        v->ids = ids;
        v->n_bricks = static_cast<uint32_t>(order.size());
        return e;
    }
};

/* Error bars and temperatures are read where they are there. */
template <typename Grids>
int take_planes(const Grids &g, vol_vdb_bricks *v, char *err, size_t err_size)
{
    const char *bars = v->channels == 1 ? BARS.one : v->split ? BARS.three[0] : BARS.vectors;
    Planes all = {{}, {}, {}, g.has(bars), g.has("temperature")};
    vol_vdb_bricks one = *v;
    one.channels = 1;
    int e = take_all(g, *v, EMISSION, &all.emission, err, err_size);
    if (e == PVX_OK && all.barred)
        e = take_all(g, *v, BARS, &all.sd, err, err_size);
    if (e == PVX_OK && all.hot)
        e = g.template take<float>(one, "temperature", 0, &all.kelvin, err, err_size);
    return e == PVX_OK ? all.give(v) : e;
}

int read_vdb(const void *data, size_t len, vol_vdb_bricks *v, char *err, size_t err_size) noexcept
{
    return vdb_guarded(err, err_size, [&]() -> int {
        View bytes(data, len);
        std::istream is(&bytes);
        is.exceptions(std::ios::badbit | std::ios::eofbit | std::ios::failbit);
        openvdb::io::Stream stream(is, false);
        const Open open{stream.getGrids()};
        if (!open.grids)
            return fail(PVX_EFORMAT, err, err_size, "has no grids");
        return take_planes(open, v, err, err_size);
    });
}

int read_nvdb(const void *data, size_t len, vol_vdb_bricks *v, char *err, size_t err_size) noexcept
{
    return vdb_guarded(err, err_size, [&]() -> int {
        View bytes(data, len);
        std::istream is(&bytes);
        Flat flat;
        flat.grids = nanovdb::io::readGrids<nanovdb::HostBuffer, std::vector>(is);
        return take_planes(flat, v, err, err_size);
    });
}

const struct vol_vdb module = {VOL_VDB_VERSION,
                               write_vdb,
                               write_nvdb,
                               read_vdb,
                               read_nvdb,
                               NANOVDB_MAJOR_VERSION_NUMBER << 21 |
                                   NANOVDB_MINOR_VERSION_NUMBER << 10 |
                                   NANOVDB_PATCH_VERSION_NUMBER,
                               nano_room,
                               nano_make};

} // namespace

const struct vol_vdb *vol_vdb_module(void) noexcept
{
    return &module;
}
