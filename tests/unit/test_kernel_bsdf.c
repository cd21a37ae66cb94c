/* kernels/bsdf.h: densities, weights and energy of the specular lobe over the diffuse base. */
#include "kernels/bsdf.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static const kl_scene_view scene = {.needs = KL_NEED_SPECULAR};
static const kl_vec3 up = {0.0f, 0.0f, 1.0f};

static kl_surface surface_of(float roughness, float f0, float f90, float diffuse)
{
    kl_surface s = {.geometric = up, .smooth = up, .shading = up, .roughness = roughness};
    s.f0 = kl_v3_splat(f0);
    s.f90 = kl_v3_splat(f90);
    s.diffuse = kl_v3_splat(diffuse);
    return s;
}

static kl_vec3 view_at(float cosine)
{
    return kl_v3(sqrtf(1.0f - cosine * cosine), 0.0f, cosine);
}

static const float roughnesses[] = {0.1f, 0.2f, 0.35f, 0.5f, 0.7f, 0.85f, 1.0f};
static const float cosines[] = {1.0f, 0.9f, 0.7f, 0.5f, 0.3f, 0.15f, 0.05f};

/* Integral of density and of f cos over the hemisphere: directions by a fine grid of the sphere of
 * half vectors would miss grazing ones, so plain angles, refined about the mirror direction by
 * size. */
static void integrate(const kl_surface *s, kl_vec3 wo, double *density, double *albedo)
{
    enum { NT = 1200, NP = 1200 };
    *density = 0.0;
    *albedo = 0.0;
    for (int i = 0; i < NT; ++i) {
        const double theta = 1.5707963 * (i + 0.5) / NT;
        for (int k = 0; k < NP; ++k) {
            const double phi = 3.14159265 * (k + 0.5) / NP; /* symmetric: half is enough */
            const kl_vec3 wi = kl_v3((float)(sin(theta) * cos(phi)), (float)(sin(theta) * sin(phi)),
                                     (float)cos(theta));
            const double weight = 2.0 * sin(theta) * (1.5707963 / NT) * (3.14159265 / NP);
            float pdf;
            const kl_vec3 f = kl_specular_eval(s, wo, wi, &pdf);
            *density += weight * (double)pdf;
            *albedo += weight * (double)f.y;
        }
    }
}

/* At most 1: what is missing goes below the surface. For a view from above, nearly nothing does. */
static void densities_integrate(void **state)
{
    (void)state;
    for (size_t r = 1; r < sizeof roughnesses / sizeof *roughnesses; r += 2) {
        for (size_t c = 0; c < sizeof cosines / sizeof *cosines; c += 3) {
            const kl_surface s = surface_of(roughnesses[r], 1.0f, 1.0f, 0.0f);
            double density, albedo;
            integrate(&s, view_at(cosines[c]), &density, &albedo);
            assert_true(density < 1.01 && albedo < 1.01);
            if (roughnesses[r] < 0.4f && cosines[c] > 0.6f) assert_true(density > 0.98);
        }
    }
}

/* Mean weight of samples = reflectance; each weight = eval / pdf; both directions agree. */
static void samples_match_their_density(void **state)
{
    enum { N = 1 << 15 };
    (void)state;
    for (size_t r = 1; r < sizeof roughnesses / sizeof *roughnesses; r += 2) {
        for (size_t c = 0; c < sizeof cosines / sizeof *cosines; c += 3) {
            const kl_surface s = surface_of(roughnesses[r], 0.6f, 1.0f, 0.0f);
            const kl_vec3 wo = view_at(cosines[c]);
            double density, albedo;
            double mean = 0.0;
            double inside = 0.0;
            for (uint32_t i = 0; i < N; ++i) {
                kl_vec3 wi;
                float pdf, again;
                const kl_vec3 w = kl_specular_sample(&s, wo, kl_sobol_2d(i, 4), &wi, &pdf);
                assert_true(kl_v3_isfinite(w) && w.x >= 0.0f && w.x <= 1.0001f);
                mean += (double)w.y / N;
                if (!(pdf > 0.0f)) continue;
                inside += 1.0 / N;
                const kl_vec3 f = kl_specular_eval(&s, wo, wi, &again);
                assert_true(fabsf(again / pdf - 1.0f) < 1e-4f);
                assert_true(fabsf(f.x / pdf - w.x) < 1e-4f);
                assert_true(fabsf(kl_length(wi) - 1.0f) < 1e-3f);
            }
            integrate(&s, wo, &density, &albedo);
            assert_true(fabs(mean - albedo) < 0.01);
            assert_true(fabs(inside - density) < 0.01);
        }
    }
}

/* f is symmetric: f(wo, wi) cos(wi) / cos(wi) equals it the other way round. */
static void lobe_is_reciprocal(void **state)
{
    struct random r = {3};
    (void)state;
    for (int i = 0; i < 20000; ++i) {
        const kl_surface s = surface_of(random_range(&r, 0.1f, 1.0f), 0.04f, 1.0f, 0.0f);
        kl_vec3 a = random_direction(&r);
        kl_vec3 b = random_direction(&r);
        a.z = fabsf(a.z);
        b.z = fabsf(b.z);
        if (a.z < 0.01f || b.z < 0.01f) continue;
        float pdf;
        const float ab = kl_specular_eval(&s, a, b, &pdf).x / b.z;
        const float ba = kl_specular_eval(&s, b, a, &pdf).x / a.z;
        assert_true(fabsf(ab - ba) <= 2e-3f * (fabsf(ab) + 1e-6f));
    }
}

