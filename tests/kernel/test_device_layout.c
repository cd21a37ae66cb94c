/* The device's compiler lays the shared structs out as the host's does; selectors; errors. */
#include "kernels/probe_list.h"
#include "src/device/device.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LIST_SIZE(type)         {#type, (uint32_t)sizeof(type)},
#define LIST_FIELD(type, field) {#type "." #field, (uint32_t)offsetof(type, field)},

static const struct {
    const char *name;
    uint32_t value;
} layout[] = {KL_PROBE_ALL(LIST_SIZE, LIST_FIELD)};

enum { LAYOUT_COUNT = sizeof layout / sizeof layout[0] };

static struct kl_device *open_or_skip(void)
{
    struct kl_device *device = NULL;
    struct kl_err err = {0};
    if (kl_device_open("opencl", &device, &err) != KL_OK) {
        (void)printf("SKIPPED: %s\n", err.msg);
        skip();
    }
    return device;
}

static void same_layout(void **state)
{
    (void)state;
    struct kl_device *device = open_or_skip();
    struct kl_device_program *program = NULL;
    struct kl_device_buffer *buffer = NULL;
    struct kl_err err = {0};
    uint32_t values[LAYOUT_COUNT] = {0};

    kl_status st = kl_device_program_create(device, "kernels/probe.cl", 0, &program, &err);
    if (st == KL_OK) {
        st =
            kl_device_buffer_create(device, KL_DEVICE_OUTPUT, values, sizeof values, &buffer, &err);
    }
    const struct kl_device_arg arg = {.buffer = buffer};
    if (st == KL_OK) st = kl_device_run(program, "kl_probe_layout", &arg, 1, 1, 1, &err);
    if (st == KL_OK) st = kl_device_buffer_read(buffer, &err);
    if (st != KL_OK) fail_msg("%s", err.msg);
    for (size_t i = 0; i < LAYOUT_COUNT; ++i) {
        if (values[i] != layout[i].value) {
            fail_msg("%s: device %u, host %u", layout[i].name, values[i], layout[i].value);
        }
    }
    kl_device_buffer_destroy(buffer);
    kl_device_program_destroy(program);
    kl_device_close(device);
}

static void list_and_selectors(void **state)
{
    (void)state;
    struct kl_device_info *infos = NULL;
    struct kl_device *device = NULL;
    struct kl_err err = {0};
    size_t count = 0;

    assert_int_equal(kl_device_list(&infos, &count, &err), KL_OK);
    for (size_t i = 0; i < count; ++i) {
        assert_true(infos[i].name[0] != '\0' && infos[i].type[0] != '\0');
        assert_int_equal(infos[i].usable, infos[i].reason[0] == '\0');
    }
    assert_int_equal(kl_device_open("cuda", &device, &err), KL_ERR_USAGE);
    assert_int_equal(kl_device_open("opencl:", &device, &err), KL_ERR_USAGE);
    assert_int_equal(kl_device_open("opencl:x", &device, &err), KL_ERR_USAGE);
    assert_int_equal(kl_device_open("opencl:-1", &device, &err), KL_ERR_USAGE);
    assert_int_equal(kl_device_open("opencl:1x", &device, &err), KL_ERR_USAGE);
    assert_int_equal(kl_device_open("opencl:63", &device, &err), KL_ERR_DEVICE);
    assert_null(device);
    if (count > 0 && infos[0].usable) {
        assert_int_equal(kl_device_open("opencl:0", &device, &err), KL_OK);
        assert_string_equal(kl_device_get_info(device)->name, infos[0].name);
    }
    kl_device_close(device);
    kl_device_close(NULL);
    free(infos);
}

/* A kernel that does not compile: the message has the place and names the saved source. */
static void compiler_errors(void **state)
{
    (void)state;
    struct kl_device *device = open_or_skip();
    struct kl_device_program *program = NULL;
    struct kl_err err = {0};
    char dir[] = "/tmp/keeplight-test-XXXXXX";
    char path[64];

    assert_non_null(mkdtemp(dir));
    (void)snprintf(path, sizeof path, "%s/trace.cl", dir);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs("\n#include \"kernels/lost.h\"\n", file) >= 0);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(setenv("KEEPLIGHT_KERNEL_DIR", dir, 1), 0);
    assert_int_equal(kl_device_program_create(device, "kernels/trace.cl", 0, &program, &err),
                     KL_ERR_INPUT);
    assert_non_null(strstr(err.msg, "lost.h"));

    file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs("/* one */\n\n__kernel void f(void) { nonsense; }\n", file) >= 0);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(kl_device_program_create(device, "kernels/trace.cl", 3, &program, &err),
                     KL_ERR_DEVICE);
    assert_non_null(strstr(err.msg, "KL_FEATURES=0x3u"));
    const char *saved = strstr(err.msg, "source in ");
    assert_non_null(saved);
    char name[128] = "";
    assert_int_equal(sscanf(saved, "source in %127[^;]", name), 1);
    assert_int_equal(unlink(name), 0);
    assert_int_equal(unsetenv("KEEPLIGHT_KERNEL_DIR"), 0);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(dir), 0);
    assert_null(program);
    kl_device_close(device);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(same_layout),
        cmocka_unit_test(list_and_selectors),
        cmocka_unit_test(compiler_errors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
