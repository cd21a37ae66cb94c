/* src/render/camera.c: rays and projections are each other's inverse. */
#include "src/render/camera.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static struct kl_camera any_camera(struct random *r, bool orthographic)
{
    double eye[3], target[3];
    const double up[3] = {0.0, 1.0, 0.0};
    const double origin[3] = {1e6, -1e6, 5.0};
    for (int k = 0; k < 3; ++k) {
        eye[k] = origin[k] + (double)random_range(r, -5.0f, 5.0f);
        target[k] = origin[k] + (double)random_range(r, -5.0f, 5.0f);
    }
    struct kl_camera c = kl_camera_look_at(eye, target, up, 1.0, origin, 320, 180);
    c.orthographic = orthographic;
    return c;
}

static void project_undoes_ray(void **state)
{
    struct random r = {1};
    (void)state;
    for (int i = 0; i < 20000; ++i) {
        const struct kl_camera c = any_camera(&r, i % 2);
        const float x = random_range(&r, 0.0f, 320.0f);
        const float y = random_range(&r, 0.0f, 180.0f);
        const kl_ray ray = kl_camera_ray(&c, x, y);
        float px, py, depth;
        assert_true(fabsf(kl_length(ray.dir) - 1.0f) < 1e-5f);
        const kl_vec3 p = kl_v3_mad(ray.origin, random_range(&r, 0.1f, 20.0f), ray.dir);
        assert_true(kl_camera_project(&c, p, &px, &py, &depth));
        assert_true(fabsf(px - x) < 0.02f && fabsf(py - y) < 0.02f && depth > 0.0f);
        assert_false(kl_camera_project(&c, kl_v3_mad(c.eye, -1.0f, c.forward), &px, &py, &depth));
    }
}

/* Right of the image is right of the camera, its upper edge is up, and a pixel is as wide as it is
 * high. */
static void pixels_are_square_and_upright(void **state)
{
    const double eye[3] = {0.0, 0.0, 3.0}, target[3] = {0.0, 0.0, 0.0}, up[3] = {0.0, 1.0, 0.0};
    const double origin[3] = {0.0, 0.0, 0.0};
    const struct kl_camera c = kl_camera_look_at(eye, target, up, 0.8, origin, 400, 100);
    (void)state;
    assert_true(kl_camera_ray(&c, 400.0f, 50.0f).dir.x > 0.0f);
    assert_true(kl_camera_ray(&c, 200.0f, 0.0f).dir.y > 0.0f);
    assert_true(fabsf(kl_camera_ray(&c, 200.0f, 50.0f).dir.z + 1.0f) < 1e-6f);
    float x0, x1, y0, y1, depth;
    assert_true(kl_camera_project(&c, kl_v3(0.0f, 0.0f, 0.0f), &x0, &y0, &depth));
    const float pixel = kl_camera_pixel_size(&c, 3.0f);
    assert_true(kl_camera_project(&c, kl_v3(pixel, pixel, 0.0f), &x1, &y1, &depth));
    assert_true(fabsf(x1 - x0 - 1.0f) < 1e-4f && fabsf(y0 - y1 - 1.0f) < 1e-4f);
    assert_true(fabsf(depth - 3.0f) < 1e-5f);
}

/* Looking straight along `up` still gives a frame. */
static void looking_along_up(void **state)
{
    const double eye[3] = {0.0, 3.0, 0.0}, target[3] = {0.0, 0.0, 0.0}, up[3] = {0.0, 1.0, 0.0};
    const double origin[3] = {0.0, 0.0, 0.0};
    const struct kl_camera c = kl_camera_look_at(eye, target, up, 0.8, origin, 64, 64);
    (void)state;
    assert_true(fabsf(kl_length(c.right) - 1.0f) < 1e-5f && fabsf(kl_length(c.up) - 1.0f) < 1e-5f);
    assert_true(fabsf(kl_dot(c.right, c.forward)) < 1e-5f &&
                fabsf(kl_dot(c.up, c.forward)) < 1e-5f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(project_undoes_ray),
        cmocka_unit_test(pixels_are_square_and_upright),
        cmocka_unit_test(looking_along_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
