// Animations: glTF 2.0 section 3.11.
#include "src/import/gltf_impl.hpp"

#include <algorithm>
#include <cmath>

namespace
{
const unsigned value_formats = KL_GLTF_FLOAT | KL_GLTF_NORM8 | KL_GLTF_NORM16 | KL_GLTF_SNORM;

struct channel_keys {
    std::vector<float> times, values;
    size_t width; // numbers per key and part
    size_t parts; // 3 for cubic splines
};

bool read_path(kl_gltf_import &in, const tinygltf::AnimationChannel &from, const std::string &place,
               kl_animation_channel &out)
{
    if (from.target_path == "translation") {
        out.path = KL_TRANSLATION;
    } else if (from.target_path == "rotation") {
        out.path = KL_ROTATION;
    } else if (from.target_path == "scale") {
        out.path = KL_SCALE;
    } else if (from.target_path == "weights") {
        out.path = KL_WEIGHTS;
    } else {
        kl_gltf_warn(in, "%s: path \"%.40s\" is unknown: left out", place.c_str(),
                     from.target_path.c_str());
        return false;
    }
    return true;
}

// KHR_animation_pointer: what a JSON pointer names, if it is one of these.
struct pointer_target {
    const char *list, *property; // "/LIST/number/PROPERTY"
    kl_channel_path path;
    uint32_t width;
};
const pointer_target pointer_targets[] = {
    {"/nodes/", "translation", KL_TRANSLATION, 3},
    {"/nodes/", "rotation", KL_ROTATION, 4},
    {"/nodes/", "scale", KL_SCALE, 3},
    {"/nodes/", "weights", KL_WEIGHTS, 0},
    {"/extensions/KHR_lights_punctual/lights/", "color", KL_LIGHT_COLOR, 3},
    {"/extensions/KHR_lights_punctual/lights/", "intensity", KL_LIGHT_INTENSITY, 1},
    {"/extensions/KHR_lights_punctual/lights/", "range", KL_LIGHT_RANGE, 1},
    {"/extensions/KHR_lights_punctual/lights/", "spot/innerConeAngle", KL_LIGHT_INNER_CONE, 1},
    {"/extensions/KHR_lights_punctual/lights/", "spot/outerConeAngle", KL_LIGHT_OUTER_CONE, 1},
    {"/cameras/", "perspective/yfov", KL_CAMERA_YFOV, 1},
    {"/cameras/", "orthographic/xmag", KL_CAMERA_XMAG, 1},
    {"/cameras/", "orthographic/ymag", KL_CAMERA_YMAG, 1},
    {"/materials/", "pbrMetallicRoughness/baseColorFactor", KL_MATERIAL_BASE_COLOR, 4},
    {"/materials/", "pbrMetallicRoughness/metallicFactor", KL_MATERIAL_METALLIC, 1},
    {"/materials/", "pbrMetallicRoughness/roughnessFactor", KL_MATERIAL_ROUGHNESS, 1},
    {"/materials/", "normalTexture/scale", KL_MATERIAL_NORMAL_SCALE, 1},
    {"/materials/", "alphaCutoff", KL_MATERIAL_ALPHA_CUTOFF, 1},
    {"/materials/", "emissiveFactor", KL_MATERIAL_EMISSIVE_FACTOR, 3},
    {"/materials/", "extensions/KHR_materials_emissive_strength/emissiveStrength",
     KL_MATERIAL_EMISSIVE_STRENGTH, 1},
    {"/materials/", "extensions/KHR_materials_ior/ior", KL_MATERIAL_IOR, 1},
    {"/materials/", "extensions/KHR_materials_specular/specularFactor", KL_MATERIAL_SPECULAR, 1},
    {"/materials/", "extensions/KHR_materials_specular/specularColorFactor",
     KL_MATERIAL_SPECULAR_COLOR, 3},
};

// The number and the rest of "/LIST/12/PROPERTY" after the list; false if there is none.
bool split_pointer(const std::string &pointer, size_t at, size_t &number, std::string &property)
{
    const size_t end = pointer.find('/', at);

    if (end == std::string::npos || end == at || end - at > 9) return false;
    number = 0;
    for (size_t i = at; i < end; ++i) {
        if (pointer[i] < '0' || pointer[i] > '9') return false;
        number = number * 10 + static_cast<size_t>(pointer[i] - '0');
    }
    property = pointer.substr(end + 1);
    return true;
}

size_t count_targets(const kl_gltf_import &in, kl_channel_path path)
{
    if (kl_path_is_of_node(path)) return in.model.nodes.size();
    if (path <= KL_LIGHT_OUTER_CONE) return in.model.lights.size();
    if (path <= KL_CAMERA_YMAG) return in.model.cameras.size();
    return in.model.materials.size();
}

bool read_pointer(kl_gltf_import &in, const tinygltf::AnimationChannel &from,
                  const std::string &place, kl_animation_channel &out)
{
    const tinygltf::Value *extension =
        kl_gltf_find(from.target_extensions, "KHR_animation_pointer");
    std::string pointer, property;
    size_t number = 0;

    if (extension != nullptr && extension->Has("pointer") && extension->Get("pointer").IsString()) {
        pointer = extension->Get("pointer").Get<std::string>();
    }
    for (const pointer_target &target : pointer_targets) {
        const std::string list = target.list;
        if (pointer.compare(0, list.size(), list) != 0) continue;
        if (!split_pointer(pointer, list.size(), number, property)) continue;
        if (property != target.property) continue;
        if (number >= count_targets(in, target.path)) {
            kl_import_refuse("%s: pointer \"%.80s\", but there are %zu", place.c_str(),
                             pointer.c_str(), count_targets(in, target.path));
        }
        out.path = target.path;
        out.node =
            kl_path_is_of_node(target.path) ? in.node_of[number] : static_cast<uint32_t>(number);
        out.width = target.width;
        return true;
    }
    kl_gltf_warn(in, "%s: pointer \"%.80s\" is not supported: left out", place.c_str(),
                 pointer.c_str());
    return false;
}

// What may not move, though its path is known.
bool check_node_path(kl_gltf_import &in, const std::string &place, const kl_animation_channel &out)
{
    const kl_node &node = in.scene->nodes[out.node];
    const uint32_t number = in.file_node[out.node];

    if (out.path == KL_WEIGHTS && node.weight_count == 0) {
        kl_gltf_warn(in, "%s: moves the weights of nodes[%u], which has no morph targets: left out",
                     place.c_str(), number);
        return false;
    }
    if (out.path != KL_WEIGHTS && node.has_matrix) {
        kl_gltf_warn(in, "%s: moves nodes[%u], which has a matrix: left out", place.c_str(),
                     number);
        return false;
    }
    return true;
}

kl_interpolation read_interpolation(kl_gltf_import &in, const std::string &text,
                                    const std::string &place)
{
    if (text == "STEP") return KL_STEP;
    if (text == "CUBICSPLINE") return KL_CUBIC_SPLINE;
    if (text != "LINEAR") {
        kl_gltf_warn(in, "%s: interpolation \"%.40s\" is unknown: LINEAR is used", place.c_str(),
                     text.c_str());
    }
    return KL_LINEAR;
}

// Keeps the keys whose time is finite and later than the one before.
void drop_bad_keys(kl_gltf_import &in, const std::string &place, channel_keys &keys)
{
    const size_t stride = keys.width * keys.parts;
    size_t kept = 0;

    for (size_t k = 0; k < keys.times.size(); ++k) {
        const float time = keys.times[k];
        if (!std::isfinite(time) || (kept > 0 && time <= keys.times[kept - 1])) continue;
        keys.times[kept] = time;
        std::copy_n(keys.values.begin() + static_cast<std::ptrdiff_t>(k * stride), stride,
                    keys.values.begin() + static_cast<std::ptrdiff_t>(kept * stride));
        ++kept;
    }
    if (kept == keys.times.size()) return;
    kl_gltf_warn(in, "%s: %zu key times do not increase: those keys are dropped", place.c_str(),
                 keys.times.size() - kept);
    keys.times.resize(kept);
    keys.values.resize(kept * stride);
}

void check_values(kl_gltf_import &in, const std::string &place, kl_channel_path path,
                  channel_keys &keys)
{
    size_t not_finite = 0, not_unit = 0;

    for (float &x : keys.values) {
        if (std::fabs(x) <= 1e18f) continue;
        x = 0.0f;
        ++not_finite;
    }
    for (size_t k = 0; path == KL_ROTATION && k < keys.times.size(); ++k) {
        float *q = &keys.values[(k * keys.parts + keys.parts / 2) * 4];
        double length = 0.0;
        for (size_t i = 0; i < 4; ++i) {
            length += static_cast<double>(q[i]) * static_cast<double>(q[i]);
        }
        length = std::sqrt(length);
        if (!(std::fabs(length - 1.0) < 0.02)) ++not_unit;
        if (!(length > 0.0)) {
            q[3] = 1.0f;
            length = 1.0;
        }
        for (size_t i = 0; i < 4; ++i) {
            q[i] = static_cast<float>(static_cast<double>(q[i]) / length);
        }
    }
    if (not_finite > 0) {
        kl_gltf_warn(in, "%s: %zu values are not finite: 0 is used", place.c_str(), not_finite);
    }
    if (not_unit > 0) {
        kl_gltf_warn(in, "%s: %zu rotations are not of unit length: they are normalised",
                     place.c_str(), not_unit);
    }
}

unsigned get_widths(kl_channel_path path, uint32_t width)
{
    if (path == KL_WEIGHTS || width == 1) return KL_GLTF_SCALAR;
    return width == 4 ? KL_GLTF_VEC4 : KL_GLTF_VEC3;
}

channel_keys read_keys(kl_gltf_import &in, const tinygltf::AnimationSampler &sampler,
                       const kl_animation_channel &channel, const std::string &place)
{
    channel_keys keys;
    const kl_gltf_numbers times =
        kl_gltf_read_numbers(in, sampler.input, KL_GLTF_SCALAR | KL_GLTF_FLOAT, place + " input");
    const kl_gltf_numbers values = kl_gltf_read_numbers(
        in, sampler.output, get_widths(channel.path, channel.width) | value_formats,
        place + " output");

    keys.width = channel.width;
    keys.parts = channel.interpolation == KL_CUBIC_SPLINE ? 3 : 1;
    const size_t expected = times.count * keys.parts * keys.width;
    if (values.values.size() != expected) {
        kl_import_refuse("%s: %zu keys, but %zu output numbers, expected %zu", place.c_str(),
                         times.count, values.values.size(), expected);
    }
    keys.times = times.values;
    keys.values = values.values;
    drop_bad_keys(in, place, keys);
    check_values(in, place, channel.path, keys);
    return keys;
}

using taken_set = std::set<std::pair<uint32_t, int>>; // node and path that have a channel

void read_channel(kl_gltf_import &in, const tinygltf::Animation &from, size_t index,
                  const std::string &where, taken_set &taken, kl_animation &out)
{
    const tinygltf::AnimationChannel &source = from.channels[index];
    const std::string place = where + kl_gltf_format_text(" channel %zu", index);
    kl_animation_channel channel = {};

    if (source.sampler < 0 || static_cast<size_t>(source.sampler) >= from.samplers.size()) {
        kl_import_refuse("%s: sampler %d, but there are %zu", place.c_str(), source.sampler,
                         from.samplers.size());
    }
    if (source.target_path == "pointer") {
        if (!read_pointer(in, source, place, channel)) return;
    } else {
        if (source.target_node < 0) return; // section 3.11: such a channel is to be ignored
        channel.node = in.node_of[static_cast<size_t>(source.target_node)];
        if (!read_path(in, source, place, channel)) return;
    }
    if (kl_path_is_of_node(channel.path) && !check_node_path(in, place, channel)) return;
    if (!taken.insert({channel.node, channel.path}).second) {
        kl_gltf_warn(in, "%s: moves the same as an earlier channel: left out", place.c_str());
        return;
    }
    const tinygltf::AnimationSampler &sampler = from.samplers[static_cast<size_t>(source.sampler)];
    channel.interpolation = read_interpolation(in, sampler.interpolation, place);
    if (channel.path == KL_WEIGHTS) {
        channel.width = in.scene->nodes[channel.node].weight_count;
    } else if (channel.width == 0) {
        channel.width = channel.path == KL_ROTATION ? 4 : 3;
    }
    const channel_keys keys = read_keys(in, sampler, channel, place);
    if (keys.times.empty()) {
        kl_gltf_warn(in, "%s: no keys: left out", place.c_str());
        return;
    }
    kl_animation_channel &slot = out.channels[out.channel_count++];
    slot = channel;
    slot.key_count = static_cast<uint32_t>(keys.times.size());
    slot.times = kl_gltf_copy_array(keys.times);
    slot.values = kl_gltf_copy_array(keys.values);
    out.duration = std::max(out.duration, static_cast<double>(keys.times.back()));
}
} // namespace

void kl_gltf_read_animations(kl_gltf_import &in)
{
    kl_scene &scene = *in.scene;

    scene.animations = kl_gltf_new_array<kl_animation>(in.model.animations.size());
    for (size_t a = 0; a < in.model.animations.size(); ++a) {
        const tinygltf::Animation &from = in.model.animations[a];
        kl_animation &out = scene.animations[scene.animation_count++];
        out.name = kl_gltf_copy_name(kl_gltf_name(from.name, "animation", a));
        out.channels = kl_gltf_new_array<kl_animation_channel>(from.channels.size());
        const std::string place = kl_gltf_format_text("animations[%zu]", a);
        taken_set taken;
        for (size_t c = 0; c < from.channels.size(); ++c) {
            read_channel(in, from, c, place, taken, out);
        }
    }
}
