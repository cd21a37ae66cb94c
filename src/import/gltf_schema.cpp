// The glTF 2.0 schema as tables, and the walk that checks a document against them before anything
// else looks at it: after this every member has its type, every required member is there and every
// index is in range.
#include "src/import/gltf_impl.hpp"

#include <cmath>

#include <nlohmann/json.hpp>

namespace
{
using nlohmann::json;

enum class form {
    integer, // low..high, refused outside
    number,  // low..high, clamped outside with a warning
    numbers, // array of `least`..`most` numbers, ditto each
    boolean,
    text,
    index,      // into the collection `of`
    indices,    // array of them
    object,     // of type `of`
    objects,    // array of them
    attributes, // object whose members index accessors
    targets,    // array of attributes
};

// Beyond any scene, and small enough that products of transforms stay finite.
const double huge_number = 1e18;
const double max_integer = 9007199254740991.0; // 2^53 - 1
const double max_int = 2147483647.0;
const double any = 3.5e38; // any float

struct member {
    const char *owner, *name;
    form what;
    const char *of;
    bool required;
    double low, high;
    unsigned least, most;
};

const member members[] = {
    {"root", "asset", form::object, "asset", true, 0, 0, 0, 0},
    {"root", "accessors", form::objects, "accessor", false, 0, 0, 0, 0},
    {"root", "animations", form::objects, "animation", false, 0, 0, 0, 0},
    {"root", "buffers", form::objects, "buffer", false, 0, 0, 0, 0},
    {"root", "bufferViews", form::objects, "bufferView", false, 0, 0, 0, 0},
    {"root", "cameras", form::objects, "camera", false, 0, 0, 0, 0},
    {"root", "images", form::objects, "image", false, 0, 0, 0, 0},
    {"root", "materials", form::objects, "material", false, 0, 0, 0, 0},
    {"root", "meshes", form::objects, "mesh", false, 0, 0, 0, 0},
    {"root", "nodes", form::objects, "node", false, 0, 0, 0, 0},
    {"root", "samplers", form::objects, "sampler", false, 0, 0, 0, 0},
    {"root", "scene", form::index, "scenes", false, 0, 0, 0, 0},
    {"root", "scenes", form::objects, "scene", false, 0, 0, 0, 0},
    {"root", "skins", form::objects, "skin", false, 0, 0, 0, 0},
    {"root", "textures", form::objects, "texture", false, 0, 0, 0, 0},
    {"root", "KHR_lights_punctual", form::object, "lightList", false, 0, 0, 0, 0},

    {"accessor", "bufferView", form::index, "bufferViews", false, 0, 0, 0, 0},
    {"accessor", "byteOffset", form::integer, nullptr, false, 0, max_integer, 0, 0},
    {"accessor", "componentType", form::integer, nullptr, true, 5120, 5126, 0, 0},
    {"accessor", "count", form::integer, nullptr, true, 0, max_int, 0, 0},
    {"accessor", "type", form::text, nullptr, true, 0, 0, 0, 0},
    {"accessor", "normalized", form::boolean, nullptr, false, 0, 0, 0, 0},
    {"accessor", "min", form::numbers, nullptr, false, -1e300, 1e300, 0, 16},
    {"accessor", "max", form::numbers, nullptr, false, -1e300, 1e300, 0, 16},
    {"accessor", "sparse", form::object, "sparse", false, 0, 0, 0, 0},
    {"sparse", "count", form::integer, nullptr, true, 0, max_int, 0, 0},
    {"sparse", "indices", form::object, "sparseIndices", true, 0, 0, 0, 0},
    {"sparse", "values", form::object, "sparseValues", true, 0, 0, 0, 0},
    {"sparseIndices", "bufferView", form::index, "bufferViews", true, 0, 0, 0, 0},
    {"sparseIndices", "byteOffset", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"sparseIndices", "componentType", form::integer, nullptr, true, 5121, 5125, 0, 0},
    {"sparseValues", "bufferView", form::index, "bufferViews", true, 0, 0, 0, 0},
    {"sparseValues", "byteOffset", form::integer, nullptr, false, 0, max_int, 0, 0},

    {"buffer", "byteLength", form::integer, nullptr, true, 0, max_integer, 0, 0},
    {"buffer", "uri", form::text, nullptr, false, 0, 0, 0, 0},
    {"bufferView", "buffer", form::index, "buffers", true, 0, 0, 0, 0},
    {"bufferView", "byteOffset", form::integer, nullptr, false, 0, max_integer, 0, 0},
    {"bufferView", "byteLength", form::integer, nullptr, true, 0, max_integer, 0, 0},
    {"bufferView", "byteStride", form::integer, nullptr, false, 4, 252, 0, 0},
    {"bufferView", "target", form::integer, nullptr, false, 0, max_int, 0, 0},

    {"animation", "channels", form::objects, "channel", true, 0, 0, 0, 0},
    {"animation", "samplers", form::objects, "animationSampler", true, 0, 0, 0, 0},
    {"channel", "sampler", form::integer, nullptr, true, 0, max_int, 0, 0},
    {"channel", "target", form::object, "channelTarget", true, 0, 0, 0, 0},
    {"channelTarget", "node", form::index, "nodes", false, 0, 0, 0, 0},
    {"channelTarget", "path", form::text, nullptr, true, 0, 0, 0, 0},
    {"animationSampler", "input", form::index, "accessors", true, 0, 0, 0, 0},
    {"animationSampler", "output", form::index, "accessors", true, 0, 0, 0, 0},
    {"animationSampler", "interpolation", form::text, nullptr, false, 0, 0, 0, 0},

    {"camera", "type", form::text, nullptr, true, 0, 0, 0, 0},
    {"camera", "perspective", form::object, "perspective", false, 0, 0, 0, 0},
    {"camera", "orthographic", form::object, "orthographic", false, 0, 0, 0, 0},
    {"perspective", "aspectRatio", form::number, nullptr, false, -any, any, 0, 0},
    {"perspective", "yfov", form::number, nullptr, true, -any, any, 0, 0},
    {"perspective", "zfar", form::number, nullptr, false, -any, any, 0, 0},
    {"perspective", "znear", form::number, nullptr, true, -any, any, 0, 0},
    {"orthographic", "xmag", form::number, nullptr, true, -any, any, 0, 0},
    {"orthographic", "ymag", form::number, nullptr, true, -any, any, 0, 0},
    {"orthographic", "zfar", form::number, nullptr, true, -any, any, 0, 0},
    {"orthographic", "znear", form::number, nullptr, true, -any, any, 0, 0},

    {"image", "uri", form::text, nullptr, false, 0, 0, 0, 0},
    {"image", "mimeType", form::text, nullptr, false, 0, 0, 0, 0},
    {"image", "bufferView", form::index, "bufferViews", false, 0, 0, 0, 0},
    {"texture", "sampler", form::index, "samplers", false, 0, 0, 0, 0},
    {"texture", "source", form::index, "images", false, 0, 0, 0, 0},
    {"sampler", "magFilter", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"sampler", "minFilter", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"sampler", "wrapS", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"sampler", "wrapT", form::integer, nullptr, false, 0, max_int, 0, 0},

    {"material", "pbrMetallicRoughness", form::object, "pbr", false, 0, 0, 0, 0},
    {"material", "normalTexture", form::object, "normalTexture", false, 0, 0, 0, 0},
    {"material", "occlusionTexture", form::object, "occlusionTexture", false, 0, 0, 0, 0},
    {"material", "emissiveTexture", form::object, "textureInfo", false, 0, 0, 0, 0},
    {"material", "emissiveFactor", form::numbers, nullptr, false, 0, 1, 3, 3},
    {"material", "alphaMode", form::text, nullptr, false, 0, 0, 0, 0},
    {"material", "alphaCutoff", form::number, nullptr, false, 0, huge_number, 0, 0},
    {"material", "doubleSided", form::boolean, nullptr, false, 0, 0, 0, 0},
    {"material", "KHR_materials_emissive_strength", form::object, "strength", false, 0, 0, 0, 0},
    {"material", "KHR_materials_ior", form::object, "ior", false, 0, 0, 0, 0},
    {"material", "KHR_materials_specular", form::object, "specular", false, 0, 0, 0, 0},
    {"material", "KHR_materials_unlit", form::object, "unlit", false, 0, 0, 0, 0},
    {"pbr", "baseColorFactor", form::numbers, nullptr, false, 0, 1, 4, 4},
    {"pbr", "baseColorTexture", form::object, "textureInfo", false, 0, 0, 0, 0},
    {"pbr", "metallicRoughnessTexture", form::object, "textureInfo", false, 0, 0, 0, 0},
    {"pbr", "metallicFactor", form::number, nullptr, false, 0, 1, 0, 0},
    {"pbr", "roughnessFactor", form::number, nullptr, false, 0, 1, 0, 0},
    {"textureInfo", "index", form::index, "textures", true, 0, 0, 0, 0},
    {"textureInfo", "texCoord", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"textureInfo", "KHR_texture_transform", form::object, "transform", false, 0, 0, 0, 0},
    {"normalTexture", "index", form::index, "textures", true, 0, 0, 0, 0},
    {"normalTexture", "texCoord", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"normalTexture", "scale", form::number, nullptr, false, -huge_number, huge_number, 0, 0},
    {"normalTexture", "KHR_texture_transform", form::object, "transform", false, 0, 0, 0, 0},
    {"occlusionTexture", "index", form::index, "textures", true, 0, 0, 0, 0},
    {"occlusionTexture", "texCoord", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"occlusionTexture", "strength", form::number, nullptr, false, 0, 1, 0, 0},
    {"transform", "offset", form::numbers, nullptr, false, -huge_number, huge_number, 2, 2},
    {"transform", "rotation", form::number, nullptr, false, -huge_number, huge_number, 0, 0},
    {"transform", "scale", form::numbers, nullptr, false, -huge_number, huge_number, 2, 2},
    {"transform", "texCoord", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"strength", "emissiveStrength", form::number, nullptr, false, 0, huge_number, 0, 0},
    {"ior", "ior", form::number, nullptr, false, 0, huge_number, 0, 0},
    {"specular", "specularFactor", form::number, nullptr, false, 0, 1, 0, 0},
    {"specular", "specularTexture", form::object, "textureInfo", false, 0, 0, 0, 0},
    {"specular", "specularColorFactor", form::numbers, nullptr, false, 0, huge_number, 3, 3},
    {"specular", "specularColorTexture", form::object, "textureInfo", false, 0, 0, 0, 0},

    {"mesh", "primitives", form::objects, "primitive", true, 0, 0, 0, 0},
    {"mesh", "weights", form::numbers, nullptr, false, -huge_number, huge_number, 0, 65535},
    {"primitive", "attributes", form::attributes, nullptr, true, 0, 0, 0, 0},
    {"primitive", "indices", form::index, "accessors", false, 0, 0, 0, 0},
    {"primitive", "material", form::index, "materials", false, 0, 0, 0, 0},
    {"primitive", "mode", form::integer, nullptr, false, 0, max_int, 0, 0},
    {"primitive", "targets", form::targets, nullptr, false, 0, 0, 0, 0},

    {"node", "camera", form::index, "cameras", false, 0, 0, 0, 0},
    {"node", "children", form::indices, "nodes", false, 0, 0, 0, 0},
    {"node", "skin", form::index, "skins", false, 0, 0, 0, 0},
    {"node", "mesh", form::index, "meshes", false, 0, 0, 0, 0},
    {"node", "matrix", form::numbers, nullptr, false, -huge_number, huge_number, 16, 16},
    {"node", "rotation", form::numbers, nullptr, false, -huge_number, huge_number, 4, 4},
    {"node", "scale", form::numbers, nullptr, false, -huge_number, huge_number, 3, 3},
    {"node", "translation", form::numbers, nullptr, false, -huge_number, huge_number, 3, 3},
    {"node", "weights", form::numbers, nullptr, false, -huge_number, huge_number, 0, 65535},
    {"node", "KHR_lights_punctual", form::object, "nodeLight", false, 0, 0, 0, 0},
    {"scene", "nodes", form::indices, "nodes", false, 0, 0, 0, 0},
    {"skin", "inverseBindMatrices", form::index, "accessors", false, 0, 0, 0, 0},
    {"skin", "skeleton", form::index, "nodes", false, 0, 0, 0, 0},
    {"skin", "joints", form::indices, "nodes", true, 0, 0, 0, 0},

    {"lightList", "lights", form::objects, "light", true, 0, 0, 0, 0},
    {"nodeLight", "light", form::index, "lights", true, 0, 0, 0, 0},
    {"light", "type", form::text, nullptr, true, 0, 0, 0, 0},
    {"light", "color", form::numbers, nullptr, false, 0, huge_number, 3, 3},
    {"light", "intensity", form::number, nullptr, false, 0, huge_number, 0, 0},
    {"light", "range", form::number, nullptr, false, 0, any, 0, 0},
    {"light", "spot", form::object, "spot", false, 0, 0, 0, 0},
    {"spot", "innerConeAngle", form::number, nullptr, false, 0, 1.5707963267948966, 0, 0},
    {"spot", "outerConeAngle", form::number, nullptr, false, 0, 1.5707963267948966, 0, 0},
};

class schema_walk
{
  public:
    schema_walk(kl_gltf_import &import, const json &root) : in(import)
    {
        for (const char *name :
             {"accessors", "bufferViews", "buffers", "cameras", "images", "materials", "meshes",
              "nodes", "samplers", "scenes", "skins", "textures"}) {
            const auto list = root.find(name);
            counts[name] = list != root.end() && list->is_array() ? list->size() : 0;
        }
        const json::json_pointer lights("/extensions/KHR_lights_punctual/lights");
        counts["lights"] =
            root.contains(lights) && root[lights].is_array() ? root[lights].size() : 0;
        for (const member &m : members) {
            tables[m.owner].push_back(&m);
        }
    }

