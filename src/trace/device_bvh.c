#include "src/trace/device_bvh.h"

#include "src/base/memory.h"
#include "src/trace/embree_error.h"
#include "src/trace/ranges.h"

#include <embree3/rtcore.h>
#include <float.h>
#include <stdlib.h>

/* What the builder makes: a tree of pointers in the builder's own memory. A node with
 * child_count 0 is a leaf. */
struct build_node {
    uint32_t child_count, primitive_count;
    struct build_node *child[KL_BVH_WIDTH];
    struct RTCBounds bounds[KL_BVH_WIDTH];
    uint32_t primitives[]; /* of a leaf: triangles or instances */
};

enum {
    MAX_PACKS = 4,        /* a leaf's packs fit kl_bvh_node.child's two bits */
    DEPTH_FIRST_TRY = 32, /* levels; deep enough for the builder to split where it is best */
    STACK_INSTANCES = 64, /* of KL_BVH_STACK, when there are two levels of trees */
};

struct builder {
    const struct kl_flat *flat;
    const struct kl_motion *motion; /* NULL: nothing moves */
    const kl_instance *instances;
    uint32_t instance_count;
    struct kl_device_bvh *bvh;
    size_t node_capacity, leaf_capacity;
    bool of_instances; /* which of the two kinds of tree is being built */
    struct kl_embree_error report;
    RTCDevice device;
    struct RTCBuildPrimitive *primitives;
    size_t primitive_capacity;
};

static void *create_node(RTCThreadLocalAllocator allocator, unsigned int count, void *user)
{
    struct build_node *node = rtcThreadLocalAlloc(allocator, sizeof *node, 16);

    (void)user;
    *node = (struct build_node){.child_count = count};
    return node;
}

static void set_children(void *pointer, void **children, unsigned int count, void *user)
{
    struct build_node *node = pointer;

    (void)user;
    for (unsigned int i = 0; i < count; ++i) {
        node->child[i] = children[i];
    }
}

static void set_bounds(void *pointer, const struct RTCBounds **bounds, unsigned int count,
                       void *user)
{
    struct build_node *node = pointer;

    (void)user;
    for (unsigned int i = 0; i < count; ++i) {
        node->bounds[i] = *bounds[i];
    }
}

static void *create_leaf(RTCThreadLocalAllocator allocator,
                         const struct RTCBuildPrimitive *primitives, size_t count, void *user)
{
    struct build_node *leaf =
        rtcThreadLocalAlloc(allocator, sizeof *leaf + count * sizeof leaf->primitives[0], 16);

    (void)user;
    *leaf = (struct build_node){.primitive_count = (uint32_t)count};
    for (size_t i = 0; i < count; ++i) {
        leaf->primitives[i] = primitives[i].primID;
    }
    return leaf;
}

static void triangle_vertices(const struct kl_flat *flat, uint32_t triangle, float v[3][3])
{
    for (int i = 0; i < 3; ++i) {
        const float *p = flat->positions + 3 * (size_t)flat->triangles[triangle].v[i];
        for (int k = 0; k < 3; ++k) {
            v[i][k] = p[k];
        }
    }
}

/* Is the triangle a part of something merged that moves? That has a tree of its own. */
static bool is_apart(const struct builder *b, uint32_t triangle)
{
    return b->motion != NULL && kl_motion_find(b->motion, triangle) != KL_NONE;
}

/* How an instance moves; NULL: it stands still. */
static const kl_moving *moving_of(const struct builder *b, uint32_t instance)
{
    if (b->motion == NULL || b->motion->moving[instance].steps == 0) return NULL;
    return &b->motion->moving[instance];
}

static void box_clear(float box[6])
{
    for (int k = 0; k < 3; ++k) {
        box[k] = FLT_MAX;
        box[3 + k] = -FLT_MAX;
    }
}

static void box_add(float box[6], const float p[3])
{
    for (int k = 0; k < 3; ++k) {
        if (p[k] < box[k]) box[k] = p[k];
        if (p[k] > box[3 + k]) box[3 + k] = p[k];
    }
}

