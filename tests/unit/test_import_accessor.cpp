// Accessors of every kind: glTF 2.0 section 3.6.
#include "test_import_build.hpp"

namespace
{
// TEXCOORD_0 of the three vertices of a triangle through the accessor that `add` makes.
template <class Add> void check_uv(Add add, const std::vector<double> &expected, double tolerance)
{
    test_gltf gltf;
    const int position = gltf.add(test_triangle(), F32, "VEC3", 3);
    const int uv = add(gltf);
    gltf.add_mesh("\"attributes\":{\"POSITION\":" + std::to_string(position) +
                  ",\"TEXCOORD_0\":" + std::to_string(uv) + "}");
    gltf.rest += ",\"extensionsUsed\":[\"KHR_mesh_quantization\"]";
    const test_import in(gltf);
    assert_non_null(in.mesh().uv[0]);
    assert_floats(in.mesh().uv[0], expected, tolerance);
    assert_int_equal(in.warnings.size(), 0);
}

void test_float(void **)
{
    check_uv(
        [](test_gltf &g) {
            return g.add(std::vector<float>{0, 1, 0.5f, 0.25f, -3, 7}, F32, "VEC2", 3);
        },
        {0, 1, 0.5, 0.25, -3, 7}, 0.0);
}

void test_u8_normalized(void **)
{
    check_uv(
        [](test_gltf &g) { // rows padded to 4 bytes
            const int view =
                g.add_view(std::vector<uint8_t>{0, 255, 9, 9, 51, 102, 9, 9, 153, 204}, 4);
            return g.add_accessor(view, U8, "VEC2", 3, ",\"normalized\":true");
        },
        {0, 1, 0.2, 0.4, 0.6, 0.8}, 1e-7);
}

void test_u16_normalized(void **)
{
    check_uv(
        [](test_gltf &g) {
            return g.add(std::vector<uint16_t>{0, 65535, 13107, 26214, 39321, 52428}, U16, "VEC2",
                         3, ",\"normalized\":true");
        },
        {0, 1, 0.2, 0.4, 0.6, 0.8}, 1e-7);
}

void test_signed_normalized(void **)
{
    check_uv(
        [](test_gltf &g) { // the two lowest values are both -1
            const int view =
                g.add_view(std::vector<int8_t>{-128, 127, 0, 0, -127, 0, 0, 0, 64, -64}, 4);
            return g.add_accessor(view, I8, "VEC2", 3, ",\"normalized\":true");
        },
        {-1, 1, -1, 0, 64.0 / 127, -64.0 / 127}, 1e-7);
    check_uv(
        [](test_gltf &g) {
            return g.add(std::vector<int16_t>{-32768, 32767, -32767, 0, 1, -1}, I16, "VEC2", 3,
                         ",\"normalized\":true");
        },
        {-1, 1, -1, 0, 1.0 / 32767, -1.0 / 32767}, 1e-7);
}

void test_quantized_integers(void **)
{
    check_uv(
        [](test_gltf &g) {
            return g.add(std::vector<int16_t>{-300, 300, 0, 1, 2, 3}, I16, "VEC2", 3);
        },
        {-300, 300, 0, 1, 2, 3}, 0.0);
    check_uv(
        [](test_gltf &g) {
            const int view = g.add_view(std::vector<uint8_t>{0, 255, 9, 9, 7, 8, 9, 9, 5, 6}, 4);
            return g.add_accessor(view, U8, "VEC2", 3);
        },
        {0, 255, 7, 8, 5, 6}, 0.0);
}

void test_interleaved_with_offset(void **)
{
    check_uv(
        [](test_gltf &g) {
            const int view = g.add_view(std::vector<float>{9, 1, 2, 9, 3, 4, 9, 5, 6}, 12);
            return g.add_accessor(view, F32, "VEC2", 3, ",\"byteOffset\":4");
        },
        {1, 2, 3, 4, 5, 6}, 0.0);
}

void test_zeros_without_view(void **)
{
    check_uv([](test_gltf &g) { return g.add_accessor(-1, F32, "VEC2", 3); }, {0, 0, 0, 0, 0, 0},
             0.0);
}

void test_sparse(void **)
{
    for (const bool based : {false, true}) {
        check_uv(
            [based](test_gltf &g) {
                const int base = based ? g.add_view(std::vector<float>{1, 1, 2, 2, 3, 3}) : -1;
                const int indices = g.add_view(std::vector<uint16_t>{0, 2});
                const int values = g.add_view(std::vector<float>{7, 8, 5, 6});
                return g.add_accessor(base, F32, "VEC2", 3,
                                      ",\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":" +
                                          std::to_string(indices) +
                                          ",\"componentType\":5123},\"values\":{\"bufferView\":" +
                                          std::to_string(values) + "}}");
            },
            {7, 8, based ? 2.0 : 0.0, based ? 2.0 : 0.0, 5, 6}, 0.0);
    }
}

void test_whole_numbers_written_as_floats(void **)
{
    test_gltf gltf;
    gltf.add_view(test_triangle());
    gltf.accessors =
        "{\"componentType\":5126.0,\"type\":\"VEC3\",\"count\":3e0,\"bufferView\":0.0}";
    gltf.add_mesh("\"attributes\":{\"POSITION\":0.0}");
    const test_import in(gltf);
    assert_int_equal(in.mesh().triangle_count, 1);
}

void refuse(const std::string &accessor_extra, size_t count, const char *expected)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC3", count, accessor_extra);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0}");
    const test_import in(gltf);
    in.assert_refused(expected);
}

