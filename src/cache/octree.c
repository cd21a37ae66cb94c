#include "src/cache/octree.h"

#include "kernels/cache_query.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A cell is divided as long as rows get shorter at a fair price: the logarithm of how much shorter
 * a row gets, over that of how many more items all rows have. Measured: lower values buy little
 * time for much memory (docs/decisions/0015). */
static const float least_gain = 1.25f;
static const float free_gain = 100.0f;       /* rows get hardly more items */
static const float least_forced_gain = 0.2f; /* of rows that are longer than KL_ROW_MAX */
/* What the rows may take, in items a record, before no more cells are divided for time's sake, and
 * before none are divided to keep rows whole. */
enum { SHORT_ROW = 10, ITEMS_EACH = 16, ITEMS_FORCED = 64, ITEMS_FREE = 4096 };

/* What of a record the index is about. */
struct disc {
    kl_vec3 pos, normal;
    float lo[3], hi[3]; /* of the slab of the ellipsoid in which the weight is not 0 */
    float reach, thick; /* [m] radius about pos, half height above the plane */
    float radius;
    uint32_t faces;
};

struct cell {
    uint32_t level, at[3];
};

struct builder {
    const struct kl_octree_root *root;
    struct disc *discs;
    uint32_t count;
    struct kl_octree *out;
    size_t node_count, node_capacity, row_count, row_capacity;
    /* A stack of lists: the records of the cells on the way down, and the children they touch. */
    uint32_t *items;
    uint8_t *masks;
    size_t item_capacity, mask_capacity;
};