static bool box_is_usable(const float box[6])
{
    for (int k = 0; k < 3; ++k) {
        if (!(box[k] <= box[3 + k] && box[k] >= -1e18f && box[3 + k] <= 1e18f)) return false;
    }
    return true;
}

static kl_status reserve_node(struct builder *b, uint32_t *index, struct kl_err *err)
{
    struct kl_device_bvh *bvh = b->bvh;
    kl_status st =
        kl_grow_array(&bvh->nodes, &b->node_capacity, bvh->node_count + 1, sizeof *bvh->nodes, err);

    if (st != KL_OK) return st;
    if (bvh->node_count >= KL_BVH_LEAF) {
        return kl_fail(err, KL_ERR_DEVICE, "too many nodes for a device");
    }
    *index = (uint32_t)bvh->node_count++;
    return KL_OK;
}

/* Appends the packs of a leaf of triangles; *out refers to them. */
static kl_status flatten_leaf(struct builder *b, const struct build_node *leaf, kl_u32 *out,
                              struct kl_err *err)
{
    struct kl_device_bvh *bvh = b->bvh;
    const size_t first = bvh->leaf_count;
    const uint32_t n = leaf->primitive_count;
    const uint32_t packs = (n + KL_BVH_PACK - 1) / KL_BVH_PACK;
    kl_status st =
        kl_grow_array(&bvh->leaves, &b->leaf_capacity, first + packs, sizeof *bvh->leaves, err);

    if (st != KL_OK) return st;
    if (packs < 1 || packs > MAX_PACKS || first + packs > KL_BVH_LEAF / 4) {
        return kl_fail(err, KL_ERR_DEVICE, "too many triangles for a device");
    }
    bvh->leaf_count += packs;
    for (uint32_t i = 0; i < packs * KL_BVH_PACK; ++i) {
        kl_bvh_leaf *pack = &bvh->leaves[first + i / KL_BVH_PACK];
        const uint32_t lane = i % KL_BVH_PACK;
        float v[3][3] = {{0}};
        if (i < n) triangle_vertices(b->flat, leaf->primitives[i], v);
        pack->triangle[lane] = i < n ? leaf->primitives[i] : KL_NONE;
        for (uint32_t k = 0; k < 9; ++k) {
            pack->v[k * KL_BVH_PACK + lane] = v[k / 3][k % 3];
        }
    }
    *out = KL_BVH_LEAF | (kl_u32)(first << 2) | (packs - 1);
    return KL_OK;
}

/* Enlarged by a few units in the last place: the triangle test accepts points that rounding moves
 * out of the triangle, and the map into object space rounds as well. */
static float padded(float x, float magnitude, float sign)
{
    return x + sign * (magnitude * 0x1p-21f + 1e-30f);
}

static void set_child_box(kl_bvh_node *node, uint32_t i, const struct RTCBounds *bounds)
{
    const float lower[3] = {bounds->lower_x, bounds->lower_y, bounds->lower_z};
    const float upper[3] = {bounds->upper_x, bounds->upper_y, bounds->upper_z};

    for (uint32_t k = 0; k < 3; ++k) {
        const float size = kl_fmax(fabsf(lower[k]), fabsf(upper[k]));
        node->bounds[2 * k * KL_BVH_WIDTH + i] = padded(lower[k], size, -1.0f);
        node->bounds[(2 * k + 1) * KL_BVH_WIDTH + i] = padded(upper[k], size, 1.0f);
    }
}

static void set_no_child(kl_bvh_node *node, uint32_t i)
{
    node->child[i] = KL_NONE;
    for (uint32_t k = 0; k < 3; ++k) {
        node->bounds[2 * k * KL_BVH_WIDTH + i] = KL_INF;
        node->bounds[(2 * k + 1) * KL_BVH_WIDTH + i] = -KL_INF;
    }
}

/* Appends a subtree; *out refers to its root, *need is the most stack entries its traversal leaves
 * waiting. Recursion is as deep as the tree: at most DEPTH_FIRST_TRY. */