void test_out_of_bounds(void **)
{
    refuse("", 4, "needs bytes 0..48 of bufferViews[0], which has 36");
    refuse(",\"byteOffset\":4", 3, "needs bytes 4..40");
    refuse(",\"byteOffset\":9007199254740991", 1, "needs bytes");
    refuse("", 2147483647, "needs bytes");
}

void test_view_out_of_bounds(void **)
{
    const test_import in(
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":3,\"uri\":"
        "\"data:;base64,AAAA\"}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":4}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\","
        "\"count\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}"
        "]}]}");
    in.assert_refused("bufferViews[0] has bytes 0..4, but buffers[0] has 3");
}

void test_sparse_index_out_of_range(void **)
{
    test_gltf gltf;
    gltf.add_view(std::vector<uint16_t>{0, 3});
    gltf.add_view(std::vector<float>{0, 0, 0, 0, 0, 0});
    gltf.add_accessor(
        -1, F32, "VEC3", 3,
        ",\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":0,\"componentType\":5123},"
        "\"values\":{\"bufferView\":1}}");
    gltf.add_mesh("\"attributes\":{\"POSITION\":0}");
    const test_import in(gltf);
    in.assert_refused("sparse index 3, but 3 elements");
}

void test_wrong_types(void **)
{
    test_gltf gltf;
    gltf.add(test_triangle(), F32, "VEC2", 3);
    gltf.add_mesh("\"attributes\":{\"POSITION\":0}");
    test_import(gltf).assert_refused("expected VEC3");
    test_gltf integers;
    integers.add(std::vector<uint32_t>(9), U32, "VEC3", 3);
    integers.add_mesh("\"attributes\":{\"POSITION\":0}");
    test_import(integers).assert_refused("is u32, which has no meaning here");
}

void test_placeholder_buffer(void **)
{
    const test_import in("{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":36}],"
                         "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"accessors\":[{"
                         "\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":3}],"
                         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}");
    in.assert_warned("buffers[0] has no data");
    assert_int_equal(in.scene->dropped_triangles, 1);
}
} // namespace

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_float),
        cmocka_unit_test(test_u8_normalized),
        cmocka_unit_test(test_u16_normalized),
        cmocka_unit_test(test_signed_normalized),
        cmocka_unit_test(test_quantized_integers),
        cmocka_unit_test(test_interleaved_with_offset),
        cmocka_unit_test(test_zeros_without_view),
        cmocka_unit_test(test_sparse),
        cmocka_unit_test(test_whole_numbers_written_as_floats),
        cmocka_unit_test(test_out_of_bounds),
        cmocka_unit_test(test_view_out_of_bounds),
        cmocka_unit_test(test_sparse_index_out_of_range),
        cmocka_unit_test(test_wrong_types),
        cmocka_unit_test(test_placeholder_buffer),
    };
    return cmocka_run_group_tests(tests, nullptr, nullptr);
}
