#include "daemon/volumes/nanovdb_grids.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <type_traits>
#include <vector>

#include <nanovdb/NanoVDB.h>
#include <nanovdb/util/GridChecksum.h>
#include <nanovdb/util/GridStats.h>

namespace vol
{
namespace
{

using nanovdb::Coord;
using nanovdb::Vec3f;

/* Voxels along a side of the nodes.  The tree has one upper node: a grid of 4096 voxels a side has no more. */
constexpr int LOWER = 128, UPPER = 4096;

struct Leaf {
    uint32_t place, brick; /* of the lower node in the upper one, of the leaf in the lower one */
    uint32_t lower() const
    {
        return place >> 12;
    }
    uint32_t in_lower() const
    {
        return place & 4095;
    }
};

uint32_t place(const Index &at)
{
    const auto lower = [](int x) { return static_cast<uint32_t>(x & (UPPER - 1)) / LOWER; };
    const auto leaf = [](int x) { return static_cast<uint32_t>(x & (LOWER - 1)) / SIDE; };
    return lower(at.x) << 22 | lower(at.y) << 17 | lower(at.z) << 12 | leaf(at.x) << 8 |
           leaf(at.y) << 4 | leaf(at.z);
}

/* Bricks with flame, in the order of the nodes. */
struct Topology {
    std::vector<Leaf> leaves;
    std::vector<size_t> first; /* [lowers + 1] leaf of each lower node */

    explicit Topology(const vol_vdb_bricks &v)
    {
        const size_t one = static_cast<size_t>(CELLS) * v.channels;
        leaves.reserve(v.n_bricks);
        for (uint32_t b = 0; b < v.n_bricks; b++) {
            const float *in = v.brick + b * one;
            if (std::any_of(in, in + one, [](float x) { return x != 0; }))
                leaves.push_back({place(leaf_origin(v, v.ids[b])), b});
        }
        std::sort(leaves.begin(), leaves.end(),
                  [](const Leaf &a, const Leaf &b) { return a.place < b.place; });
        for (size_t k = 0; k < leaves.size(); k++)
            if (k == 0 || leaves[k].lower() != leaves[k - 1].lower())
                first.push_back(k);
        first.push_back(leaves.size());
    }
    size_t lowers() const
    {
        return first.size() - 1;
    }
};

constexpr int LANES = 4; /* of a sum: what gcc keeps in registers */
constexpr float MOST = std::numeric_limits<float>::max();

/* A brick's voxels in the order of a leaf, one channel behind the other, and which of them have flame. */
struct Cells {
    float c[3][CELLS];
    float off[CELLS]; /* 0: some channel is not 0; else MOST */
    uint64_t mask[SIDE];
    unsigned count;

