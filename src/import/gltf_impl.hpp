// Private to src/import: what the readers of one glTF file share. Each reader throws
// kl_import_failure; src/import/gltf_open.cpp catches.
#ifndef KL_SRC_IMPORT_GLTF_IMPL_HPP
#define KL_SRC_IMPORT_GLTF_IMPL_HPP

#include "src/base/memory.h"
#include "src/import/import.h"
#include "src/import/import_guard.hpp"

#include <cstdint>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <type_traits>
#include <vector>

#include <nlohmann/json_fwd.hpp>
#ifndef TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE
#endif
#ifndef TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#endif
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#include <tiny_gltf.h>
#pragma GCC diagnostic pop

// Bytes of a buffer or an encoded image. A failure to get them matters only where they are used.
struct kl_gltf_blob {
    std::vector<unsigned char> bytes;
    uint64_t size = 0;        // of the buffer; > bytes.size() only if `placeholder`
    bool placeholder = false; // a buffer without uri or BIN chunk: read as zeros
    bool failed = false;
    kl_err why = {};
};

struct kl_gltf_image_source {
    std::string place; // "images[3]"
    kl_gltf_blob blob; // from a file or data URI
    int buffer_view = -1;
};

// One import. Scene arrays are filled with their counts raised item by item, so that a failure at
// any point frees what is there.
struct kl_gltf_import {
    std::string base_dir;
    bool files_allowed = true;
    bool quantized = false; // KHR_mesh_quantization is declared
    kl_warn_fn warn = nullptr;
    void *warn_context = nullptr;
    std::set<std::string> given; // warnings so far

    tinygltf::Model model;
    std::vector<kl_gltf_blob> buffers;
    std::vector<kl_gltf_image_source> images;
    // Numbers that may still be read from accessors: bounds the work that a small file with many
    // references to one accessor can cause.
    uint64_t number_budget = 0;

    kl_scene *scene = nullptr;
    std::vector<uint32_t> image_of;      // per file image: scene image, KL_NONE: not yet
    std::vector<uint32_t> texture_of;    // per file texture: ditto
    std::vector<bool> texture_is_broken; // per file texture: its image cannot be read
    uint32_t default_material = KL_NONE;
    std::vector<std::vector<uint32_t>> meshes_of; // per file mesh: scene meshes
    std::vector<uint32_t> node_of;                // per file node: scene node
    std::vector<uint32_t> skin_joint_limit;       // per scene mesh: highest joint number + 1
    std::vector<uint32_t> file_node;              // per scene node: file node
};

void kl_gltf_warn(kl_gltf_import &in, const char *fmt, ...) KL_PRINTF(2, 3);

// gltf_schema.cpp: checks types, required members, ranges and references of a whole document
// against the glTF 2.0 schema; numbers out of range are clamped with a warning; removes "extras".
void kl_gltf_check_schema(kl_gltf_import &in, nlohmann::json &root);

// Warns once if the extension is not one that is read.
void kl_gltf_note_extension(kl_gltf_import &in, const std::string &name);

// gltf_source.cpp: files, data URIs, the GLB container.
struct kl_gltf_chunks {
    const unsigned char *json, *bin;
    size_t json_size, bin_size;
};
std::vector<unsigned char> kl_gltf_read_file(const std::string &path);
kl_gltf_chunks kl_gltf_split(kl_gltf_import &in, const unsigned char *bytes, size_t size);
kl_gltf_blob kl_gltf_read_uri(const kl_gltf_import &in, const std::string &uri);

// gltf_accessor.cpp. `place` names the user of the accessor in messages.
struct kl_gltf_numbers {
    size_t count = 0; // elements
    size_t width = 0; // numbers per element
    int component_type = 0;
    std::vector<float> values; // normalised where the accessor says so
};
struct kl_gltf_view {
    const unsigned char *bytes; // NULL: zeros
    size_t size;
};
kl_gltf_view kl_gltf_buffer_view(kl_gltf_import &in, int index, const std::string &place);
// `types`: widths and component types that are allowed, by name of the use.
enum kl_gltf_format : unsigned {
    KL_GLTF_VEC2 = 1u << 2,
    KL_GLTF_VEC3 = 1u << 3,
    KL_GLTF_VEC4 = 1u << 4,
    KL_GLTF_SCALAR = 1u << 1,
    KL_GLTF_MAT4 = 1u << 16,
    KL_GLTF_FLOAT = 1u << 20,
    KL_GLTF_NORM8 = 1u << 21,     // normalised u8
    KL_GLTF_NORM16 = 1u << 22,    // normalised u16
    KL_GLTF_SNORM = 1u << 23,     // normalised i8, i16
    KL_GLTF_QUANTIZED = 1u << 24, // any 8 and 16 bit type: KHR_mesh_quantization
};
kl_gltf_numbers kl_gltf_read_numbers(kl_gltf_import &in, int index, unsigned formats,
                                     const std::string &place);
