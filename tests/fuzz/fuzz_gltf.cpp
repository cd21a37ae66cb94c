// Any bytes as a glTF file: import, then pose and deform at two instants. Invariants of scene.h are
// checked as they would be relied on. Corpus: any .gltf and .glb files.
#include "src/import/import.h"

#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace
{
void require(bool condition)
{
    if (!condition) std::abort();
}

void check_mesh(const kl_scene &scene, const kl_mesh &mesh)
{
    require(mesh.material < scene.material_count && mesh.name != nullptr);
    require(mesh.triangle_count > 0 && mesh.vertex_count > 0);
    for (size_t i = 0; i < size_t(mesh.triangle_count) * 3; ++i) {
        require(mesh.indices[i] < mesh.vertex_count);
    }
    for (size_t v = 0; v < mesh.vertex_count; ++v) {
        const float *n = mesh.normals + v * 3;
        const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        require(std::fabs(length - 1.0f) < 1e-3f);
        for (size_t i = 0; i < 3; ++i) {
            require(std::isfinite(mesh.positions[v * 3 + i]));
        }
    }
    const bool mapped = scene.materials[mesh.material].tex[KL_TEX_NORMAL].texture != KL_NONE;
    require(!mapped || mesh.tangents != nullptr);
}

void check_scene(const kl_scene &scene)
{
    for (uint32_t m = 0; m < scene.mesh_count; ++m) {
        check_mesh(scene, scene.meshes[m]);
    }
    for (uint32_t n = 0; n < scene.node_count; ++n) {
        require(scene.nodes[n].parent == KL_NONE || scene.nodes[n].parent < n);
    }
    for (uint32_t a = 0; a < scene.animation_count; ++a) {
        for (uint32_t c = 0; c < scene.animations[a].channel_count; ++c) {
            const kl_animation_channel &channel = scene.animations[a].channels[c];
            require(channel.key_count > 0 && channel.node < scene.node_count);
            for (uint32_t k = 1; k < channel.key_count; ++k) {
                require(channel.times[k] > channel.times[k - 1]);
            }
        }
    }
}

void deform_all(const kl_scene &scene, double time)
{
    kl_err err = {};
    kl_pose *pose = nullptr;
    if (kl_pose_create(&scene, KL_NONE, time, &pose, &err) != KL_OK) return;
    for (uint32_t i = 0; i < scene.instance_count; ++i) {
        kl_deformed deformed = {};
        if (!kl_instance_is_deformed(&scene, i)) continue;
        if (kl_instance_deform(&scene, pose, i, &deformed, &err) != KL_OK) continue;
        kl_deformed_fini(&deformed);
    }
    kl_pose_destroy(pose);
}
} // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    kl_err err = {};
    kl_scene *scene = nullptr;

    if (kl_import_gltf_memory(data, size, "fuzz", nullptr, nullptr, &scene, &err) != KL_OK) {
        require(err.msg[0] != '\0');
        return 0;
    }
    check_scene(*scene);
    deform_all(*scene, 0.0);
    deform_all(*scene, 0.7);
    (void)kl_scene_is_moving(scene, KL_NONE);
    kl_scene_destroy(scene);
    return 0;
}
