/* cache dump: the records as a table, as points, or as volumes. */
#include "kernels/sampling.h"
#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/json_text.h"
#include "src/app/record_list.h"
#include "src/base/file.h"

#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static float error_of(const struct kl_record_item *r)
{
    return kl_half_to_float(r->cold.error_spacing & 0xffffu);
}

static void write_csv(FILE *file, const struct kl_record_list *list)
{
    (void)fprintf(file, "instant,level,x,y,z,nx,ny,nz,radius,radius2,irradiance_r,irradiance_g,"
                        "irradiance_b,error,born,touched\n");
    for (size_t i = 0; i < list->count; ++i) {
        const struct kl_record_item *r = &list->items[i];
        const kl_vec3 n = kl_oct_decode(r->hot.normal);
        (void)fprintf(file,
                      "%s,%u,%.9g,%.9g,%.9g,%.6f,%.6f,%.6f,%.6g,%.6g,%.7g,%.7g,%.7g,%.4g,%u,"
                      "%08x%08x\n",
                      list->instants[r->instant], r->level, r->pos[0], r->pos[1], r->pos[2],
                      (double)n.x, (double)n.y, (double)n.z, (double)r->hot.radius,
                      (double)r->hot.radius2, (double)r->cold.irr[0], (double)r->cold.irr[1],
                      (double)r->cold.irr[2], (double)error_of(r), r->born, r->cold.touched[1],
                      r->cold.touched[0]);
    }
}

/* Irradiance as 8-bit sRGB: that of a white surface, mapped by x / (1 + x). */
static unsigned char shown(float irradiance)
{
    const float radiance = irradiance * KL_INV_PI;
    const float x = radiance / (1.0f + radiance);
    const float c = x <= 0.0031308f ? 12.92f * x : 1.055f * powf(x, 1.0f / 2.4f) - 0.055f;
    return (unsigned char)(255.0f * fminf(fmaxf(c, 0.0f), 1.0f) + 0.5f);
}

/* Binary, little-endian: this machine's, as cache files are. */
static void write_ply(FILE *file, const struct kl_record_list *list)
{
    (void)fprintf(file,
                  "ply\nformat binary_little_endian 1.0\ncomment keeplight records\n"
                  "element vertex %zu\nproperty double x\nproperty double y\nproperty double z\n"
                  "property float nx\nproperty float ny\nproperty float nz\n"
                  "property float radius\nproperty float radius2\nproperty float irradiance_r\n"
                  "property float irradiance_g\nproperty float irradiance_b\n"
                  "property float error\nproperty uint born\nproperty uchar level\n"
                  "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
                  list->count);
    for (size_t i = 0; i < list->count; ++i) {
        const struct kl_record_item *r = &list->items[i];
        const kl_vec3 n = kl_oct_decode(r->hot.normal);
        const float floats[] = {n.x,
                                n.y,
                                n.z,
                                r->hot.radius,
                                r->hot.radius2,
                                r->cold.irr[0],
                                r->cold.irr[1],
                                r->cold.irr[2],
                                error_of(r)};
        const unsigned char bytes[] = {(unsigned char)r->level, shown(r->cold.irr[0]),
                                       shown(r->cold.irr[1]), shown(r->cold.irr[2])};
        (void)fwrite(r->pos, sizeof r->pos, 1, file);
        (void)fwrite(floats, sizeof floats, 1, file);
        (void)fwrite(&r->born, sizeof r->born, 1, file);
        (void)fwrite(bytes, sizeof bytes, 1, file);
    }
}

/* Through a temp file: `path` appears whole or not at all. */
static kl_status write_stream(const char *path, const struct kl_record_list *list,
                              void (*write)(FILE *, const struct kl_record_list *),
                              struct kl_err *err)
{
    struct kl_file_temp temp;
    kl_status st = kl_file_temp_open(path, &temp, err);

    if (st != KL_OK) return st;
    const int fd = dup(temp.fd);
    FILE *file = fd >= 0 ? fdopen(fd, "wb") : NULL;
    if (file == NULL) {
        st = kl_fail_errno(err, "%s", path);
        if (fd >= 0) (void)close(fd);
    } else {
        write(file, list);
        const bool failed = ferror(file) != 0;
        if (fclose(file) != 0 || failed) st = kl_fail_errno(err, "%s: write", path);
    }
    if (st == KL_OK) return kl_file_temp_commit(&temp, err);
    kl_file_temp_discard(&temp);
    return st;
}

kl_status kl_command_cache_dump(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    const char *extension = o->output != NULL ? strrchr(o->output, '.') : NULL;
    struct kl_record_list list = {0};

    if (extension == NULL) {
        return kl_fail(err, KL_ERR_USAGE, "cache dump: expected -o FILE.csv or FILE.ply");
    }
    const bool is_csv = strcmp(extension, ".csv") == 0;
    if (!is_csv && strcmp(extension, ".ply") != 0) {
        return kl_fail(err, KL_ERR_USAGE, "--output: '%s', expected .csv or .ply", o->output);
    }
    kl_status st = kl_record_list_load(o->arguments[0], &list, err);
    if (st == KL_OK) st = kl_folders_make(o->output, false, err);
    if (st == KL_OK) st = write_stream(o->output, &list, is_csv ? write_csv : write_ply, err);
    if (st == KL_OK && (!o->json || o->json_file != NULL)) {
        (void)printf("%s: %zu records\n", o->output, list.count);
    }
    if (st == KL_OK && o->json) {
        json_t *root = json_pack("{s:s,s:s,s:I}", "cache", o->arguments[0], "file", o->output,
                                 "records", (json_int_t)list.count);
        st = kl_json_write(root, o->json_file, err);
        json_decref(root);
    }
    kl_record_list_fini(&list);
    return st;
}
