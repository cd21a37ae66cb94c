// Documents as a whole: extensions, hierarchy, materials, lights, cameras, animations, images.
#include "test_import_build.hpp"

namespace
{
std::string document(const std::string &members)
{
    return "{\"asset\":{\"version\":\"2.0\"}," + members + "}";
}

void test_not_gltf(void **)
{
    test_import("").assert_refused("the file is empty");
    test_import("hello").assert_refused("not valid JSON");
    test_import("[]").assert_refused("expected an object");
    test_import("{}").assert_refused("no \"asset\"");
    test_import("{\"asset\":{\"version\":\"1.0\"}}").assert_refused("asset.version \"1.0\"");
    test_import(std::string(100000, '[')).assert_refused("nested deeper than 64");
    test_import(document("\"nodes\":{}")).assert_refused("nodes: object, expected an array");
    test_import(document("\"nodes\":[{\"mesh\":0}]")).assert_refused("nodes[0].mesh: found 0, but");
}

void append_u32(std::string &out, uint32_t value)
{
    for (int i = 0; i < 4; ++i) {
        out += static_cast<char>(value >> (8 * i) & 0xffu);
    }
}

std::string make_glb(uint32_t version, uint32_t length, uint32_t json_length,
                     const std::string &json)
{
    std::string out = "glTF";
    append_u32(out, version);
    append_u32(out, length);
    append_u32(out, json_length);
    out += "JSON" + json;
    return out;
}

void test_glb(void **)
{
    const std::string json = "{\"asset\":{\"version\":\"2.0\"}} ";
    const uint32_t size = static_cast<uint32_t>(json.size());
    assert_int_equal(test_import(make_glb(2, 20 + size, size, json)).status, KL_OK);
    test_import(make_glb(1, 20 + size, size, json)).assert_refused("GLB version 1");
    test_import(make_glb(2, 21 + size, size, json)).assert_refused("GLB length");
    test_import(make_glb(2, 20 + size, size + 1, json)).assert_refused("chunk of");
    test_import(make_glb(2, 20 + size, 0xffffffffu, json)).assert_refused("chunk of 4294967295");
    test_import("glTF\2").assert_refused("GLB header");
    test_import(make_glb(2, 24 + size, size, json + "    ")).assert_refused("header cut off");
}

void test_extensions(void **)
{
    test_import(document("\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]"))
        .assert_refused("extension KHR_draco_mesh_compression is required");
    const test_import in(document("\"extensionsUsed\":[\"A_b\",\"KHR_texture_transform\"],"
                                  "\"nodes\":[{\"extensions\":{\"A_b\":{}}}]"));
    in.assert_warned("extension A_b is not supported");
    assert_int_equal(in.warnings.size(), 1);
}

void test_hierarchy_is_reordered(void **)
{
    const test_import in(
        document("\"nodes\":[{\"name\":\"leaf\"},{\"name\":\"mid\",\"children\":[0]},"
                 "{\"name\":\"root\",\"children\":[1]}]"));
    assert_int_equal(in.status, KL_OK);
    assert_string_equal(in.scene->nodes[0].name, "root");
    assert_int_equal(in.scene->nodes[0].parent, KL_NONE);
    assert_string_equal(in.scene->nodes[1].name, "mid");
    assert_int_equal(in.scene->nodes[1].parent, 0);
    assert_string_equal(in.scene->nodes[2].name, "leaf");
    assert_int_equal(in.scene->nodes[2].parent, 1);
}

void test_broken_hierarchy(void **)
{
    test_import(document("\"nodes\":[{\"children\":[1]},{\"children\":[0]}]"))
        .assert_refused("nodes[0]: is its own ancestor");
    test_import(document("\"nodes\":[{\"children\":[0]}]")).assert_refused("own ancestor");
    test_import(document("\"nodes\":[{\"children\":[2]},{\"children\":[2]},{}]"))
        .assert_refused("nodes[2]: child of nodes[0] and of nodes[1]");
    const test_import in(document("\"nodes\":[{\"rotation\":[0,0,0,0]}]"));
    in.assert_warned("nodes[0].rotation: length 0");
    assert_true(in.scene->nodes[0].rotation[3] == 1.0);
}

void test_scene_selection(void **)
{
    const std::string nodes = "\"nodes\":[{},{\"children\":[2]},{}]";
    const struct {
        const char *scenes;
        bool visible[3];
    } cases[] = {
        {"", {true, true, true}},
        {",\"scenes\":[{\"nodes\":[0]},{\"nodes\":[1]}]", {true, false, false}},
        {",\"scene\":1,\"scenes\":[{\"nodes\":[0]},{\"nodes\":[1]}]", {false, true, true}},
    };
    for (const auto &c : cases) {
        const test_import in(document(nodes + c.scenes));
        assert_int_equal(in.status, KL_OK);
        for (int n = 0; n < 3; ++n) {
            assert_int_equal(in.scene->nodes[n].visible, c.visible[n]);
        }
    }
}

void test_material(void **)
{
    const test_import in(document(
        "\"images\":[{\"uri\":\"" + test_png_uri() +
        "\"}],\"samplers\":[{\"wrapS\":33071,\"wrapT\":33648,\"magFilter\":9728}],\"textures\":[{"
        "\"source\":0,\"sampler\":0}],\"materials\":[{\"alphaMode\":\"MASK\",\"alphaCutoff\":0.25,"
        "\"doubleSided\":true,\"emissiveFactor\":[1,0.5,0],\"pbrMetallicRoughness\":{"
        "\"baseColorFactor\":[0.1,0.2,0.3,0.4],\"metallicFactor\":0.5,\"roughnessFactor\":2,"
        "\"baseColorTexture\":{\"index\":0,\"texCoord\":1,\"extensions\":{\"KHR_texture_"
        "transform\":{"
        "\"offset\":[0.5,0.25],\"scale\":[2,3],\"texCoord\":0}}}},\"extensions\":{"
        "\"KHR_materials_emissive_strength\":{\"emissiveStrength\":10},\"KHR_materials_ior\":{"
        "\"ior\":1.33},\"KHR_materials_specular\":{\"specularFactor\":0.5,\"specularColorFactor\":"
        "[1,2,3],\"specularTexture\":{\"index\":0,\"texCoord\":1}},\"KHR_materials_unlit\":{}}}]"));
    in.assert_warned("materials[0].pbrMetallicRoughness.roughnessFactor: found 2, expected 0..1");
    const kl_material &m = in.scene->materials[0];
    assert_floats(m.base_color, {0.1, 0.2, 0.3, 0.4}, 1e-7);
    assert_floats(m.emission, {10, 5, 0}, 0.0);
    assert_floats(&m.metallic, {0.5, 1.0, 0.25}, 0.0);
    assert_floats(&m.specular, {0.5, 1, 2, 3}, 0.0);
    assert_floats(&m.ior, {1.33}, 1e-6);
    assert_int_equal(m.flags, KL_MAT_DOUBLE_SIDED | KL_MAT_UNLIT | KL_MAT_ALPHA_MASK);
    assert_int_equal(m.tex[KL_TEX_BASE_COLOR].uv_set, 0);
    assert_floats(m.tex[KL_TEX_BASE_COLOR].matrix, {2, 0, 0.5, 0, 3, 0.25}, 1e-6);
    assert_int_equal(m.tex[KL_TEX_SPECULAR].uv_set, 1);
    assert_int_equal(m.tex[KL_TEX_NORMAL].texture, KL_NONE);
    assert_int_equal(in.scene->texture_count, 1); // shared by both uses
    assert_int_equal(in.scene->textures[0].wrap_s, KL_WRAP_CLAMP);
    assert_int_equal(in.scene->textures[0].wrap_t, KL_WRAP_MIRROR);
    assert_true(in.scene->textures[0].nearest);
    assert_int_equal(in.scene->images[0].width, 1);
    const uint8_t red[4] = {255, 0, 0, 255};
    assert_memory_equal(in.scene->images[0].texels, red, 4);
}

void test_images(void **)
{
    const std::string rest = "\"textures\":[{\"source\":0}],\"materials\":[{\"emissiveTexture\":{"
                             "\"index\":0}}],\"images\":[{\"uri\":\"";
    const std::string png = test_png_uri();
    test_import(document(rest + png.substr(0, png.size() - 48) + "\"}]"))
        .assert_refused("images[0]: damaged image");
    test_import(document(rest + "data:;base64,!\"}]")).assert_refused("expected base64");
    test_import(document(rest + "http://a/b.png\"}]"))
        .assert_refused("expected a file or data URI");
    const test_import other(document(rest + "data:image/ktx;base64,AAAAAAAA\"}]"));
    other.assert_warned("images[0]: neither PNG nor JPEG");
    assert_int_equal(other.scene->materials[0].tex[KL_TEX_EMISSIVE].texture, KL_NONE);
    // What nothing uses is not looked at.
    assert_int_equal(test_import(document("\"images\":[{\"uri\":\"none.png\"}]")).status, KL_OK);
}

void test_lights(void **)
{
    const std::string lights =
        "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"spot\",\"color\":[1,0.5,"
        "0],"
        "\"intensity\":7,\"range\":3,\"spot\":{\"innerConeAngle\":0.1,\"outerConeAngle\":0.2}},{"
        "\"type\":\"directional\"},{\"type\":\"area\"}]}},\"nodes\":[";
    const std::string use = "\"extensions\":{\"KHR_lights_punctual\":{\"light\":";
    const test_import in(
        document(lights + "{\"name\":\"lamp\"," + use + "0}}},{" + use + "1}}},{" + use + "2}}}]"));
    in.assert_warned("type \"area\" is unknown");
    assert_int_equal(in.scene->light_count, 2);
    const kl_scene_light &spot = in.scene->lights[0];
    assert_string_equal(spot.name, "lamp");
    assert_int_equal(spot.type, KL_LIGHT_SPOT);
    assert_true(spot.intensity == 7.0 && spot.range == 3.0 && spot.color[1] == 0.5);
    assert_true(spot.inner_cone == 0.1 && spot.outer_cone == 0.2);
    assert_int_equal(in.scene->lights[1].type, KL_LIGHT_DIRECTIONAL);
    assert_true(in.scene->lights[1].intensity == 1.0 && in.scene->lights[1].color[2] == 1.0);
}

void test_cameras(void **)
{
    const test_import in(document(
        "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":2,\"zfar\":1}"
        "},{"
        "\"type\":\"orthographic\",\"name\":\"ortho\",\"orthographic\":{\"xmag\":2,\"ymag\":1,"
        "\"znear\":0,\"zfar\":9}},{\"type\":\"perspective\",\"perspective\":{\"yfov\":0,\"znear\":"
        "1}}"
        "],\"nodes\":[{\"camera\":0},{\"camera\":1},{\"camera\":0,\"name\":\"eye\"},{\"camera\":2}"
        "]"));
    in.assert_warned("cameras[0]: zfar 1, expected > znear 2");
    in.assert_warned("cameras[2]: yfov 0");
    assert_int_equal(in.scene->camera_count, 3);
    assert_string_equal(in.scene->cameras[0].name, "camera 0");
    assert_string_equal(in.scene->cameras[1].name, "ortho");
    assert_string_equal(in.scene->cameras[2].name, "eye");
    assert_true(in.scene->cameras[0].zfar == 0.0 && in.scene->cameras[0].aspect == 0.0);
    assert_true(in.scene->cameras[1].xmag == 2.0);
}

test_gltf make_animation(const std::vector<float> &times, const std::vector<float> &values,
                         const std::string &interpolation)
{
    test_gltf gltf;
    gltf.add(times, F32, "SCALAR", times.size());
    gltf.add(values, F32, "VEC3", values.size() / 3);
    gltf.rest =
        ",\"nodes\":[{}],\"animations\":[{\"samplers\":[{\"input\":0,\"output\":1,"
        "\"interpolation\":\"" +
        interpolation +
        "\"}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"translation\"}},{"
        "\"sampler\":0,\"target\":{\"path\":\"scale\"}},{\"sampler\":0,\"target\":{\"node\":0,"
        "\"path\":\"weights\"}}]}]";
    return gltf;
}

void test_animation(void **)
{
    const test_import in(
        make_animation({0, 1, 1, 2}, {1, 1, 1, 2, 2, 2, 9, 9, 9, 3, 3, 3}, "LINEAR"));
    in.assert_warned("1 key times do not increase");
    in.assert_warned("has no morph targets");
    const kl_animation &animation = in.scene->animations[0];
    assert_int_equal(animation.channel_count, 1);
    assert_int_equal(animation.channels[0].key_count, 3);
    assert_floats(animation.channels[0].times, {0, 1, 2}, 0.0);
    assert_floats(animation.channels[0].values, {1, 1, 1, 2, 2, 2, 3, 3, 3}, 0.0);
    assert_true(animation.duration == 2.0);
}

void test_animation_counts(void **)
{
    test_import(make_animation({0, 1}, {1, 1, 1}, "STEP"))
        .assert_refused("2 keys, but 3 output numbers, expected 6");
    test_import(make_animation({0, 1}, {1, 1, 1, 2, 2, 2}, "CUBICSPLINE"))
        .assert_refused("expected 18");
}
} // namespace

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_not_gltf),         cmocka_unit_test(test_glb),
        cmocka_unit_test(test_extensions),       cmocka_unit_test(test_hierarchy_is_reordered),
        cmocka_unit_test(test_broken_hierarchy), cmocka_unit_test(test_scene_selection),
        cmocka_unit_test(test_material),         cmocka_unit_test(test_images),
        cmocka_unit_test(test_lights),           cmocka_unit_test(test_cameras),
        cmocka_unit_test(test_animation),        cmocka_unit_test(test_animation_counts),
    };
    return cmocka_run_group_tests(tests, nullptr, nullptr);
}
