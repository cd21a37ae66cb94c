/* Skies: a file written here byte by byte, then those of $KEEPLIGHT_DATA. */
#include "src/import/import.h"

#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

struct bytes {
    unsigned char data[4096];
    size_t size;
};

static void put(struct bytes *out, const void *data, size_t size)
{
    assert_true(out->size + size <= sizeof out->data);
    memcpy(out->data + out->size, data, size);
    out->size += size;
}

static void put_i32(struct bytes *out, int32_t value)
{
    put(out, &value, sizeof value); /* the tests run on little-endian machines */
}

static void put_attribute(struct bytes *out, const char *name, const char *type, const void *value,
                          int32_t size)
{
    put(out, name, strlen(name) + 1);
    put(out, type, strlen(type) + 1);
    put_i32(out, size);
    put(out, value, (size_t)size);
}

/* An uncompressed image of float channels B, G, R: openexr.com/en/latest/OpenEXRFileLayout. The
 * display window is one column wider than the data. */
static void make_exr(struct bytes *out, int32_t width, int32_t height, const float *rgb)
{
    const int32_t data[4] = {0, 0, width - 1, height - 1};
    const int32_t display[4] = {0, 0, width, height - 1};
    const float one = 1.0f;
    const float zero[2] = {0.0f, 0.0f};
    struct bytes channels = {.size = 0};

    for (int c = 0; c < 3; ++c) {
        const char name[2] = {"BGR"[c], '\0'};
        put(&channels, name, 2);
        put_i32(&channels, 2); /* float */
        put_i32(&channels, 0);
        put_i32(&channels, 1);
        put_i32(&channels, 1);
    }
    put(&channels, "", 1);
    out->size = 0;
    put_i32(out, 20000630);
    put_i32(out, 2);
    put_attribute(out, "channels", "chlist", channels.data, (int32_t)channels.size);
    put_attribute(out, "compression", "compression", "", 1);
    put_attribute(out, "dataWindow", "box2i", data, sizeof data);
    put_attribute(out, "displayWindow", "box2i", display, sizeof display);
    put_attribute(out, "lineOrder", "lineOrder", "", 1);
    put_attribute(out, "pixelAspectRatio", "float", &one, 4);
    put_attribute(out, "screenWindowCenter", "v2f", zero, 8);
    put_attribute(out, "screenWindowWidth", "float", &one, 4);
    put(out, "", 1);
    const int64_t first = (int64_t)out->size + 8 * height;
    for (int32_t y = 0; y < height; ++y) {
        const int64_t offset = first + (int64_t)y * (8 + 12 * width);
        put(out, &offset, sizeof offset);
    }
    for (int32_t y = 0; y < height; ++y) {
        put_i32(out, y);
        put_i32(out, 12 * width);
        for (int c = 2; c >= 0; --c) {
            for (int32_t x = 0; x < width; ++x) {
                put(out, &rgb[(y * width + x) * 3 + c], sizeof(float));
            }
        }
    }
}

static void write_file(const char *path, const unsigned char *data, size_t size)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static void keep_warning(void *context, const char *line)
{
    char *kept = context;
    (void)snprintf(kept, 256, "%s", line);
}

/* A file of its own for each test program. */
static void temporary_path(char out[64])
{
    (void)snprintf(out, 64, "/tmp/keeplight-test-%ld.exr", (long)getpid());
}

static void test_small_image(void **state)
{
    const float rgb[12] = {1.0f, 2.0f, 3.0f, 0.5f, NAN, 0.0f, -1.0f, 4.0f, 5.0f, 6.0f, 7.0f, 8.0f};
    const float expected[18] = {1.0f, 2.0f, 3.0f, 0.5f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
                                0.0f, 4.0f, 5.0f, 6.0f, 7.0f, 8.0f, 0.0f, 0.0f, 0.0f};
    struct kl_scene scene = {0};
    struct kl_err err;
    struct bytes file;
    char path[64];
    char warning[256] = "";
    (void)state;
    temporary_path(path);
    make_exr(&file, 2, 2, rgb);
    write_file(path, file.data, file.size);
    assert_int_equal(kl_import_environment(&scene, path, keep_warning, warning, &err), KL_OK);
    assert_int_equal(scene.environment.width, 3);
    assert_int_equal(scene.environment.height, 2);
    assert_memory_equal(scene.environment.rgb, expected, sizeof expected);
    assert_non_null(strstr(warning, "2 texels of the environment"));
    /* Any cut: refused, and what was there stays. */
    for (size_t size = 0; size + 1 < file.size; size += 7) {
        write_file(path, file.data, size);
        assert_int_not_equal(kl_import_environment(&scene, path, NULL, NULL, &err), KL_OK);
        assert_int_equal(strncmp(err.msg, path, strlen(path)), 0);
        assert_int_equal(scene.environment.width, 3);
    }
    (void)remove(path);
    free(scene.environment.rgb);
}

