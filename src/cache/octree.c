#include "src/cache/octree.h"

#include "kernels/cache_query.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct pair {     /* a record in a cell */
    uint64_t key; /* level, then cell coordinates */
    uint32_t record;
};

struct pairs {
    struct pair *items;
    size_t count, capacity;
};

struct kl_octree_root kl_octree_root_make(const float center[3], float radius)
{
    struct kl_octree_root root;
    root.side = exp2f(ceilf(log2f(2.05f * radius)));
    for (int k = 0; k < 3; ++k) {
        root.min[k] = center[k] - 0.5f * root.side;
    }
    return root;
}

/* Cells of level l have edges in [r, 2 r) / sqrt(2): measured best between references (14 a record)
 * and candidates. */
static uint32_t level_of(float side, float r)
{
    const float l = floorf(log2f(side / r) + 0.5f);
    return (uint32_t)kl_clamp(l, 0.0f, (float)KL_OCTREE_MAX_LEVEL);
}

/* Kind (level and face) above cell coordinates; cells just outside the root are at -2 at most. */
enum { KEY_BITS = 18, KEY_BIAS = 4 };

static uint64_t key_make(uint32_t kind, const int32_t cell[3])
{
    uint64_t key = kind;
    for (int k = 2; k >= 0; --k) {
        key = key << KEY_BITS | (uint64_t)(cell[k] + KEY_BIAS);
    }
    return key;
}

static uint32_t key_split(uint64_t key, int32_t cell[3])
{
    for (int k = 0; k < 3; ++k) {
        cell[k] = (int32_t)(key & ((1u << KEY_BITS) - 1)) - KEY_BIAS;
        key >>= KEY_BITS;
    }
    return (uint32_t)key;
}

/* Faces that normals within the cone about n may point to: bit set. Superset, exact on the axes. */
static uint32_t faces_of(kl_vec3 n, float cos_max)
{
    const float v[3] = {n.x, n.y, n.z};
    const float least = -sqrtf(2.0f * fmaxf(0.0f, 1.0f - cos_max * cos_max)) - 1e-4f;
    uint32_t faces = 0;
    for (uint32_t f = 0; f < 6; ++f) {
        const uint32_t axis = f / 2;
        const float along = f % 2 ? -v[axis] : v[axis];
        const float b = fabsf(v[(axis + 1) % 3]);
        const float c = fabsf(v[(axis + 2) % 3]);
        if (along - b >= least && along - c >= least) faces |= 1u << f;
    }
    return faces;
}

/* Does a cell touch the part of the record's sphere that the slab test of kl_record_weight lets
 * through? */
static bool touches(const kl_record_hot *r, kl_vec3 n, float reach, kl_vec3 lo, float edge)
{
    const float half = 0.5f * edge;
    const kl_vec3 center = kl_v3(lo.x + half, lo.y + half, lo.z + half);
    const kl_vec3 d = kl_v3_sub(center, kl_v3_load(r->pos));
    const float slack = 1.0001f * half;
    const float dx = kl_fmax(0.0f, fabsf(d.x) - slack);
    const float dy = kl_fmax(0.0f, fabsf(d.y) - slack);
    const float dz = kl_fmax(0.0f, fabsf(d.z) - slack);
    const float r2 = reach * r->radius2;
    if (dx * dx + dy * dy + dz * dz > r2 * r2) return false;
    const float thick = KL_SLAB * reach * r->radius * 1.0001f;
    return fabsf(kl_dot(d, n)) <= thick + slack * (fabsf(n.x) + fabsf(n.y) + fabsf(n.z));
}

static kl_status add_pairs(struct pairs *pairs, uint32_t level, uint32_t faces,
                           const int32_t cell[3], uint32_t number, struct kl_err *err)
{
    for (uint32_t f = 0; f < 6; ++f) {
        if (!((faces >> f) & 1u)) continue;
        kl_status st = kl_grow_array(&pairs->items, &pairs->capacity, pairs->count + 1,
                                     sizeof *pairs->items, err);
        if (st != KL_OK) return st;
        pairs->items[pairs->count++] = (struct pair){key_make(8 * level + f, cell), number};
    }
    return KL_OK;
}

