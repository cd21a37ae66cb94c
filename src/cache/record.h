/* Records from gathers, and the radii that follow from all of them together. */
#ifndef KL_SRC_CACHE_RECORD_H
#define KL_SRC_CACHE_RECORD_H

#include "kernels/cache_data.h"
#include "kernels/derivatives.h"

/* Pack one gather. `spacing` [m]: the least radius (a multiple of the pixel size there); `level`:
 * bounce level; `scene_radius` caps infinite distances. Radii are not set yet. */
void kl_record_pack(const kl_gather_point *point, const kl_gather_result *result, uint32_t level,
                    float spacing, float scene_radius, kl_record_hot *hot, kl_record_cold *cold);

/* Radius for a neighbour-clamped raw radius: accuracy times it, within [spacing, 0.2 scene]. */
float kl_record_radius(const kl_record_cold *cold, float clamped_raw, float accuracy,
                       float scene_radius);

#endif
