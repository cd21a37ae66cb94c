// Meshes: glTF 2.0 section 3.7.2. One kl_mesh per primitive of triangles, in the order of the file.
#include "src/import/gltf_impl.hpp"

#include <algorithm>
#include <cfloat>
#include <cmath>

namespace
{
const unsigned uv_formats =
    KL_GLTF_VEC2 | KL_GLTF_FLOAT | KL_GLTF_NORM8 | KL_GLTF_NORM16 | KL_GLTF_QUANTIZED;

struct attribute_reader {
    kl_gltf_import &in;
    const std::map<std::string, int> &attributes;
    const std::string &place;
    size_t vertex_count;

    int find(const std::string &name) const
    {
        const auto it = attributes.find(name);
        return it != attributes.end() ? it->second : -1;
    }

    void check_count(const std::string &name, size_t count) const
    {
        if (count != vertex_count) {
            kl_import_refuse("%s %s: %zu elements, but %zu vertices", place.c_str(), name.c_str(),
                             count, vertex_count);
        }
    }

    // Empty where the attribute is absent.
    kl_gltf_numbers read(const std::string &name, unsigned formats) const
    {
        const int accessor = find(name);
        if (accessor < 0) return kl_gltf_numbers();
        kl_gltf_numbers out = kl_gltf_read_numbers(in, accessor, formats, place + " " + name);
        check_count(name, out.count);
        return out;
    }
};

// Replaces what is not finite; says so once.
void replace_non_finite(kl_gltf_import &in, const std::string &place, const char *what,
                        std::vector<float> &values, float with)
{
    size_t count = 0;
    for (float &x : values) {
        if (!std::isfinite(x)) {
            x = with;
            ++count;
        }
    }
    if (count > 0) {
        kl_gltf_warn(in, "%s %s: %zu numbers are not finite: %g is used", place.c_str(), what,
                     count, static_cast<double>(with));
    }
}

void read_colors(const attribute_reader &reader, kl_gltf_primitive &p)
{
    const kl_gltf_numbers from = reader.read(
        "COLOR_0", KL_GLTF_VEC3 | KL_GLTF_VEC4 | KL_GLTF_FLOAT | KL_GLTF_NORM8 | KL_GLTF_NORM16);
    size_t clamped = 0;

    if (from.count == 0) return;
    p.colors.assign(from.count * 4, 1.0f);
    for (size_t v = 0; v < from.count; ++v) {
        for (size_t c = 0; c < from.width; ++c) {
            const float x = from.values[v * from.width + c];
            const bool inside = x >= 0.0f && x <= 1.0f;
            if (!inside) ++clamped;
            p.colors[v * 4 + c] = inside ? x : x < 0.0f ? 0.0f : 1.0f; // NaN: 1
        }
    }
    if (clamped > 0) {
        kl_gltf_warn(reader.in, "%s COLOR_0: %zu numbers outside 0..1 are clamped",
                     reader.place.c_str(), clamped);
    }
}

void read_influences(const attribute_reader &reader, kl_gltf_primitive &p)
{
    std::vector<kl_gltf_integers> joints;
    std::vector<kl_gltf_numbers> weights;

    for (int set = 0; set < 2; ++set) {
        const std::string name = "JOINTS_" + std::to_string(set);
        const int accessor = reader.find(name);
        const bool has_weights = reader.find("WEIGHTS_" + std::to_string(set)) >= 0;
        if ((accessor >= 0) != has_weights) {
            kl_gltf_warn(reader.in, "%s: JOINTS_%d and WEIGHTS_%d must come together: ignored",
                         reader.place.c_str(), set, set);
        }
        if (accessor < 0 || !has_weights) break;
        joints.push_back(kl_gltf_read_integers(reader.in, accessor, KL_GLTF_VEC4, false,
                                               reader.place + " " + name));
        reader.check_count(name, joints.back().count);
        weights.push_back(
            reader.read("WEIGHTS_" + std::to_string(set),
                        KL_GLTF_VEC4 | KL_GLTF_FLOAT | KL_GLTF_NORM8 | KL_GLTF_NORM16));
    }
    if (reader.find("JOINTS_2") >= 0) {
        kl_gltf_warn(reader.in, "%s: more than 8 joints per vertex: the first 8 are used",
                     reader.place.c_str());
    }
    const size_t n = joints.size() * 4;
    p.influences = static_cast<uint32_t>(n);
    p.joints.resize(p.vertex_count * n);
    p.weights.resize(p.vertex_count * n);
    for (size_t i = 0; i < p.vertex_count * n; ++i) {
        const size_t v = i / n, set = i % n / 4, c = v * 4 + i % 4;
        p.joints[i] = static_cast<uint16_t>(joints[set].values[c]);
        p.weights[i] = weights[set].values[c];
    }
}

// Weights sum to 1 from here on; joints of weight 0 become joint 0, as files leave rubbish there.
void normalize_weights(kl_gltf_import &in, kl_gltf_primitive &p)
{
    const size_t n = p.influences;
    size_t wrong = 0;

    for (size_t v = 0; n > 0 && v < p.vertex_count; ++v) {
        float *w = &p.weights[v * n];
        double sum = 0.0;
        bool is_wrong = false;
        for (size_t i = 0; i < n; ++i) {
            if (!(w[i] >= 0.0f && w[i] <= 1e6f)) {
                is_wrong = true;
                w[i] = 0.0f;
            }
            sum += static_cast<double>(w[i]);
        }
        // 8-bit weights may miss 1 by half a step each.
        if (is_wrong || std::fabs(sum - 1.0) > 0.02) ++wrong;
        if (sum <= 0.0) {
            w[0] = 1.0f;
            sum = 1.0;
        }
        for (size_t i = 0; i < n; ++i) {
            w[i] = static_cast<float>(static_cast<double>(w[i]) / sum);
            if (w[i] <= 0.0f) p.joints[v * n + i] = 0;
        }
    }
    if (wrong > 0) {
        kl_gltf_warn(in, "%s: the weights of %zu vertices do not sum to 1: they are rescaled",
                     p.place.c_str(), wrong);
    }
}

void read_targets(kl_gltf_import &in, const tinygltf::Primitive &from, kl_gltf_primitive &p)
{
    const unsigned formats = KL_GLTF_VEC3 | KL_GLTF_FLOAT | KL_GLTF_QUANTIZED;

    for (size_t t = 0; t < from.targets.size(); ++t) {
        const std::string place = p.place + kl_gltf_format_text(" target %zu", t);
        const attribute_reader reader = {in, from.targets[t], place, p.vertex_count};
        kl_gltf_target target;
        target.positions = reader.read("POSITION", formats).values;
        if (!p.normals.empty()) target.normals = reader.read("NORMAL", formats).values;
        if (!p.tangents.empty()) target.tangents = reader.read("TANGENT", formats).values;
        replace_non_finite(in, place, "POSITION", target.positions, 0.0f);
        replace_non_finite(in, place, "NORMAL", target.normals, 0.0f);
        replace_non_finite(in, place, "TANGENT", target.tangents, 0.0f);
        p.targets.push_back(std::move(target));
    }
}

void read_vertices(kl_gltf_import &in, const tinygltf::Primitive &from, kl_gltf_primitive &p)
{
    const kl_gltf_numbers positions = kl_gltf_read_numbers(
        in, from.attributes.at("POSITION"), KL_GLTF_VEC3 | KL_GLTF_FLOAT | KL_GLTF_QUANTIZED,
        p.place + " POSITION");
    p.vertex_count = positions.count;
    p.positions = positions.values;
    const attribute_reader reader = {in, from.attributes, p.place, p.vertex_count};
    p.normals =
        reader.read("NORMAL", KL_GLTF_VEC3 | KL_GLTF_FLOAT | KL_GLTF_SNORM | KL_GLTF_QUANTIZED)
            .values;
    // Tangents mean nothing without normals, and nothing reads them without a normal map.
    const bool mapped = in.scene->materials[p.material].tex[KL_TEX_NORMAL].texture != KL_NONE;
    if (!p.normals.empty() && mapped) {
        p.tangents =
            reader.read("TANGENT", KL_GLTF_VEC4 | KL_GLTF_FLOAT | KL_GLTF_SNORM | KL_GLTF_QUANTIZED)
                .values;
    }
    for (size_t set = 0; set < KL_MAX_UV_SETS; ++set) {
        const std::string name = "TEXCOORD_" + std::to_string(set);
        p.uv[set] = reader.read(name, uv_formats).values;
        replace_non_finite(in, p.place, name.c_str(), p.uv[set], 0.0f);
    }
    read_colors(reader, p);
    read_influences(reader, p);
    normalize_weights(in, p);
    read_targets(in, from, p);
}

// Vertex numbers in drawing order.
std::vector<uint32_t> read_order(kl_gltf_import &in, const tinygltf::Primitive &from,
                                 const kl_gltf_primitive &p)
{
    std::vector<uint32_t> order;
    if (from.indices < 0) {
        order.resize(p.vertex_count);
        for (size_t i = 0; i < order.size(); ++i) {
            order[i] = static_cast<uint32_t>(i);
        }
        return order;
    }
    kl_gltf_integers indices =
        kl_gltf_read_integers(in, from.indices, KL_GLTF_SCALAR, true, p.place + " indices");
    for (size_t i = 0; i < indices.count; ++i) {
        const uint32_t index = indices.values[i];
        if (index == indices.restart) {
            kl_import_refuse("%s: index %zu is %u, the primitive restart value", p.place.c_str(), i,
                             index);
        }
        if (index >= p.vertex_count) {
            kl_import_refuse("%s: index %zu is %u, but there are %zu vertices", p.place.c_str(), i,
                             index, p.vertex_count);
        }
    }
    return std::move(indices.values);
}

// Section 3.7.2.1: the winding of strips alternates, fans turn round their first vertex.
std::vector<uint32_t> make_triangles(kl_gltf_import &in, std::vector<uint32_t> order, int mode,
                                     const std::string &place)
{
    std::vector<uint32_t> out;
    const size_t n = order.size();

    if (mode == TINYGLTF_MODE_TRIANGLES) {
        if (n % 3 != 0) {
            kl_gltf_warn(in,
                         "%s: %zu vertices are no whole number of triangles: the last %zu are "
                         "ignored",
                         place.c_str(), n, n % 3);
            order.resize(n - n % 3);
        }
        return order;
    }
    for (size_t i = 0; i + 2 < n; ++i) {
        const size_t odd = i % 2;
        if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) {
            out.insert(out.end(), {order[i], order[i + 1 + odd], order[i + 2 - odd]});
        } else {
            out.insert(out.end(), {order[i + 1], order[i + 2], order[0]});
        }
    }
    return out;
}

