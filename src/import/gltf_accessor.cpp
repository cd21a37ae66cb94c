// Accessors into plain numbers: glTF 2.0 section 3.6. Every byte range is checked against its
// bufferView and buffer before it is read.
#include "src/import/gltf_impl.hpp"

namespace
{
enum {
    TYPE_I8 = 5120,
    TYPE_U8 = 5121,
    TYPE_I16 = 5122,
    TYPE_U16 = 5123,
    TYPE_U32 = 5125,
    TYPE_F32 = 5126,
};

const size_t max_zeros = size_t(1) << 22;

size_t component_size(int type)
{
    switch (type) {
    case TYPE_I8:
    case TYPE_U8:
        return 1;
    case TYPE_I16:
    case TYPE_U16:
        return 2;
    case TYPE_U32:
    case TYPE_F32:
        return 4;
    default:
        return 0;
    }
}

const char *component_name(int type)
{
    switch (type) {
    case TYPE_I8:
        return "i8";
    case TYPE_U8:
        return "u8";
    case TYPE_I16:
        return "i16";
    case TYPE_U16:
        return "u16";
    case TYPE_U32:
        return "u32";
    case TYPE_F32:
        return "float";
    default:
        return "unknown";
    }
}

size_t type_width(int type)
{
    switch (type) {
    case TINYGLTF_TYPE_SCALAR:
        return 1;
    case TINYGLTF_TYPE_VEC2:
        return 2;
    case TINYGLTF_TYPE_VEC3:
        return 3;
    case TINYGLTF_TYPE_VEC4:
        return 4;
    case TINYGLTF_TYPE_MAT4:
        return 16;
    default:
        return 0; // MAT2 and MAT3 have no use in core glTF
    }
}

// Elements that lie `stride` bytes apart; `first` is NULL where they are all zero.
struct element_run {
    const unsigned char *first;
    size_t stride;
};

element_run find_elements(kl_gltf_import &in, int view_index, size_t offset, size_t count,
                          size_t element_size, const std::string &place)
{
    if (view_index < 0) return element_run{nullptr, element_size};
    const kl_gltf_view view = kl_gltf_buffer_view(in, view_index, place);
    const size_t given = in.model.bufferViews[static_cast<size_t>(view_index)].byteStride;
    const size_t stride = given != 0 ? given : element_size;

    if (stride < element_size) {
        kl_import_refuse("%s: byteStride %zu, but an element has %zu bytes", place.c_str(), stride,
                         element_size);
    }
    // The last element need not be padded to the stride. count < 2^31, stride < 256: no overflow.
    const size_t need = count == 0 ? 0 : (count - 1) * stride + element_size;
    if (offset > view.size || need > view.size - offset) {
        kl_import_refuse("%s: needs bytes %zu..%zu of bufferViews[%d], which has %zu",
                         place.c_str(), offset, offset + need, view_index, view.size);
    }
    return element_run{view.bytes != nullptr ? view.bytes + offset : nullptr, stride};
}

float read_component(const unsigned char *p, int type, bool normalized)
{
    uint8_t u8 = 0;
    int8_t i8 = 0;
    uint16_t u16 = 0;
    int16_t i16 = 0;
    float f32 = 0.0f;

    switch (type) {
    case TYPE_U8:
        std::memcpy(&u8, p, sizeof u8);
        return normalized ? static_cast<float>(u8) / 255.0f : static_cast<float>(u8);
    case TYPE_I8: // section 3.11: the two lowest values are both -1
        std::memcpy(&i8, p, sizeof i8);
        if (!normalized) return static_cast<float>(i8);
        return i8 < -127 ? -1.0f : static_cast<float>(i8) / 127.0f;
    case TYPE_U16:
        std::memcpy(&u16, p, sizeof u16);
        return normalized ? static_cast<float>(u16) / 65535.0f : static_cast<float>(u16);
    case TYPE_I16:
        std::memcpy(&i16, p, sizeof i16);
        if (!normalized) return static_cast<float>(i16);
        return i16 < -32767 ? -1.0f : static_cast<float>(i16) / 32767.0f;
    default:
        std::memcpy(&f32, p, sizeof f32);
        return f32;
    }
}

uint32_t read_unsigned(const unsigned char *p, int type)
{
    uint16_t u16 = 0;
    uint32_t u32 = 0;

    if (type == TYPE_U8) return *p;
    if (type == TYPE_U16) {
        std::memcpy(&u16, p, sizeof u16);
        return u16;
    }
    std::memcpy(&u32, p, sizeof u32);
    return u32;
}

void decode(const unsigned char *p, int type, bool normalized, float *out)
{
    *out = read_component(p, type, normalized);
}

void decode(const unsigned char *p, int type, bool /*normalized*/, uint32_t *out)
{
    *out = read_unsigned(p, type);
}

template <class T>
void read_run(const element_run &run, const tinygltf::Accessor &accessor, size_t width,
              size_t count, T *out)
{
    if (run.first == nullptr) return;
    const size_t size = component_size(accessor.componentType);
    for (size_t i = 0; i < count; ++i) {
        for (size_t c = 0; c < width; ++c) {
            decode(run.first + i * run.stride + c * size, accessor.componentType,
                   accessor.normalized, out + i * width + c);
        }
    }
}

template <class T>
void read_sparse(kl_gltf_import &in, const tinygltf::Accessor &accessor, size_t width,
                 const std::string &place, std::vector<T> &values)
{
    const auto &sparse = accessor.sparse;
    const size_t count = static_cast<size_t>(sparse.count);
    const size_t index_size = component_size(sparse.indices.componentType);
    const size_t element_size = component_size(accessor.componentType) * width;
    const int type = sparse.indices.componentType;

    if (type != TYPE_U8 && type != TYPE_U16 && type != TYPE_U32) {
        kl_import_refuse("%s: sparse indices of type %d, expected u8, u16 or u32", place.c_str(),
                         type);
    }
    if (count > accessor.count) {
        kl_import_refuse("%s: %zu sparse values, but %zu elements", place.c_str(), count,
                         accessor.count);
    }
    const element_run indices =
        find_elements(in, sparse.indices.bufferView, static_cast<size_t>(sparse.indices.byteOffset),
                      count, index_size, place + " sparse indices");
    const element_run changed =
        find_elements(in, sparse.values.bufferView, static_cast<size_t>(sparse.values.byteOffset),
                      count, element_size, place + " sparse values");
    std::vector<T> fresh(count * width);
    read_run(changed, accessor, width, count, fresh.data());
    for (size_t i = 0; i < count; ++i) {
        const uint32_t at =
            indices.first != nullptr ? read_unsigned(indices.first + i * indices.stride, type) : 0;
        if (at >= accessor.count) {
            kl_import_refuse("%s: sparse index %u, but %zu elements", place.c_str(), at,
                             accessor.count);
        }
        std::copy(fresh.begin() + static_cast<std::ptrdiff_t>(i * width),
                  fresh.begin() + static_cast<std::ptrdiff_t>((i + 1) * width),
                  values.begin() + static_cast<std::ptrdiff_t>(at * width));
    }
}

template <class T>
std::vector<T> read_values(kl_gltf_import &in, const tinygltf::Accessor &accessor, size_t width,
                           const std::string &place)
{
    const size_t count = accessor.count;
    const uint64_t total = static_cast<uint64_t>(count) * width; // < 2^35
    // What no bytes stand for is bounded by a round number: 2^22 zero vertices are no scene.
    if (accessor.bufferView < 0 && count > max_zeros) {
        kl_import_refuse("%s: %zu elements without a bufferView", place.c_str(), count);
    }
    const size_t element_size = component_size(accessor.componentType) * width;
    const element_run run =
        find_elements(in, accessor.bufferView, accessor.byteOffset, count, element_size, place);
    if (run.first == nullptr && count > max_zeros) {
        kl_import_refuse("%s: %zu elements without bytes", place.c_str(), count);
    }
    if (total > in.number_budget) {
        kl_import_refuse("%s: the accessors of this file hold too many numbers", place.c_str());
    }
    in.number_budget -= total;
    std::vector<T> values(static_cast<size_t>(total));
    read_run(run, accessor, width, count, values.data());
    if (accessor.sparse.isSparse) read_sparse(in, accessor, width, place, values);
    return values;
}

// Whether the component type is core glTF for this use; with quantization more are.
bool is_core_format(const tinygltf::Accessor &accessor, unsigned formats)
{
    const int type = accessor.componentType;
    if (type == TYPE_F32) return (formats & KL_GLTF_FLOAT) != 0;
    if (!accessor.normalized) return false;
    if (type == TYPE_U8) return (formats & KL_GLTF_NORM8) != 0;
    if (type == TYPE_U16) return (formats & KL_GLTF_NORM16) != 0;
    return (type == TYPE_I8 || type == TYPE_I16) && (formats & KL_GLTF_SNORM) != 0;
}

std::string list_types(unsigned widths)
{
    static const std::pair<unsigned, const char *> names[] = {
        {1, "SCALAR"}, {2, "VEC2"}, {3, "VEC3"}, {4, "VEC4"}, {16, "MAT4"}};
    std::string text;
    for (const auto &name : names) {
        if ((widths & 1u << name.first) == 0) continue;
        if (!text.empty()) text += " or ";
        text += name.second;
    }
    return text;
}

const tinygltf::Accessor &get_accessor(const kl_gltf_import &in, int index, unsigned widths,
                                       const std::string &place)
{
    const tinygltf::Accessor &accessor = in.model.accessors.at(static_cast<size_t>(index));
    const size_t width = type_width(accessor.type);
    if (component_size(accessor.componentType) == 0) {
        kl_import_refuse("%s: accessors[%d] has componentType %d, expected 5120..5126 but not 5124",
                         place.c_str(), index, accessor.componentType);
    }
    if (width == 0 || (widths & 1u << width) == 0) {
        kl_import_refuse("%s: accessors[%d] has another type, expected %s", place.c_str(), index,
                         list_types(widths).c_str());
    }
    return accessor;
}
} // namespace

