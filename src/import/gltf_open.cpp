// The two entry points, and the way from bytes to a checked tinygltf model.
#include "src/import/gltf_impl.hpp"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <memory>

#include <nlohmann/json.hpp>

namespace
{
// All extensions that change how a file is read and that we read. Anything else is refused where
// the file requires it and ignored with a warning where it does not.
const char *const known_extensions[] = {
    "KHR_animation_pointer", "KHR_lights_punctual",    "KHR_materials_emissive_strength",
    "KHR_materials_ior",     "KHR_materials_specular", "KHR_materials_unlit",
    "KHR_mesh_quantization", "KHR_texture_transform",
};

// Real files stay under 20; nlohmann's printer and tinygltf's readers recurse.
const unsigned max_json_depth = 64;
// Numbers that may be read from accessors, for any file and per byte of it: several primitives may
// share an accessor, but a small file must not cause hours of work.
const uint64_t base_numbers = uint64_t(1) << 28;
const uint64_t numbers_per_byte = 256;

bool is_known(const std::string &name)
{
    return std::any_of(std::begin(known_extensions), std::end(known_extensions),
                       [&](const char *known) { return name == known; });
}

void check_depth(const unsigned char *text, size_t size)
{
    unsigned depth = 0;
    bool in_string = false;

    for (size_t i = 0; i < size; ++i) {
        const unsigned char c = text[i];
        if (in_string) {
            if (c == '\\') ++i;
            if (c == '"') in_string = false;
        } else if (c == '"') {
            in_string = true;
        } else if (c == '{' || c == '[') {
            if (++depth > max_json_depth) {
                kl_import_refuse("JSON nested deeper than %u at byte %zu", max_json_depth, i);
            }
        } else if ((c == '}' || c == ']') && depth > 0) {
            --depth;
        }
    }
}

nlohmann::json parse_json(const kl_gltf_chunks &chunks)
{
    check_depth(chunks.json, chunks.json_size);
    try {
        // GLB pads its JSON with spaces, some writers with zeros.
        size_t size = chunks.json_size;
        while (size > 0 && chunks.json[size - 1] == 0) {
            --size;
        }
        nlohmann::json root = nlohmann::json::parse(chunks.json, chunks.json + size);
        if (!root.is_object()) {
            kl_import_refuse("JSON %s, expected an object", root.type_name());
        }
        return root;
    } catch (const nlohmann::json::exception &e) {
        // "[json.exception.parse_error.101] parse error at line 1, ...": drop the bracket.
        const char *text = std::strchr(e.what(), ']');
        kl_import_refuse("not valid JSON:%.300s", text != nullptr ? text + 1 : e.what());
    }
}

void check_version(kl_gltf_import &in, const nlohmann::json &root)
{
    const auto asset = root.find("asset");
    if (asset == root.end() || !asset->is_object()) {
        kl_import_refuse("no \"asset\" object, expected glTF 2.0");
    }
    const auto version = asset->find("version");
    if (version == asset->end() || !version->is_string()) {
        kl_import_refuse("no asset.version, expected \"2.0\"");
    }
    const std::string text = version->get<std::string>();
    if (text.compare(0, 2, "2.") != 0) {
        kl_import_refuse("asset.version \"%.20s\", expected \"2.0\"", text.c_str());
    }
    const auto least = asset->find("minVersion");
    const bool newer = least != asset->end() && least->is_string() && *least != "2.0";
    if (newer) {
        kl_gltf_warn(in, "asset.minVersion \"%.20s\": read as 2.0",
                     least->get<std::string>().c_str());
    }
}

std::vector<std::string> get_names(const nlohmann::json &root, const char *member)
{
    std::vector<std::string> names;
    const auto list = root.find(member);
    if (list == root.end()) return names;
    if (!list->is_array()) kl_import_refuse("%s: %s, expected an array", member, list->type_name());
    for (const auto &name : *list) {
        if (!name.is_string()) {
            kl_import_refuse("%s: %s, expected strings", member, name.type_name());
        }
        names.push_back(name.get<std::string>());
    }
    return names;
}

void check_extensions(kl_gltf_import &in, const nlohmann::json &root)
{
    for (const std::string &name : get_names(root, "extensionsRequired")) {
        if (!is_known(name)) {
            kl_import_refuse("extension %.100s is required by the file and not supported",
                             name.c_str());
        }
        if (name == "KHR_mesh_quantization") in.quantized = true;
    }
    for (const std::string &name : get_names(root, "extensionsUsed")) {
        kl_gltf_note_extension(in, name);
        if (name == "KHR_mesh_quantization") in.quantized = true;
    }
}

kl_gltf_blob read_buffer(const kl_gltf_import &in, const nlohmann::json &buffer, bool first,
                         const kl_gltf_chunks &chunks)
{
    kl_gltf_blob blob;
    const uint64_t length = buffer["byteLength"].get<uint64_t>();

    if (buffer.contains("uri")) {
        blob = kl_gltf_read_uri(in, buffer["uri"].get<std::string>());
    } else if (first && chunks.bin_size > 0) {
        blob.bytes.assign(chunks.bin, chunks.bin + chunks.bin_size);
    } else {
        blob.placeholder = true;
        blob.size = length;
        return blob;
    }
    if (!blob.failed && blob.bytes.size() < length) {
        blob.failed = true;
        (void)kl_fail(&blob.why, KL_ERR_INPUT, "%zu bytes, but byteLength is %llu",
                      blob.bytes.size(), static_cast<unsigned long long>(length));
    }
    if (!blob.failed) blob.bytes.resize(static_cast<size_t>(length));
    blob.size = length;
    return blob;
}

// KHR_animation_pointer: tinygltf drops channels whose target is not a node.
void keep_pointers(nlohmann::json &root)
{
    const auto animations = root.find("animations");
    if (animations == root.end()) return;
    for (auto &animation : *animations) {
        for (auto &channel : animation["channels"]) {
            auto &target = channel["target"];
            if (target["path"] == "pointer" && !target.contains("node")) target["node"] = -1;
        }
    }
}

// Buffers and images are read here and not by tinygltf, which reads past short ones, refuses
// padded ones and opens whatever a URI names.
void take_sources(kl_gltf_import &in, nlohmann::json &root, const kl_gltf_chunks &chunks)
{
    if (root.contains("buffers")) {
        for (const auto &buffer : root["buffers"]) {
            in.buffers.push_back(read_buffer(in, buffer, in.buffers.empty(), chunks));
        }
    }
    if (root.contains("images")) {
        for (const auto &image : root["images"]) {
            kl_gltf_image_source source;
            source.place = kl_gltf_format_text("images[%zu]", in.images.size());
            if (image.contains("bufferView")) {
                source.buffer_view = image["bufferView"].get<int>();
            } else if (image.contains("uri")) {
                source.blob = kl_gltf_read_uri(in, image["uri"].get<std::string>());
            } else {
                source.blob.failed = true;
                (void)kl_fail(&source.blob.why, KL_ERR_INPUT, "no uri and no bufferView");
            }
            in.images.push_back(std::move(source));
        }
    }
    root.erase("buffers");
    root.erase("images");
}

// The schema checked indices against the document; tinygltf must not have left anything out.
void check_counts(const tinygltf::Model &model, const nlohmann::json &root)
{
    const std::pair<const char *, size_t> read[] = {
        {"/accessors", model.accessors.size()},
        {"/animations", model.animations.size()},
        {"/bufferViews", model.bufferViews.size()},
        {"/cameras", model.cameras.size()},
        {"/materials", model.materials.size()},
        {"/meshes", model.meshes.size()},
        {"/nodes", model.nodes.size()},
        {"/samplers", model.samplers.size()},
        {"/scenes", model.scenes.size()},
        {"/skins", model.skins.size()},
        {"/textures", model.textures.size()},
        {"/extensions/KHR_lights_punctual/lights", model.lights.size()},
    };
    for (const auto &list : read) {
        const nlohmann::json::json_pointer at(list.first);
        const size_t expected = root.contains(at) ? root[at].size() : 0;
        if (list.second != expected) {
            kl_import_refuse("%s: only %zu of %zu could be read", list.first + 1, list.second,
                             expected);
        }
    }
}

void parse_model(kl_gltf_import &in, const nlohmann::json &root)
{
    tinygltf::TinyGLTF loader;
    std::string why, warnings;
    const std::string text = root.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);

