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

/* Rows follow each other without gaps behind the directory: one pass in the order of memory, whose
 * time a hostile file cannot stretch. starts: bit p is set where a row starts at item p. */
static bool rows_are_sound(const struct kl_level_arrays *level, uint64_t *starts)
{
    const kl_u32 size = level->octree.row_size;
    kl_u32 highest = 0;
    kl_u32 p = KL_DIRECTORY_SIZE;

    while (p < size) {
        /* A check word, a count, then as many record numbers. */
        if (size - p < 2 || level->rows[p + 1] > size - p - 2) return false;
        const kl_u32 count = level->rows[p + 1];
        const kl_u32 *numbers = level->rows + p + 2;
        starts[p / 64] |= 1ull << (p % 64);
        for (kl_u32 k = 0; k < count; ++k)
            highest = numbers[k] > highest ? numbers[k] : highest;
        p += 2 + count;
    }
    return highest < level->record_count;
}

static bool slots_are_sound(const struct kl_level_arrays *level, const uint64_t *starts)
{
    const int64_t slots = (int64_t)level->octree.slot_count;
    const kl_u32 size = level->octree.row_size;
    bool ok = true;

#pragma omp parallel for schedule(static) reduction(&& : ok) if (slots > 65536)
    for (int64_t i = 0; i < slots; ++i) {
        const kl_octree_slot *slot = &level->slots[i];
        ok = ok && (slot->tag == 0 ||
                    (slot->row < size && (starts[slot->row / 64] >> (slot->row % 64) & 1u) != 0));
    }
    return ok;
}

kl_status octree_validate(const struct kl_level_arrays *level, struct kl_err *err)
{
    kl_status st = check_octree_header(level, err);

    if (st != KL_OK) return st;
    if (level->octree.row_size < KL_DIRECTORY_SIZE) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u row items, the directory alone has %d",
                       level->octree.row_size, KL_DIRECTORY_SIZE);
    }
    uint64_t *starts = NULL;
    st = kl_alloc_array(&starts, level->octree.row_size / 64 + 1, sizeof *starts, err);
    if (st != KL_OK) return st;
    if (!rows_are_sound(level, starts) || !slots_are_sound(level, starts)) {
        st = kl_fail(err, KL_ERR_CORRUPT, "octree: a row, or a slot's place, is not sound");
    }
    free(starts);
    return st;
}

bool records_are_valid(const struct kl_level_arrays *level, uint32_t first, uint32_t last)
{
    for (uint32_t i = first; i < last; ++i) {
        if (!kl_record_is_valid(&level->hot[i], &level->cold[i])) return false;
    }
    return true;
}

static bool part_is_valid(const kl_part *part)
{
    bool ok = part->kind < KL_PART_KINDS && isfinite(part->power) && part->power >= 0.0f &&
              part->label[KL_PART_LABEL - 1] == '\0';

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