// Unsigned integers (indices, joints): `widths` as above, `allow_u32` for indices.
struct kl_gltf_integers {
    size_t count = 0, width = 0;
    uint32_t restart = 0; // the highest value of the type
    std::vector<uint32_t> values;
};
kl_gltf_integers kl_gltf_read_integers(kl_gltf_import &in, int index, unsigned widths,
                                       bool allow_u32, const std::string &place);

// gltf_image.cpp, gltf_material.cpp. KL_NONE where the texture has no image that can be read.
uint32_t kl_gltf_get_texture(kl_gltf_import &in, int index, const std::string &place);
void kl_gltf_read_materials(kl_gltf_import &in);
uint32_t kl_gltf_get_material(kl_gltf_import &in, int material);

// gltf_primitive.cpp, gltf_normals.cpp, gltf_tangents.cpp: one primitive while it is worked on.
struct kl_gltf_target {
    std::vector<float> positions, normals, tangents; // 3 per vertex, empty: no displacement
};
struct kl_gltf_primitive {
    std::string place;
    uint32_t material = 0;
    size_t vertex_count = 0;
    std::vector<float> positions, normals, tangents, uv[KL_MAX_UV_SETS], colors, weights;
    std::vector<uint16_t> joints;
    uint32_t influences = 0;
    std::vector<kl_gltf_target> targets;
    std::vector<uint32_t> indices;
    uint32_t dropped = 0;
};
// New vertex i is old vertex source[i]; indices are not touched.
void kl_gltf_gather_vertices(kl_gltf_primitive &p, const std::vector<uint32_t> &source);
void kl_gltf_make_flat_normals(kl_gltf_primitive &p);
void kl_gltf_repair_normals(kl_gltf_import &in, kl_gltf_primitive &p);
void kl_gltf_make_tangents(kl_gltf_import &in, kl_gltf_primitive &p);
void kl_gltf_repair_tangents(kl_gltf_import &in, kl_gltf_primitive &p);

void kl_gltf_read_meshes(kl_gltf_import &in);     // gltf_mesh.cpp
void kl_gltf_read_nodes(kl_gltf_import &in);      // gltf_node.cpp: nodes and instances
void kl_gltf_read_skins(kl_gltf_import &in);      // gltf_skin.cpp
void kl_gltf_read_cameras(kl_gltf_import &in);    // gltf_camera.cpp
void kl_gltf_read_lights(kl_gltf_import &in);     // gltf_light.cpp
void kl_gltf_read_animations(kl_gltf_import &in); // gltf_animation.cpp

// Helpers over tinygltf's extension values; the schema has checked the types.
const tinygltf::Value *kl_gltf_find(const tinygltf::ExtensionMap &extensions, const char *name);
double kl_gltf_get_number(const tinygltf::Value &object, const char *name, double fallback);

// A name that is never empty.
std::string kl_gltf_name(const std::string &given, const char *kind, size_t index);
std::string kl_gltf_format_text(const char *fmt, ...) KL_PRINTF(1, 2);
float kl_gltf_to_float(double x); // finite: clamped to the range of float

// Storage that the scene frees with free().
template <class T> T *kl_gltf_new_array(size_t count)
{
    static_assert(std::is_trivially_copyable<T>::value, "the scene is plain C");
    kl_err err = {};
    T *out = nullptr;
    if (kl_alloc_array(&out, count, sizeof(T), &err) != KL_OK) throw kl_import_failure(err);
    return out;
}
template <class T> T *kl_gltf_copy_array(const std::vector<T> &from)
{
    T *out = kl_gltf_new_array<T>(from.size());
    if (!from.empty()) std::memcpy(out, from.data(), from.size() * sizeof(T));
    return out;
}
char *kl_gltf_copy_name(const std::string &name);

#endif
