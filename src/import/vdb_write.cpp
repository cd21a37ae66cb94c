// The only file that knows OpenVDB.
#include "src/import/vdb_write.h"

// In templates of the library, once optimised.
#pragma GCC diagnostic ignored "-Wnull-dereference"

#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointAttribute.h>
#include <openvdb/points/PointConversion.h>

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

namespace
{
using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::Vec3d;
using openvdb::Vec3f;
using openvdb::Vec3SGrid;
namespace points = openvdb::points;
using IndexGrid = openvdb::tools::PointIndexGrid;

template <typename T>
void add_attribute(points::PointDataGrid &grid, const IndexGrid &index, const std::string &name,
                   const std::vector<T> &values)
{
    const points::PointAttributeVector<T> wrapped(values);
    points::appendAttribute<T>(grid.tree(), name);
    points::populateAttribute<points::PointDataTree, openvdb::tools::PointIndexTree,
                              points::PointAttributeVector<T>>(grid.tree(), index.tree(), name,
                                                               wrapped);
}

template <typename T> std::vector<T> copy(const T *values, size_t count)
{
    return std::vector<T>(values, values + count);
}

std::vector<Vec3f> copy3(const float *values, size_t count)
{
    std::vector<Vec3f> out(count);
    for (size_t i = 0; i < count; ++i) {
        out[i] = Vec3f(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
    }
    return out;
}

openvdb::GridBase::Ptr make_points(const kl_vdb_points &in, const std::vector<Vec3d> &positions,
                                   const openvdb::math::Transform &transform)
{
    const points::PointAttributeVector<Vec3d> wrapped(positions);
    const IndexGrid::Ptr index =
        openvdb::tools::createPointIndexGrid<IndexGrid>(wrapped, transform);
    const auto grid = points::createPointDataGrid<points::NullCodec, points::PointDataGrid>(
        *index, wrapped, transform);

    add_attribute(*grid, *index, "N", copy3(in.normals, in.count));
    add_attribute(*grid, *index, "Cd", copy3(in.irradiance, in.count));
    add_attribute(*grid, *index, "pscale", copy(in.radius, in.count));
    add_attribute(*grid, *index, "error", copy(in.error, in.count));
    add_attribute(*grid, *index, "level", copy(in.level, in.count));
    add_attribute(*grid, *index, "born", copy(in.born, in.count));
    grid->setName("records");
    return grid;
}

void add_volumes(const kl_vdb_points &in, const std::vector<Vec3d> &positions,
                 const openvdb::math::Transform::Ptr &transform, openvdb::GridPtrVec &out)
{
    const FloatGrid::Ptr density = FloatGrid::create(0.0F);
    const FloatGrid::Ptr error = FloatGrid::create(0.0F);
    const Vec3SGrid::Ptr light = Vec3SGrid::create(Vec3f(0.0F));
    auto to_density = density->getAccessor();
    auto to_error = error->getAccessor();
    auto to_light = light->getAccessor();

    for (size_t i = 0; i < in.count; ++i) { // running means
        const Coord at = transform->worldToIndexCellCentered(positions[i]);
        const float n = to_density.getValue(at) + 1.0F;
        const Vec3f e(in.irradiance[3 * i], in.irradiance[3 * i + 1], in.irradiance[3 * i + 2]);
        const Vec3f mean = to_light.getValue(at);
        const float mean_error = to_error.getValue(at);
        to_density.setValue(at, n);
        to_light.setValue(at, mean + (e - mean) / n);
        to_error.setValue(at, mean_error + (in.error[i] - mean_error) / n);
    }
    density->setName("density");
    density->setGridClass(openvdb::GRID_FOG_VOLUME);
    light->setName("irradiance");
    error->setName("error");
    for (const openvdb::GridBase::Ptr &grid : openvdb::GridPtrVec{density, light, error}) {
        grid->setTransform(transform);
        out.push_back(grid);
    }
}
} // namespace

int kl_vdb_write(const char *path, const kl_vdb_points *in, char *message, size_t size)
{
    try {
        openvdb::initialize();
        const auto transform = openvdb::math::Transform::createLinearTransform(in->voxel);
        std::vector<Vec3d> positions(in->count);
        for (size_t i = 0; i < in->count; ++i) {
            positions[i] =
                Vec3d(in->positions[3 * i], in->positions[3 * i + 1], in->positions[3 * i + 2]);
        }
        openvdb::GridPtrVec grids;
        add_volumes(*in, positions, transform, grids);
        grids.push_back(make_points(*in, positions, *transform));
        openvdb::io::File file(path);
        file.write(grids);
        file.close();
        openvdb::uninitialize();
        return 0;
    } catch (const std::exception &e) {
        (void)std::snprintf(message, size, "%s", e.what());
        return 1;
    }
}
