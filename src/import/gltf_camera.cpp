// Cameras: glTF 2.0 section 3.10.
#include "src/import/gltf_impl.hpp"

namespace
{
const double pi = 3.14159265358979323846;

void read_range(kl_gltf_import &in, double znear, double zfar, const std::string &place,
                kl_scene_camera &out)
{
    out.znear = znear;
    out.zfar = zfar;
    if (znear < 0.0) {
        kl_gltf_warn(in, "%s: znear %g, expected > 0: 0 is used", place.c_str(), znear);
        out.znear = 0.0;
    }
    if (zfar != 0.0 && zfar <= out.znear) {
        kl_gltf_warn(in, "%s: zfar %g, expected > znear %g: no limit is used", place.c_str(), zfar,
                     out.znear);
        out.zfar = 0.0;
    }
}

bool read_perspective(kl_gltf_import &in, const tinygltf::PerspectiveCamera &from,
                      const std::string &place, kl_scene_camera &out)
{
    out.projection = KL_PERSPECTIVE;
    if (!(from.yfov > 0.0 && from.yfov < pi)) {
        kl_gltf_warn(in, "%s: yfov %g, expected 0..pi: the camera is left out", place.c_str(),
                     from.yfov);
        return false;
    }
    out.yfov = from.yfov;
    out.aspect = from.aspectRatio;
    if (from.aspectRatio < 0.0) {
        kl_gltf_warn(in, "%s: aspectRatio %g, expected > 0: that of the image is used",
                     place.c_str(), from.aspectRatio);
        out.aspect = 0.0;
    }
    read_range(in, from.znear, from.zfar, place, out);
    return true;
}

bool read_orthographic(kl_gltf_import &in, const tinygltf::OrthographicCamera &from,
                       const std::string &place, kl_scene_camera &out)
{
    out.projection = KL_ORTHOGRAPHIC;
    if (from.xmag == 0.0 || from.ymag == 0.0) {
        kl_gltf_warn(in, "%s: xmag %g and ymag %g, expected not 0: the camera is left out",
                     place.c_str(), from.xmag, from.ymag);
        return false;
    }
    out.xmag = from.xmag;
    out.ymag = from.ymag;
    read_range(in, from.znear, from.zfar, place, out);
    return true;
}

bool read_camera(kl_gltf_import &in, const tinygltf::Camera &from, const std::string &place,
                 kl_scene_camera &out)
{
    if (from.type == "perspective") return read_perspective(in, from.perspective, place, out);
    if (from.type == "orthographic") return read_orthographic(in, from.orthographic, place, out);
    kl_gltf_warn(in, "%s: type \"%.40s\" is unknown: left out", place.c_str(), from.type.c_str());
    return false;
}

std::string camera_name(const kl_gltf_import &in, uint32_t node, size_t camera)
{
    const std::string &of_node = in.model.nodes[in.file_node[node]].name;
    return of_node.empty() ? kl_gltf_name(in.model.cameras[camera].name, "camera", camera)
                           : of_node;
}
} // namespace

void kl_gltf_read_cameras(kl_gltf_import &in)
{
    kl_scene &scene = *in.scene;

    scene.cameras = kl_gltf_new_array<kl_scene_camera>(scene.node_count);
    for (uint32_t n = 0; n < scene.node_count; ++n) {
        const int camera = in.model.nodes[in.file_node[n]].camera;
        if (camera < 0 || !scene.nodes[n].visible) continue;
        const size_t index = static_cast<size_t>(camera);
        kl_scene_camera out = {};
        out.node = n;
        out.source = static_cast<uint32_t>(index);
        if (!read_camera(in, in.model.cameras[index], kl_gltf_format_text("cameras[%d]", camera),
                         out)) {
            continue;
        }
        out.name = kl_gltf_copy_name(camera_name(in, n, index));
        scene.cameras[scene.camera_count++] = out;
    }
}
