// Materials: glTF 2.0 section 3.9 with KHR_materials_{emissive_strength, ior, specular, unlit} and
// KHR_texture_transform.
#include "src/import/gltf_impl.hpp"

#include <cmath>

namespace
{
using tinygltf::ExtensionMap;
using tinygltf::Value;

// What the kinds of texture reference have in common.
struct texture_ref {
    int index;
    int uv_set;
    const Value *transform; // KHR_texture_transform or NULL
};

template <class Info> texture_ref get_ref(const Info &info)
{
    return texture_ref{info.index, info.texCoord,
                       kl_gltf_find(info.extensions, "KHR_texture_transform")};
}

// Texture infos inside extensions are not parsed by tinygltf.
texture_ref get_ref(const Value &info)
{
    texture_ref ref = {-1, 0, nullptr};
    if (!info.IsObject()) return ref;
    ref.index = static_cast<int>(kl_gltf_get_number(info, "index", -1));
    ref.uv_set = static_cast<int>(kl_gltf_get_number(info, "texCoord", 0));
    const Value &extensions = info.Get("extensions");
    if (extensions.IsObject() && extensions.Has("KHR_texture_transform")) {
        ref.transform = &extensions.Get("KHR_texture_transform");
    }
    return ref;
}

double get_item(const Value &object, const char *name, size_t i, double fallback)
{
    const Value &list = object.Get(name);
    return list.IsArray() && i < list.ArrayLen() ? list.Get(static_cast<int>(i)).GetNumberAsDouble()
                                                 : fallback;
}

// KHR_texture_transform: (u', v') = T R S (u, v). A positive rotation turns the UVs counter-
// clockwise as they are seen, that is with v pointing down.
void read_transform(const Value &transform, float matrix[6])
{
    const double angle = kl_gltf_get_number(transform, "rotation", 0.0);
    const double c = std::cos(angle), s = std::sin(angle);
    const double su = get_item(transform, "scale", 0, 1.0);
    const double sv = get_item(transform, "scale", 1, 1.0);

    matrix[0] = kl_gltf_to_float(c * su);
    matrix[1] = kl_gltf_to_float(s * sv);
    matrix[2] = kl_gltf_to_float(get_item(transform, "offset", 0, 0.0));
    matrix[3] = kl_gltf_to_float(-s * su);
    matrix[4] = kl_gltf_to_float(c * sv);
    matrix[5] = kl_gltf_to_float(get_item(transform, "offset", 1, 0.0));
}

void read_texture(kl_gltf_import &in, const texture_ref &ref, const std::string &place,
                  kl_texture_use &out)
{
    if (ref.index < 0) return;
    const uint32_t texture = kl_gltf_get_texture(in, ref.index, place);
    if (texture == KL_NONE) return;
    int uv_set = ref.uv_set;
    if (ref.transform != nullptr) {
        uv_set = static_cast<int>(kl_gltf_get_number(*ref.transform, "texCoord", uv_set));
        read_transform(*ref.transform, out.matrix);
    }
    if (uv_set >= KL_MAX_UV_SETS) {
        kl_gltf_warn(in, "%s: TEXCOORD_%d, only 0 and 1 are read: 0 is used", place.c_str(),
                     uv_set);
        uv_set = 0;
    }
    out.texture = texture;
    out.uv_set = static_cast<uint32_t>(uv_set);
}

kl_material make_default()
{
    kl_material m = {};
    for (int i = 0; i < 4; ++i) {
        m.base_color[i] = 1.0f;
    }
    for (int i = 0; i < 3; ++i) {
        m.specular_color[i] = 1.0f;
    }
    m.metallic = 1.0f;
    m.roughness = 1.0f;
    m.alpha_cutoff = 0.5f;
    m.normal_scale = 1.0f;
    m.specular = 1.0f;
    m.ior = 1.5f;
    for (kl_texture_use &use : m.tex) {
        use.texture = KL_NONE;
        use.matrix[0] = 1.0f;
        use.matrix[4] = 1.0f;
    }
    return m;
}

void read_flags(kl_gltf_import &in, const tinygltf::Material &from, const std::string &place,
                kl_material &m)
{
    if (from.doubleSided) m.flags |= KL_MAT_DOUBLE_SIDED;
    if (from.alphaMode == "MASK") {
        m.flags |= KL_MAT_ALPHA_MASK;
        m.alpha_cutoff = kl_gltf_to_float(from.alphaCutoff);
    } else if (from.alphaMode == "BLEND") {
        m.flags |= KL_MAT_ALPHA_BLEND;
    } else if (from.alphaMode != "OPAQUE") {
        kl_gltf_warn(in, "%s.alphaMode: \"%.40s\" is unknown: OPAQUE is used", place.c_str(),
                     from.alphaMode.c_str());
    }
    if (kl_gltf_find(from.extensions, "KHR_materials_unlit") != nullptr) m.flags |= KL_MAT_UNLIT;
}

void read_ior(kl_gltf_import &in, const ExtensionMap &extensions, const std::string &place,
              kl_material &m)
{
    const Value *ior = kl_gltf_find(extensions, "KHR_materials_ior");
    if (ior == nullptr) return;
    const double value = kl_gltf_get_number(*ior, "ior", 1.5);
    // 0 stands for a reflectance of 1 at every angle (the extension's own convention).
    if (value != 0.0 && value < 1.0) {
        kl_gltf_warn(in, "%s: ior %g, expected 0 or >= 1: 1 is used", place.c_str(), value);
        m.ior = 1.0f;
        return;
    }
    m.ior = kl_gltf_to_float(value);
}

void read_specular(kl_gltf_import &in, const ExtensionMap &extensions, const std::string &place,
                   kl_material &m)
{
    const Value *specular = kl_gltf_find(extensions, "KHR_materials_specular");
    if (specular == nullptr) return;
    m.specular = kl_gltf_to_float(kl_gltf_get_number(*specular, "specularFactor", 1.0));
    for (size_t i = 0; i < 3; ++i) {
        m.specular_color[i] = kl_gltf_to_float(get_item(*specular, "specularColorFactor", i, 1.0));
    }
    read_texture(in, get_ref(specular->Get("specularTexture")), place + ".specularTexture",
                 m.tex[KL_TEX_SPECULAR]);
    read_texture(in, get_ref(specular->Get("specularColorTexture")),
                 place + ".specularColorTexture", m.tex[KL_TEX_SPECULAR_COLOR]);
}

void read_emission(const tinygltf::Material &from, kl_material &m, kl_scene_glow &glow)
{
    const Value *extension = kl_gltf_find(from.extensions, "KHR_materials_emissive_strength");
    const double strength =
        extension != nullptr ? kl_gltf_get_number(*extension, "emissiveStrength", 1.0) : 1.0;
    glow.strength = kl_gltf_to_float(strength);
    for (size_t i = 0; i < 3 && i < from.emissiveFactor.size(); ++i) {
        glow.factor[i] = kl_gltf_to_float(from.emissiveFactor[i]);
        m.emission[i] = kl_gltf_to_float(from.emissiveFactor[i] * strength);
    }
}

kl_material read_material(kl_gltf_import &in, const tinygltf::Material &from,
                          const std::string &place, kl_scene_glow &glow)
{
    kl_material m = make_default();
    const auto &pbr = from.pbrMetallicRoughness;

    for (size_t i = 0; i < 4 && i < pbr.baseColorFactor.size(); ++i) {
        m.base_color[i] = kl_gltf_to_float(pbr.baseColorFactor[i]);
    }
    m.metallic = kl_gltf_to_float(pbr.metallicFactor);
    m.roughness = kl_gltf_to_float(pbr.roughnessFactor);
    m.normal_scale = kl_gltf_to_float(from.normalTexture.scale);
    read_flags(in, from, place, m);
    read_emission(from, m, glow);
    read_texture(in, get_ref(pbr.baseColorTexture), place + ".baseColorTexture",
                 m.tex[KL_TEX_BASE_COLOR]);
    read_texture(in, get_ref(pbr.metallicRoughnessTexture), place + ".metallicRoughnessTexture",
                 m.tex[KL_TEX_METAL_ROUGH]);
    read_texture(in, get_ref(from.normalTexture), place + ".normalTexture", m.tex[KL_TEX_NORMAL]);
    read_texture(in, get_ref(from.emissiveTexture), place + ".emissiveTexture",
                 m.tex[KL_TEX_EMISSIVE]);
    read_ior(in, from.extensions, place, m);
    read_specular(in, from.extensions, place, m);
    return m;
}
} // namespace

void kl_gltf_read_materials(kl_gltf_import &in)
{
    const size_t count = in.model.materials.size();

    in.image_of.assign(in.images.size(), KL_NONE);
    in.texture_of.assign(in.model.textures.size(), KL_NONE);
    in.texture_is_broken.assign(in.model.textures.size(), false);
    in.scene->images = kl_gltf_new_array<kl_scene_image>(in.images.size());
    in.scene->textures = kl_gltf_new_array<kl_scene_texture>(in.model.textures.size());
    in.scene->materials = kl_gltf_new_array<kl_material>(count + 1); // and the default
    in.scene->glows = kl_gltf_new_array<kl_scene_glow>(count + 1);
    for (size_t i = 0; i < count; ++i) {
        in.scene->materials[i] =
            read_material(in, in.model.materials[i], kl_gltf_format_text("materials[%zu]", i),
                          in.scene->glows[i]);
        ++in.scene->material_count;
    }
}

uint32_t kl_gltf_get_material(kl_gltf_import &in, int material)
{
    if (material >= 0) return static_cast<uint32_t>(material);
    if (in.default_material == KL_NONE) {
        in.default_material = in.scene->material_count++;
        in.scene->materials[in.default_material] = make_default();
    }
    return in.default_material;
}
