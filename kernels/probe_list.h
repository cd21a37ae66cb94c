/* Every struct whose bytes host and devices share, with its fields: a test compares what both
 * compilers make of them. T(type) a struct; F(type, field) one of its fields. */
#ifndef KL_KERNELS_PROBE_LIST_H
#define KL_KERNELS_PROBE_LIST_H
#include "kernels/cache_data.h"
#include "kernels/derivatives.h"
#include "kernels/scene_args.h"
#include "kernels/trace.h"
#if !KL_DEVICE
#include "kernels/bvh.h" /* on devices trace.h includes it */
#endif

/* One struct a line.
 * clang-format breaks such lists at random. */
/* clang-format off */
#define KL_PROBE_TRACE(T, F)                                                                      \
    T(kl_ray) F(kl_ray, tmin) F(kl_ray, dir) F(kl_ray, tmax)                                      \
    T(kl_hit) F(kl_hit, u) F(kl_hit, v) F(kl_hit, triangle) F(kl_hit, instance)                   \
    T(kl_bvh_node) F(kl_bvh_node, child) F(kl_bvh_node, pad)                                      \
    T(kl_bvh_leaf) F(kl_bvh_leaf, triangle)                                                       \
    T(kl_triangle) F(kl_triangle, material) F(kl_triangle, object) F(kl_triangle, light)          \
    T(kl_instance) F(kl_instance, object_from_render) F(kl_instance, first_triangle)              \
    F(kl_instance, triangle_count) F(kl_instance, object) F(kl_instance, mirrored)

#define KL_PROBE_SURFACES(T, F)                                                                   \
    T(kl_texture_use) F(kl_texture_use, uv_set) F(kl_texture_use, matrix)                         \
    T(kl_material) F(kl_material, emission) F(kl_material, metallic) F(kl_material, roughness)    \
    F(kl_material, alpha_cutoff) F(kl_material, normal_scale) F(kl_material, specular)            \
    F(kl_material, specular_color) F(kl_material, ior) F(kl_material, flags)                      \
    F(kl_material, tex)                                                                           \
    T(kl_texture) F(kl_texture, width) F(kl_texture, height) F(kl_texture, wrap_s)                \
    F(kl_texture, wrap_t) F(kl_texture, nearest) F(kl_texture, srgb)

#define KL_PROBE_LIGHTS(T, F)                                                                     \
    T(kl_light) F(kl_light, triangle) F(kl_light, color) F(kl_light, pos) F(kl_light, dir)        \
    F(kl_light, edge1) F(kl_light, two_sided) F(kl_light, edge2) F(kl_light, textured)            \
    T(kl_light_node) F(kl_light_node, power) F(kl_light_node, radius) F(kl_light_node, axis)     \
    F(kl_light_node, parent) F(kl_light_node, child) F(kl_light_node, light)                      \
    T(kl_environment) F(kl_environment, light) F(kl_environment, scale)                           \
    T(kl_scene_scalars) F(kl_scene_scalars, far_probability)                                      \
    F(kl_scene_scalars, instance_count) F(kl_scene_scalars, scene_radius)                         \
    F(kl_scene_scalars, env)

#define KL_PROBE_CACHE(T, F)                                                                      \
    T(kl_record_hot) F(kl_record_hot, normal) F(kl_record_hot, radius)                            \
    F(kl_record_hot, radius2) F(kl_record_hot, form) F(kl_record_hot, object)                     \
    T(kl_record_cold) F(kl_record_cold, grad)                         \
    F(kl_record_cold, raw_radius) F(kl_record_cold, clearance) F(kl_record_cold, touched)         \
    T(kl_octree_header) F(kl_octree_header, side) F(kl_octree_header, top_bits)                   \
    F(kl_octree_header, node_count) F(kl_octree_header, row_size)                                 \
    F(kl_octree_header, record_count) F(kl_octree_header, reach) F(kl_octree_header, cos_max)

#define KL_PROBE_GATHER(T, F)                                                                     \
    T(kl_gather_point) F(kl_gather_point, geometric) F(kl_gather_point, rot_sin)                  \
    T(kl_ride) F(kl_ride, triangle) F(kl_ride, u) F(kl_ride, v) F(kl_gather_point, on)            \
    T(kl_gather_pick) F(kl_gather_pick, direction)                                                \
    T(kl_direction) F(kl_direction, index) F(kl_direction, when)                                  \
    T(kl_gather_cell) F(kl_gather_cell, distance) F(kl_gather_cell, touch)                        \
    F(kl_gather_cell, toward) F(kl_gather_cell, light)                                            \
    T(kl_gather_settings) F(kl_gather_settings, length_scale) F(kl_gather_settings, side)         \
    F(kl_gather_settings, sets) F(kl_gather_settings, touch)                                      \
    T(kl_gather_result) F(kl_gather_result, error) F(kl_gather_result, grad_t)                    \
    F(kl_gather_result, grad_r) F(kl_gather_result, hessian) F(kl_gather_result, harmonic) F(kl_gather_result, clearance)

#define KL_PROBE_ALL(T, F)                                                                        \
    KL_PROBE_TRACE(T, F) KL_PROBE_SURFACES(T, F) KL_PROBE_LIGHTS(T, F) KL_PROBE_CACHE(T, F)       \
    KL_PROBE_GATHER(T, F)
/* clang-format on */

#endif
