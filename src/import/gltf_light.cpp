// Lights: KHR_lights_punctual.
#include "src/import/gltf_impl.hpp"

namespace
{
bool read_type(kl_gltf_import &in, const tinygltf::Light &from, const std::string &place,
               kl_scene_light &out)
{
    if (from.type == "point") {
        out.type = KL_LIGHT_POINT;
    } else if (from.type == "spot") {
        out.type = KL_LIGHT_SPOT;
    } else if (from.type == "directional") {
        out.type = KL_LIGHT_DIRECTIONAL;
    } else {
        kl_gltf_warn(in, "%s: type \"%.40s\" is unknown: left out", place.c_str(),
                     from.type.c_str());
        return false;
    }
    return true;
}

void read_cone(kl_gltf_import &in, const tinygltf::SpotLight &from, const std::string &place,
               kl_scene_light &out)
{
    out.inner_cone = from.innerConeAngle;
    out.outer_cone = from.outerConeAngle;
    if (out.outer_cone > out.inner_cone) return;
    kl_gltf_warn(in, "%s: outerConeAngle %g, expected > innerConeAngle %g: a hard edge is used",
                 place.c_str(), out.outer_cone, out.inner_cone);
    out.outer_cone = out.inner_cone > 0.0 ? out.inner_cone : 1e-3;
    out.inner_cone = out.outer_cone * 0.999; // a hard edge, but with a width to divide by
}

bool read_light(kl_gltf_import &in, size_t index, kl_scene_light &out)
{
    const tinygltf::Light &from = in.model.lights[index];
    const std::string place = kl_gltf_format_text("lights[%zu]", index);

    if (!read_type(in, from, place, out)) return false;
    for (size_t i = 0; i < 3; ++i) {
        out.color[i] = from.color.size() == 3 ? from.color[i] : 1.0;
    }
    out.intensity = from.intensity;
    out.range = from.range;
    if (out.type == KL_LIGHT_SPOT) read_cone(in, from.spot, place, out);
    return true;
}
} // namespace

void kl_gltf_read_lights(kl_gltf_import &in)
{
    kl_scene &scene = *in.scene;

    scene.lights = kl_gltf_new_array<kl_scene_light>(scene.node_count);
    for (uint32_t n = 0; n < scene.node_count; ++n) {
        const tinygltf::Node &from = in.model.nodes[in.file_node[n]];
        const tinygltf::Value *use = kl_gltf_find(from.extensions, "KHR_lights_punctual");
        if (use == nullptr || !scene.nodes[n].visible) continue;
        const size_t index = static_cast<size_t>(kl_gltf_get_number(*use, "light", 0.0));
        kl_scene_light out = {};
        out.node = n;
        out.source = static_cast<uint32_t>(index);
        if (!read_light(in, index, out)) continue;
        const std::string &name = from.name.empty() ? in.model.lights[index].name : from.name;
        out.name = kl_gltf_copy_name(kl_gltf_name(name, "light", index));
        scene.lights[scene.light_count++] = out;
    }
}