struct list {
    size_t first, count; /* in items and masks */
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

/* Faces that normals within the cone about n may point to: bit set. Superset, exact on the axes. */
static uint32_t faces_of(kl_vec3 n, float cos_max)
{
    const float v[3] = {n.x, n.y, n.z};
    const float least = -sqrtf(2.0f * kl_fmax(0.0f, 1.0f - cos_max * cos_max)) - 1e-4f;
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

/* What counts as far beyond the root: squares of it are still finite. */
static float far_away(const struct kl_octree_root *root)
{
    return 1e6f * root->side;
}

static struct disc disc_of(const struct kl_octree_root *root, const kl_record_hot *r,
                           const struct kl_octree_limits *limits)
{
    const float most = far_away(root);
    const kl_vec3 n = kl_oct_decode(r->normal);
    const kl_frame f = kl_frame_from_normal(n);
    const kl_vec2 axis = kl_record_axis(r->form);
    const kl_vec3 minor = kl_v3_mad(kl_v3_scale(f.t, axis.x), axis.y, f.b);
    const kl_vec3 major = kl_v3_mad(kl_v3_scale(f.b, axis.x), -axis.y, f.t);
    const float r1 = kl_fmin(1.0001f * limits->reach * r->radius, most);
    const float r2 = kl_fmin(1.0001f * limits->reach * r->radius2, most);
    const float up[3] = {n.x, n.y, n.z};
    const float across[3] = {minor.x, minor.y, minor.z};
    const float along[3] = {major.x, major.y, major.z};
    struct disc d = {.pos = kl_v3_load(r->pos),
                     .normal = n,
                     .reach = r2,
                     .thick = KL_SLAB * r1,
                     .radius = r->radius,
                     .faces = faces_of(n, limits->cos_max)};
    for (int k = 0; k < 3; ++k) {
        const float flat = hypotf(r2 * along[k], r1 * across[k]);
        const float extent = kl_fmin(hypotf(flat, r1 * up[k]), flat + d.thick * fabsf(up[k]));
        d.lo[k] = r->pos[k] - extent;
        d.hi[k] = r->pos[k] + extent;
    }
    return d;
}

/* Interval of a cell along an axis, with room for rounding; at the root's rim it goes on outwards,
 * as queries do. */
static void cell_interval(const struct kl_octree_root *root, uint32_t level, uint32_t at, int axis,
                          float *lo, float *hi)
{
    const float edge = ldexpf(root->side, -(int)level);
    const float slack = 1e-6f * root->side; /* an eighth of the smallest cell */
    const float start = root->min[axis] + (float)at * edge;
    *lo = at == 0 ? start - far_away(root) : start - slack;
    *hi = at + 1 == 1u << level ? start + far_away(root) : start + edge + slack;
}

/* The halves of a cell along each axis. */
struct halves {
    float lo[2][3], hi[2][3];
};

static struct halves halve(const struct kl_octree_root *root, const struct cell *cell)
{
    struct halves h;
    for (int k = 0; k < 3; ++k) {
        for (uint32_t s = 0; s < 2; ++s)
            cell_interval(root, cell->level + 1, 2 * cell->at[k] + s, k, &h.lo[s][k], &h.hi[s][k]);
    }
    return h;
}

/* Bit set of the octants that a disc touches. All eight at once, without branches. */
static uint32_t octants_of(const struct halves *h, const struct disc *d)
{
    const float pos[3] = {d->pos.x, d->pos.y, d->pos.z};
    const float n[3] = {d->normal.x, d->normal.y, d->normal.z};
    uint32_t bits[8];
    uint32_t mask = 0;
    KL_SIMD
    for (uint32_t o = 0; o < 8; ++o) {
        float distance2 = 0.0f;
        float height = 0.0f;
        float span = d->thick;
        int meets = 1;
        for (uint32_t k = 0; k < 3; ++k) {
            const float a = kl_fmax(o >> k & 1u ? h->lo[1][k] : h->lo[0][k], d->lo[k]);
            const float b = kl_fmin(o >> k & 1u ? h->hi[1][k] : h->hi[0][k], d->hi[k]);
            const float out = kl_fmax(0.0f, kl_fmax(a - pos[k], pos[k] - b));
            distance2 += out * out;
            height += n[k] * (0.5f * (a + b) - pos[k]);
            span += fabsf(n[k]) * 0.5f * (b - a);
            meets &= a <= b;
        }
        meets &= (distance2 <= d->reach * d->reach) & (fabsf(height) <= 1.0001f * span);
        bits[o] = (uint32_t)meets << o;
    }
    for (uint32_t o = 0; o < 8; ++o) {
        mask |= bits[o];
    }
    return mask;
}

/* What a division into up to eight lists is worth. */
struct division {
    uint32_t sizes[8];
};

static void count_mask(struct division *d, uint32_t mask)
{
    for (uint32_t k = 0; k < 8; ++k) {
        d->sizes[k] += mask >> k & 1u;
    }
}

/* Logarithm of the old row's length over the new ones', over that of the growth of all rows. */
static float gain_of(const struct division *d, size_t count)
{
    double sum = 0.0;
    double squares = 0.0;
    for (int k = 0; k < 8; ++k) {
        sum += d->sizes[k];
        squares += (double)d->sizes[k] * d->sizes[k];
    }
    const double shorter = log((double)count * sum / squares);
    const double growth = log(sum / (double)count);
    return growth > 1e-3 * shorter ? (float)(shorter / growth) : 1e3f;
}

static kl_status push_list(struct builder *b, const struct list *list, uint32_t child,
                           struct list *out, struct kl_err *err)
{
    const size_t end = list->first + list->count;
    kl_status st =
        kl_grow_array(&b->items, &b->item_capacity, end + list->count, sizeof *b->items, err);
    if (st == KL_OK) {
        st = kl_grow_array(&b->masks, &b->mask_capacity, end + list->count, 1, err);
    }
    if (st != KL_OK) return st;
    *out = (struct list){end, 0};
    for (size_t i = list->first; i < end; ++i) {
        if (b->masks[i] >> child & 1u) b->items[end + out->count++] = b->items[i];
    }
    return KL_OK;
}

static int compare_discs(const struct disc *discs, uint32_t a, uint32_t b)
{
    const float x = discs[a].radius;
    const float y = discs[b].radius;
    if (x != y) return x < y ? -1 : 1;
    return (a > b) - (a < b);
}

/* Insertion sort of short rows, by radius and number: the finest first. */
static void sort_row(const struct disc *discs, uint32_t *row, size_t count)
{
    for (size_t i = 1; i < count; ++i) {
        const uint32_t item = row[i];
        size_t k = i;
        for (; k > 0 && compare_discs(discs, item, row[k - 1]) < 0; --k) {
            row[k] = row[k - 1];
        }
        row[k] = item;
    }
}

/* How far a record's middle lies from a box, over its reach: what weighs most in the box first. */
static float remoteness(const struct disc *d, const float lo[3], const float hi[3])
{
    const float pos[3] = {d->pos.x, d->pos.y, d->pos.z};
    float distance2 = 0.0f;
    for (int k = 0; k < 3; ++k) {
        const float out = kl_fmax(0.0f, kl_fmax(lo[k] - pos[k], pos[k] - hi[k]));
        distance2 += out * out;
    }
    return sqrtf(distance2) / d->reach;
}

struct choice {
    float remoteness;
    uint32_t item;
};

/* Of records that lie in the box, those that reach farthest come first. */
static bool is_before(const struct disc *discs, const struct choice *a, const struct choice *b)
{
    if (a->remoteness != b->remoteness) return a->remoteness < b->remoteness;
    return compare_discs(discs, a->item, b->item) > 0;
}

/* The KL_ROW_MAX that serve a cell best, to the front: every record in its own cell, unless more
 * lie there. Time: linear for what is in one place. */
static void choose_best(const struct builder *b, const struct cell *cell, uint32_t *items,
                        size_t count)
{
    struct choice best[KL_ROW_MAX];
    size_t n = 0;
    float lo[3];
    float hi[3];
    for (int k = 0; k < 3; ++k) {
        cell_interval(b->root, cell->level, cell->at[k], k, &lo[k], &hi[k]);
    }
    for (size_t i = 0; i < count; ++i) {
        const struct choice c = {remoteness(&b->discs[items[i]], lo, hi), items[i]};
        if (n == KL_ROW_MAX && !is_before(b->discs, &c, &best[n - 1])) continue;
        size_t k = n < KL_ROW_MAX ? n++ : n - 1;
        for (; k > 0 && is_before(b->discs, &c, &best[k - 1]); --k) {
            best[k] = best[k - 1];
        }
        best[k] = c;
    }
    for (size_t i = 0; i < n; ++i) {
        items[i] = best[i].item;
    }
}

static kl_status make_leaf(struct builder *b, const struct cell *cell, const struct list *list,
                           uint32_t *entry, struct kl_err *err)
{
    uint32_t *items = b->items + list->first;
    const size_t count = list->count < KL_ROW_MAX ? list->count : KL_ROW_MAX;
    if (count == 0) {
        *entry = KL_NODE_EMPTY;
        return KL_OK;
    }
    if (list->count > KL_ROW_MAX) choose_best(b, cell, items, list->count);
    sort_row(b->discs, items, count);
    kl_status st = kl_grow_array(&b->out->rows, &b->row_capacity, b->row_count + count,
                                 sizeof *b->out->rows, err);
    if (st != KL_OK) return st;
    if (b->row_count + count > KL_NODE_INDEX) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "index of %u records: too many entries", b->count);
    }
    memcpy(b->out->rows + b->row_count, items, count * sizeof *items);
    *entry = KL_NODE_LEAF | (uint32_t)b->row_count;
    b->row_count += count;
    b->out->rows[b->row_count - 1] |= KL_ROW_LAST;
    return KL_OK;
}