kl_gltf_view kl_gltf_buffer_view(kl_gltf_import &in, int index, const std::string &place)
{
    const tinygltf::BufferView &view = in.model.bufferViews.at(static_cast<size_t>(index));
    kl_gltf_blob &buffer = in.buffers.at(static_cast<size_t>(view.buffer));

    if (buffer.failed) {
        kl_err err = buffer.why;
        (void)kl_wrap(&err, "buffers[%d]", view.buffer);
        throw kl_import_failure(err);
    }
    if (view.byteOffset > buffer.size || view.byteLength > buffer.size - view.byteOffset) {
        kl_import_refuse("%s: bufferViews[%d] has bytes %zu..%zu, but buffers[%d] has %llu",
                         place.c_str(), index, view.byteOffset, view.byteOffset + view.byteLength,
                         view.buffer, static_cast<unsigned long long>(buffer.size));
    }
    if (buffer.placeholder) {
        kl_gltf_warn(in, "buffers[%d] has no data: zeros are used", view.buffer);
        return kl_gltf_view{nullptr, view.byteLength};
    }
    return kl_gltf_view{buffer.bytes.data() + view.byteOffset, view.byteLength};
}

kl_gltf_numbers kl_gltf_read_numbers(kl_gltf_import &in, int index, unsigned formats,
                                     const std::string &place)
{
    const tinygltf::Accessor &accessor = get_accessor(in, index, formats & 0x1ffffu, place);
    const bool core = is_core_format(accessor, formats);
    const bool small = component_size(accessor.componentType) < 4;

    if (!core && !((formats & KL_GLTF_QUANTIZED) != 0 && small)) {
        kl_import_refuse("%s: accessors[%d] is %s%s, which has no meaning here", place.c_str(),
                         index, accessor.normalized ? "normalized " : "",
                         component_name(accessor.componentType));
    }
    if (!core && !in.quantized) {
        kl_gltf_warn(in, "%s: integers, but KHR_mesh_quantization is not declared", place.c_str());
    }
    kl_gltf_numbers out;
    out.count = accessor.count;
    out.width = type_width(accessor.type);
    out.component_type = accessor.componentType;
    out.values = read_values<float>(in, accessor, out.width, place);
    return out;
}

kl_gltf_integers kl_gltf_read_integers(kl_gltf_import &in, int index, unsigned widths,
                                       bool allow_u32, const std::string &place)
{
    const tinygltf::Accessor &accessor = get_accessor(in, index, widths, place);
    const int type = accessor.componentType;

    if (type != TYPE_U8 && type != TYPE_U16 && !(allow_u32 && type == TYPE_U32)) {
        kl_import_refuse("%s: accessors[%d] is %s, expected u8%s", place.c_str(), index,
                         component_name(type), allow_u32 ? ", u16 or u32" : " or u16");
    }
    kl_gltf_integers out;
    out.count = accessor.count;
    out.width = type_width(accessor.type);
    out.restart = type == TYPE_U8 ? 0xffu : type == TYPE_U16 ? 0xffffu : 0xffffffffu;
    out.values = read_values<uint32_t>(in, accessor, out.width, place);
    return out;
}