bool is_finite_vertex(const kl_gltf_primitive &p, uint32_t v)
{
    const float *x = &p.positions[size_t(v) * 3];
    // Beyond 1e18 squares leave the range of float.
    return std::fabs(x[0]) <= 1e18f && std::fabs(x[1]) <= 1e18f && std::fabs(x[2]) <= 1e18f;
}

bool has_area(const kl_gltf_primitive &p, const uint32_t *v, const std::vector<float> *moved)
{
    double q[3][3];
    for (size_t k = 0; k < 3; ++k) {
        for (size_t c = 0; c < 3; ++c) {
            const size_t at = size_t(v[k]) * 3 + c;
            q[k][c] = static_cast<double>(p.positions[at]);
            if (moved != nullptr) q[k][c] += static_cast<double>((*moved)[at]);
        }
    }
    double a[3], b[3];
    for (size_t c = 0; c < 3; ++c) {
        a[c] = q[1][c] - q[0][c];
        b[c] = q[2][c] - q[0][c];
    }
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2],
                 z = a[0] * b[1] - a[1] * b[0];
    // The area must survive as a normal float.
    return std::sqrt(x * x + y * y + z * z) > 2.0 * static_cast<double>(FLT_MIN);
}

// A triangle stays if it has an area in the base or in any morph target.
void drop_bad_triangles(kl_gltf_import &in, kl_gltf_primitive &p)
{
    std::vector<uint32_t> kept;
    uint32_t not_finite = 0;

    kept.reserve(p.indices.size());
    for (size_t i = 0; i + 2 < p.indices.size(); i += 3) {
        const uint32_t *v = &p.indices[i];
        const bool finite =
            is_finite_vertex(p, v[0]) && is_finite_vertex(p, v[1]) && is_finite_vertex(p, v[2]);
        bool good = finite && has_area(p, v, nullptr);
        for (size_t t = 0; finite && !good && t < p.targets.size(); ++t) {
            if (!p.targets[t].positions.empty()) good = has_area(p, v, &p.targets[t].positions);
        }
        if (!finite) ++not_finite;
        if (good) {
            kept.insert(kept.end(), v, v + 3);
        } else {
            ++p.dropped;
        }
    }
    if (not_finite > 0) {
        kl_gltf_warn(in, "%s: %u triangles with positions that are not finite are dropped",
                     p.place.c_str(), not_finite);
    }
    p.indices.swap(kept);
}