    void check_object(json &value, const std::string &type, const std::string &place)
    {
        if (!value.is_object()) refuse_type(value, place, "an object");
        value.erase("extras");
        check_name(value, place);
        check_extension_objects(value, place);
        const auto table = tables.find(type);
        if (table == tables.end()) return;
        for (const member *m : table->second) {
            json *owner = &value;
            // Members that are extensions are one level down.
            if (std::strncmp(m->name, "KHR_", 4) == 0) {
                if (!value.contains("extensions")) continue;
                owner = &value["extensions"];
            }
            const auto found = owner->find(m->name);
            const std::string at = place.empty() ? m->name : place + "." + m->name;
            if (found != owner->end()) {
                check_member(*found, *m, at);
            } else if (m->required) {
                kl_import_refuse("%s: missing", at.c_str());
            }
        }
        check_dependencies(value, type, place);
    }

  private:
    kl_gltf_import &in;
    std::map<std::string, size_t> counts;
    std::map<std::string, std::vector<const member *>> tables;

    [[noreturn]] static void refuse_type(const json &value, const std::string &place,
                                         const char *expected)
    {
        kl_import_refuse("%s: %s, expected %s", place.empty() ? "document" : place.c_str(),
                         value.type_name(), expected);
    }

    static void check_name(const json &value, const std::string &place)
    {
        const auto name = value.find("name");
        if (name != value.end() && !name->is_string()) {
            refuse_type(*name, place + ".name", "a string");
        }
    }