    template <int C> void take(const float *in, bool y_up)
    {
        unsigned char on[CELLS];
        for (int k = 0; k < SIDE; k++)
            for (int j = 0; j < SIDE; j++)
                for (int i = 0; i < SIDE; i++, in += C) {
                    const unsigned cell = leaf_cell(i, j, k, y_up);
                    for (int a = 0; a < C; a++)
                        c[a][cell] = in[a];
                }
        for (int n = 0; n < CELLS; n++) {
            on[n] = C == 1 ? c[0][n] != 0 : (c[0][n] != 0) | (c[1][n] != 0) | (c[2][n] != 0);
            off[n] = on[n] ? 0 : MOST;
        }
        count = 0;
        for (int w = 0; w < SIDE; w++) {
            mask[w] = 0;
            for (int row = 0; row < SIDE; row++) {
                uint64_t bytes;
                memcpy(&bytes, on + (w * SIDE + row) * SIDE, sizeof bytes);
                /* The product's highest byte has the lowest bit of each byte. */
                mask[w] |= bytes * 0x0102040810204080 >> 56 << row * SIDE;
            }
            count += nanovdb::CountOn(mask[w]);
        }
    }
};

/* NanoVDB's statistics, for a whole leaf at once: its own code takes one voxel after the other, with a division each.
 * They are those of `scalar`, which is 0 where there is no flame; value(n) is what cell n stores. */
template <typename T> struct Stats : nanovdb::Stats<T> {
    template <typename Value> void leaf(const float *scalar, const Cells &in, Value value)
    {
        double sum[LANES] = {0}, square[LANES] = {0};
        float low[LANES], high[LANES];
        std::fill(low, low + LANES, MOST);
        std::fill(high, high + LANES, -MOST);
        for (int n = 0; n < CELLS; n += LANES)
            for (int k = 0; k < LANES; k++) {
                const float x = scalar[n + k];
                sum[k] += x;
                square[k] += static_cast<double>(x) * x;
            }
        for (int n = 0; n < CELLS; n += LANES)
            for (int k = 0; k < LANES; k++) {
                const float a = scalar[n + k] + in.off[n + k], b = scalar[n + k] - in.off[n + k];
                low[k] = a < low[k] ? a : low[k];
                high[k] = b > high[k] ? b : high[k];
            }
        for (int k = 1; k < LANES; k++) {
            sum[0] += sum[k];
            square[0] += square[k];
        }
        const double aux = square[0] - sum[0] * sum[0] / in.count;
        this->mSize = in.count;
        this->mAvg = sum[0] / in.count;
        this->mAux = aux > 0 ? aux : 0;
        this->min(stored(scalar, in, *std::min_element(low, low + LANES), value));
        this->max(stored(scalar, in, *std::max_element(high, high + LANES), value));
    }

  private:
    /* What the first cell with that scalar stores. */
    template <typename Value>
    static T stored(const float *scalar, const Cells &in, float x, Value value)
    {
        int n = 0;
        if constexpr (std::is_same<T, float>::value)
            return x;
        while (n < CELLS - 1 && (scalar[n] != x || in.off[n] != 0))
            n++;
        return value(n);
    }
};

template <typename Data, typename T> void put_stats(Data *data, const Stats<T> &s)
{
    using Float = typename nanovdb::FloatTraits<T>::FloatType;
    data->mMinimum = s.min();
    data->mMaximum = s.max();
    data->mAverage = static_cast<Float>(s.avg());
    data->mStdDevi = static_cast<Float>(s.std());
}

/* ---- one grid ----------------------------------------------------------------------------------- */

template <typename T> size_t bytes_of(size_t leaves, size_t lowers)
{
    const uint32_t uppers = leaves > 0;
    return nanovdb::NanoGrid<T>::memUsage() + nanovdb::NanoTree<T>::memUsage() +
           nanovdb::NanoRoot<T>::memUsage(uppers) + uppers * nanovdb::NanoUpper<T>::memUsage() +
           lowers * nanovdb::NanoLower<T>::memUsage() + leaves * sizeof(nanovdb::NanoLeaf<T>);
}

/* A grid while it is made. */
struct Sheet {
    virtual ~Sheet() = default;
    virtual void put_leaf(size_t k, const Coord &at, const Cells &in) = 0;
    virtual void finish() = 0;
};

/* value(cells, n): what cell n stores; scalar(cells, n): what its statistics are of. */
template <typename T, typename Value, typename Scalar> class SheetOf final : public Sheet
{
    const Topology &topology;
    std::vector<Stats<T>> stats; /* of each leaf */
    Value value;
    Scalar scalar;
    nanovdb::NanoGrid<T> *grid;
    nanovdb::NanoTree<T> *tree;
    nanovdb::NanoRoot<T> *root;
    nanovdb::NanoUpper<T> *upper;
    nanovdb::NanoLower<T> *lower;
    nanovdb::NanoLeaf<T> *leaf;

    template <typename To> To *next(void *at, size_t bytes)
    {
        return reinterpret_cast<To *>(static_cast<char *>(at) + bytes);
    }

  public:
    SheetOf(const Topology &t, void *at, Value v, Scalar s)
        : topology(t), stats(t.leaves.size()), value(v), scalar(s)
    {
        const uint32_t uppers = !t.leaves.empty();
        grid = next<nanovdb::NanoGrid<T>>(at, 0);
        tree = next<nanovdb::NanoTree<T>>(grid, grid->memUsage());
        root = next<nanovdb::NanoRoot<T>>(tree, tree->memUsage());
        upper = next<nanovdb::NanoUpper<T>>(root, root->memUsage(uppers));
        lower = next<nanovdb::NanoLower<T>>(upper, uppers * upper->memUsage());
        leaf = next<nanovdb::NanoLeaf<T>>(lower, t.lowers() * lower->memUsage());
        memset(static_cast<void *>(tree), 0, static_cast<size_t>(nanovdb::PtrDiff(leaf, tree)));
    }

    void put_leaf(size_t k, const Coord &at, const Cells &in) override
    {
        auto *to = leaf[k].data();
        float of[CELLS];
        memset(static_cast<void *>(to), 0, nanovdb::PtrDiff(to->mValues, to));
        to->mBBoxMin = at;
        for (int w = 0; w < SIDE; w++)
            to->mValueMask.template getWord<uint64_t>(w) = in.mask[w];
        for (int n = 0; n < CELLS; n++) {
            to->mValues[n] = value(in, n);
            of[n] = scalar(in, n);
        }
        stats[k].leaf(of, in, [&](int n) { return value(in, n); });
        put_stats(to, stats[k]);
    }

    void finish() override
    {
        tree->data()->setRoot(root);
        if (!topology.leaves.empty())
            join();
        nanovdb::gridStats(*grid, nanovdb::StatsMode::BBox);
        grid->data()->setMinMaxOn();
        grid->data()->setAverageOn();
        grid->data()->setStdDeviationOn();
    }

  private:
    /* Link every node to the one above it. */
    void join()
    {
        auto *t = tree->data();
        Stats<T> all;
        for (size_t l = 0; l < topology.lowers(); l++) {
            auto *node = lower[l].data();
            Stats<T> mine;
            for (size_t k = topology.first[l]; k < topology.first[l + 1]; k++) {
                node->mChildMask.setOn(topology.leaves[k].in_lower());
                node->setChild(topology.leaves[k].in_lower(), &leaf[k]);
                mine.add(stats[k]);
            }
            const uint32_t at = topology.leaves[topology.first[l]].lower();
            upper->data()->mChildMask.setOn(at);
            upper->data()->setChild(at, node);
            put_stats(node, mine);
            all.add(mine);
        }
        put_stats(upper->data(), all);
        root->data()->mTableSize = 1;
        root->data()->tile(0)->setChild(leaf->data()->mBBoxMin, upper, root->data());
        put_stats(root->data(), all);
        t->setFirstNode(upper);
        t->setFirstNode(lower);
        t->setFirstNode(leaf);
        t->mNodeCount[0] = static_cast<uint32_t>(topology.leaves.size());
        t->mNodeCount[1] = static_cast<uint32_t>(topology.lowers());
        t->mNodeCount[2] = 1;
        t->mVoxelCount = all.size();
    }
};

/* ---- all grids ---------------------------------------------------------------------------------- */

template <typename T> nanovdb::GridData *begin(const vol_vdb_bricks &v, const char *name, char *at)
{
    constexpr bool is_scalar = std::is_same<T, float>::value;
    double map[4][4] = {{0}}, back[4][4] = {{0}};
    auto *g = reinterpret_cast<nanovdb::GridData *>(at);
    memset(static_cast<void *>(g), 0, sizeof *g);
    for (int a = 0; a < 3; a++) {
        map[a][a] = v.spacing[a];
        back[a][a] = 1 / v.spacing[a];
        map[3][a] = v.origin[a];
        g->mVoxelSize[a] = v.spacing[a];
    }
    g->mMagic = NANOVDB_MAGIC_NUMBER;
    g->mChecksum = nanovdb::GridChecksum::EMPTY;
    g->mVersion = nanovdb::Version();
    g->setBreadthFirstOn();
    snprintf(g->mGridName, sizeof g->mGridName, "%s", name);
    g->mMap.set(map, back, 1.0);
    g->mGridClass = is_scalar ? nanovdb::GridClass::FogVolume : nanovdb::GridClass::Unknown;
    g->mGridType = is_scalar ? nanovdb::GridType::Float : nanovdb::GridType::Vec3f;
    return g;
}

size_t notes_bytes(size_t notes)
{
    const size_t n = sizeof(nanovdb::GridBlindMetaData) + notes;
    return nanovdb::AlignUp<NANOVDB_DATA_ALIGNMENT>(n);
}

/* Put the notes as blind data behind the grid. */
void put_notes(nanovdb::GridData *g, const std::string &notes)
{
    char *at = reinterpret_cast<char *>(g) + g->mGridSize;
    auto *meta = reinterpret_cast<nanovdb::GridBlindMetaData *>(at);
    memset(at, 0, notes_bytes(notes.size()));
    g->mBlindMetadataOffset = static_cast<int64_t>(g->mGridSize);
    g->mBlindMetadataCount = 1;
    g->mGridSize += notes_bytes(notes.size());
    meta->setBlindData(meta + 1);
    meta->mElementCount = notes.size();
    snprintf(meta->mName, sizeof meta->mName, VOL_NVDB_NOTES);
    memcpy(static_cast<void *>(meta + 1), notes.data(), notes.size());
}

/* The grids of a volume, behind each other. */
struct Book {
    const vol_vdb_bricks &v;
    const Topology topology;
    char *at;
    std::vector<nanovdb::GridData *> grids;
    std::vector<std::unique_ptr<Sheet>> sheets;

