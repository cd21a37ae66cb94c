/* src/cache/thin.c: what stays is what trying them one by one would leave. */
#include "src/cache/thin.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

static const float alike = 0.98f;
enum { N = 3000 };

static bool excludes(const struct kl_candidate *a, const struct kl_candidate *b)
{
    const kl_vec3 d = kl_v3_sub(a->pos, b->pos);
    const float e = fminf(a->exclude, b->exclude);
    return kl_dot(d, d) < e * e && kl_dot(a->normal, b->normal) > alike;
}

static void fill(struct kl_candidate *c, size_t n, float scale, float shift, struct random *r)
{
    for (size_t i = 0; i < n; ++i) {
        c[i].pos = kl_v3(shift + scale * random_range(r, -1.0f, 1.0f),
                         scale * random_range(r, -1.0f, 1.0f), i % 2 ? 0.0f : scale);
        c[i].normal = i % 2 ? kl_v3(0.0f, 0.0f, 1.0f) : random_direction(r);
        c[i].geometric = c[i].normal;
        c[i].spacing = 0.0f;
        c[i].exclude = scale * powf(10.0f, random_range(r, -3.0f, 0.0f));
        c[i].rank = (uint32_t)(random_bits(r) % 2000); /* with ties */
    }
}

/* Reference: repeatedly the smallest rank, ties by place. */
static size_t brute_force(const struct kl_candidate *c, size_t n, size_t limit,
                          struct kl_candidate *out)
{
    size_t kept = 0;
    for (uint32_t rank = 0; rank < 2000; ++rank) {
        for (size_t i = 0; i < n && kept < limit; ++i) {
            bool dropped = c[i].rank != rank;
            for (size_t k = 0; !dropped && k < kept; ++k) {
                dropped = excludes(&out[k], &c[i]);
            }
            if (!dropped) out[kept++] = c[i];
        }
    }
    return kept;
}

static void check(float scale, float shift, size_t limit, uint64_t seed)
{
    static struct kl_candidate candidates[N], want[N];
    struct random r = {seed};
    struct kl_err err = {0};
    size_t kept = 0;
    fill(candidates, N, scale, shift, &r);
    const size_t expected = brute_force(candidates, N, limit, want);
    assert_int_equal(kl_thin(candidates, N, alike, limit, &kept, &err), KL_OK);
    assert_int_equal(kept, expected);
    assert_memory_equal(candidates, want, kept * sizeof *want);
}

static void equals_brute_force(void **state)
{
    (void)state;
    check(1.0f, 0.0f, N, 1);
    check(1.0f, 0.0f, 100, 2);
    check(1e-4f, 0.0f, N, 3);
    check(1e5f, 0.0f, N, 4);
    check(1.0f, 1000.0f, N, 5);
}

static void nothing_in_nothing_out(void **state)
{
    struct kl_candidate one = {.exclude = 1.0f};
    struct kl_err err = {0};
    size_t kept = 7;
    (void)state;
    assert_int_equal(kl_thin(NULL, 0, alike, 10, &kept, &err), KL_OK);
    assert_int_equal(kept, 0);
    assert_int_equal(kl_thin(&one, 1, alike, 0, &kept, &err), KL_OK);
    assert_int_equal(kept, 0);
    assert_int_equal(kl_thin(&one, 1, alike, 5, &kept, &err), KL_OK);
    assert_int_equal(kept, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equals_brute_force),
        cmocka_unit_test(nothing_in_nothing_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
