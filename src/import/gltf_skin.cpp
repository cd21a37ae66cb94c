// Skins: glTF 2.0 section 3.7.3.
#include "src/import/gltf_impl.hpp"

#include <cmath>

namespace
{
// Affine matrices with finite numbers only.
void read_inverse_bind(kl_gltf_import &in, int accessor, const std::string &place, kl_skin &out)
{
    const kl_gltf_numbers from = kl_gltf_read_numbers(in, accessor, KL_GLTF_MAT4 | KL_GLTF_FLOAT,
                                                      place + ".inverseBindMatrices");
    size_t wrong = 0;

    if (from.count < out.joint_count) {
        kl_import_refuse("%s: %zu inverse bind matrices, but %u joints", place.c_str(), from.count,
                         out.joint_count);
    }
    for (size_t i = 0; i < size_t(out.joint_count) * 16; ++i) {
        const double x = static_cast<double>(from.values[i]);
        const bool last_row = i % 4 == 3;
        const double expected = i % 16 == 15 ? 1.0 : 0.0;
        if (!std::isfinite(x) || std::fabs(x) > 1e18) {
            kl_import_refuse("%s: inverse bind matrix %zu holds %g", place.c_str(), i / 16, x);
        }
        if (last_row && std::fabs(x - expected) > 1e-4) ++wrong;
        out.inverse_bind[i] = last_row ? expected : x;
    }
    if (wrong > 0) {
        kl_gltf_warn(in, "%s: inverse bind matrices whose last row is not 0 0 0 1: it is replaced",
                     place.c_str());
    }
}

void read_skin(kl_gltf_import &in, size_t index, kl_skin &out)
{
    const tinygltf::Skin &from = in.model.skins[index];
    const std::string place = kl_gltf_format_text("skins[%zu]", index);

    if (from.joints.empty()) kl_import_refuse("%s: no joints", place.c_str());
    out.joints = kl_gltf_new_array<uint32_t>(from.joints.size());
    out.inverse_bind = kl_gltf_new_array<double>(from.joints.size() * 16);
    out.joint_count = static_cast<uint32_t>(from.joints.size());
    for (size_t j = 0; j < from.joints.size(); ++j) {
        out.joints[j] = in.node_of[static_cast<size_t>(from.joints[j])];
        for (size_t i = 0; i < 4; ++i) {
            out.inverse_bind[j * 16 + i * 5] = 1.0;
        }
    }
    if (from.inverseBindMatrices >= 0) read_inverse_bind(in, from.inverseBindMatrices, place, out);
}
} // namespace

void kl_gltf_read_skins(kl_gltf_import &in)
{
    kl_scene &scene = *in.scene;

    scene.skins = kl_gltf_new_array<kl_skin>(in.model.skins.size());
    for (size_t s = 0; s < in.model.skins.size(); ++s) {
        ++scene.skin_count;
        read_skin(in, s, scene.skins[s]);
    }
    for (uint32_t i = 0; i < scene.instance_count; ++i) {
        const kl_scene_instance &instance = scene.instances[i];
        if (instance.skin == KL_NONE) continue;
        const uint32_t limit = in.skin_joint_limit[instance.mesh];
        const uint32_t joints = scene.skins[instance.skin].joint_count;
        if (limit > joints) {
            kl_import_refuse("%s: vertices use joint %u, but skins[%u] has %u joints",
                             scene.nodes[instance.node].name, limit - 1, instance.skin, joints);
        }
    }
}