static void nothing_below_the_surface(void **state)
{
    struct random r = {4};
    (void)state;
    for (int i = 0; i < 20000; ++i) {
        kl_surface s = surface_of(random_float(&r), 0.5f, 1.0f, 0.5f);
        s.shading = kl_normalize(kl_v3_mad(up, 0.8f, random_direction(&r)));
        const kl_vec3 wo = random_direction(&r);
        const kl_vec3 wi = random_direction(&r);
        float pdf;
        const kl_vec3 f = kl_specular_eval(&s, wo, wi, &pdf);
        assert_true(kl_v3_isfinite(f) && isfinite(pdf) && f.x >= 0.0f && pdf >= 0.0f);
        if (wi.z <= 0.0f || kl_dot(wi, s.shading) <= 0.0f || kl_dot(wo, s.shading) <= 0.0f) {
            assert_true(kl_is_black(f) && pdf == 0.0f);
        }
    }
}

/* White furnace: base and lobe together reflect no more than arrives, whatever the material. */
static void base_and_lobe_gain_no_energy(void **state)
{
    enum { N = 1 << 13 };
    double worst = 0.0;
    double worst_lobe = 0.0;
    (void)state;
    for (size_t r = 0; r < sizeof roughnesses / sizeof *roughnesses; ++r) {
        for (size_t c = 0; c < sizeof cosines / sizeof *cosines; ++c) {
            for (int k = 0; k < 4; ++k) {
                const float f0 = (float[]){0.02f, 0.04f, 0.2f, 1.0f}[k];
                const kl_surface s = surface_of(roughnesses[r], f0, 1.0f, 1.0f);
                const kl_vec3 wo = view_at(cosines[c]);
                double lobe = 0.0;
                for (uint32_t i = 0; i < N; ++i) {
                    kl_vec3 wi;
                    float pdf;
                    lobe += (double)kl_specular_sample(&s, wo, kl_sobol_2d(i, 8), &wi, &pdf).y / N;
                }
                const double base = (double)kl_diffuse_albedo(&scene, &s, wo).y;
                if (base + lobe > worst) {
                    worst = base + lobe;
                    print_message(
                        "roughness %.2f cosine %.2f f0 %.2f: base %.4f lobe %.4f sum %.4f\n",
                        (double)s.roughness, (double)cosines[c], (double)f0, base, lobe, worst);
                }
                worst_lobe = fmax(worst_lobe, lobe);
                assert_true(fabs((double)kl_specular_albedo(&s, wo.z).y - lobe) < 0.035);
                assert_true(base >= 0.0 && base <= 1.0);
                const kl_vec3 gathered = kl_gather_albedo(&scene, &s, wo);
                assert_true(gathered.y >= 0.0f && gathered.y <= 1.0001f);
            }
        }
    }
    assert_true(worst_lobe <= 1.001);
    assert_true(worst <= 1.035); /* what the table of the lobe's albedo promises */
}

/* What gathers see of a blunt lobe has its direction and the energy of its gather albedo; other
 * lobes are as good as Lambertian. */
static void gathers_see_blunt_lobes(void **state)
{
    enum { N = 1 << 13 };
    (void)state;
    for (size_t r = 0; r < sizeof roughnesses / sizeof *roughnesses; ++r) {
        const kl_surface s = surface_of(roughnesses[r], 0.04f, 1.0f, 0.5f);
        for (size_t c = 0; c < sizeof cosines / sizeof *cosines; ++c) {
            const kl_vec3 wo = view_at(cosines[c]);
            const kl_vec3 albedo = kl_gather_albedo(&scene, &s, wo);
            double mean = 0.0;
            for (uint32_t i = 0; i < N; ++i) {
                const kl_vec3 wi = kl_cosine_direction(kl_sobol_2d(i, 3));
                const kl_vec3 shape = kl_gather_shape(&scene, &s, albedo, wo, wi);
                assert_true(kl_v3_isfinite(shape) && shape.y >= 0.0f);
                if (!kl_is_blunt(&s)) assert_true(shape.y == 1.0f);
                mean += (double)(shape.y * albedo.y) / N;
            }
            assert_true(fabs(mean - (double)albedo.y) < 0.035);
            if (!kl_is_blunt(&s) || cosines[c] > 0.6f) continue;
            const kl_vec3 mirrored = kl_v3(-wo.x, -wo.y, wo.z);
            assert_true(kl_gather_shape(&scene, &s, albedo, wo, mirrored).y >
                        kl_gather_shape(&scene, &s, albedo, wo, wo).y);
        }
    }
}

static void no_lobe_leaves_the_base(void **state)
{
    const kl_surface s = surface_of(0.5f, 0.0f, 0.0f, 0.7f);
    (void)state;
    assert_true(kl_diffuse_albedo(&scene, &s, up).x == 0.7f);
    assert_true(kl_gather_albedo(&scene, &s, up).x == 0.7f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(densities_integrate),
        cmocka_unit_test(samples_match_their_density),
        cmocka_unit_test(lobe_is_reciprocal),
        cmocka_unit_test(nothing_below_the_surface),
        cmocka_unit_test(base_and_lobe_gain_no_energy),
        cmocka_unit_test(gathers_see_blunt_lobes),
        cmocka_unit_test(no_lobe_leaves_the_base),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
