#include "src/cache/record.h"

#include "kernels/cache_query.h"

#include <math.h>
#include <string.h>

static const float max_radius = 0.2f; /* of the scene's: safety net for open skies */
static const float max_raw = 10.0f;   /* of the scene's: what "infinitely far" counts as */
static const float min_raw = 1e-7f;   /* of the scene's */
static const float max_ratio = 2.0f;  /* of the axes */
static const float optimism = 1.2f;   /* what the triangulated Hessian lacks on average */

/* Where second derivatives would make an error of the irradiance's own size: E = l R^2. Pointwise,
 * so it needs no length of the scene's (docs/decisions/0010). */
static float hessian_radius(float irr, float eigenvalue)
{
    return eigenvalue > 0.0f ? sqrtf(irr / (optimism * eigenvalue)) : KL_INF;
}

struct axes {
    float minor, major; /* [m], raw */
    float angle;        /* of the minor axis in the record's frame, [0, pi) */
};

/* Length over which the irradiance changes by its own size along a unit direction of the frame. */
static float gradient_length(const kl_gather_result *r)
{
    const kl_vec3 e = kl_v3(r->irr[0], r->irr[1], r->irr[2]);
    const kl_vec3 gx = kl_v3(r->grad_t[0], r->grad_t[2], r->grad_t[4]);
    const kl_vec3 gy = kl_v3(r->grad_t[1], r->grad_t[3], r->grad_t[5]);
    const float y = kl_luminance(e);
    const float g = hypotf(kl_luminance(gx), kl_luminance(gy));
    return g > 0.0f ? y / g : KL_INF;
}

static struct axes split_sphere_axes(const kl_gather_result *r)
{
    const float radius = fminf(r->harmonic, gradient_length(r));
    return (struct axes){radius, radius, 0.0f};
}

static struct axes hessian_axes(const kl_gather_result *r)
{
    const float *h = r->hessian;
    const float middle = 0.5f * (h[0] + h[2]);
    const float spread = hypotf(0.5f * (h[0] - h[2]), h[1]);
    const float toward = 0.5f * atan2f(h[1], 0.5f * (h[0] - h[2])); /* of middle + spread */
    const bool first = fabsf(middle + spread) >= fabsf(middle - spread);
    const float large = first ? middle + spread : middle - spread;
    const float small = first ? middle - spread : middle + spread;
    const float angle = first ? toward : toward + 0.5f * KL_PI;
    const float y = kl_luminance(kl_v3(r->irr[0], r->irr[1], r->irr[2]));
    const float irr = y > 0.0f ? y : KL_PI; /* black: the Hessian is that of a radiance of 1 */
    return (struct axes){hessian_radius(irr, fabsf(large)), hessian_radius(irr, fabsf(small)),
                         angle < 0.0f ? angle + KL_PI : angle};
}

static kl_u32 form_of(const struct axes *axes, uint32_t level, uint32_t log4_rays)
{
    const float ratio = fminf(axes->major / axes->minor, max_ratio);
    const kl_u32 angle = (kl_u32)(axes->angle * (4096.0f / KL_PI)) & 0xfffu;
    return angle | (kl_u32)((ratio - 1.0f) * 255.0f) << 12 | level << 20 | log4_rays << 24;
}

static uint32_t log4_of(uint32_t side)
{
    uint32_t n = 0;
    while (2u << n <= side) {
        ++n;
    }
    return n;
}

static kl_u16 relative_half(float gradient, float irr)
{
    const float r = irr > 0.0f ? gradient / irr : 0.0f;
    return (kl_u16)kl_float_to_half(kl_clamp(r, -1000.0f, 1000.0f));
}

