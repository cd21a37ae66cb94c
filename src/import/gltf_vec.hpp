// Small vectors in double for work on meshes at import.
#ifndef KL_SRC_IMPORT_GLTF_VEC_HPP
#define KL_SRC_IMPORT_GLTF_VEC_HPP

#include <cmath>
#include <cstddef>

struct kl_gltf_vec {
    double x, y, z;
};

inline kl_gltf_vec operator+(kl_gltf_vec a, kl_gltf_vec b)
{
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline kl_gltf_vec operator-(kl_gltf_vec a, kl_gltf_vec b)
{
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline kl_gltf_vec operator*(kl_gltf_vec a, double s)
{
    return {a.x * s, a.y * s, a.z * s};
}
inline double kl_gltf_dot(kl_gltf_vec a, kl_gltf_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline kl_gltf_vec kl_gltf_cross(kl_gltf_vec a, kl_gltf_vec b)
{
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
// Scales to length 1; false, and `v` as it was, where there is no direction.
inline bool kl_gltf_normalize(kl_gltf_vec &v)
{
    const double length = std::sqrt(kl_gltf_dot(v, v));
    if (!(length > 0.0) || !std::isfinite(length)) return false;
    v = v * (1.0 / length);
    return true;
}
inline kl_gltf_vec kl_gltf_load(const float *p)
{
    return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}
inline void kl_gltf_store(kl_gltf_vec v, float *p)
{
    p[0] = static_cast<float>(v.x);
    p[1] = static_cast<float>(v.y);
    p[2] = static_cast<float>(v.z);
}
// Any unit vector at right angles to the unit vector n.
inline kl_gltf_vec kl_gltf_perpendicular(kl_gltf_vec n)
{
    kl_gltf_vec axis = {std::fabs(n.x) < 0.6 ? 1.0 : 0.0, std::fabs(n.x) < 0.6 ? 0.0 : 1.0, 0.0};
    axis = axis - n * kl_gltf_dot(axis, n);
    (void)kl_gltf_normalize(axis);
    return axis;
}

#endif