    if (text.size() > UINT32_MAX) kl_import_refuse("JSON of more than 4 GiB");
    const bool ok =
        loader.LoadASCIIFromString(&in.model, &why, &warnings, text.data(),
                                   static_cast<unsigned>(text.size()), "", tinygltf::NO_REQUIRE);
    if (!ok) {
        std::replace(why.begin(), why.end(), '\n', ' ');
        while (!why.empty() && why.back() == ' ') {
            why.pop_back();
        }
        kl_import_refuse("%.300s", why.empty() ? "not a glTF 2.0 document" : why.c_str());
    }
    check_counts(in.model, root);
}

// Each number is bounded, but products along a chain of nodes need not be.
void check_world(const kl_scene &scene)
{
    kl_err err = {};
    kl_pose *pose = nullptr;

    if (kl_pose_create(&scene, KL_NONE, 0.0, &pose, &err) != KL_OK) throw kl_import_failure(err);
    uint32_t lost = KL_NONE;
    for (size_t i = 0; i < size_t(scene.node_count) * 16 && lost == KL_NONE; ++i) {
        const bool inside = std::fabs(pose->world_from_node[i]) <= 1e30;
        if (!inside) lost = static_cast<uint32_t>(i / 16);
    }
    kl_pose_destroy(pose);
    if (lost != KL_NONE) {
        kl_import_refuse("node \"%.100s\": its place in the world is beyond 1e30",
                         scene.nodes[lost].name);
    }
}

void build_scene(kl_gltf_import &in)
{
    kl_gltf_read_materials(in);
    kl_gltf_read_meshes(in);
    kl_gltf_read_nodes(in);
    kl_gltf_read_skins(in);
    kl_gltf_read_cameras(in);
    kl_gltf_read_lights(in);
    kl_gltf_read_animations(in);
    check_world(*in.scene);
}

