/* Records from gathers, and the radii that follow from all of them together. */
#ifndef KL_SRC_CACHE_RECORD_H
#define KL_SRC_CACHE_RECORD_H

#include "kernels/cache_data.h"
#include "kernels/derivatives.h"

/* No raw radius is larger than this many harmonic mean distances: what hangs close over a record
 * may hide things that its rays did not find. */
#define KL_RAW_OVER_HARMONIC 32.0f

/* What decides how far a record serves. */
enum kl_radius_rule {
    KL_RADIUS_HESSIAN,      /* second derivatives: Schwarzhaupt, Jensen, Jarosz 2012 */
    KL_RADIUS_SPLIT_SPHERE, /* harmonic mean distance: Ward 1988, bounded; for comparison */
};

/* What radii depend on besides the record. */
struct kl_radius_settings {
    enum kl_radius_rule rule;
    float accuracy;     /* radius over raw radius, > 0 */
    float scene_radius; /* [m] caps infinite distances */
};

/* Pack one gather. `spacing` [m]: the least radius (a multiple of the pixel size there); `level`:
 * bounce level; settings->accuracy is not read. Radii are not set yet. */
void kl_record_pack(const kl_gather_point *point, const kl_gather_result *result, uint32_t level,
                    float spacing, const struct kl_radius_settings *settings, kl_record_hot *hot,
                    kl_record_cold *cold);

/* Radius [m] along the minor axis that the record alone asks for: accuracy times its raw radius, no
 * farther than where its gradient would take the irradiance to zero. */
float kl_record_wish(const kl_record_hot *hot, const kl_record_cold *cold,
                     const struct kl_radius_settings *settings);

/* How much faster than the distance between them radii of neighbours may differ. */
float kl_record_slope(const struct kl_radius_settings *settings);

/* Set both radii from the neighbour-clamped wish: within [spacing, 0.2 scene]. */
void kl_record_set_radii(kl_record_hot *hot, const kl_record_cold *cold, float clamped_wish,
                         const struct kl_radius_settings *settings);

/* Make both radii no larger than `limit` [m], but no smaller than the least radius. */
void kl_record_limit_radii(kl_record_hot *hot, const kl_record_cold *cold, float limit);

/* Multiply both radii by `share` in (0, 1], but make them no smaller than the least radius. */
void kl_record_scale_radii(kl_record_hot *hot, const kl_record_cold *cold, float share);

#endif
