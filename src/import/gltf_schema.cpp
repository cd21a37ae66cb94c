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
    INTEGER, // low..high, refused outside
    NUMBER,  // low..high, clamped outside with a warning
    NUMBERS, // array of `least`..`most` numbers, ditto each
    BOOLEAN,
    TEXT,
    INDEX,      // into the collection `of`
    INDICES,    // array of them
    OBJECT,     // of type `of`
    OBJECTS,    // array of them
    ATTRIBUTES, // object whose members index accessors
    TARGETS,    // array of attributes
};

// Beyond any scene, and small enough that products of transforms stay finite.
const double huge_number = 1e18;
const double max_integer = 9007199254740991.0; // 2^53 - 1
const double max_int = 2147483647.0;
const double any = 3.5e38; // any float

struct member {
    const char *owner, *name, *of;
    form what;
    bool required = false;
    double low = 0, high = 0;
    unsigned least = 0, most = 0;
};

const member members[] = {
    {"root", "asset", "asset", form::OBJECT, true},
    {"root", "accessors", "accessor", form::OBJECTS},
    {"root", "animations", "animation", form::OBJECTS},
    {"root", "buffers", "buffer", form::OBJECTS},
    {"root", "bufferViews", "bufferView", form::OBJECTS},
    {"root", "cameras", "camera", form::OBJECTS},
    {"root", "images", "image", form::OBJECTS},
    {"root", "materials", "material", form::OBJECTS},
    {"root", "meshes", "mesh", form::OBJECTS},
    {"root", "nodes", "node", form::OBJECTS},
    {"root", "samplers", "sampler", form::OBJECTS},
    {"root", "scene", "scenes", form::INDEX},
    {"root", "scenes", "scene", form::OBJECTS},
    {"root", "skins", "skin", form::OBJECTS},
    {"root", "textures", "texture", form::OBJECTS},
    {"root", "KHR_lights_punctual", "lightList", form::OBJECT},

    {"accessor", "bufferView", "bufferViews", form::INDEX},
    {"accessor", "byteOffset", nullptr, form::INTEGER, false, 0, max_integer},
    {"accessor", "componentType", nullptr, form::INTEGER, true, 5120, 5126},
    {"accessor", "count", nullptr, form::INTEGER, true, 0, max_int},
    {"accessor", "type", nullptr, form::TEXT, true},
    {"accessor", "normalized", nullptr, form::BOOLEAN},
    {"accessor", "min", nullptr, form::NUMBERS, false, -1e300, 1e300, 0, 16},
    {"accessor", "max", nullptr, form::NUMBERS, false, -1e300, 1e300, 0, 16},
    {"accessor", "sparse", "sparse", form::OBJECT},
    {"sparse", "count", nullptr, form::INTEGER, true, 0, max_int},
    {"sparse", "indices", "sparseIndices", form::OBJECT, true},
    {"sparse", "values", "sparseValues", form::OBJECT, true},
    {"sparseIndices", "bufferView", "bufferViews", form::INDEX, true},
    {"sparseIndices", "byteOffset", nullptr, form::INTEGER, false, 0, max_int},
    {"sparseIndices", "componentType", nullptr, form::INTEGER, true, 5121, 5125},
    {"sparseValues", "bufferView", "bufferViews", form::INDEX, true},
    {"sparseValues", "byteOffset", nullptr, form::INTEGER, false, 0, max_int},

    {"buffer", "byteLength", nullptr, form::INTEGER, true, 0, max_integer},
    {"buffer", "uri", nullptr, form::TEXT},
    {"bufferView", "buffer", "buffers", form::INDEX, true},
    {"bufferView", "byteOffset", nullptr, form::INTEGER, false, 0, max_integer},
    {"bufferView", "byteLength", nullptr, form::INTEGER, true, 0, max_integer},
    {"bufferView", "byteStride", nullptr, form::INTEGER, false, 4, 252},
    {"bufferView", "target", nullptr, form::INTEGER, false, 0, max_int},

    {"animation", "channels", "channel", form::OBJECTS, true},
    {"animation", "samplers", "animationSampler", form::OBJECTS, true},
    {"channel", "sampler", nullptr, form::INTEGER, true, 0, max_int},
    {"channel", "target", "channelTarget", form::OBJECT, true},
    {"channelTarget", "node", "nodes", form::INDEX},
    {"channelTarget", "path", nullptr, form::TEXT, true},
    {"animationSampler", "input", "accessors", form::INDEX, true},
    {"animationSampler", "output", "accessors", form::INDEX, true},
    {"animationSampler", "interpolation", nullptr, form::TEXT},

    {"camera", "type", nullptr, form::TEXT, true},
    {"camera", "perspective", "perspective", form::OBJECT},
    {"camera", "orthographic", "orthographic", form::OBJECT},
    {"perspective", "aspectRatio", nullptr, form::NUMBER, false, -any, any},
    {"perspective", "yfov", nullptr, form::NUMBER, true, -any, any},
    {"perspective", "zfar", nullptr, form::NUMBER, false, -any, any},
    {"perspective", "znear", nullptr, form::NUMBER, true, -any, any},
    {"orthographic", "xmag", nullptr, form::NUMBER, true, -any, any},
    {"orthographic", "ymag", nullptr, form::NUMBER, true, -any, any},
    {"orthographic", "zfar", nullptr, form::NUMBER, true, -any, any},
    {"orthographic", "znear", nullptr, form::NUMBER, true, -any, any},

    {"image", "uri", nullptr, form::TEXT},
    {"image", "mimeType", nullptr, form::TEXT},
    {"image", "bufferView", "bufferViews", form::INDEX},
    {"texture", "sampler", "samplers", form::INDEX},
    {"texture", "source", "images", form::INDEX},
    {"sampler", "magFilter", nullptr, form::INTEGER, false, 0, max_int},
    {"sampler", "minFilter", nullptr, form::INTEGER, false, 0, max_int},
    {"sampler", "wrapS", nullptr, form::INTEGER, false, 0, max_int},
    {"sampler", "wrapT", nullptr, form::INTEGER, false, 0, max_int},

    {"material", "pbrMetallicRoughness", "pbr", form::OBJECT},
    {"material", "normalTexture", "normalTexture", form::OBJECT},
    {"material", "occlusionTexture", "occlusionTexture", form::OBJECT},
    {"material", "emissiveTexture", "textureInfo", form::OBJECT},
    {"material", "emissiveFactor", nullptr, form::NUMBERS, false, 0, 1, 3, 3},
    {"material", "alphaMode", nullptr, form::TEXT},
    {"material", "alphaCutoff", nullptr, form::NUMBER, false, 0, huge_number},
    {"material", "doubleSided", nullptr, form::BOOLEAN},
    {"material", "KHR_materials_emissive_strength", "strength", form::OBJECT},
    {"material", "KHR_materials_ior", "ior", form::OBJECT},
    {"material", "KHR_materials_specular", "specular", form::OBJECT},
    {"material", "KHR_materials_unlit", "unlit", form::OBJECT},
    {"pbr", "baseColorFactor", nullptr, form::NUMBERS, false, 0, 1, 4, 4},
    {"pbr", "baseColorTexture", "textureInfo", form::OBJECT},
    {"pbr", "metallicRoughnessTexture", "textureInfo", form::OBJECT},
    {"pbr", "metallicFactor", nullptr, form::NUMBER, false, 0, 1},
    {"pbr", "roughnessFactor", nullptr, form::NUMBER, false, 0, 1},
    {"textureInfo", "index", "textures", form::INDEX, true},
    {"textureInfo", "texCoord", nullptr, form::INTEGER, false, 0, max_int},
    {"textureInfo", "KHR_texture_transform", "transform", form::OBJECT},
    {"normalTexture", "index", "textures", form::INDEX, true},
    {"normalTexture", "texCoord", nullptr, form::INTEGER, false, 0, max_int},
    {"normalTexture", "scale", nullptr, form::NUMBER, false, -huge_number, huge_number},
    {"normalTexture", "KHR_texture_transform", "transform", form::OBJECT},
    {"occlusionTexture", "index", "textures", form::INDEX, true},
    {"occlusionTexture", "texCoord", nullptr, form::INTEGER, false, 0, max_int},
    {"occlusionTexture", "strength", nullptr, form::NUMBER, false, 0, 1},
    {"transform", "offset", nullptr, form::NUMBERS, false, -huge_number, huge_number, 2, 2},
    {"transform", "rotation", nullptr, form::NUMBER, false, -huge_number, huge_number},
    {"transform", "scale", nullptr, form::NUMBERS, false, -huge_number, huge_number, 2, 2},
    {"transform", "texCoord", nullptr, form::INTEGER, false, 0, max_int},
    {"strength", "emissiveStrength", nullptr, form::NUMBER, false, 0, huge_number},
    {"ior", "ior", nullptr, form::NUMBER, false, 0, huge_number},
    {"specular", "specularFactor", nullptr, form::NUMBER, false, 0, 1},
    {"specular", "specularTexture", "textureInfo", form::OBJECT},
    {"specular", "specularColorFactor", nullptr, form::NUMBERS, false, 0, huge_number, 3, 3},
    {"specular", "specularColorTexture", "textureInfo", form::OBJECT},

    {"mesh", "primitives", "primitive", form::OBJECTS, true},
    {"mesh", "weights", nullptr, form::NUMBERS, false, -huge_number, huge_number, 0, 65535},
    {"primitive", "attributes", nullptr, form::ATTRIBUTES, true},
    {"primitive", "indices", "accessors", form::INDEX},
    {"primitive", "material", "materials", form::INDEX},
    {"primitive", "mode", nullptr, form::INTEGER, false, 0, max_int},
    {"primitive", "targets", nullptr, form::TARGETS},

    {"node", "camera", "cameras", form::INDEX},
    {"node", "children", "nodes", form::INDICES},
    {"node", "skin", "skins", form::INDEX},
    {"node", "mesh", "meshes", form::INDEX},
    {"node", "matrix", nullptr, form::NUMBERS, false, -huge_number, huge_number, 16, 16},
    {"node", "rotation", nullptr, form::NUMBERS, false, -huge_number, huge_number, 4, 4},
    {"node", "scale", nullptr, form::NUMBERS, false, -huge_number, huge_number, 3, 3},
    {"node", "translation", nullptr, form::NUMBERS, false, -huge_number, huge_number, 3, 3},
    {"node", "weights", nullptr, form::NUMBERS, false, -huge_number, huge_number, 0, 65535},
    {"node", "KHR_lights_punctual", "nodeLight", form::OBJECT},
    {"scene", "nodes", "nodes", form::INDICES},
    {"skin", "inverseBindMatrices", "accessors", form::INDEX},
    {"skin", "skeleton", "nodes", form::INDEX},
    {"skin", "joints", "nodes", form::INDICES, true},

    {"lightList", "lights", "light", form::OBJECTS, true},
    {"nodeLight", "light", "lights", form::INDEX, true},
    {"light", "type", nullptr, form::TEXT, true},
    {"light", "color", nullptr, form::NUMBERS, false, 0, huge_number, 3, 3},
    {"light", "intensity", nullptr, form::NUMBER, false, 0, huge_number},
    {"light", "range", nullptr, form::NUMBER, false, 0, any},
    {"light", "spot", "spot", form::OBJECT},
    {"spot", "innerConeAngle", nullptr, form::NUMBER, false, 0, 1.5707963267948966},
    {"spot", "outerConeAngle", nullptr, form::NUMBER, false, 0, 1.5707963267948966},
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
    void check_dependencies(const json &value, const std::string &type, const std::string &place)
    {
        if (type == "light" && value["type"] == "spot" && !value.contains("spot")) {
            kl_import_refuse("%s.spot: missing", place.c_str());
        }
        if (type == "node" && value.contains("matrix") &&
            (value.contains("translation") || value.contains("rotation") ||
             value.contains("scale"))) {
            kl_gltf_warn(in, "%s: both a matrix and its parts: the matrix is used", place.c_str());
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
        case form::INTEGER:
            check_integer(value, m.low, m.high, place);
            return;
        case form::NUMBER:
            check_number(value, m, place);
            return;
        case form::NUMBERS:
            check_numbers(value, m, place);
            return;
        case form::BOOLEAN:
            if (!value.is_boolean()) refuse_type(value, place, "true or false");
            return;
        case form::TEXT:
            if (!value.is_string()) refuse_type(value, place, "a string");
            return;
        case form::INDEX:
            check_index(value, m.of, place);
            return;
        case form::OBJECT:
            check_object(value, m.of, place);
            return;
        case form::ATTRIBUTES:
            check_attributes(value, place);
            return;
        case form::INDICES:
        case form::OBJECTS:
        case form::TARGETS:
            check_array(value, m, place);
            return;
        }
    }

    void check_array(json &value, const member &m, const std::string &place)
    {
        if (!value.is_array()) refuse_type(value, place, "an array");
        for (size_t i = 0; i < value.size(); ++i) {
            const std::string at = place + "[" + std::to_string(i) + "]";
            if (m.what == form::INDICES) check_index(value[i], m.of, at);
            if (m.what == form::OBJECTS) check_object(value[i], m.of, at);
            if (m.what == form::TARGETS) check_attributes(value[i], at);
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
