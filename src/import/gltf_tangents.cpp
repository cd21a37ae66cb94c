// Tangents for normal maps. After Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008):
// per corner the direction of increasing u in the triangle, laid into the plane of the vertex
// normal and weighted by the corner's angle there, summed over all corners that share position,
// normal, UV and orientation. Differs from MikkTSpace in that corners need not share an edge.
//
// glTF 2.0 section 3.7.2.1: bitangent = cross(normal, tangent) * w, which is the way of decreasing
// v, as v points down in glTF.
#include "src/import/gltf_impl.hpp"
#include "src/import/gltf_vec.hpp"

#include <algorithm>
#include <array>
#include <unordered_map>

namespace
{
// What makes two vertices one for tangents; bits compared, as both come from the same file.
struct weld_key {
    std::array<uint32_t, 8> bits;
    bool operator==(const weld_key &other) const
    {
        return bits == other.bits;
    }
};
struct weld_hash {
    size_t operator()(const weld_key &key) const
    {
        uint64_t h = 0xcbf29ce484222325u; // FNV-1a over words, mixed at the end
        for (const uint32_t word : key.bits) {
            h = (h ^ word) * 0x100000001b3u;
        }
        return static_cast<size_t>(h ^ h >> 29);
    }
};

struct uv_pair {
    double u, v;
};

uv_pair get_uv(const kl_gltf_primitive &p, const kl_texture_use &use, size_t vertex)
{
    const std::vector<float> &uv = p.uv[use.uv_set];
    if (uv.empty()) return {0.0, 0.0};
    const double u = static_cast<double>(uv[vertex * 2]);
    const double v = static_cast<double>(uv[vertex * 2 + 1]);
    const float *m = use.matrix;
    return {static_cast<double>(m[0]) * u + static_cast<double>(m[1]) * v,
            static_cast<double>(m[3]) * u + static_cast<double>(m[4]) * v};
}

std::vector<uint32_t> weld_vertices(const kl_gltf_primitive &p, const kl_texture_use &use)
{
    std::unordered_map<weld_key, uint32_t, weld_hash> groups;
    std::vector<uint32_t> group_of(p.vertex_count);

    groups.reserve(p.vertex_count);
    for (size_t v = 0; v < p.vertex_count; ++v) {
        weld_key key = {};
        std::memcpy(&key.bits[0], &p.positions[v * 3], 3 * sizeof(float));
        std::memcpy(&key.bits[3], &p.normals[v * 3], 3 * sizeof(float));
        if (!p.uv[use.uv_set].empty()) {
            std::memcpy(&key.bits[6], &p.uv[use.uv_set][v * 2], 2 * sizeof(float));
        }
        group_of[v] = groups.emplace(key, static_cast<uint32_t>(groups.size())).first->second;
    }
    return group_of;
}

// Directions of one triangle. `sign` is the orientation of its UVs with v up: 1, -1, 0 (no area).
struct triangle_frame {
    kl_gltf_vec along_u;
    int sign;
};

triangle_frame find_frame(const kl_gltf_primitive &p, const kl_texture_use &use, const uint32_t *v)
{
    const kl_gltf_vec q0 = kl_gltf_load(&p.positions[size_t(v[0]) * 3]);
    const kl_gltf_vec e1 = kl_gltf_load(&p.positions[size_t(v[1]) * 3]) - q0;
    const kl_gltf_vec e2 = kl_gltf_load(&p.positions[size_t(v[2]) * 3]) - q0;
    const uv_pair t0 = get_uv(p, use, v[0]), t1 = get_uv(p, use, v[1]), t2 = get_uv(p, use, v[2]);
    const double u1 = t1.u - t0.u, v1 = t0.v - t1.v, u2 = t2.u - t0.u, v2 = t0.v - t2.v;
    const double area = u1 * v2 - u2 * v1;
    triangle_frame frame = {{0.0, 0.0, 0.0}, 0};

    if (area == 0.0 || !std::isfinite(area)) return frame;
    frame.along_u = e1 * v2 - e2 * v1;
    frame.sign = area > 0.0 ? 1 : -1;
    if (frame.sign < 0) frame.along_u = frame.along_u * -1.0;
    return frame;
}

kl_gltf_vec project(kl_gltf_vec v, kl_gltf_vec n)
{
    return v - n * kl_gltf_dot(v, n);
}

double corner_angle(const kl_gltf_primitive &p, const uint32_t *v, size_t k, kl_gltf_vec n)
{
    const kl_gltf_vec at = kl_gltf_load(&p.positions[size_t(v[k]) * 3]);
    kl_gltf_vec a = project(kl_gltf_load(&p.positions[size_t(v[(k + 1) % 3]) * 3]) - at, n);
    kl_gltf_vec b = project(kl_gltf_load(&p.positions[size_t(v[(k + 2) % 3]) * 3]) - at, n);
    if (!kl_gltf_normalize(a) || !kl_gltf_normalize(b)) return 0.0;
    return std::acos(std::min(std::max(kl_gltf_dot(a, b), -1.0), 1.0));
}

// A vertex that triangles of both orientations use becomes two: returns for each vertex its sign.
// Triangles without UV area take the vertices as they are.
std::vector<int> split_mirrored(kl_gltf_primitive &p, const std::vector<triangle_frame> &frames)
{
    std::vector<int> sign_of(p.vertex_count, 0);
    std::vector<uint32_t> twin_of(p.vertex_count, KL_NONE), source;

    for (size_t i = 0; i < p.indices.size(); ++i) {
        const int sign = frames[i / 3].sign;
        uint32_t &v = p.indices[i];
        if (sign == 0 || sign_of[v] == sign) continue;
        if (sign_of[v] == 0) {
            sign_of[v] = sign;
            continue;
        }
        if (twin_of[v] == KL_NONE) {
            twin_of[v] = static_cast<uint32_t>(p.vertex_count + source.size());
            source.push_back(v);
        }
        v = twin_of[v];
    }
    if (source.empty()) return sign_of;
    std::vector<uint32_t> all(p.vertex_count);
    for (size_t v = 0; v < all.size(); ++v) {
        all[v] = static_cast<uint32_t>(v);
    }
    for (const uint32_t v : source) {
        all.push_back(v);
        sign_of.push_back(-sign_of[v]);
    }
    kl_gltf_gather_vertices(p, all);
    return sign_of;
}
} // namespace

