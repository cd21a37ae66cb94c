// Images and textures, read when a material first uses them: PNG and JPEG through stb_image.
#include "src/import/gltf_impl.hpp"

#include <climits>
#include <cstdlib>
#include <memory>

#include <stb/stb_image.h>

namespace
{
const uint64_t max_texels = uint64_t(1) << 28;

bool is_png(const kl_gltf_view &data)
{
    static const unsigned char magic[8] = {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a};
    return data.size >= sizeof magic && std::memcmp(data.bytes, magic, sizeof magic) == 0;
}

bool is_jpeg(const kl_gltf_view &data)
{
    return data.size >= 3 && data.bytes[0] == 0xff && data.bytes[1] == 0xd8 &&
           data.bytes[2] == 0xff;
}

struct stb_deleter {
    void operator()(unsigned char *texels) const
    {
        stbi_image_free(texels);
    }
};

kl_gltf_view find_bytes(kl_gltf_import &in, const kl_gltf_image_source &source)
{
    if (source.buffer_view >= 0) return kl_gltf_buffer_view(in, source.buffer_view, source.place);
    if (source.blob.failed) {
        kl_err err = source.blob.why;
        (void)kl_wrap(&err, "%s", source.place.c_str());
        throw kl_import_failure(err);
    }
    return kl_gltf_view{source.blob.bytes.data(), source.blob.bytes.size()};
}

// False, with a warning, for a format that glTF viewers need not know.
bool decode_image(kl_gltf_import &in, const kl_gltf_image_source &source, kl_scene_image &out)
{
    const kl_gltf_view data = find_bytes(in, source);
    int width = 0, height = 0, channels = 0;
    const char *place = source.place.c_str();

    if (data.bytes == nullptr || (!is_png(data) && !is_jpeg(data))) {
        kl_gltf_warn(in, "%s: neither PNG nor JPEG: textures that use it are left out", place);
        return false;
    }
    if (data.size > INT_MAX) kl_import_refuse("%s: %zu bytes are too many", place, data.size);
    const int size = static_cast<int>(data.size);
    if (stbi_info_from_memory(data.bytes, size, &width, &height, &channels) == 0) {
        kl_import_refuse("%s: damaged image: %s", place, stbi_failure_reason());
    }
    if (width < 1 || height < 1 ||
        static_cast<uint64_t>(width) * static_cast<uint64_t>(height) > max_texels) {
        kl_import_refuse("%s: %d x %d texels, expected 1..2^28", place, width, height);
    }
    // 16 bits become 8 here: stb keeps the high byte.
    const std::unique_ptr<unsigned char, stb_deleter> texels(
        stbi_load_from_memory(data.bytes, size, &width, &height, &channels, 4));
    if (texels == nullptr) kl_import_refuse("%s: damaged image: %s", place, stbi_failure_reason());
    const size_t bytes = static_cast<size_t>(width) * static_cast<size_t>(height) * 4;
    out.texels = kl_gltf_new_array<uint8_t>(bytes);
    std::memcpy(out.texels, texels.get(), bytes);
    out.width = static_cast<uint32_t>(width);
    out.height = static_cast<uint32_t>(height);
    return true;
}

const uint32_t broken_image = KL_NONE - 1;

uint32_t get_image(kl_gltf_import &in, size_t index)
{
    if (in.image_of[index] != KL_NONE) return in.image_of[index];
    kl_scene_image &image = in.scene->images[in.scene->image_count];
    if (!decode_image(in, in.images[index], image)) {
        in.image_of[index] = broken_image;
        return broken_image;
    }
    in.image_of[index] = in.scene->image_count++;
    image.name = kl_gltf_copy_name(in.images[index].place);
    // The encoded bytes are not needed again.
    std::vector<unsigned char>().swap(in.images[index].blob.bytes);
    return in.image_of[index];
}

uint32_t get_wrap(kl_gltf_import &in, int mode, int sampler)
{
    switch (mode) {
    case TINYGLTF_TEXTURE_WRAP_REPEAT:
        return KL_WRAP_REPEAT;
    case TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE:
        return KL_WRAP_CLAMP;
    case TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT:
        return KL_WRAP_MIRROR;
    default:
        kl_gltf_warn(in, "samplers[%d]: wrap mode %d is unknown: repeat is used", sampler, mode);
        return KL_WRAP_REPEAT;
    }
}
} // namespace

uint32_t kl_gltf_get_texture(kl_gltf_import &in, int index, const std::string &place)
{
    const size_t i = static_cast<size_t>(index);
    const tinygltf::Texture &texture = in.model.textures.at(i);

    if (in.texture_is_broken[i]) return KL_NONE;
    if (in.texture_of[i] != KL_NONE) return in.texture_of[i];
    if (texture.source < 0) {
        kl_gltf_warn(in, "%s: textures[%d] has no image: it is left out", place.c_str(), index);
        in.texture_is_broken[i] = true;
        return KL_NONE;
    }
    const uint32_t image = get_image(in, static_cast<size_t>(texture.source));
    if (image == broken_image) {
        in.texture_is_broken[i] = true;
        return KL_NONE;
    }
    kl_scene_texture &out = in.scene->textures[in.scene->texture_count];
    out.image = image;
    out.wrap_s = KL_WRAP_REPEAT;
    out.wrap_t = KL_WRAP_REPEAT;
    if (texture.sampler >= 0) {
        const tinygltf::Sampler &sampler =
            in.model.samplers.at(static_cast<size_t>(texture.sampler));
        out.wrap_s = get_wrap(in, sampler.wrapS, texture.sampler);
        out.wrap_t = get_wrap(in, sampler.wrapT, texture.sampler);
        out.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    }
    in.texture_of[i] = in.scene->texture_count++;
    return in.texture_of[i];
}
