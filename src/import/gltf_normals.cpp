// Normals: flat ones where the file has none (glTF 2.0 section 3.7.2.1), and repairs.
#include "src/import/gltf_impl.hpp"
#include "src/import/gltf_vec.hpp"

namespace
{
// Normal of triangle `t` with the target's displacements, if any. Length: twice the area.
kl_gltf_vec face_normal(const kl_gltf_primitive &p, size_t t, const std::vector<float> *moved)
{
    kl_gltf_vec q[3];
    for (size_t k = 0; k < 3; ++k) {
        const size_t at = size_t(p.indices[t * 3 + k]) * 3;
        q[k] = kl_gltf_load(&p.positions[at]);
        if (moved != nullptr) q[k] = q[k] + kl_gltf_load(&(*moved)[at]);
    }
    return kl_gltf_cross(q[1] - q[0], q[2] - q[0]);
}

// The change of the flat normals that a target makes: exact at weight 0 and 1.
void make_flat_target_normals(const kl_gltf_primitive &p, kl_gltf_target &target)
{
    if (target.positions.empty()) return;
    target.normals.assign(p.vertex_count * 3, 0.0f);
    for (size_t t = 0; t < p.indices.size() / 3; ++t) {
        kl_gltf_vec n = face_normal(p, t, &target.positions);
        if (!kl_gltf_normalize(n)) continue;
        for (size_t k = 0; k < 3; ++k) {
            const size_t at = size_t(p.indices[t * 3 + k]) * 3;
            kl_gltf_store(n - kl_gltf_load(&p.normals[at]), &target.normals[at]);
        }
    }
}
} // namespace

void kl_gltf_make_flat_normals(kl_gltf_primitive &p)
{
    const std::vector<uint32_t> corners = p.indices;

    kl_gltf_gather_vertices(p, corners); // each triangle gets three vertices of its own
    p.normals.resize(p.vertex_count * 3);
    for (size_t i = 0; i < p.indices.size(); ++i) {
        p.indices[i] = static_cast<uint32_t>(i);
    }
    for (size_t t = 0; t < p.indices.size() / 3; ++t) {
        kl_gltf_vec n = face_normal(p, t, nullptr);
        if (!kl_gltf_normalize(n)) n = {0.0, 0.0, 1.0}; // has an area in a target only
        for (size_t k = 0; k < 3; ++k) {
            kl_gltf_store(n, &p.normals[(t * 3 + k) * 3]);
        }
    }
    for (kl_gltf_target &target : p.targets) {
        make_flat_target_normals(p, target);
    }
}

void kl_gltf_repair_normals(kl_gltf_import &in, kl_gltf_primitive &p)
{
    std::vector<uint32_t> missing;
    size_t wrong = 0;

    for (size_t v = 0; v < p.vertex_count; ++v) {
        kl_gltf_vec n = kl_gltf_load(&p.normals[v * 3]);
        const double length = std::sqrt(kl_gltf_dot(n, n));
        // 8-bit normals miss unit length by up to 0.7 %.
        if (!(std::fabs(length - 1.0) < 0.02)) ++wrong;
        if (kl_gltf_normalize(n)) {
            kl_gltf_store(n, &p.normals[v * 3]);
        } else {
            missing.push_back(static_cast<uint32_t>(v));
        }
    }
    if (wrong > 0) {
        kl_gltf_warn(in, "%s NORMAL: %zu normals are not of unit length: they are repaired",
                     p.place.c_str(), wrong);
    }
    if (missing.empty()) return;
    // The mean of the triangles round the vertex, weighted by area.
    std::vector<kl_gltf_vec> sums(p.vertex_count, kl_gltf_vec{0.0, 0.0, 0.0});
    for (size_t t = 0; t < p.indices.size() / 3; ++t) {
        const kl_gltf_vec n = face_normal(p, t, nullptr);
        for (size_t k = 0; k < 3; ++k) {
            kl_gltf_vec &sum = sums[p.indices[t * 3 + k]];
            sum = sum + n;
        }
    }
    for (const uint32_t v : missing) {
        kl_gltf_vec n = sums[v];
        if (!kl_gltf_normalize(n)) n = {0.0, 0.0, 1.0};
        kl_gltf_store(n, &p.normals[size_t(v) * 3]);
    }
}