static kl_status add_record(const struct kl_octree_root *root, const kl_record_hot *r,
                            uint32_t number, const struct kl_octree_limits *limits,
                            struct pairs *pairs, struct kl_err *err)
{
    const float radius = limits->reach * r->radius2;
    const uint32_t level = level_of(root->side, radius);
    const float edge = root->side / (float)(1u << level);
    const kl_vec3 n = kl_oct_decode(r->normal);
    const uint32_t faces = faces_of(n, limits->cos_max);
    const float limit = (float)((1u << level) + 2);
    int32_t lo[3];
    int32_t hi[3];
    int32_t c[3];

    for (int k = 0; k < 3; ++k) {
        const float rel = r->pos[k] - root->min[k];
        lo[k] = (int32_t)floorf(kl_clamp((rel - radius) / edge, -2.0f, limit));
        hi[k] = (int32_t)floorf(kl_clamp((rel + radius) / edge, -2.0f, limit));
    }
    for (c[2] = lo[2]; c[2] <= hi[2]; ++c[2]) {
        for (c[1] = lo[1]; c[1] <= hi[1]; ++c[1]) {
            for (c[0] = lo[0]; c[0] <= hi[0]; ++c[0]) {
                const kl_vec3 corner =
                    kl_v3(root->min[0] + (float)c[0] * edge, root->min[1] + (float)c[1] * edge,
                          root->min[2] + (float)c[2] * edge);
                if (!touches(r, n, limits->reach, corner, edge)) continue;
                kl_status st = add_pairs(pairs, level, faces, c, number, err);
                if (st != KL_OK) return st;
            }
        }
    }
    return KL_OK;
}

/* Stable byte-wise radix sort by key. */
static kl_status sort_pairs(struct pairs *pairs, struct kl_err *err)
{
    struct pair *from = pairs->items;
    struct pair *other = NULL;
    kl_status st = kl_alloc_array(&other, pairs->count, sizeof *other, err);
    if (st != KL_OK) return st;
    struct pair *to = other;
    for (int shift = 0; shift < 64; shift += 8) {
        size_t start[257] = {0};
        for (size_t i = 0; i < pairs->count; ++i) {
            ++start[((from[i].key >> shift) & 255u) + 1];
        }
        if (pairs->count > 0 && start[((from[0].key >> shift) & 255u) + 1] == pairs->count)
            continue;
        for (int k = 0; k < 256; ++k) {
            start[k + 1] += start[k];
        }
        for (size_t i = 0; i < pairs->count; ++i) {
            to[start[(from[i].key >> shift) & 255u]++] = from[i];
        }
        struct pair *swap = from;
        from = to;
        to = swap;
    }
    if (from != pairs->items) {
        memcpy(pairs->items, from, pairs->count * sizeof *from);
    }
    free(other);
    return KL_OK;
}

/* Directory cells that cell `c` of `level` lies in or holds, clamped to the root as queries are. */
static void mark_directory(struct kl_octree *o, uint32_t level, const int32_t c[3])
{
    const float ratio = exp2f((float)KL_DIRECTORY_BITS - (float)level);
    const float last = (float)((1 << KL_DIRECTORY_BITS) - 1);
    uint32_t lo[3];
    uint32_t hi[3];
    for (int k = 0; k < 3; ++k) {
        lo[k] = (uint32_t)kl_clamp(floorf((float)c[k] * ratio), 0.0f, last);
        hi[k] = (uint32_t)kl_clamp(ceilf((float)(c[k] + 1) * ratio) - 1.0f, 0.0f, last);
    }
    for (uint32_t z = lo[2]; z <= hi[2]; ++z) {
        for (uint32_t y = lo[1]; y <= hi[1]; ++y) {
            for (uint32_t x = lo[0]; x <= hi[0]; ++x) {
                o->rows[(z << (2 * KL_DIRECTORY_BITS)) | (y << KL_DIRECTORY_BITS) | x] |= 1u
                                                                                          << level;
            }
        }
    }
}