void kl_record_pack(const kl_gather_point *point, const kl_gather_result *result, uint32_t level,
                    float spacing, const struct kl_radius_settings *settings, kl_record_hot *hot,
                    kl_record_cold *cold)
{
    const float scene = settings->scene_radius;
    struct axes axes =
        settings->rule == KL_RADIUS_HESSIAN ? hessian_axes(result) : split_sphere_axes(result);
    axes.minor = fminf(axes.minor, KL_RAW_OVER_HARMONIC * result->harmonic);
    axes.minor = fmaxf(fminf(axes.minor, max_raw * scene), min_raw * scene);
    axes.major = fmaxf(fminf(axes.major, max_raw * scene), axes.minor);
    /* Surroundings nearer than the least radius: the gradient would be carried too far. */
    const float damp = fminf(1.0f, result->harmonic / fmaxf(spacing, 1e-30f));

    memset(hot, 0, sizeof *hot);
    memset(cold, 0, sizeof *cold);
    memcpy(hot->pos, point->pos, sizeof hot->pos);
    hot->normal = point->normal;
    hot->form = form_of(&axes, level, log4_of(result->side));
    hot->object = KL_NONE;
    hot->radius = axes.minor;
    hot->radius2 = axes.minor;
    memcpy(cold->irr, result->irr, sizeof cold->irr);
    for (int k = 0; k < 6; ++k) {
        const float irr = result->irr[k / 2];
        cold->grad[k] = relative_half(result->grad_t[k] * axes.minor * damp, irr);
        cold->grad[6 + k] =
            relative_half(kl_clamp(result->grad_r[k], -8.0f * irr, 8.0f * irr), irr);
    }
    cold->raw_radius = axes.minor;
    memcpy(cold->touched, result->touched, sizeof cold->touched);
    cold->error_spacing = kl_float_to_half(fminf(result->error, 100.0f)) |
                          kl_float_to_half(fminf(spacing / axes.minor, 60000.0f)) << 16;
    const float unit2 = kl_clearance_unit2(cold->error_spacing, cold->raw_radius);
    for (int k = 0; k < KL_SECTORS; ++k) {
        const float open = result->clearance[k];
        cold->clearance[k] =
            open < KL_INF ? (kl_u8)kl_clearance_code(unit2, 0.96f * open * open) : (kl_u8)255u;
    }
}

/* Relative gradient [1/m] of the luminance along the axis at `angle`. */
static float relative_gradient(const kl_record_cold *cold, float angle)
{
    const float c = cosf(angle);
    const float s = sinf(angle);
    float g[3];
    for (int k = 0; k < 3; ++k) {
        g[k] = cold->irr[k] * (c * kl_half_to_float(cold->grad[2 * k]) +
                               s * kl_half_to_float(cold->grad[2 * k + 1]));
    }
    const float y = kl_luminance(kl_v3(cold->irr[0], cold->irr[1], cold->irr[2]));
    return y > 0.0f ? fabsf(kl_luminance(kl_v3(g[0], g[1], g[2]))) / (y * cold->raw_radius) : 0.0f;
}

static float within_gradient(float radius, float gradient)
{
    return radius * gradient > 1.0f ? 1.0f / gradient : radius;
}

float kl_record_wish(const kl_record_hot *hot, const kl_record_cold *cold,
                     const struct kl_radius_settings *settings)
{
    const float radius = settings->accuracy * cold->raw_radius;
    return within_gradient(radius, relative_gradient(cold, kl_record_axis_angle(hot->form)));
}

/* Radii of the Hessian legitimately grow like the square root of the distance near corners, faster
 * than the distance: there the clamp is but a filter of outliers. */
float kl_record_slope(const struct kl_radius_settings *settings)
{
    return settings->rule == KL_RADIUS_HESSIAN ? 2.0f : settings->accuracy;
}

static float spacing_of(const kl_record_cold *cold)
{
    return kl_half_to_float(cold->error_spacing >> 16) * cold->raw_radius;
}

void kl_record_set_radii(kl_record_hot *hot, const kl_record_cold *cold, float clamped_wish,
                         const struct kl_radius_settings *settings)
{
    const float most = max_radius * settings->scene_radius;
    const float spacing = spacing_of(cold);
    const float angle = kl_record_axis_angle(hot->form) + 0.5f * KL_PI;
    const float minor =
        fmaxf(fminf(fmaxf(clamped_wish, spacing), most), min_raw * settings->scene_radius);
    const float major = within_gradient(clamped_wish * kl_record_axis_ratio(hot->form),
                                        relative_gradient(cold, angle));
    hot->radius = minor;
    hot->radius2 = fmaxf(minor, fminf(major, most));
}

void kl_record_limit_radii(kl_record_hot *hot, const kl_record_cold *cold, float limit)
{
    const float most = fmaxf(limit, spacing_of(cold));
    hot->radius = fminf(hot->radius, most);
    hot->radius2 = fminf(hot->radius2, most);
}

void kl_record_scale_radii(kl_record_hot *hot, const kl_record_cold *cold, float share)
{
    hot->radius = fmaxf(hot->radius * share, fminf(hot->radius, spacing_of(cold)));
    hot->radius2 = fmaxf(hot->radius2 * share, hot->radius);
}