static kl_status add_group(struct builder *b, uint32_t *first, struct kl_err *err)
{
    kl_status st = kl_grow_array(&b->out->nodes, &b->node_capacity, b->node_count + 8,
                                 sizeof *b->out->nodes, err);
    if (st != KL_OK) return st;
    if (b->node_count + 8 > KL_NODE_INDEX) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "index of %u records: too many nodes", b->count);
    }
    *first = (uint32_t)b->node_count;
    memset(b->out->nodes + b->node_count, 0, 8 * sizeof *b->out->nodes);
    b->node_count += 8;
    return KL_OK;
}

enum division_kind { NOT_AT_ALL = 0, BY_OCTANTS = 1, BY_FACES = 2 };

/* How a cell is divided, b->masks set accordingly. `allowed`: kinds, or-ed. */
static uint32_t choose_division(struct builder *b, const struct cell *cell, const struct list *list,
                                uint32_t allowed)
{
    struct division octants = {0};
    struct division faces = {0};
    if (list->count <= SHORT_ROW) return NOT_AT_ALL;
    const struct halves halves = halve(b->root, cell);
    for (size_t i = list->first; i < list->first + list->count; ++i) {
        const struct disc *d = &b->discs[b->items[i]];
        if (allowed & BY_OCTANTS) {
            b->masks[i] = (uint8_t)octants_of(&halves, d);
            count_mask(&octants, b->masks[i]);
        }
        count_mask(&faces, d->faces);
    }
    const float by_octants = allowed & BY_OCTANTS ? gain_of(&octants, list->count) : 0.0f;
    const float by_faces = allowed & BY_FACES ? gain_of(&faces, list->count) : 0.0f;
    const bool is_long = list->count > KL_ROW_MAX;
    const size_t most = (size_t)(is_long ? ITEMS_FORCED : ITEMS_EACH) * b->count + ITEMS_FREE;
    const float least = is_long ? least_forced_gain : least_gain;
    if (kl_fmax(by_octants, by_faces) < (b->row_count < most ? least : free_gain)) {
        return NOT_AT_ALL;
    }
    if (by_octants >= by_faces) return BY_OCTANTS;
    for (size_t i = list->first; i < list->first + list->count; ++i) {
        b->masks[i] = (uint8_t)b->discs[b->items[i]].faces;
    }
    return BY_FACES;
}

