// Primitives: modes, normals, tangents, colours, weights, morph targets.
#include "test_import_build.hpp"

namespace
{
const std::string normal_map = ",\"materials\":[{\"normalTexture\":{\"index\":0}}],\"textures\":[{"
                               "\"source\":0}],\"images\":[{\"uri\":\"" +
                               test_png_uri() + "\"}]";

// Four corners of the unit square in z = 0, as a strip would have them.
const std::vector<float> square = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};

// All triangles must face +z with an area of `area` in sum.
void check_facing(const kl_mesh &mesh, uint32_t triangles, double area)
{
    double sum = 0.0;
    assert_int_equal(mesh.triangle_count, triangles);
    for (uint32_t t = 0; t < mesh.triangle_count; ++t) {
        const float *a = mesh.positions + mesh.indices[t * 3] * 3;
        const float *b = mesh.positions + mesh.indices[t * 3 + 1] * 3;
        const float *c = mesh.positions + mesh.indices[t * 3 + 2] * 3;
        const float z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert_true(z > 0.0f);
        sum += static_cast<double>(z) / 2;
    }
    assert_true(std::fabs(sum - area) < 1e-6);
}

void test_strip(void **)
{
    for (const bool indexed : {false, true}) {
        test_gltf gltf;
        gltf.add(square, F32, "VEC3", 4);
        if (indexed) gltf.add(std::vector<uint8_t>{0, 1, 2, 3}, U8, "SCALAR", 4);
        gltf.add_mesh(std::string("\"mode\":5,\"attributes\":{\"POSITION\":0}") +
                      (indexed ? ",\"indices\":1" : ""));
        const test_import in(gltf);
        check_facing(in.mesh(), 2, 1.0);
    }
}

void test_fan(void **)
{
    test_gltf gltf;
    gltf.add(square, F32, "VEC3", 4);
    gltf.add(std::vector<uint16_t>{0, 1, 3, 2}, U16, "SCALAR", 4);
    gltf.add_mesh("\"mode\":6,\"attributes\":{\"POSITION\":0},\"indices\":1");
    const test_import in(gltf);
    check_facing(in.mesh(), 2, 1.0);
}

void test_flat_normals(void **)
{
    test_gltf gltf; // two triangles at a right angle that share an edge
    gltf.add(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, F32, "VEC3", 4);
    gltf.add(std::vector<uint32_t>{0, 1, 2, 0, 3, 1}, U32, "SCALAR", 6);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0},\"indices\":1");
    const test_import in(gltf);
    const kl_mesh &mesh = in.mesh();
    assert_int_equal(mesh.vertex_count, 6); // split
    assert_floats(mesh.normals, {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 1, 0}, 1e-6);
    assert_null(mesh.tangents);
}

void test_index_out_of_range(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.add(std::vector<uint8_t>{0, 1, 3}, U8, "SCALAR", 3);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0},\"indices\":1");
    test_import(gltf).assert_refused("mesh 0 primitive 0: index 2 is 3, but there are 3 vertices");
    test_gltf restart;
    restart.add(test_triangle(), F32, "VEC3", 3);
    restart.add(std::vector<uint8_t>{0, 1, 255}, U8, "SCALAR", 3);
    restart.add_mesh("\"attributes\":{\"POSITION\":0},\"indices\":1");
    test_import(restart).assert_refused("the primitive restart value");
}

void test_bad_triangles(void **)
{
    test_gltf gltf; // one good, one with NaN, one without area
    std::vector<float> points = test_triangle();
    points.insert(points.end(), {NAN, 0, 0, 5, 5, 5});
    gltf.add(points, F32, "VEC3", 5);
    gltf.add(std::vector<uint8_t>{0, 1, 2, 0, 1, 3, 0, 1, 1}, U8, "SCALAR", 9);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0},\"indices\":1");
    const test_import in(gltf);
    check_facing(in.mesh(), 1, 0.5);
    assert_int_equal(in.mesh().vertex_count, 3); // what nothing uses is gone, the NaN with it
    assert_int_equal(in.scene->dropped_triangles, 2);
    in.assert_warned("1 triangles with positions that are not finite");
}

