/* src/cache/octree.c and kl_cache_query: what a query finds through the index is what it would find
 * among all records. */
#include "kernels/cache_query.h"
#include "src/base/clock.h"
#include "src/cache/octree.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

static const float cos_max = 0.9394f;
static const float reach = 1.4f;

struct cloud {
    uint32_t count;
    kl_record_hot *hot;
    kl_record_cold *cold;
    struct kl_octree octree;
    kl_level_view view;
};

static void set_record(struct cloud *c, uint32_t i, kl_vec3 pos, kl_vec3 normal, float radius)
{
    kl_record_hot *h = &c->hot[i];
    kl_record_cold *k = &c->cold[i];
    *h = (kl_record_hot){{pos.x, pos.y, pos.z}, kl_oct_encode(normal), radius, radius, 0, KL_NONE};
    *k = (kl_record_cold){.irr = {1.0f + (float)(i % 7), 1.0f, 0.5f}, .raw_radius = radius};
    k->error_spacing = kl_float_to_half(0.01f);
    memset(k->clearance, 255, sizeof k->clearance);
}

static struct cloud *cloud_create(uint32_t count)
{
    struct cloud *c = calloc(1, sizeof *c);
    assert_non_null(c);
    c->count = count;
    c->hot = calloc((size_t)count + 1, sizeof *c->hot);
    c->cold = calloc((size_t)count + 1, sizeof *c->cold);
    assert_non_null(c->hot);
    assert_non_null(c->cold);
    return c;
}

static void cloud_destroy(struct cloud *c)
{
    kl_octree_fini(&c->octree);
    free(c->hot);
    free(c->cold);
    free(c);
}

static void cloud_index(struct cloud *c, const float center[3], float scene_radius)
{
    const struct kl_octree_root root = kl_octree_root_make(center, scene_radius);
    const struct kl_octree_limits limits = {reach, cos_max};
    struct kl_err err = {0};
    if (kl_octree_build(&root, c->hot, c->count, &limits, &c->octree, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    c->view =
        (kl_level_view){c->octree.head, c->hot, c->cold, c->octree.nodes, c->octree.rows, NULL};
}

/* Sum of weights over all records, and their number, without any index. */
static double brute_force(const struct cloud *c, const kl_query *q, kl_vec3 p, kl_vec3 n,
                          double *largest)
{
    double sum = 0.0;
    *largest = 0.0;
    for (uint32_t i = 0; i < c->count; ++i) {
        const kl_bearing b = kl_record_bearing(&c->hot[i], q, p, n);
        if (!(b.weight > 0.0f) || kl_record_is_blocked(&c->cold[i], &b)) continue;
        sum += (double)b.weight;
        *largest = fmax(*largest, (double)b.weight);
    }
    return sum;
}

struct tally {
    uint32_t served, wrong;
    double worst;
};

static void compare(const struct cloud *c, const kl_query *q, kl_vec3 p, kl_vec3 n,
                    struct tally *tally)
{
    double largest;
    const double want = brute_force(c, q, p, n, &largest);
    const kl_answer got = kl_cache_query(&c->view, q, p, n, n);
    tally->served += want > 0.0;
    if (fabs((double)got.weight - want) > 2e-5 * (1.0 + want)) {
        ++tally->wrong;
        tally->worst = fmax(tally->worst, fabs((double)got.weight - want));
    }
}

/* Query near random records, so that many are found, and anywhere. */
static struct tally compare_many(const struct cloud *c, float spread, uint64_t seed, int queries)
{
    const kl_query wide = {reach, cos_max, KL_INF};
    const kl_query narrow = {1.0f, 0.98f, KL_INF};
    struct random r = {seed};
    struct tally tally = {0};
    for (int i = 0; i < queries; ++i) {
        kl_vec3 p = kl_v3_scale(random_direction(&r), spread * random_float(&r));
        kl_vec3 n = random_direction(&r);
        if (i % 8 != 0 && c->count > 0) {
            const kl_record_hot *h = &c->hot[random_bits(&r) % c->count];
            const kl_vec3 ni = kl_oct_decode(h->normal);
            const kl_vec3 d = random_direction(&r);
            const kl_vec3 flat = kl_v3_mad(d, -0.95f * kl_dot(d, ni), ni);
            p = kl_v3_mad(kl_v3_load(h->pos), 1.45f * h->radius * random_float(&r), flat);
            n = kl_normalize(kl_v3_mad(ni, 0.4f * random_float(&r), random_direction(&r)));
        }
        compare(c, i % 3 ? &wide : &narrow, p, n, &tally);
    }
    return tally;
}

static void check(const struct tally *t, uint32_t least_served)
{
    if (t->wrong > 0) fail_msg("%u queries differ, by %g at most", t->wrong, t->worst);
    assert_true(t->served >= least_served);
}

static void random_clouds(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    (void)state;
    for (uint64_t seed = 1; seed <= 6; ++seed) {
        struct cloud *c = cloud_create(2000);
        struct random r = {seed};
        for (uint32_t i = 0; i < c->count; ++i) {
            const float radius = 0.2f * powf(10.0f, random_range(&r, -2.5f, 0.0f));
            set_record(c, i, kl_v3_scale(random_direction(&r), random_float(&r)),
                       random_direction(&r), radius);
        }
        cloud_index(c, center, 1.0f);
        const struct tally t = compare_many(c, 1.2f, seed + 100, 4000);
        check(&t, 1000);
        cloud_destroy(c);
    }
}

/* Radii far below the finest cells and far above the scene. */
static void huge_and_tiny_radii(void **state)
{
    const float center[3] = {5.0f, -3.0f, 1.0f};
    struct cloud *c = cloud_create(90); /* all reach everywhere: no more than a row holds */
    struct random r = {21};
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        const kl_vec3 d = kl_v3_scale(random_direction(&r), random_float(&r));
        const float radius = i % 3 == 0 ? 1e30f : (i % 3 == 1 ? 1e-7f : 3.0f);
        set_record(c, i, kl_v3(center[0] + d.x, center[1] + d.y, center[2] + d.z),
                   random_direction(&r), radius);
    }
    cloud_index(c, center, 1.0f);
    struct tally t = {0};
    const kl_query wide = {reach, cos_max, KL_INF};
    for (int i = 0; i < 4000; ++i) {
        const kl_vec3 d = kl_v3_scale(random_direction(&r), random_float(&r));
        kl_vec3 p = kl_v3(center[0] + d.x, center[1] + d.y, center[2] + d.z);
        const kl_record_hot *h = &c->hot[random_bits(&r) % c->count];
        if (i % 2) p = kl_v3_load(h->pos);
        compare(c, &wide, p, i % 2 ? kl_oct_decode(h->normal) : random_direction(&r), &t);
    }
    check(&t, 2000);
    cloud_destroy(c);
}

/* Small records over a large scene: cells are millionths of the root's edge, where single precision
 * leaves few digits. */
static void fine_records_in_a_large_scene(void **state)
{
    const float center[3] = {100.0f, 200.0f, -300.0f};
    struct cloud *c = cloud_create(1500);
    struct random r = {23};
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        const kl_vec3 p = kl_v3(center[0] + random_range(&r, -0.7f, 0.7f),
                                center[1] + random_range(&r, -0.7f, 0.7f), center[2] + 0.25f);
        set_record(c, i, p, kl_v3(0.0f, 0.0f, 1.0f), random_range(&r, 0.01f, 0.05f));
    }
    cloud_index(c, center, 1000.0f);
    const struct tally t = compare_many(c, 1.0f, 24, 6000);
    check(&t, 3000);
    cloud_destroy(c);
}