/* Enter a row under its cell; false if another cell looks exactly like it under this salt. */
static bool enter_slot(struct kl_octree *o, uint64_t key, uint32_t row)
{
    const uint32_t mask = o->head.slot_count - 1;
    int32_t c[3];
    const uint32_t kind = key_split(key, c);
    const uint32_t tag = kl_cell_tag(kind, c[0], c[1], c[2], o->head.salt);
    uint32_t i = tag & mask;
    o->rows[row] = kl_cell_check(kind, c[0], c[1], c[2]);
    mark_directory(o, kind / 8, c);
    while (o->slots[i].tag != 0) {
        if (o->slots[i].tag == tag && o->rows[o->slots[i].row] == o->rows[row]) return false;
        i = (i + 1) & mask;
    }
    o->slots[i] = (kl_octree_slot){tag, row};
    return true;
}

static bool fill_tables(struct kl_octree *o, const struct pairs *pairs)
{
    uint32_t row = KL_DIRECTORY_SIZE;
    memset(o->slots, 0, (size_t)o->head.slot_count * sizeof *o->slots);
    for (size_t i = 0; i < pairs->count;) {
        const uint64_t key = pairs->items[i].key;
        uint32_t count = 0;
        for (; i < pairs->count && pairs->items[i].key == key; ++i) {
            o->rows[row + 2 + count++] = pairs->items[i].record;
        }
        o->rows[row + 1] = count;
        if (!enter_slot(o, key, row)) return false;
        row += 2 + count;
    }
    return true;
}

kl_status kl_octree_build(const struct kl_octree_root *root, const kl_record_hot *hot,
                          uint32_t count, const struct kl_octree_limits *limits,
                          struct kl_octree *out, struct kl_err *err)
{
    struct pairs pairs = {0};
    struct kl_octree o = {.head = {.side = root->side,
                                   .record_count = count,
                                   .reach = limits->reach,
                                   .cos_max = limits->cos_max}};
    size_t cells = 0;
    kl_status st = KL_OK;

    memcpy(o.head.root_min, root->min, sizeof o.head.root_min);
    for (uint32_t i = 0; st == KL_OK && i < count; ++i) {
        st = add_record(root, &hot[i], i, limits, &pairs, err);
        o.head.level_mask |= 1u << level_of(root->side, limits->reach * hot[i].radius2);
    }
    if (st == KL_OK) st = sort_pairs(&pairs, err);
    if (st != KL_OK) goto cleanup;
    for (size_t i = 0; i < pairs.count; ++i) {
        cells += i == 0 || pairs.items[i].key != pairs.items[i - 1].key;
    }
    if (pairs.count + 2 * cells >= UINT32_MAX - KL_DIRECTORY_SIZE || cells >= UINT32_MAX / 4) {
        st = kl_fail(err, KL_ERR_NO_MEMORY, "index of %u records: more than 2^32 entries", count);
        goto cleanup;
    }
    o.head.row_size = (uint32_t)(KL_DIRECTORY_SIZE + pairs.count + 2 * cells);
    o.head.slot_count = 16;
    while (o.head.slot_count < 2 * cells) {
        o.head.slot_count *= 2;
    }
    st = kl_alloc_array(&o.slots, o.head.slot_count, sizeof *o.slots, err);
    if (st == KL_OK) st = kl_alloc_array(&o.rows, o.head.row_size, sizeof *o.rows, err);
    if (st != KL_OK) goto cleanup;
    while (!fill_tables(&o, &pairs)) {
        ++o.head.salt;
    }
    *out = o;
    o = (struct kl_octree){0};

cleanup:
    kl_octree_fini(&o);
    free(pairs.items);
    return st;
}

void kl_octree_fini(struct kl_octree *octree)
{
    free(octree->slots);
    free(octree->rows);
    *octree = (struct kl_octree){0};
}
