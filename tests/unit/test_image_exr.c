/* OpenEXR files: what is written is read back, and broken files are refused. */
#include "src/base/file.h"
#include "src/image/exr.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

struct fixture {
    char dir[32], path[64];
    struct kl_image *image;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    struct kl_err err;
    float *data = NULL;
    uint32_t *ids = NULL;

    assert_non_null(f);
    strcpy(f->dir, "/tmp/kl_exr_XXXXXX");
    assert_non_null(mkdtemp(f->dir));
    (void)snprintf(f->path, sizeof f->path, "%s/a.exr", f->dir);
    assert_int_equal(kl_image_create(37, 53, &f->image, &err), KL_OK);
    const char *const names[] = {"R", "G", "B", "A", "Z", "albedo.G"};
    for (size_t c = 0; c < 6; ++c) {
        const enum kl_pixel pixel = c == 4 ? KL_PIXEL_FLOAT : KL_PIXEL_HALF;
        assert_int_equal(kl_image_add_channel(f->image, names[c], pixel, &data, &err), KL_OK);
        for (size_t i = 0; i < 37 * 53; ++i)
            data[i] = (float)(i % 256) * 0.25f + (float)c;
    }
    data[0] = 1e9f;
    assert_int_equal(kl_image_add_channel(f->image, "id", KL_PIXEL_UINT, &ids, &err), KL_OK);
    for (uint32_t i = 0; i < 37 * 53; ++i)
        ids[i] = i * 2654435761u;
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, 3, 4, 1};
    assert_int_equal(kl_image_set_string(f->image, "keeplight.scene", "abc", &err), KL_OK);
    assert_int_equal(kl_image_set_m44f(f->image, "worldToCamera", matrix, &err), KL_OK);
    assert_int_equal(kl_image_set_rational(f->image, "framesPerSecond", 24000, 1001, &err), KL_OK);
    assert_int_equal(kl_image_set_int(f->image, "keeplight.frame", -7, &err), KL_OK);
    assert_int_equal(kl_image_set_double(f->image, "keeplight.seconds", 0.1, &err), KL_OK);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;

    (void)unlink(f->path);
    assert_int_equal(rmdir(f->dir), 0); /* no temp file is left behind */
    kl_image_destroy(f->image);
    free(f);
    return 0;
}

static void round_trip(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    struct kl_image *back = NULL;

    assert_int_equal(kl_exr_write(f->path, f->image, &err), KL_OK);
    assert_int_equal(kl_exr_read(f->path, &back, &err), KL_OK);
    assert_int_equal(back->width, 37);
    assert_int_equal(back->height, 53);
    assert_int_equal(back->channel_count, f->image->channel_count);
    for (size_t c = 0; c < back->channel_count; ++c) {
        const struct kl_channel *was = &f->image->channels[c];
        const struct kl_channel *is = kl_image_find(back, was->name);
        assert_non_null(is);
        assert_int_equal(is->pixel, was->pixel);
        const size_t from = c == 5 ? 1 : 0; /* the value that half cannot hold */
        if (is->data != NULL) {
            assert_memory_equal(is->data + from, was->data + from, (37 * 53 - from) * 4);
        } else {
            assert_memory_equal(is->uints, was->uints, 37 * 53 * 4);
        }
    }
    assert_true(kl_image_find(back, "albedo.G")->data[0] == 65504.0f);
    assert_string_equal(kl_image_get_string(back, "keeplight.scene"), "abc");
    assert_int_equal(kl_image_get_attribute(back, "keeplight.frame")->value.i, -7);
    assert_int_equal(kl_image_get_attribute(back, "framesPerSecond")->value.rational.denominator,
                     1001);
    assert_true(kl_image_get_attribute(back, "worldToCamera")->value.m44f[13] == 3.0f);
    assert_true(kl_image_get_attribute(back, "chromaticities")->value.chromaticities[0] == 0.64f);
    kl_image_destroy(back);
}

static void same_image_same_bytes(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    char *a = NULL;
    char *b = NULL;
    size_t size_a = 0;
    size_t size_b = 0;

    assert_int_equal(kl_exr_write(f->path, f->image, &err), KL_OK);
    assert_int_equal(kl_file_read(f->path, 1 << 24, &a, &size_a, &err), KL_OK);
    assert_int_equal(kl_exr_write(f->path, f->image, &err), KL_OK);
    assert_int_equal(kl_file_read(f->path, 1 << 24, &b, &size_b, &err), KL_OK);
    assert_int_equal(size_a, size_b);
    assert_memory_equal(a, b, size_a);
    free(a);
    free(b);
}

static void truncated_files_are_not_complete(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    char *bytes = NULL;
    size_t size = 0;
    bool complete = false;
    struct kl_image *header = NULL;

    assert_int_equal(kl_exr_write(f->path, f->image, &err), KL_OK);
    assert_int_equal(kl_exr_read_header(f->path, &header, &complete, &err), KL_OK);
    assert_true(complete);
    assert_string_equal(kl_image_get_string(header, "keeplight.scene"), "abc");
    kl_image_destroy(header);
    assert_int_equal(kl_file_read(f->path, 1 << 24, &bytes, &size, &err), KL_OK);
    for (size_t n = 0; n < size; n += 1 + size / 97) {
        struct kl_image *image = NULL;
        assert_int_equal(kl_file_replace(f->path, bytes, n, &err), KL_OK);
        header = NULL;
        complete = true;
        if (kl_exr_read_header(f->path, &header, &complete, &err) == KL_OK) assert_false(complete);
        kl_image_destroy(header);
        assert_int_equal(kl_exr_read(f->path, &image, &err), KL_ERR_INPUT);
        assert_null(image);
    }
    free(bytes);
}

static void flipped_bits_do_not_crash(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    char *bytes = NULL;
    size_t size = 0;

    assert_int_equal(kl_exr_write(f->path, f->image, &err), KL_OK);
    assert_int_equal(kl_file_read(f->path, 1 << 24, &bytes, &size, &err), KL_OK);
    for (size_t i = 0; i < size; i += i < 1500 ? 3 : 211) {
        struct kl_image *image = NULL;
        bytes[i] = (char)(bytes[i] ^ (1 << (i % 8)));
        assert_int_equal(kl_file_replace(f->path, bytes, size, &err), KL_OK);
        if (kl_exr_read(f->path, &image, &err) == KL_OK) kl_image_destroy(image);
        bytes[i] = (char)(bytes[i] ^ (1 << (i % 8)));
    }
    free(bytes);
}

static void bad_paths_say_what_is_wrong(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    struct kl_image *image = NULL;

    assert_int_not_equal(kl_exr_read("/nonexistent/x.exr", &image, &err), KL_OK);
    assert_non_null(strstr(err.msg, "/nonexistent/x.exr"));
    assert_int_not_equal(kl_exr_write("/nonexistent/x.exr", f->image, &err), KL_OK);
    assert_int_equal(kl_image_add_channel(f->image, "R", KL_PIXEL_HALF, NULL, &err), KL_ERR_USAGE);
    assert_int_equal(kl_image_create(0, 4, &image, &err), KL_ERR_USAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(round_trip, setup, teardown),
        cmocka_unit_test_setup_teardown(same_image_same_bytes, setup, teardown),
        cmocka_unit_test_setup_teardown(truncated_files_are_not_complete, setup, teardown),
        cmocka_unit_test_setup_teardown(flipped_bits_do_not_crash, setup, teardown),
        cmocka_unit_test_setup_teardown(bad_paths_say_what_is_wrong, setup, teardown),
    };

    return cmocka_run_group_tests_name("image_exr", tests, NULL, NULL);
}
