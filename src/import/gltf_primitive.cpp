// Moving the vertices of a primitive together with all that hangs on them.
#include "src/import/gltf_impl.hpp"

namespace
{
template <class T>
void gather(std::vector<T> &values, size_t width, const std::vector<uint32_t> &source)
{
    if (values.empty()) return;
    std::vector<T> out(source.size() * width);
    for (size_t i = 0; i < source.size(); ++i) {
        for (size_t c = 0; c < width; ++c) {
            out[i * width + c] = values[source[i] * width + c];
        }
    }
    values.swap(out);
}
} // namespace

void kl_gltf_gather_vertices(kl_gltf_primitive &p, const std::vector<uint32_t> &source)
{
    gather(p.positions, 3, source);
    gather(p.normals, 3, source);
    gather(p.tangents, 4, source);
    for (std::vector<float> &uv : p.uv) {
        gather(uv, 2, source);
    }
    gather(p.colors, 4, source);
    gather(p.weights, p.influences, source);
    gather(p.joints, p.influences, source);
    for (kl_gltf_target &target : p.targets) {
        gather(target.positions, 3, source);
        gather(target.normals, 3, source);
        gather(target.tangents, 3, source);
    }
    p.vertex_count = source.size();
}