void test_points_are_skipped(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.rest = ",\"meshes\":[{\"primitives\":[{\"mode\":0,\"attributes\":{\"POSITION\":0}},"
                "{\"mode\":1,\"attributes\":{\"POSITION\":0}},{\"attributes\":{\"POSITION\":0}}]}]";
    const test_import in(gltf);
    in.assert_warned("points and lines are not drawn");
    assert_int_equal(in.scene->mesh_count, 1);
}

// A square of two triangles in z = 0 with the UVs given; returns tangents of the result.
struct tangent_case {
    test_gltf gltf;
    explicit tangent_case(const std::vector<float> &uv, const std::string &extra = "")
    {
        gltf.add(square, F32, "VEC3", 4);
        gltf.add(uv, F32, "VEC2", 4);
        gltf.add(std::vector<uint8_t>{0, 1, 2, 1, 3, 2}, U8, "SCALAR", 6);
        gltf.add(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, F32, "VEC3", 4);
        gltf.add_mesh("\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1,\"NORMAL\":3},\"indices\":2,"
                      "\"material\":0");
        gltf.rest += extra.empty() ? normal_map : extra;
    }
};

void test_tangents(void **)
{
    // v points down, so that (u, 1 - v) is the plain case.
    const test_import plain(tangent_case({0, 1, 1, 1, 0, 0, 1, 0}).gltf);
    assert_int_equal(plain.mesh().vertex_count, 4);
    for (size_t v = 0; v < 4; ++v) {
        assert_floats(plain.mesh().tangents + v * 4, {1, 0, 0, 1}, 1e-6);
    }
    const test_import mirrored(tangent_case({1, 1, 0, 1, 1, 0, 0, 0}).gltf);
    for (size_t v = 0; v < 4; ++v) {
        assert_floats(mirrored.mesh().tangents + v * 4, {-1, 0, 0, -1}, 1e-6);
    }
}

void test_tangents_turn_with_the_texture(void **)
{
    // A quarter turn of the UVs turns the direction of increasing u with it.
    const test_import in(
        tangent_case({0, 1, 1, 1, 0, 0, 1, 0},
                     ",\"materials\":[{\"normalTexture\":{\"index\":0,\"extensions\":{"
                     "\"KHR_texture_transform\":{\"rotation\":1.57079632679}}}}],"
                     "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"" +
                         test_png_uri() + "\"}]")
            .gltf);
    // u' = v: u' grows downwards.
    assert_floats(in.mesh().tangents, {0, -1, 0, 1}, 1e-6);
}

void test_tangents_split_mirrored(void **)
{
    // The second triangle has its UVs mirrored: the two vertices of the common edge are split.
    const test_import in(tangent_case({0, 1, 1, 1, 0, 0, 0, 1}).gltf);
    const kl_mesh &mesh = in.mesh();
    assert_int_equal(mesh.vertex_count, 6);
    for (size_t t = 0; t < 2; ++t) {
        for (size_t k = 0; k < 3; ++k) {
            const float w = mesh.tangents[mesh.indices[t * 3 + k] * 4 + 3];
            assert_true(w == (t == 0 ? 1.0f : -1.0f));
        }
    }
}

void test_tangents_without_uv(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0},\"material\":0");
    gltf.rest += normal_map;
    const test_import in(gltf);
    in.assert_warned("needs TEXCOORD_0");
    for (size_t v = 0; v < 3; ++v) { // any unit vector in the plane
        const float *t = in.mesh().tangents + v * 4;
        assert_true(std::fabs(t[0] * t[0] + t[1] * t[1] - 1.0f) < 1e-5f && t[2] == 0.0f);
    }
}