static struct cell child_of(const struct cell *cell, uint32_t octant)
{
    return (struct cell){cell->level + 1,
                         {2 * cell->at[0] + (octant & 1u), 2 * cell->at[1] + (octant >> 1 & 1u),
                          2 * cell->at[2] + (octant >> 2)}};
}

/* The entry of a cell, divided in no other than the allowed ways. */
static kl_status build_cell(struct builder *b, const struct cell *cell, const struct list *list,
                            uint32_t allowed, uint32_t *entry, struct kl_err *err)
{
    if (cell->level == KL_OCTREE_MAX_LEVEL) allowed &= BY_FACES;
    const uint32_t how = choose_division(b, cell, list, allowed);
    uint32_t first = 0;
    if (how == NOT_AT_ALL) return make_leaf(b, cell, list, entry, err);
    if (how == BY_FACES) allowed &= BY_OCTANTS;
    kl_status st = add_group(b, &first, err);
    for (uint32_t k = 0; st == KL_OK && k < 8; ++k) {
        const struct cell child = how == BY_FACES ? *cell : child_of(cell, k);
        struct list below;
        uint32_t made = 0;
        st = push_list(b, list, k, &below, err);
        if (st == KL_OK) st = build_cell(b, &child, &below, allowed, &made, err);
        if (st == KL_OK) b->out->nodes[first + k] = made;
    }
    *entry = how == BY_FACES ? KL_NODE_FACES | first : first;
    return st;
}

/* All cells of the top grid in a cell above it. */
static void fill_top(struct builder *b, const struct cell *cell, uint32_t entry)
{
    const uint32_t bits = b->out->head.top_bits;
    const uint32_t up = bits - cell->level;
    for (uint32_t i = 0; i < 1u << 3 * up; ++i) {
        const uint32_t low = (1u << up) - 1;
        const uint32_t x = (cell->at[0] << up) + (i & low);
        const uint32_t y = (cell->at[1] << up) + (i >> up & low);
        const uint32_t z = (cell->at[2] << up) + (i >> 2 * up);
        b->out->nodes[(z << bits | y) << bits | x] = entry;
    }
}