    template <typename T, typename Value, typename Scalar>
    void add(const char *name, Value value, Scalar scalar)
    {
        nanovdb::GridData *g = begin<T>(v, name, at);
        g->mGridSize = bytes_of<T>(topology.leaves.size(), topology.lowers());
        sheets.push_back(std::make_unique<SheetOf<T, Value, Scalar>>(topology, at, value, scalar));
        grids.push_back(g);
        at += g->mGridSize;
    }
    template <typename Value> void add_scalar(const char *name, Value value)
    {
        add<float>(name, value, value);
    }
    template <int C> void add_channel(const char *name)
    {
        add_scalar(name, [](const Cells &in, int n) { return in.c[C][n]; });
    }
    void add_vectors(const char *name)
    {
        add<Vec3f>(
            name, [](const Cells &in, int n) { return Vec3f(in.c[0][n], in.c[1][n], in.c[2][n]); },
            [](const Cells &in, int n) {
                return in.c[0][n] * in.c[0][n] + in.c[1][n] * in.c[1][n] + in.c[2][n] * in.c[2][n];
            });
    }
    void add_all(const std::string &notes)
    {
        if (v.channels == 1)
            add_channel<0>("density");
        else
            add_scalar("density", [](const Cells &in, int n) {
                return luminance(in.c[0][n], in.c[1][n], in.c[2][n]);
            });
        put_notes(grids[0], notes);
        at += notes_bytes(notes.size());
        if (v.channels == 3 && v.split) {
            add_channel<0>("red");
            add_channel<1>("green");
            add_channel<2>("blue");
        } else if (v.channels == 3) {
            add_vectors("emission");
        }
    }
    void add_bars()
    {
        if (v.channels == 1)
            add_channel<0>("emission_sd");
        else if (!v.split) {
            add_scalar("emission_sd", [](const Cells &in, int n) {
                return luminance(in.c[0][n], in.c[1][n], in.c[2][n]);
            });
            add_vectors("rgb_sd");
        } else {
            add_channel<0>("red_sd");
            add_channel<1>("green_sd");
            add_channel<2>("blue_sd");
        }
    }
    void fill()
    {
        Cells cells;
        for (size_t k = 0; k < topology.leaves.size(); k++) {
            const uint32_t b = topology.leaves[k].brick;
            const Index first = leaf_origin(v, v.ids[b]);
            const float *brick = v.brick + static_cast<size_t>(b) * CELLS * v.channels;
            if (v.channels == 1)
                cells.take<1>(brick, v.y_up != 0);
            else
                cells.take<3>(brick, v.y_up != 0);
            for (auto &s : sheets)
                s->put_leaf(k, Coord(first.x, first.y, first.z), cells);
        }
        for (auto &s : sheets)
            s->finish();
    }
};

/* Number the grids of n bytes. */
void count_grids(char *at, size_t n)
{
    std::vector<nanovdb::GridData *> all;
    for (char *end = at + n; at < end; at += all.back()->mGridSize)
        all.push_back(reinterpret_cast<nanovdb::GridData *>(at));
    for (size_t k = 0; k < all.size(); k++) {
        all[k]->mGridIndex = static_cast<uint32_t>(k);
        all[k]->mGridCount = static_cast<uint32_t>(all.size());
    }
}

} // namespace

size_t nano_room(const vol_vdb_bricks &v, size_t notes)
{
    size_t lowers = 1;
    for (uint32_t n : v.n)
        lowers *= (n + LOWER - 1) / LOWER;
    lowers = std::min<size_t>(lowers, v.n_bricks);
    const size_t scalar = bytes_of<float>(v.n_bricks, lowers);
    const size_t one = scalar + (v.channels == 1 ? 0
                                 : v.split       ? 3 * scalar
                                                 : bytes_of<Vec3f>(v.n_bricks, lowers));
    return notes_bytes(notes) + (v.sd != nullptr ? 2 : 1) * one; /* bars take no more */
}

size_t nano_make(const vol_vdb_bricks &v, const std::string &notes, void *out)
{
    Book book{v, Topology(v), static_cast<char *>(out), {}, {}};
    book.add_all(notes);
    book.fill();
    char *end = book.at;
    if (v.sd != nullptr) {
        vol_vdb_bricks of = v;
        of.brick = v.sd;
        Book bars{of, Topology(of), end, {}, {}};
        bars.add_bars();
        bars.fill();
        end = bars.at;
    }
    const auto n = static_cast<size_t>(end - static_cast<char *>(out));
    count_grids(static_cast<char *>(out), n);
    return n;
}

} // namespace vol
