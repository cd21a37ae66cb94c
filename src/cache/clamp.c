#include "src/cache/clamp.h"

#include "src/base/memory.h"
#include "src/cache/agreement.h"
#include "src/cache/validity.h"

#include <stdlib.h>
#include <string.h>

/* How far records must agree, of the second-order term at the end of their radii: that is the error
 * that is asked for (0013), of which interpolation leaves less (0031). */
static const float agreed = 0.5f;

kl_status kl_clamp_tree(const kl_record_hot *hot, const kl_record_cold *cold, uint32_t count,
                        const struct kl_radius_settings *settings, struct kl_point_tree **out,
                        struct kl_err *err)
{
    const float slope = kl_record_slope(settings);
    struct kl_tree_point *points = NULL;
    kl_status st = kl_alloc_array(&points, count, sizeof *points, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < count; ++i) {
        memcpy(points[i].pos, hot[i].pos, sizeof points[i].pos);
        points[i].value = kl_record_wish(&hot[i], &cold[i], settings) / slope;
    }
    st = kl_point_tree_create(points, count, out, err);
    free(points);
    return st;
}

void kl_clamp_by_neighbours(const struct kl_record_set *set,
                            const struct kl_radius_settings *settings)
{
    const float slope = kl_record_slope(settings);
#pragma omp parallel for schedule(static, 256)
    for (uint32_t i = 0; i < set->count; ++i) {
        const float wish = kl_record_wish(&set->hot[i], &set->cold[i], settings);
        const float clamped =
            slope * kl_point_tree_envelope(set->tree, set->hot[i].pos, wish / slope);
        kl_record_set_radii(&set->hot[i], &set->cold[i], clamped, settings);
    }
}

void kl_clamp_by_agreement(const struct kl_record_set *set, uint32_t level,
                           const struct kl_radius_settings *settings, float *scratch)
{
    const float error = agreed * settings->accuracy * settings->accuracy;
    if (level != 0 || settings->rule != KL_RADIUS_HESSIAN) return;
    kl_agreement_shares(set, error, scratch);
    for (uint32_t i = 0; i < set->count; ++i) {
        kl_record_scale_radii(&set->hot[i], &set->cold[i], scratch[i]);
    }
}

void kl_clamp_by_validity(const struct kl_record_set *set, float *scratch)
{
    kl_validity_limits(set, scratch);
    for (uint32_t i = 0; i < set->count; ++i) {
        kl_record_limit_radii(&set->hot[i], &set->cold[i], scratch[i]);
    }
}