static kl_status flatten(struct builder *b, const struct build_node *node, kl_u32 *out,
                         uint32_t *need, struct kl_err *err)
{
    uint32_t index = 0;

    *need = 0;
    if (node->child_count == 0 && !b->of_instances) return flatten_leaf(b, node, out, err);
    if (node->child_count == 0) {
        *out = KL_BVH_LEAF | node->primitives[0];
        return KL_OK;
    }
    kl_status st = reserve_node(b, &index, err);
    if (st != KL_OK) return st;
    uint32_t deepest = 0;
    for (uint32_t i = 0; i < KL_BVH_WIDTH; ++i) {
        kl_u32 child = KL_NONE;
        uint32_t below = 0;
        if (i >= node->child_count) {
            set_no_child(&b->bvh->nodes[index], i);
            continue;
        }
        st = flatten(b, node->child[i], &child, &below, err);
        if (st != KL_OK) return st;
        kl_bvh_node *flat = &b->bvh->nodes[index]; /* the array may have moved */
        flat->child[i] = child;
        set_child_box(flat, i, &node->bounds[i]);
        if (below > deepest) deepest = below;
    }
    *out = index;
    *need = node->child_count - 1 + (deepest > 1 ? deepest : 1);
    return KL_OK;
}

static struct RTCBuildArguments arguments(struct builder *b, RTCBVH embree, size_t count)
{
    struct RTCBuildArguments args = rtcDefaultBuildArguments();

    /* HIGH (spatial splits) takes ten times as long and did not speed rays up on meshes. */
    args.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
    args.maxBranchingFactor = KL_BVH_WIDTH;
    args.sahBlockSize = b->of_instances ? 1 : KL_BVH_PACK;
    args.minLeafSize = b->of_instances ? 1 : KL_BVH_PACK;
    args.maxLeafSize = b->of_instances ? 1 : 2 * KL_BVH_PACK;
    args.bvh = embree;
    args.primitives = b->primitives;
    args.primitiveCount = count;
    args.primitiveArrayCapacity = b->primitive_capacity;
    args.createNode = create_node;
    args.setNodeChildren = set_children;
    args.setNodeBounds = set_bounds;
    args.createLeaf = create_leaf;
    args.userPtr = b;
    return args;
}

/* Builds a tree of at most `depth` levels over b->primitives[0 .. count) and appends it. The
 * builder reorders the primitives. Near the limit it splits at the median, so any count fits. */
static kl_status build_once(struct builder *b, size_t count, unsigned int depth, kl_u32 *root,
                            uint32_t *need, struct kl_err *err)
{
    RTCBVH embree = rtcNewBVH(b->device);

    if (embree == NULL) return kl_embree_check(&b->report, "new tree", err);
    struct RTCBuildArguments args = arguments(b, embree, count);
    args.maxDepth = depth;
    const struct build_node *top = rtcBuildBVH(&args);
    kl_status st = kl_embree_check(&b->report, "build tree", err);
    if (st == KL_OK && top == NULL) st = kl_fail(err, KL_ERR_DEVICE, "Embree built no tree");
    if (st == KL_OK) st = flatten(b, top, root, need, err);
    rtcReleaseBVH(embree);
    return st;
}

static void set_primitive(struct builder *b, size_t at, uint32_t id, const float box[6])
{
    b->primitives[at] = (struct RTCBuildPrimitive){.lower_x = box[0],
                                                   .lower_y = box[1],
                                                   .lower_z = box[2],
                                                   .upper_x = box[3],
                                                   .upper_y = box[4],
                                                   .upper_z = box[5],
                                                   .primID = id};
}

/* The box of a triangle: at all its steps where it deforms. */
static void triangle_box(const struct builder *b, const kl_moving *deforms, uint32_t triangle,
                         float box[6])
{
    float v[3][3];
    box_clear(box);
    triangle_vertices(b->flat, triangle, v);
    for (int k = 0; k < 3 && deforms == NULL; ++k) {
        box_add(box, v[k]);
    }
    for (uint32_t step = 0; deforms != NULL && step < deforms->steps; ++step) {
        for (int k = 0; k < 3; ++k) {
            const uint32_t vertex = b->flat->triangles[triangle].v[k] - deforms->first_vertex;
            const size_t at = deforms->first + (size_t)step * deforms->vertex_count + vertex;
            box_add(box, b->motion->positions + 3 * at);
        }
    }
}