    // What the tables cannot say; tinygltf would refuse these without naming the place.
    static void check_dependencies(const json &value, const std::string &type,
                                   const std::string &place)
    {
        if (type == "light" && value["type"] == "spot" && !value.contains("spot")) {
            kl_import_refuse("%s.spot: missing", place.c_str());
        }
        if (type == "bufferView" && value.contains("byteStride") &&
            value["byteStride"].get<uint64_t>() % 4 != 0) {
            kl_import_refuse("%s.byteStride: found %llu, expected a multiple of 4", place.c_str(),
                             static_cast<unsigned long long>(value["byteStride"].get<uint64_t>()));
        }
    }

    void check_extension_objects(json &value, const std::string &place)
    {
        const auto extensions = value.find("extensions");
        if (extensions == value.end()) return;
        if (!extensions->is_object()) refuse_type(*extensions, place + ".extensions", "an object");
        for (auto &item : extensions->items()) {
            if (!item.value().is_object()) {
                refuse_type(item.value(), place + ".extensions." + item.key(), "an object");
            }
            kl_gltf_note_extension(in, item.key());
        }
    }

    void check_member(json &value, const member &m, const std::string &place)
    {
        switch (m.what) {
        case form::integer:
            check_integer(value, m.low, m.high, place);
            return;
        case form::number:
            check_number(value, m, place);
            return;
        case form::numbers:
            check_numbers(value, m, place);
            return;
        case form::boolean:
            if (!value.is_boolean()) refuse_type(value, place, "true or false");
            return;
        case form::text:
            if (!value.is_string()) refuse_type(value, place, "a string");
            return;
        case form::index:
            check_index(value, m.of, place);
            return;
        case form::object:
            check_object(value, m.of, place);
            return;
        case form::attributes:
            check_attributes(value, place);
            return;
        case form::indices:
        case form::objects:
        case form::targets:
            check_array(value, m, place);
            return;
        }
    }