// Vertices that no triangle uses go away: several primitives often share one big array.
void drop_unused_vertices(kl_gltf_primitive &p)
{
    std::vector<uint32_t> fresh(p.vertex_count, KL_NONE), source;

    for (uint32_t &v : p.indices) {
        if (fresh[v] == KL_NONE) fresh[v] = 0;
    }
    for (size_t v = 0; v < p.vertex_count; ++v) {
        if (fresh[v] == KL_NONE) continue;
        fresh[v] = static_cast<uint32_t>(source.size());
        source.push_back(static_cast<uint32_t>(v));
    }
    if (source.size() == p.vertex_count) return;
    for (uint32_t &v : p.indices) {
        v = fresh[v];
    }
    kl_gltf_gather_vertices(p, source);
}

void finish_directions(kl_gltf_import &in, kl_gltf_primitive &p)
{
    const kl_texture_use &normal_map = in.scene->materials[p.material].tex[KL_TEX_NORMAL];

    if (p.normals.empty()) {
        kl_gltf_make_flat_normals(p);
    } else {
        kl_gltf_repair_normals(in, p);
    }
    if (normal_map.texture == KL_NONE) return;
    if (p.tangents.empty()) {
        kl_gltf_make_tangents(in, p);
    } else {
        kl_gltf_repair_tangents(in, p);
    }
}