static void test_missing_file(void **state)
{
    struct kl_scene scene = {0};
    struct kl_err err;
    (void)state;
    assert_int_equal(kl_import_environment(&scene, "/nonexistent.exr", NULL, NULL, &err),
                     KL_ERR_IO);
    assert_int_equal(kl_import_environment(&scene, "/", NULL, NULL, &err), KL_ERR_INPUT);
}

static void find_folder(char out[512])
{
    const char *data = getenv("KEEPLIGHT_DATA");
    (void)snprintf(out, 512, "%s/scenes/env", data != NULL ? data : KL_SOURCE_DIR "/../shared");
}

static void test_known_images(void **state)
{
    static const struct {
        const char *name;
        uint32_t width, height;
        double mean;
    } cases[] = {
        {"white-furnace.exr", 16, 8, 1.0},
        {"StageEnvLatLong.exr", 1000, 500, 2.90141},           /* tiles, mip map */
        {"OrientationLatLong.exr", 1024, 512, 0.916467},       /* tiles, RGBA */
        {"Rec709_YC-luminance-chroma.exr", 610, 406, 0.25296}, /* half of the chroma */
        {"potsdamer_platz_1k.exr", 1024, 512, 0.714065},
        {"lebombo_512.exr", 512, 256, 0.638977},
        {"sky-and-sun.exr", 512, 256, 1.62971},
        {"BrightRings.exr", 800, 800, 27.5853},
    };
    char folder[512];
    (void)state;
    find_folder(folder);
    if (access(folder, R_OK) != 0) {
        print_message("skipped: no images at %s (set KEEPLIGHT_DATA)\n", folder);
        skip();
    }
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        struct kl_scene scene = {0};
        struct kl_err err = {0};
        char path[768];
        (void)snprintf(path, sizeof path, "%s/%s", folder, cases[i].name);
        const kl_status st = kl_import_environment(&scene, path, NULL, NULL, &err);
        if (st != KL_OK) print_message("%s\n", err.msg);
        assert_int_equal(st, KL_OK);
        const struct kl_scene_environment *env = &scene.environment;
        assert_int_equal(env->width, cases[i].width);
        assert_int_equal(env->height, cases[i].height);
        double sum = 0.0;
        const size_t count = (size_t)env->width * env->height * 3;
        for (size_t k = 0; k < count; ++k) {
            assert_true(env->rgb[k] >= 0.0f && env->rgb[k] <= 3.4e38f);
            sum += (double)env->rgb[k];
        }
        assert_true(fabs(sum / (double)count / cases[i].mean - 1.0) < 1e-4);
        free(env->rgb);
    }
}

static void test_damaged_images(void **state)
{
    char folder[512];
    char damaged[600];
    (void)state;
    find_folder(folder);
    (void)snprintf(damaged, sizeof damaged, "%s/damaged", folder);
    DIR *dir = opendir(damaged);
    if (dir == NULL) {
        print_message("skipped: no images at %s (set KEEPLIGHT_DATA)\n", damaged);
        skip();
    }
    /* One thread reads this directory. NOLINTNEXTLINE(concurrency-mt-unsafe) */
    for (struct dirent *entry = readdir(dir); entry != NULL; entry = readdir(dir)) {
        struct kl_scene scene = {0};
        struct kl_err err = {0};
        char path[1024];
        if (entry->d_name[0] == '.') continue;
        (void)snprintf(path, sizeof path, "%s/%s", damaged, entry->d_name);
        assert_int_equal(kl_import_environment(&scene, path, NULL, NULL, &err), KL_ERR_INPUT);
        assert_null(scene.environment.rgb);
        assert_null(strchr(err.msg, '\n'));
    }
    assert_int_equal(closedir(dir), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_small_image),
        cmocka_unit_test(test_missing_file),
        cmocka_unit_test(test_known_images),
        cmocka_unit_test(test_damaged_images),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