// Whatever a name or URI in the file holds.
void make_one_line(char *text)
{
    for (char *c = text; *c != '\0'; ++c) {
        if (static_cast<unsigned char>(*c) < 0x20) *c = ' ';
    }
}

// What could not be read but is not used stops nothing.
void warn_about_unused(kl_gltf_import &in)
{
    for (size_t i = 0; i < in.buffers.size(); ++i) {
        if (!in.buffers[i].failed) continue;
        kl_gltf_warn(in, "buffers[%zu]: %.300s: nothing uses it", i, in.buffers[i].why.msg);
    }
    for (const kl_gltf_image_source &image : in.images) {
        if (!image.blob.failed) continue;
        kl_gltf_warn(in, "%s: %.300s: nothing uses it", image.place.c_str(), image.blob.why.msg);
    }
}

struct scene_deleter {
    void operator()(kl_scene *scene) const
    {
        kl_scene_destroy(scene);
    }
};

kl_scene *import_bytes(kl_gltf_import &in, const unsigned char *bytes, size_t size,
                       const char *path)
{
    std::unique_ptr<kl_scene, scene_deleter> scene(kl_gltf_new_array<kl_scene>(1));
    {
        const kl_gltf_chunks chunks = kl_gltf_split(in, bytes, size);
        nlohmann::json root = parse_json(chunks);
        check_version(in, root);
        check_extensions(in, root);
        kl_gltf_check_schema(in, root);
        keep_pointers(root);
        take_sources(in, root, chunks);
        parse_model(in, root);
    }
    in.scene = scene.get();
    in.number_budget = base_numbers + numbers_per_byte * size;
    for (const kl_gltf_blob &buffer : in.buffers) {
        in.number_budget += numbers_per_byte * buffer.bytes.size();
    }
    in.scene->path = kl_gltf_copy_name(path);
    build_scene(in);
    warn_about_unused(in);
    return scene.release();
}
} // namespace

void kl_import_refuse(const char *fmt, ...)
{
    char text[sizeof(kl_err::msg)];
    va_list args;
    va_start(args, fmt);
    (void)!vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    make_one_line(text);
    kl_err err = {};
    (void)kl_fail(&err, KL_ERR_INPUT, "%s", text);
    throw kl_import_failure(err);
}

void kl_gltf_warn(kl_gltf_import &in, const char *fmt, ...)
{
    char text[512];
    va_list args;
    va_start(args, fmt);
    (void)!vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    make_one_line(text);
    if (in.given.insert(text).second && in.warn != nullptr) in.warn(in.warn_context, text);
}

void kl_gltf_note_extension(kl_gltf_import &in, const std::string &name)
{
    if (is_known(name)) return;
    kl_gltf_warn(in, "extension %.100s is not supported and ignored", name.c_str());
}

std::string kl_gltf_format_text(const char *fmt, ...)
{
    char text[256];
    va_list args;
    va_start(args, fmt);
    (void)!vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return text;
}

float kl_gltf_to_float(double x)
{
    return static_cast<float>(
        std::min(std::max(x, -static_cast<double>(FLT_MAX)), static_cast<double>(FLT_MAX)));
}

char *kl_gltf_copy_name(const std::string &name)
{
    kl_err err = {};
    char *out = nullptr;
    if (kl_copy_string(&out, name.c_str(), &err) != KL_OK) throw kl_import_failure(err);
    return out;
}

std::string kl_gltf_name(const std::string &given, const char *kind, size_t index)
{
    return given.empty() ? kl_gltf_format_text("%s %zu", kind, index) : given;
}

const tinygltf::Value *kl_gltf_find(const tinygltf::ExtensionMap &extensions, const char *name)
{
    const auto it = extensions.find(name);
    return it != extensions.end() && it->second.IsObject() ? &it->second : nullptr;
}

double kl_gltf_get_number(const tinygltf::Value &object, const char *name, double fallback)
{
    const tinygltf::Value &value = object.Get(name);
    return value.IsNumber() ? value.GetNumberAsDouble() : fallback;
}

extern "C" kl_status kl_import_gltf_memory(const void *bytes, size_t size, const char *name,
                                           kl_warn_fn warn, void *warn_context, kl_scene **out,
                                           kl_err *err)
{
    return kl_import_guard(err, name, [&]() {
        kl_gltf_import in;
        in.files_allowed = false;
        in.warn = warn;
        in.warn_context = warn_context;
        *out = import_bytes(in, static_cast<const unsigned char *>(bytes), size, name);
    });
}

extern "C" kl_status kl_import_gltf(const char *path, kl_warn_fn warn, void *warn_context,
                                    kl_scene **out, kl_err *err)
{
    return kl_import_guard(err, path, [&]() {
        kl_gltf_import in;
        const std::string name = path;
        const size_t slash = name.rfind('/');
        in.base_dir = slash == std::string::npos ? "" : name.substr(0, slash + 1);
        in.warn = warn;
        in.warn_context = warn_context;
        const std::vector<unsigned char> bytes = kl_gltf_read_file(name);
        *out = import_bytes(in, bytes.data(), bytes.size(), path);
    });
}