void test_colors(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    const int view =
        gltf.add_view(std::vector<uint8_t>{255, 0, 51, 0, 0, 255, 0, 0, 1, 2, 3, 0}, 4);
    gltf.add_accessor(view, U8, "VEC3", 3, ",\"normalized\":true");
    gltf.add_mesh("\"attributes\":{\"POSITION\":0,\"COLOR_0\":1}");
    const test_import in(gltf);
    assert_floats(in.mesh().colors, {1, 0, 0.2, 1, 0, 1, 0, 1}, 1e-6);
}

void test_weights_are_rescaled(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.add(std::vector<uint8_t>{0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0}, U8, "VEC4", 3);
    gltf.add(std::vector<float>{2, 2, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0}, F32, "VEC4", 3);
    gltf.rest = ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"JOINTS_0\":1,"
                "\"WEIGHTS_0\":2}}]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{},{}],\"skins\":[{"
                "\"joints\":[1,2]}]";
    const test_import in(gltf);
    in.assert_warned("the weights of 2 vertices do not sum to 1");
    assert_int_equal(in.mesh().influence_count, 4);
    assert_floats(in.mesh().weights, {0.5, 0.5, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, 1e-7);
    assert_int_equal(in.scene->instances[0].skin, 0);
}

void test_joint_out_of_range(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.add(std::vector<uint8_t>{0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0}, U8, "VEC4", 3);
    gltf.add(std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, F32, "VEC4", 3);
    gltf.rest = ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"JOINTS_0\":1,"
                "\"WEIGHTS_0\":2}}]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{}],\"skins\":[{"
                "\"joints\":[1]}]";
    test_import(gltf).assert_refused("vertices use joint 2, but skins[0] has 1 joints");
}

void test_morph_targets(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.add(std::vector<float>{0, 0, 0, 0, 0, 0, 0, 0, 1}, F32, "VEC3", 3);
    gltf.rest = ",\"meshes\":[{\"weights\":[0.25],\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                "\"targets\":[{\"POSITION\":1}]}]}],\"nodes\":[{\"mesh\":0}]";
    const test_import in(gltf);
    assert_int_equal(in.mesh().morph_count, 1);
    assert_floats(in.mesh().morph_positions, {0, 0, 0, 0, 0, 0, 0, 0, 1}, 0.0);
    // No normals in the file: the change of the flat normal, (0, -1, 1) / sqrt 2 - (0, 0, 1).
    const double s = 1 / std::sqrt(2.0);
    assert_floats(in.mesh().morph_normals, {0, -s, s - 1}, 1e-6);
    assert_int_equal(in.scene->nodes[0].weight_count, 1);
    assert_true(in.scene->nodes[0].weights[0] == 0.25);
}

void test_default_material(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", 3);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0}");
    gltf.rest += ",\"materials\":[{}]";
    const test_import in(gltf);
    assert_int_equal(in.scene->material_count, 2);
    assert_int_equal(in.mesh().material, 1);
    assert_floats(in.scene->materials[1].base_color, {1, 1, 1, 1}, 0.0);
}
} // namespace

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_strip),
        cmocka_unit_test(test_fan),
        cmocka_unit_test(test_flat_normals),
        cmocka_unit_test(test_index_out_of_range),
        cmocka_unit_test(test_bad_triangles),
        cmocka_unit_test(test_points_are_skipped),
        cmocka_unit_test(test_tangents),
        cmocka_unit_test(test_tangents_turn_with_the_texture),
        cmocka_unit_test(test_tangents_split_mirrored),
        cmocka_unit_test(test_tangents_without_uv),
        cmocka_unit_test(test_colors),
        cmocka_unit_test(test_weights_are_rescaled),
        cmocka_unit_test(test_joint_out_of_range),
        cmocka_unit_test(test_morph_targets),
        cmocka_unit_test(test_default_material),
    };
    return cmocka_run_group_tests(tests, nullptr, nullptr);
}
