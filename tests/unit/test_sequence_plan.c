/* Which frames are rendered, skipped or refused. */
#include "sequences/plan.h"
#include "src/base/file.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

/* The test's files hold their fingerprint as text, "cut" stands for a torn picture. */
static kl_status read_text(void *context, const char *path, bool *complete,
                           char text[KL_FINGERPRINT_SIZE], struct kl_err *err)
{
    char *bytes = NULL;
    size_t size = 0;
    kl_status st = kl_file_read(path, 1000, &bytes, &size, err);

    ++*(int *)context;
    if (st != KL_OK) return st;
    *complete = strcmp(bytes, "cut") != 0;
    (void)snprintf(text, KL_FINGERPRINT_SIZE, "%.32s", bytes);
    free(bytes);
    return KL_OK;
}

static void plans(void **state)
{
    char dir[] = "/tmp/kl_plan_XXXXXX";
    char pattern[64];
    char path[64];
    int32_t numbers[] = {5, 1, 2, 3};
    const struct kl_frames frames = {.count = 4, .frames = numbers};
    const uint8_t scene[16] = {1};
    const uint8_t settings[16] = {2};
    int reads = 0;
    struct kl_plan_options options = {.frames = &frames,
                                      .pattern = pattern,
                                      .scene = scene,
                                      .settings = settings,
                                      .read = read_text,
                                      .context = &reads};
    struct kl_plan plan;
    struct kl_err err;
    char text[KL_FINGERPRINT_SIZE];

    (void)state;
    assert_non_null(mkdtemp(dir));
    (void)snprintf(pattern, sizeof pattern, "%s/a.exr", dir);
    kl_fingerprint_make(scene, settings, 5, text);
    (void)snprintf(path, sizeof path, "%s/a.0005.exr", dir);
    assert_int_equal(kl_file_replace(path, text, 32, &err), KL_OK);
    (void)snprintf(path, sizeof path, "%s/a.0001.exr", dir);
    assert_int_equal(kl_file_replace(path, text, 32, &err), KL_OK); /* of another frame */
    (void)snprintf(path, sizeof path, "%s/a.0002.exr", dir);
    assert_int_equal(kl_file_replace(path, "cut", 3, &err), KL_OK);

    assert_int_equal(kl_plan_make(&options, &plan, &err), KL_OK);
    assert_int_equal(plan.count, 4);
    assert_int_equal(plan.frames[0].action, KL_PLAN_SKIP);
    assert_int_equal(plan.frames[1].action, KL_PLAN_REFUSE);
    assert_int_equal(plan.frames[2].action, KL_PLAN_RENDER);
    assert_int_equal(plan.frames[2].found, KL_PLAN_INCOMPLETE);
    assert_int_equal(plan.frames[3].action, KL_PLAN_RENDER);
    assert_int_equal(plan.frames[3].found, KL_PLAN_MISSING);
    assert_int_equal(plan.render_count, 2);
    assert_int_equal(reads, 3);
    assert_string_equal(plan.frames[2].path, path);
    kl_plan_fini(&plan);

    options.overwrite = true;
    assert_int_equal(kl_plan_make(&options, &plan, &err), KL_OK);
    assert_int_equal(plan.render_count, 4);
    kl_plan_fini(&plan);
    options.overwrite = false;
    options.read = NULL;
    assert_int_equal(kl_plan_make(&options, &plan, &err), KL_OK);
    assert_int_equal(plan.refuse_count, 3);
    kl_plan_fini(&plan);
    options.pattern = "x.##.##";
    assert_int_equal(kl_plan_make(&options, &plan, &err), KL_ERR_USAGE);

    for (int i = 0; i < 3; ++i) {
        (void)snprintf(path, sizeof path, "%s/a.000%d.exr", dir, (int)numbers[i]);
        assert_int_equal(unlink(path), 0);
    }
    assert_int_equal(rmdir(dir), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(plans)};

    return cmocka_run_group_tests_name("sequence_plan", tests, NULL, NULL);
}
