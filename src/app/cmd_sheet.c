#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/base/memory.h"
#include "src/image/exr.h"
#include "src/image/png.h"

#include <stdio.h>
#include <stdlib.h>

/* SHEET.png FRAMES...: previews side by side. */
kl_status kl_command_sheet(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    const struct kl_png_options png = {.exposure = (float)o->exposure};
    const size_t count = o->argument_count - 1;
    struct kl_image **images = NULL;
    kl_status st = kl_alloc_array(&images, count, sizeof(struct kl_image *), err);

    for (size_t i = 0; st == KL_OK && i < count; ++i) {
        st = kl_file_expect(o->arguments[i + 1], "", err);
        if (st == KL_OK) st = kl_exr_read(o->arguments[i + 1], &images[i], err);
    }
    if (st == KL_OK) {
        const struct kl_png_sheet sheet = {.count = count,
                                           .images = (const struct kl_image *const *)images,
                                           .columns = o->columns,
                                           .border = 4,
                                           .reduce = o->reduce};
        st = kl_png_write_sheet(o->arguments[0], &sheet, &png, err);
    }
    if (st == KL_OK) (void)printf("%s: %zu images\n", o->arguments[0], count);
    for (size_t i = 0; images != NULL && i < count; ++i) {
        kl_image_destroy(images[i]);
    }
    free(images);
    return st;
}
