#include "src/cache/agreement.h"

#include <math.h>

static const float standard_errors = 2.0f; /* of either record, that noise explains */

static float told_error(const kl_record_cold *cold)
{
    return kl_half_to_float(cold->error_spacing & 0xffffu);
}

/* Does what a record says at the bearing `b` of another, which has it at the bearing `back`,
 * contradict what was gathered there? Half of the way by either's gradients, as answers go. */
static bool contradicts(const kl_record_cold *record, const kl_record_cold *there,
                        const kl_bearing *b, const kl_bearing *back, float error)
{
    const kl_vec3 half = kl_record_with_gain(record, kl_record_half_gain(record, *b));
    const kl_vec3 other = kl_v3_mul(kl_v3_load(there->irr), kl_record_half_gain(there, *back));
    const float said = kl_luminance(kl_v3_sub(half, other));
    const float found = kl_luminance(kl_v3_load(there->irr));
    const float noise = fabsf(said) * told_error(record) + found * told_error(there);
    return fabsf(said - found) > error * found + standard_errors * noise;
}

/* Of a record's radii, where a bearing is. */
static float share_at(const kl_record_hot *r, const kl_bearing *b)
{
    const kl_vec2 axis = kl_record_axis(r->form);
    const float minor = (b->x * axis.x + b->y * axis.y) / r->radius;
    const float major = (b->y * axis.x - b->x * axis.y) / r->radius2;
    return hypotf(minor, major);
}

/* The share of a record's radii with which it ends where it must, to the farthest-reaching query.
 */
static float share_of(const struct kl_record_set *set, uint32_t number, float error)
{
    const kl_record_hot *r = &set->hot[number];
    const kl_record_cold *cold = &set->cold[number];
    const kl_query query = {set->reach, set->cos_max, KL_INF};
    uint32_t near[KL_NEAREST_MOST];
    const uint32_t count =
        kl_point_tree_nearest(set->tree, r->pos, set->reach * r->radius2, KL_NEAREST_MOST, near);
    float share = 1.0f;
    for (uint32_t k = 0; k < count; ++k) {
        const kl_record_hot *there = &set->hot[near[k]];
        if (near[k] == number) continue;
        const kl_bearing b =
            kl_record_bearing(r, &query, kl_v3_load(there->pos), kl_oct_decode(there->normal));
        if (!(b.weight > 0.0f) || kl_record_is_blocked(cold, &b)) continue;
        const kl_bearing back =
            kl_record_bearing(there, &query, kl_v3_load(r->pos), kl_oct_decode(r->normal));
        if (!contradicts(cold, &set->cold[near[k]], &b, &back, error)) continue;
        share = fminf(share, share_at(r, &b) / set->reach);
    }
    return share;
}

void kl_agreement_shares(const struct kl_record_set *set, float error, float *shares)
{
#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t i = 0; i < set->count; ++i) {
        shares[i] = share_of(set, i, error);
    }
}