void kl_gltf_make_tangents(kl_gltf_import &in, kl_gltf_primitive &p)
{
    const kl_texture_use &use = in.scene->materials[p.material].tex[KL_TEX_NORMAL];
    std::vector<triangle_frame> frames(p.indices.size() / 3);

    for (size_t t = 0; t < frames.size(); ++t) {
        frames[t] = find_frame(p, use, &p.indices[t * 3]);
    }
    const std::vector<int> sign_of = split_mirrored(p, frames);
    const std::vector<uint32_t> group_of = weld_vertices(p, use);
    std::vector<kl_gltf_vec> sums(p.vertex_count * 2, kl_gltf_vec{0.0, 0.0, 0.0});
    for (size_t i = 0; i < p.indices.size(); ++i) {
        const triangle_frame &frame = frames[i / 3];
        if (frame.sign == 0) continue;
        const uint32_t v = p.indices[i];
        const kl_gltf_vec n = kl_gltf_load(&p.normals[size_t(v) * 3]);
        kl_gltf_vec t = project(frame.along_u, n);
        if (!kl_gltf_normalize(t)) continue;
        kl_gltf_vec &sum = sums[size_t(group_of[v]) * 2 + (frame.sign < 0 ? 1 : 0)];
        sum = sum + t * corner_angle(p, &p.indices[i / 3 * 3], i % 3, n);
    }
    p.tangents.resize(p.vertex_count * 4);
    for (size_t v = 0; v < p.vertex_count; ++v) {
        const kl_gltf_vec n = kl_gltf_load(&p.normals[v * 3]);
        kl_gltf_vec t = project(sums[size_t(group_of[v]) * 2 + (sign_of[v] < 0 ? 1 : 0)], n);
        if (!kl_gltf_normalize(t)) t = kl_gltf_perpendicular(n);
        kl_gltf_store(t, &p.tangents[v * 4]);
        p.tangents[v * 4 + 3] = sign_of[v] < 0 ? -1.0f : 1.0f;
    }
}

void kl_gltf_repair_tangents(kl_gltf_import &in, kl_gltf_primitive &p)
{
    size_t wrong = 0;

    for (size_t v = 0; v < p.vertex_count; ++v) {
        float *tangent = &p.tangents[v * 4];
        kl_gltf_vec t = kl_gltf_load(tangent);
        const double length = std::sqrt(kl_gltf_dot(t, t));
        const bool is_wrong =
            !(std::fabs(length - 1.0) < 0.02) || !(std::fabs(std::fabs(tangent[3]) - 1.0f) < 0.01f);
        if (is_wrong) ++wrong;
        if (!kl_gltf_normalize(t)) t = kl_gltf_perpendicular(kl_gltf_load(&p.normals[v * 3]));
        kl_gltf_store(t, tangent);
        tangent[3] = tangent[3] < 0.0f ? -1.0f : 1.0f;
    }
    if (wrong > 0) {
        kl_gltf_warn(in,
                     "%s TANGENT: %zu tangents are not of unit length with w 1 or -1: they are "
                     "repaired",
                     p.place.c_str(), wrong);
    }
}
