#include "src/cache/agreement.h"

#include <math.h>

static const float standard_errors = 2.0f; /* of either record, that noise explains */

static float told_error(const kl_record_cold *cold)
{
    return kl_half_to_float(cold->error_spacing & 0xffffu);
}

/* Does what a record says at a bearing, `said`, contradict what was gathered there? */
static bool contradicts(const kl_record_cold *record, const kl_record_cold *there,
                        const kl_bearing *b, float error)
{
    const float said = kl_luminance(kl_record_extrapolate(record, b));
    const float found = kl_luminance(kl_v3_load(there->irr));
    const float noise = said * told_error(record) + found * told_error(there);
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

/* Everything that serves the place of record `number`. */
static void check_at(const kl_level_view *level, uint32_t number, float error, float *shares)
{
    const kl_record_hot *there = &level->hot[number];
    const kl_query query = {1.0f, level->head.cos_max, KL_INF};
    const kl_vec3 pos = kl_v3_load(there->pos);
    const kl_vec3 normal = kl_oct_decode(there->normal);
    const kl_u32 row = kl_octree_row(level, pos, kl_normal_face(normal));
    kl_u32 item = row == KL_NONE ? KL_ROW_LAST : 0;
    for (kl_u32 at = row; !(item & KL_ROW_LAST); ++at) {
        item = level->rows[at];
        const kl_u32 i = item & ~KL_ROW_LAST;
        if (i == number) continue;
        const kl_bearing b = kl_record_bearing(&level->hot[i], &query, pos, normal);
        if (!(b.weight > 0.0f) || kl_record_is_blocked(&level->cold[i], &b)) continue;
        if (!contradicts(&level->cold[i], &level->cold[number], &b, error)) continue;
        const float share = share_at(&level->hot[i], &b);
#pragma omp critical
        shares[i] = fminf(shares[i], share);
    }
}

void kl_agreement_shares(const kl_level_view *level, float error, float *shares)
{
    const uint32_t n = level->head.record_count;
    for (uint32_t i = 0; i < n; ++i) {
        shares[i] = 1.0f;
    }
#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t i = 0; i < n; ++i) {
        check_at(level, i, error, shares);
    }
}