/* Fills b->primitives with the usable triangles of an instance; grows `whole` by their boxes. */
static kl_status list_triangles(struct builder *b, uint32_t instance, float whole[6], size_t *count,
                                struct kl_err *err)
{
    const uint32_t first = b->instances[instance].first_triangle;
    const uint32_t n = b->instances[instance].triangle_count;
    const kl_moving *moving = moving_of(b, instance);
    const kl_moving *deforms = moving != NULL && moving->deforms ? moving : NULL;
    kl_status st =
        kl_grow_array(&b->primitives, &b->primitive_capacity, n, sizeof *b->primitives, err);
    if (st != KL_OK) return st;
    *count = 0;
    for (uint32_t i = first; i < first + n; ++i) {
        float box[6];
        if (instance == 0 && is_apart(b, i)) continue;
        triangle_box(b, deforms, i, box);
        if (!box_is_usable(box)) continue;
        box_add(whole, box);
        box_add(whole, box + 3);
        set_primitive(b, (*count)++, i, box);
    }
    return KL_OK;
}

/* The tree of an instance's triangles; *root is KL_NONE where it has none. `whole`: its box. */
static kl_status build_triangles(struct builder *b, uint32_t instance, kl_u32 *root, float whole[6],
                                 struct kl_err *err)
{
    const bool two_levels = b->instance_count > 1;
    const uint32_t limit = (uint32_t)KL_BVH_STACK - (two_levels ? STACK_INSTANCES : 0u);
    const size_t old_nodes = b->bvh->node_count;
    const size_t old_leaves = b->bvh->leaf_count;
    uint32_t need = 0;
    size_t count = 0;

    box_clear(whole);
    *root = KL_NONE;
    b->of_instances = false;
    kl_status st = list_triangles(b, instance, whole, &count, err);
    if (st != KL_OK || count == 0) return st;
    st = build_once(b, count, DEPTH_FIRST_TRY, root, &need, err);
    if (st != KL_OK || need <= limit) return st;
    b->bvh->node_count = old_nodes;
    b->bvh->leaf_count = old_leaves;
    st = list_triangles(b, instance, whole, &count, err);
    if (st != KL_OK) return st;
    st = build_once(b, count, (limit - 1) / (KL_BVH_WIDTH - 1), root, &need, err);
    if (st == KL_OK && need > limit) {
        st = kl_fail(err, KL_ERR_DEVICE, "tree of triangles too deep: %u > %u", need, limit);
    }
    return st;
}

/* Grows a box in render space by the corners of one in object space. */
static void add_corners(const float matrix[12], const float object[6], float box[6])
{
    for (int corner = 0; corner < 8; ++corner) {
        const kl_vec3 p = kl_v3(object[corner & 1 ? 3 : 0], object[corner & 2 ? 4 : 1],
                                object[corner & 4 ? 5 : 2]);
        const kl_vec3 q = kl_affine_point(matrix, p);
        const float point[3] = {q.x, q.y, q.z};
        box_add(box, point);
    }
}

/* The box of an instance in render space, of its triangles' box: wherever it gets to. Between two
 * steps points go straight. */
static void instance_box(const struct builder *b, uint32_t instance, const float object[6],
                         float box[6])
{
    const kl_moving *m = moving_of(b, instance);
    box_clear(box);
    if (m == NULL || m->deforms) {
        add_corners(b->instances[instance].render_from_object, object, box);
    } else {
        for (uint32_t step = 0; step < m->steps; ++step) {
            add_corners(b->motion->matrices + 12 * (size_t)(m->first + step), object, box);
        }
    }
}

/* The tree over all instances that have triangles. `boxes`: of each one, object space. */
static kl_status build_instances(struct builder *b, float (*boxes)[6], kl_u32 *root,
                                 struct kl_err *err)
{
    uint32_t need = 0;
    size_t count = 0;
    kl_status st = kl_grow_array(&b->primitives, &b->primitive_capacity, b->instance_count,
                                 sizeof *b->primitives, err);

