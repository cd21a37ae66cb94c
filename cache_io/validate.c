#include "cache_io/format_impl.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

static bool half_is_finite(kl_u16 half)
{
    return (half & 0x7c00u) != 0x7c00u;
}

bool kl_record_is_valid(const kl_record_hot *hot, const kl_record_cold *cold)
{
    bool ok = true;

    for (int i = 0; i < 3; ++i) {
        ok = ok && isfinite(hot->pos[i]) && isfinite(cold->irr[i]) && cold->irr[i] >= 0.0f;
    }
    for (int i = 0; i < 6; ++i) {
        ok = ok && half_is_finite(cold->grad_t[i]) && half_is_finite(cold->grad_r[i]);
    }
    ok = ok && isfinite(hot->radius2) && hot->radius > 0.0f && hot->radius <= hot->radius2;
    ok = ok && isfinite(cold->raw_radius) && cold->raw_radius > 0.0f;
    /* Halves that are finite and not negative. */
    ok = ok && (cold->error_spacing & 0xffffu) < 0x7c00u && cold->error_spacing >> 16 < 0x7c00u;
    ok = ok && kl_record_level(hot->form) < KL_CACHE_LEVELS;
    return ok;
}

static bool is_power_of_two(kl_u32 x)
{
    return x != 0 && (x & (x - 1)) == 0;
}

static kl_status check_octree_header(const struct kl_level_arrays *level, struct kl_err *err)
{
    const kl_octree_header *head = &level->octree;
    int exponent = 0;

    for (int i = 0; i < 3; ++i) {
        if (!isfinite(head->root_min[i])) {
            return kl_fail(err, KL_ERR_CORRUPT, "octree: root corner is not finite");
        }
    }
    if (!isfinite(head->side) || !(head->side > 0.0f) || frexpf(head->side, &exponent) != 0.5f) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: side %g is not a power of two",
                       (double)head->side);
    }
    if (!isfinite(head->reach) || !(head->reach > 0.0f)) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: reach %g is not positive",
                       (double)head->reach);
    }
    if (!is_power_of_two(head->slot_count)) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u slots are not a power of two",
                       head->slot_count);
    }
    if (head->record_count != level->record_count) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u records, the level has %u",
                       head->record_count, level->record_count);
    }
    return KL_OK;
}

/* runs[p] = how many items from p on are record numbers that exist. Rows may be shared or overlap,
 * so each is judged by its start in constant time: no file can make this slow. */
static void find_runs(const struct kl_level_arrays *level, kl_u32 *runs)
{
    kl_u32 run = 0;

    for (kl_u32 p = level->octree.row_size; p-- > 0;) {
        run = level->rows[p] < level->record_count ? run + 1 : 0;
        runs[p] = run;
    }
}

static kl_status check_octree(const struct kl_level_arrays *level, struct kl_err *err)
{
    const kl_u32 size = level->octree.row_size;
    kl_u32 *runs = NULL;
    kl_status st = check_octree_header(level, err);

    if (st != KL_OK) return st;
    if (size < KL_DIRECTORY_SIZE) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u row items, the directory alone has %d",
                       size, KL_DIRECTORY_SIZE);
    }
    st = kl_alloc_array(&runs, (size_t)size + 1, sizeof *runs, err); /* runs[size] is 0 */
    if (st != KL_OK) return st;
    find_runs(level, runs);
    for (kl_u32 i = 0; i < level->octree.slot_count; ++i) {
        const kl_octree_slot *slot = &level->slots[i];
        if (slot->tag == 0) continue;
        /* A check word, a count, then as many record numbers. */
        if (slot->row >= size - 1 || level->rows[slot->row + 1] > runs[slot->row + 2]) {
            st = kl_fail(err, KL_ERR_CORRUPT, "octree: slot %u: bad row at %u of %u", i, slot->row,
                         size);
            break;
        }
    }
    free(runs);
    return st;
}

kl_status level_validate(const struct kl_level_arrays *level, struct kl_err *err)
{
    for (uint32_t i = 0; i < level->record_count; ++i) {
        if (!kl_record_is_valid(&level->hot[i], &level->cold[i])) {
            return kl_fail(err, KL_ERR_CORRUPT, "record %u of %u is not sound", i,
                           level->record_count);
        }
    }
    if (level->octree.record_count == 0) return KL_OK;
    return check_octree(level, err);
}

static bool part_is_valid(const kl_part *part)
{
    bool ok =
        part->kind < KL_PART_KINDS && part->pad == 0 && part->label[KL_PART_LABEL - 1] == '\0';

    for (int k = 0; k < 3; ++k) {
        ok = ok && isfinite(part->box_min[k]) && isfinite(part->box_max[k]) &&
             part->box_min[k] <= part->box_max[k];
    }
    for (const char *c = part->label; ok && *c != '\0'; ++c) {
        ok = (unsigned char)*c >= 32; /* it is printed */
    }
    return ok;
}

kl_status parts_validate(const kl_part *parts, uint32_t count, struct kl_err *err)
{
    if (count > KL_PARTS_MAX) {
        return kl_fail(err, KL_ERR_CORRUPT, "%u parts of the scene, at most %u", count,
                       KL_PARTS_MAX);
    }
    for (uint32_t i = 0; i < count; ++i) {
        if (!part_is_valid(&parts[i])) {
            return kl_fail(err, KL_ERR_CORRUPT, "part %u of the scene is not sound", i);
        }
    }
    return KL_OK;
}