void warn_about_uv(kl_gltf_import &in, const kl_gltf_primitive &p)
{
    for (const kl_texture_use &use : in.scene->materials[p.material].tex) {
        if (use.texture != KL_NONE && p.uv[use.uv_set].empty()) {
            kl_gltf_warn(in, "%s: its material needs TEXCOORD_%u, which is missing: (0, 0) is used",
                         p.place.c_str(), use.uv_set);
        }
    }
}

enum target_part { TARGET_POSITIONS, TARGET_NORMALS, TARGET_TANGENTS };

const std::vector<float> &get_part(const kl_gltf_target &target, target_part part)
{
    if (part == TARGET_POSITIONS) return target.positions;
    return part == TARGET_NORMALS ? target.normals : target.tangents;
}

// NULL where no target moves this part.
float *join_targets(const kl_gltf_primitive &p, target_part part)
{
    const bool used =
        std::any_of(p.targets.begin(), p.targets.end(),
                    [&](const kl_gltf_target &target) { return !get_part(target, part).empty(); });
    if (!used) return nullptr;
    const size_t n = p.vertex_count * 3;
    float *out = kl_gltf_new_array<float>(n * p.targets.size());
    for (size_t t = 0; t < p.targets.size(); ++t) {
        const std::vector<float> &from = get_part(p.targets[t], part);
        std::copy(from.begin(), from.end(), out + t * n);
    }
    return out;
}

template <class T> T *copy_or_null(const std::vector<T> &from)
{
    return from.empty() ? nullptr : kl_gltf_copy_array(from);
}