    if (st != KL_OK) return st;
    for (int attempt = 0; attempt < 2; ++attempt) {
        const size_t old_nodes = b->bvh->node_count;
        count = 0;
        for (uint32_t i = 0; i < b->instance_count; ++i) {
            float box[6];
            if (b->bvh->roots[i] == KL_NONE) continue;
            instance_box(b, i, boxes[i], box);
            if (box_is_usable(box)) set_primitive(b, count++, i, box);
        }
        if (count == 0) return KL_OK;
        b->of_instances = true;
        st = build_once(b, count, attempt == 0 ? DEPTH_FIRST_TRY : (STACK_INSTANCES - 1) / 7, root,
                        &need, err);
        if (st != KL_OK || need <= STACK_INSTANCES) return st;
        b->bvh->node_count = old_nodes;
    }
    return kl_fail(err, KL_ERR_DEVICE, "tree of instances too deep: %u > %d", need,
                   STACK_INSTANCES);
}

static kl_status build_all(struct builder *b, float (*boxes)[6], struct kl_err *err)
{
    const struct kl_flat *flat = b->flat;
    kl_u32 *roots = b->bvh->roots;
    struct kl_range *ranges = NULL;
    size_t count = 0;
    kl_status st = KL_OK;

    for (uint32_t i = 0; i <= b->instance_count; ++i) {
        roots[i] = KL_NONE;
    }
    if (flat->instance_count == 0) return KL_OK;
    st = build_triangles(b, 0, &roots[0], boxes[0], err);
    for (uint32_t i = flat->instance_count; st == KL_OK && i < b->instance_count; ++i) {
        st = build_triangles(b, i, &roots[i], boxes[i], err);
    }
    if (st == KL_OK) st = kl_ranges_sorted(flat, &ranges, &count, err);
    for (size_t i = 0, end = 0; st == KL_OK && i < count; i = end) {
        const uint32_t leader = ranges[i].instance;
        end = kl_ranges_run_end(ranges, count, i);
        st = build_triangles(b, leader, &roots[leader], boxes[leader], err);
        for (size_t k = i + 1; k < end; ++k) {
            roots[ranges[k].instance] = roots[leader];
            memcpy(boxes[ranges[k].instance], boxes[leader], sizeof boxes[leader]);
        }
    }
    free(ranges);
    if (st == KL_OK) st = build_instances(b, boxes, &roots[b->instance_count], err);
    return st;
}

kl_status kl_device_bvh_create(struct kl_flat *flat, struct kl_motion *motion,
                               struct kl_device_bvh **out, struct kl_err *err)
{
    kl_scene_view *view = motion != NULL ? &motion->view : &flat->view;
    struct builder b = {.flat = flat,
                        .motion = motion,
                        .instances = motion != NULL ? motion->instances : flat->instances,
                        .instance_count = view->instance_count};
    float(*boxes)[6] = NULL;
    kl_status st = kl_alloc_array(&b.bvh, 1, sizeof *b.bvh, err);

    if (st != KL_OK) return st;
    b.bvh->root_count = (size_t)b.instance_count + 1;
    st = kl_alloc_array(&b.bvh->roots, b.bvh->root_count, sizeof *b.bvh->roots, err);
    if (st == KL_OK) st = kl_alloc_array(&boxes, b.bvh->root_count, sizeof *boxes, err);
    if (st == KL_OK) st = kl_embree_open(&b.report, &b.device, err);
    if (st == KL_OK) st = build_all(&b, boxes, err);
    if (b.device != NULL) rtcReleaseDevice(b.device);
    free(b.primitives);
    free(boxes);
    if (st != KL_OK) {
        kl_device_bvh_destroy(b.bvh);
        return kl_wrap(err, "device ray tracer, %u triangles", flat->triangle_count);
    }
    view->bvh_nodes = b.bvh->nodes;
    view->bvh_leaves = b.bvh->leaves;
    view->bvh_roots = b.bvh->roots;
    *out = b.bvh;
    return KL_OK;
}

void kl_device_bvh_destroy(struct kl_device_bvh *bvh)
{
    if (bvh == NULL) return;
    free(bvh->nodes);
    free(bvh->leaves);
    free(bvh->roots);
    free(bvh);
}