    void check_array(json &value, const member &m, const std::string &place)
    {
        if (!value.is_array()) refuse_type(value, place, "an array");
        for (size_t i = 0; i < value.size(); ++i) {
            const std::string at = place + "[" + std::to_string(i) + "]";
            if (m.what == form::indices) check_index(value[i], m.of, at);
            if (m.what == form::objects) check_object(value[i], m.of, at);
            if (m.what == form::targets) check_attributes(value[i], at);
        }
    }

    // A whole number may be written as 3.0 or 3e0; tinygltf wants 3.
    static void check_integer(json &value, double low, double high, const std::string &place)
    {
        if (!value.is_number()) refuse_type(value, place, "an integer");
        const double x = value.get<double>();
        if (x != std::floor(x) || x < low || x > high) {
            kl_import_refuse("%s: found %.17g, expected an integer in %.17g..%.17g", place.c_str(),
                             x, low, high);
        }
        value = static_cast<uint64_t>(x);
    }

    void check_index(json &value, const char *of, const std::string &place)
    {
        const size_t count = counts[of];
        if (!value.is_number()) refuse_type(value, place, "an index");
        const double x = value.get<double>();
        if (x != std::floor(x) || x < 0 || x >= static_cast<double>(count)) {
            kl_import_refuse("%s: found %.17g, but there are %zu %s", place.c_str(), x, count, of);
        }
        value = static_cast<uint64_t>(x);
    }