void store_mesh(kl_gltf_import &in, const kl_gltf_primitive &p, const std::string &name)
{
    kl_mesh &out = in.scene->meshes[in.scene->mesh_count++]; // zeroed: freed whole on failure
    out.name = kl_gltf_copy_name(name);
    out.material = p.material;
    out.vertex_count = static_cast<uint32_t>(p.vertex_count);
    out.triangle_count = static_cast<uint32_t>(p.indices.size() / 3);
    out.positions = kl_gltf_copy_array(p.positions);
    out.normals = kl_gltf_copy_array(p.normals);
    out.tangents = copy_or_null(p.tangents);
    for (size_t set = 0; set < KL_MAX_UV_SETS; ++set) {
        out.uv[set] = copy_or_null(p.uv[set]);
    }
    out.colors = copy_or_null(p.colors);
    out.indices = kl_gltf_copy_array(p.indices);
    out.morph_count = static_cast<uint32_t>(p.targets.size());
    out.morph_positions = join_targets(p, TARGET_POSITIONS);
    out.morph_normals = join_targets(p, TARGET_NORMALS);
    out.morph_tangents = join_targets(p, TARGET_TANGENTS);
    out.influence_count = p.influences;
    out.joints = copy_or_null(p.joints);
    out.weights = copy_or_null(p.weights);
    uint32_t limit = 0;
    for (const uint16_t joint : p.joints) {
        limit = std::max(limit, joint + 1u);
    }
    in.skin_joint_limit.push_back(limit);
}

// What is no triangle is not drawn; said once per file.
bool is_readable(kl_gltf_import &in, const tinygltf::Primitive &from, const std::string &place)
{
    if (from.mode < 0 || from.mode > TINYGLTF_MODE_TRIANGLE_FAN) {
        kl_gltf_warn(in, "%s: mode %d is unknown: left out", place.c_str(), from.mode);
        return false;
    }
    if (from.mode < TINYGLTF_MODE_TRIANGLES) {
        kl_gltf_warn(in, "points and lines are not drawn");
        return false;
    }
    if (from.attributes.count("POSITION") == 0) {
        kl_gltf_warn(in, "%s: no POSITION: left out", place.c_str());
        return false;
    }
    return true;
}

void read_primitive(kl_gltf_import &in, const tinygltf::Primitive &from, const std::string &place,
                    const std::string &name, std::vector<uint32_t> &meshes)
{
    kl_gltf_primitive p;

    if (!is_readable(in, from, place)) return;
    p.place = place;
    p.material = kl_gltf_get_material(in, from.material);
    read_vertices(in, from, p);
    p.indices = make_triangles(in, read_order(in, from, p), from.mode, place);
    if (p.indices.size() / 3 >= KL_NONE / 3 || p.vertex_count >= KL_NONE) {
        kl_import_refuse("%s: more than 2^32 triangle corners", place.c_str());
    }
    drop_bad_triangles(in, p);
    in.scene->dropped_triangles += p.dropped;
    if (p.indices.empty()) {
        kl_gltf_warn(in, "%s: no triangle with an area: left out", place.c_str());
        return;
    }
    drop_unused_vertices(p);
    warn_about_uv(in, p);
    finish_directions(in, p);
    meshes.push_back(in.scene->mesh_count);
    store_mesh(in, p, name);
}
} // namespace

void kl_gltf_read_meshes(kl_gltf_import &in)
{
    size_t total = 0;

    for (const tinygltf::Mesh &mesh : in.model.meshes) {
        total += mesh.primitives.size();
    }
    in.scene->meshes = kl_gltf_new_array<kl_mesh>(total);
    in.meshes_of.resize(in.model.meshes.size());
    for (size_t m = 0; m < in.model.meshes.size(); ++m) {
        const tinygltf::Mesh &mesh = in.model.meshes[m];
        const std::string name = kl_gltf_name(mesh.name, "mesh", m);
        for (size_t i = 0; i < mesh.primitives.size(); ++i) {
            const std::string place = kl_gltf_format_text("mesh %zu primitive %zu", m, i);
            if (mesh.primitives[i].targets.size() != mesh.primitives[0].targets.size()) {
                kl_import_refuse("%s: %zu morph targets, but primitive 0 has %zu", place.c_str(),
                                 mesh.primitives[i].targets.size(),
                                 mesh.primitives[0].targets.size());
            }
            read_primitive(in, mesh.primitives[i], place, name, in.meshes_of[m]);
        }
    }
}