/* A cell of the top grid or above. Queries come from the grid, so above it a cell that is not
 * divided by octants never is. */
static kl_status build_top(struct builder *b, const struct cell *cell, const struct list *list,
                           struct kl_err *err)
{
    uint32_t entry = 0;
    kl_status st = KL_OK;
    const bool in_grid = cell->level == b->out->head.top_bits;
    if (in_grid || choose_division(b, cell, list, BY_OCTANTS) == NOT_AT_ALL) {
        st = build_cell(b, cell, list, in_grid ? BY_FACES | BY_OCTANTS : BY_FACES, &entry, err);
        if (st == KL_OK) fill_top(b, cell, entry);
        return st;
    }
    for (uint32_t k = 0; st == KL_OK && k < 8; ++k) {
        const struct cell child = child_of(cell, k);
        struct list below;
        st = push_list(b, list, k, &below, err);
        if (st == KL_OK) st = build_top(b, &child, &below, err);
    }
    return st;
}

/* The largest grid of no more cells than records. */
static uint32_t top_bits_for(uint32_t count)
{
    uint32_t bits = 0;
    while (bits < KL_TOP_BITS_MAX && 8u << 3 * bits <= count) {
        ++bits;
    }
    return bits;
}

static kl_status build(struct builder *b, const kl_record_hot *hot,
                       const struct kl_octree_limits *limits, struct kl_err *err)
{
    const struct cell root = {0, {0, 0, 0}};
    const struct list all = {0, b->count};
    kl_status st = kl_alloc_array(&b->discs, b->count, sizeof *b->discs, err);
    b->node_count = (size_t)1 << 3 * b->out->head.top_bits;
    if (st == KL_OK) {
        st = kl_grow_array(&b->out->nodes, &b->node_capacity, b->node_count, sizeof *b->out->nodes,
                           err);
    }
    if (st == KL_OK) {
        st = kl_grow_array(&b->items, &b->item_capacity, b->count, sizeof *b->items, err);
    }
    if (st == KL_OK) st = kl_grow_array(&b->masks, &b->mask_capacity, b->count, 1, err);
    if (st != KL_OK) return st;
    memset(b->out->nodes, 0, b->node_count * sizeof *b->out->nodes);
#pragma omp parallel for schedule(static, 1024)
    for (uint32_t i = 0; i < b->count; ++i) {
        b->discs[i] = disc_of(b->root, &hot[i], limits);
        b->items[i] = i;
    }
    return build_top(b, &root, &all, err);
}

kl_status kl_octree_build(const struct kl_octree_root *root, const kl_record_hot *hot,
                          uint32_t count, const struct kl_octree_limits *limits,
                          struct kl_octree *out, struct kl_err *err)
{
    struct kl_octree o = {.head = {.side = root->side,
                                   .top_bits = top_bits_for(count),
                                   .record_count = count,
                                   .reach = limits->reach,
                                   .cos_max = limits->cos_max}};
    struct builder b = {.root = root, .count = count, .out = &o};
    memcpy(o.head.root_min, root->min, sizeof o.head.root_min);
    kl_status st = build(&b, hot, limits, err);
    o.head.node_count = (kl_u32)b.node_count;
    o.head.row_size = (kl_u32)b.row_count;
    free(b.discs);
    free(b.items);
    free(b.masks);
    if (st == KL_OK) {
        *out = o;
        return KL_OK;
    }
    kl_octree_fini(&o);
    return st;
}

void kl_octree_fini(struct kl_octree *octree)
{
    free(octree->nodes);
    free(octree->rows);
    *octree = (struct kl_octree){0};
}
