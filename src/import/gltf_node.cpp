// The node hierarchy (glTF 2.0 section 3.5): checked to be a forest, reordered so that parents
// come first, with the instances of the scene that is rendered.
#include "src/import/gltf_impl.hpp"

#include <algorithm>
#include <cmath>

namespace
{
std::vector<uint32_t> find_parents(const tinygltf::Model &model)
{
    std::vector<uint32_t> parent(model.nodes.size(), KL_NONE);

    for (size_t n = 0; n < model.nodes.size(); ++n) {
        for (const int child : model.nodes[n].children) {
            uint32_t &slot = parent[static_cast<size_t>(child)];
            if (slot != KL_NONE) {
                kl_import_refuse("nodes[%d]: child of nodes[%u] and of nodes[%zu], expected one "
                                 "parent",
                                 child, slot, n);
            }
            slot = static_cast<uint32_t>(n);
        }
    }
    return parent;
}

// Roots first, level by level. Each node has one parent, so what is not reached lies on a loop.
std::vector<uint32_t> find_order(const tinygltf::Model &model, const std::vector<uint32_t> &parent)
{
    std::vector<uint32_t> order;

    for (size_t n = 0; n < parent.size(); ++n) {
        if (parent[n] == KL_NONE) order.push_back(static_cast<uint32_t>(n));
    }
    for (size_t i = 0; i < order.size(); ++i) {
        for (const int child : model.nodes[order[i]].children) {
            order.push_back(static_cast<uint32_t>(child));
        }
    }
    if (order.size() < parent.size()) {
        std::vector<bool> reached(parent.size(), false);
        for (const uint32_t n : order) {
            reached[n] = true;
        }
        const auto lost = std::find(reached.begin(), reached.end(), false);
        kl_import_refuse("nodes[%td]: is its own ancestor, expected a tree",
                         lost - reached.begin());
    }
    return order;
}

void read_vector(const std::vector<double> &from, double *out, size_t count, double fallback)
{
    for (size_t i = 0; i < count; ++i) {
        out[i] = from.size() == count ? from[i] : fallback;
    }
}

void read_matrix(kl_gltf_import &in, const std::vector<double> &from, size_t place, kl_node &out)
{
    out.has_matrix = true;
    std::copy(from.begin(), from.end(), out.matrix);
    const bool affine = from[3] == 0.0 && from[7] == 0.0 && from[11] == 0.0 && from[15] == 1.0;
    if (affine) return;
    kl_gltf_warn(in, "nodes[%zu].matrix: last row is not 0 0 0 1: it is replaced", place);
    out.matrix[3] = out.matrix[7] = out.matrix[11] = 0.0;
    out.matrix[15] = 1.0;
}

void read_rotation(kl_gltf_import &in, const std::vector<double> &from, size_t place, kl_node &out)
{
    double length = 0.0;

    read_vector(from, out.rotation, 4, 0.0);
    for (const double q : out.rotation) {
        length += q * q;
    }
    length = std::sqrt(length);
    if (from.size() == 4 && !(std::fabs(length - 1.0) < 0.01)) {
        kl_gltf_warn(in, "nodes[%zu].rotation: length %g, expected 1: %s", place, length,
                     length > 0.0 ? "normalised" : "no rotation is used");
    }
    for (double &q : out.rotation) {
        q = length > 0.0 ? q / length : 0.0;
    }
    if (!(length > 0.0)) out.rotation[3] = 1.0;
}

void read_weights(kl_gltf_import &in, const tinygltf::Node &from, size_t place, kl_node &out)
{
    if (from.mesh < 0) return;
    const tinygltf::Mesh &mesh = in.model.meshes[static_cast<size_t>(from.mesh)];
    const size_t count = mesh.primitives.empty() ? 0 : mesh.primitives[0].targets.size();
    const std::vector<double> &weights = from.weights.empty() ? mesh.weights : from.weights;

    if (!weights.empty() && weights.size() != count) {
        kl_gltf_warn(in, "nodes[%zu]: %zu weights, but %zu morph targets", place, weights.size(),
                     count);
    }
    if (count == 0) return;
    out.weights = kl_gltf_new_array<double>(count);
    out.weight_count = static_cast<uint32_t>(count);
    std::copy_n(weights.begin(), std::min(count, weights.size()), out.weights);
}

void read_node(kl_gltf_import &in, size_t file_index, kl_node &out)
{
    const tinygltf::Node &from = in.model.nodes[file_index];

    out.name = kl_gltf_copy_name(kl_gltf_name(from.name, "node", file_index));
    read_vector(from.translation, out.translation, 3, 0.0);
    read_vector(from.scale, out.scale, 3, 1.0);
    read_rotation(in, from.rotation, file_index, out);
    if (from.matrix.size() == 16) read_matrix(in, from.matrix, file_index, out);
    read_weights(in, from, file_index, out);
}

// The default scene, else scene 0, else everything.
void mark_visible(kl_gltf_import &in)
{
    const tinygltf::Model &model = in.model;
    kl_scene &scene = *in.scene;

    if (model.scenes.empty()) {
        for (uint32_t n = 0; n < scene.node_count; ++n) {
            scene.nodes[n].visible = true;
        }
        return;
    }
    const size_t chosen = model.defaultScene >= 0 ? static_cast<size_t>(model.defaultScene) : 0;
    for (const int root : model.scenes[chosen].nodes) {
        kl_node &node = scene.nodes[in.node_of[static_cast<size_t>(root)]];
        if (node.parent != KL_NONE) {
            kl_gltf_warn(in, "scenes[%zu]: nodes[%d] is no root", chosen, root);
        }
        node.visible = true;
    }
    for (uint32_t n = 0; n < scene.node_count; ++n) {
        const uint32_t parent = scene.nodes[n].parent;
        if (parent != KL_NONE && scene.nodes[parent].visible) scene.nodes[n].visible = true;
    }
}

void add_instances(kl_gltf_import &in)
{
    kl_scene &scene = *in.scene;
    size_t total = 0;
    uint32_t object = 0;

    for (const tinygltf::Node &node : in.model.nodes) {
        if (node.mesh >= 0) total += in.meshes_of[static_cast<size_t>(node.mesh)].size();
    }
    scene.instances = kl_gltf_new_array<kl_scene_instance>(total);
    for (uint32_t n = 0; n < scene.node_count; ++n) {
        const tinygltf::Node &from = in.model.nodes[in.file_node[n]];
        if (from.mesh < 0 || !scene.nodes[n].visible) continue;
        for (const uint32_t mesh : in.meshes_of[static_cast<size_t>(from.mesh)]) {
            const bool skinned = from.skin >= 0 && scene.meshes[mesh].influence_count > 0;
            if (from.skin >= 0 && !skinned) {
                kl_gltf_warn(in, "nodes[%u]: has a skin, but its mesh has no joints",
                             in.file_node[n]);
            }
            scene.instances[scene.instance_count++] = {
                mesh, n, skinned ? static_cast<uint32_t>(from.skin) : KL_NONE, object};
        }
        ++object;
    }
}
} // namespace

void kl_gltf_read_nodes(kl_gltf_import &in)
{
    const std::vector<uint32_t> parent = find_parents(in.model);
    kl_scene &scene = *in.scene;

    in.file_node = find_order(in.model, parent);
    in.node_of.resize(in.file_node.size());
    for (size_t n = 0; n < in.file_node.size(); ++n) {
        in.node_of[in.file_node[n]] = static_cast<uint32_t>(n);
    }
    scene.nodes = kl_gltf_new_array<kl_node>(in.file_node.size());
    for (const uint32_t file_index : in.file_node) {
        kl_node &node = scene.nodes[scene.node_count++];
        node.parent = parent[file_index] == KL_NONE ? KL_NONE : in.node_of[parent[file_index]];
        read_node(in, file_index, node);
    }
    mark_visible(in);
    add_instances(in);
}