/* Records on the root's faces serve points outside of it; further out nothing is found, and nothing
 * breaks. */
static void points_outside_the_root(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    struct cloud *c = cloud_create(300);
    struct random r = {25};
    struct tally near = {0};
    struct tally far = {0};
    const kl_query wide = {reach, cos_max, KL_INF};
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        kl_vec3 p = kl_v3(random_range(&r, -1.0f, 1.0f), random_range(&r, -1.0f, 1.0f), 1.0f);
        if (i % 2) p = kl_v3(-p.z, p.x, p.y);
        set_record(c, i, p, kl_v3(0.6f, 0.64f, 0.48f), 0.3f);
    }
    cloud_index(c, center, 0.49f);
    assert_true(c->octree.head.side == 2.0f);
    for (int i = 0; i < 4000; ++i) {
        const kl_vec3 d = kl_v3_scale(random_direction(&r), 0.4f * random_float(&r));
        const kl_vec3 p = kl_v3_add(kl_v3_load(c->hot[random_bits(&r) % c->count].pos), d);
        compare(c, &wide, p, kl_normalize(kl_v3(0.6f, 0.6f, 0.5f)), &near);
    }
    for (int i = 0; i < 1000; ++i) {
        const kl_vec3 d = random_direction(&r);
        const kl_vec3 p = kl_v3_scale(d, powf(10.0f, random_range(&r, 0.5f, 8.0f)));
        compare(c, &wide, p, random_direction(&r), &far);
    }
    check(&near, 2000);
    check(&far, 0);
    cloud_destroy(c);
}

/* A sphere of records: neighbours with turned normals, as on curved surfaces. */
static void curved_surfaces(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    struct cloud *c = cloud_create(2000);
    struct random r = {27};
    struct tally t = {0};
    const kl_query wide = {reach, cos_max, KL_INF};
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        const kl_vec3 n = random_direction(&r);
        set_record(c, i, kl_v3_scale(n, 0.5f), n, random_range(&r, 0.02f, 0.08f));
    }
    cloud_index(c, center, 0.5f);
    for (int i = 0; i < 4000; ++i) {
        const kl_vec3 n = random_direction(&r);
        compare(c, &wide, kl_v3_scale(n, 0.5f), n, &t);
    }
    check(&t, 3900);
    cloud_destroy(c);
}