    void check_number(json &value, const member &m, const std::string &place)
    {
        if (!value.is_number()) refuse_type(value, place, "a number");
        const double x = value.get<double>();
        if (x >= m.low && x <= m.high) return;
        const double clamped = x < m.low ? m.low : m.high;
        kl_gltf_warn(in, "%s: found %g, expected %g..%g: %g is used", place.c_str(), x, m.low,
                     m.high, clamped);
        value = clamped;
    }

    void check_numbers(json &value, const member &m, const std::string &place)
    {
        if (!value.is_array()) refuse_type(value, place, "an array");
        if (value.size() < m.least || value.size() > m.most) {
            kl_import_refuse("%s: %zu numbers, expected %u", place.c_str(), value.size(), m.most);
        }
        for (size_t i = 0; i < value.size(); ++i) {
            check_number(value[i], m, place + "[" + std::to_string(i) + "]");
        }
    }

    void check_attributes(json &value, const std::string &place)
    {
        if (!value.is_object()) refuse_type(value, place, "an object");
        for (auto &item : value.items()) {
            check_index(item.value(), "accessors", place + "." + item.key());
        }
    }
};
} // namespace

void kl_gltf_check_schema(kl_gltf_import &in, json &root)
{
    schema_walk(in, root).check_object(root, "root", "");
}
