// What kl_vdb_write writes, read with the library: three points, two of them in one voxel.
#include "src/import/vdb_write.h"

// In templates of the library, once optimised.
#pragma GCC diagnostic ignored "-Wnull-dereference"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/points/PointDataGrid.h>
#include <string>

// cmocka's macros skip and fail are names in the library: it comes last.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

extern "C" {
#include <cmocka.h>
}

static void test_points_and_volumes(void **state)
{
    const double positions[] = {0.1, 0.1, 0.1, 0.2, 0.1, 0.1, 5.0, -3.0, 2.0};
    const float normals[] = {0, 1, 0, 0, 1, 0, 1, 0, 0};
    const float light[] = {1, 2, 3, 3, 4, 5, 7, 7, 7};
    const float radius[] = {0.5F, 0.25F, 1.0F};
    const float error[] = {0.1F, 0.3F, 0.2F};
    const int32_t level[] = {0, 0, 1};
    const int32_t born[] = {1, 2, 3};
    const kl_vdb_points points = {3, positions, normals, light, radius, error, level, born, 1.0};
    char folder[] = "/tmp/kl_vdb_XXXXXX";
    char message[256] = "";
    (void)state;

    assert_non_null(mkdtemp(folder));
    const std::string path = std::string(folder) + "/a.vdb";
    assert_int_equal(kl_vdb_write(path.c_str(), &points, message, sizeof message), 0);
    openvdb::initialize();
    openvdb::io::File file(path);
    file.open();
    const auto density = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("density"));
    const auto mean = openvdb::gridPtrCast<openvdb::Vec3SGrid>(file.readGrid("irradiance"));
    const auto records =
        openvdb::gridPtrCast<openvdb::points::PointDataGrid>(file.readGrid("records"));
    file.close();
    const auto at = density->transform().worldToIndexCellCentered(openvdb::Vec3d(0.1, 0.1, 0.1));
    const auto far = density->transform().worldToIndexCellCentered(openvdb::Vec3d(5, -3, 2));
    assert_true(density->tree().getValue(at) == 2.0F);
    assert_true(density->tree().getValue(far) == 1.0F);
    assert_int_equal(density->activeVoxelCount(), 2);
    assert_true(mean->tree().getValue(at) == openvdb::Vec3f(2, 3, 4));
    assert_int_equal(openvdb::points::pointCount(records->tree()), 3);
    const auto leaf = records->tree().cbeginLeaf();
    for (const char *name : {"P", "N", "Cd", "pscale", "error", "level", "born"}) {
        assert_true(leaf->attributeSet().find(name) != openvdb::points::AttributeSet::INVALID_POS);
    }
    assert_int_equal(std::remove(path.c_str()), 0);

    /* What cannot be written is said, not thrown. */
    const std::string nowhere = std::string(folder) + "/none/a.vdb";
    assert_int_not_equal(kl_vdb_write(nowhere.c_str(), &points, message, sizeof message), 0);
    assert_true(message[0] != '\0');
    assert_int_equal(std::remove(folder), 0);
}

int main()
{
    const CMUnitTest tests[] = {cmocka_unit_test(test_points_and_volumes)};
    return cmocka_run_group_tests(tests, nullptr, nullptr);
}