/* Normals on the edges and corners of the direction cube, where the face is decided by rounding. */
static void normals_between_cube_faces(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    struct cloud *c = cloud_create(130);
    struct random r = {29};
    struct tally t = {0};
    const kl_query wide = {reach, cos_max, KL_INF};
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        const uint32_t k = i % 26 + (i % 26 >= 13);
        const kl_vec3 n =
            kl_v3((float)(k % 3) - 1.0f, (float)(k / 3 % 3) - 1.0f, (float)(k / 9) - 1.0f);
        const kl_vec3 bent = kl_v3_mad(n, random_float(&r) * 0.3f, random_direction(&r));
        set_record(c, i, kl_v3_scale(random_direction(&r), 0.3f), kl_normalize(bent), 0.3f);
    }
    cloud_index(c, center, 0.5f);
    for (int i = 0; i < 5000; ++i) {
        const uint32_t k = (uint32_t)i % 26 + ((uint32_t)i % 26 >= 13);
        const kl_vec3 n =
            kl_v3((float)(k % 3) - 1.0f, (float)(k / 3 % 3) - 1.0f, (float)(k / 9) - 1.0f);
        const float off = i % 2 ? 0.0f : 1e-6f;
        const kl_vec3 bent = kl_normalize(kl_v3_mad(n, off, random_direction(&r)));
        compare(c, &wide, kl_v3_scale(random_direction(&r), 0.3f), bent, &t);
    }
    check(&t, 2000);
    cloud_destroy(c);
}

static void none_and_one_and_the_same(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    const kl_query wide = {reach, cos_max, KL_INF};
    const kl_vec3 up = kl_v3(0.0f, 0.0f, 1.0f);
    struct tally t = {0};
    (void)state;
    for (uint32_t n = 0; n <= 50; n = n == 0 ? 1 : 50 * n) {
        struct cloud *c = cloud_create(n);
        for (uint32_t i = 0; i < n; ++i) {
            set_record(c, i, kl_v3(0.1f, 0.1f, 0.1f), up, 0.1f);
        }
        cloud_index(c, center, 1.0f);
        compare(c, &wide, kl_v3(0.15f, 0.1f, 0.1f), up, &t);
        compare(c, &wide, kl_v3(0.1f, 0.1f, 0.1f), up, &t);
        compare(c, &wide, kl_v3(0.9f, 0.1f, 0.1f), up, &t);
        cloud_destroy(c);
        if (n >= 50) break;
    }
    check(&t, 4);
}

/* An elliptic record serves further along its major axis, and is found there. */
static void elliptic_records(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    struct cloud *c = cloud_create(500);
    struct random r = {31};
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        set_record(c, i, kl_v3_scale(random_direction(&r), random_float(&r)), random_direction(&r),
                   random_range(&r, 0.05f, 0.3f));
        c->hot[i].radius2 = c->hot[i].radius * random_range(&r, 1.0f, 2.0f);
        c->hot[i].form = (uint32_t)(random_bits(&r) & 0xfffu);
    }
    cloud_index(c, center, 1.0f);
    const struct tally t = compare_many(c, 1.2f, 32, 4000);
    check(&t, 1000);
    cloud_destroy(c);
}

/* A million records at one position (normals, or a hostile file): the index neither explodes nor
 * takes forever, and a query there looks at 64 of them. */
static void a_million_at_one_position(void **state)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    const kl_query few = {reach, cos_max, 4.0f};
    struct cloud *c = cloud_create(1000000);
    (void)state;
    for (uint32_t i = 0; i < c->count; ++i) {
        set_record(c, i, kl_v3(0.1f, 0.2f, 0.3f), kl_v3(0.0f, 0.0f, 1.0f), 0.05f);
    }
    double start = kl_seconds();
    cloud_index(c, center, 1.0f);
    const double build = kl_seconds() - start;
    start = kl_seconds();
    float weight = 0.0f;
    for (int i = 0; i < 5; ++i) {
        const kl_vec3 p = kl_v3(0.1f + 1e-5f * (float)i, 0.2f, 0.3f);
        weight +=
            kl_cache_query(&c->view, &few, p, kl_v3(0.0f, 0.0f, 1.0f), kl_v3(0.0f, 0.0f, 1.0f))
                .weight;
    }
    const double query = (kl_seconds() - start) / 5;
    print_message("1e6 at one position: build %.2f s, %.1f MiB, query %.2f ms\n", build,
                  (double)c->octree.head.row_size * 4 / 1048576, 1e3 * query);
    assert_true(weight > 0.0f);
    assert_true(c->octree.head.row_size < 100000);
    assert_true(query < 1e-3);
    cloud_destroy(c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_clouds),
        cmocka_unit_test(huge_and_tiny_radii),
        cmocka_unit_test(fine_records_in_a_large_scene),
        cmocka_unit_test(points_outside_the_root),
        cmocka_unit_test(curved_surfaces),
        cmocka_unit_test(normals_between_cube_faces),
        cmocka_unit_test(none_and_one_and_the_same),
        cmocka_unit_test(elliptic_records),
        cmocka_unit_test(a_million_at_one_position),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
