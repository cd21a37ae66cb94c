#include "src/cache/record.h"

#include "kernels/cache_query.h"

#include <math.h>
#include <string.h>

static const float max_radius = 0.2f;    /* of the scene's: safety net for open skies */
static const float max_harmonic = 10.0f; /* of the scene's: what "infinitely far" counts as */

/* Length over which the irradiance changes by its own size, from the larger of the channels'
 * relative gradients weighted by luminance. */
static float gradient_length(const kl_gather_result *r)
{
    const kl_vec3 e = kl_v3(r->irr[0], r->irr[1], r->irr[2]);
    const kl_vec3 gx = kl_v3(r->grad_t[0], r->grad_t[2], r->grad_t[4]);
    const kl_vec3 gy = kl_v3(r->grad_t[1], r->grad_t[3], r->grad_t[5]);
    const float y = kl_luminance(e);
    const float g = hypotf(kl_luminance(gx), kl_luminance(gy));
    return g > 0.0f ? y / g : KL_INF;
}

static kl_u16 relative_half(float gradient, float irr, float limit)
{
    const float r = irr > 0.0f ? gradient / irr : 0.0f;
    return (kl_u16)kl_float_to_half(kl_clamp(r, -limit, limit));
}

void kl_record_pack(const kl_gather_point *point, const kl_gather_result *result, uint32_t level,
                    float spacing, float scene_radius, kl_record_hot *hot, kl_record_cold *cold)
{
    const float harmonic = fminf(result->harmonic, max_harmonic * scene_radius);
    const float raw = fmaxf(fminf(harmonic, gradient_length(result)), 1e-7f * scene_radius);
    /* A radius raised to the spacing would carry the gradient too far: scale it down. */
    const float damp = fminf(1.0f, raw / fmaxf(spacing, 1e-30f));

    memset(hot, 0, sizeof *hot);
    memset(cold, 0, sizeof *cold);
    memcpy(hot->pos, point->pos, sizeof hot->pos);
    hot->normal = point->normal;
    hot->form = level << 20;
    hot->object = KL_NONE;
    hot->radius = raw;
    hot->radius2 = raw;
    memcpy(cold->irr, result->irr, sizeof cold->irr);
    for (int k = 0; k < 6; ++k) {
        const float irr = result->irr[k / 2];
        cold->grad_t[k] = relative_half(result->grad_t[k] * raw * damp, irr, 8.0f);
        cold->grad_r[k] = relative_half(result->grad_r[k], irr, 8.0f);
    }
    cold->raw_radius = raw;
    memcpy(cold->touched, result->touched, sizeof cold->touched);
    cold->error_spacing = kl_float_to_half(fminf(result->error, 100.0f)) |
                          kl_float_to_half(fminf(spacing / raw, 60000.0f)) << 16;
    for (int k = 0; k < KL_SECTORS; ++k) {
        const float open = result->clearance[k] / kl_clearance_unit(cold);
        cold->clearance[k] = (kl_u8)(open >= 254.0f ? 255.0f : floorf(open * 0.98f));
    }
}

float kl_record_radius(const kl_record_cold *cold, float clamped_raw, float accuracy,
                       float scene_radius)
{
    const float spacing = kl_half_to_float(cold->error_spacing >> 16) * cold->raw_radius;
    const float r = fmaxf(accuracy * clamped_raw, spacing);
    return fmaxf(fminf(r, max_radius * scene_radius), 1e-7f * scene_radius);
}
