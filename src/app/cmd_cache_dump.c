/* cache dump: the records as a table, as points, or as volumes. */
#include "kernels/sampling.h"
#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/json_text.h"
#include "src/app/record_list.h"
#include "src/app/vdb_module.h"
#include "src/base/file.h"
#include "src/base/memory.h"

#include <float.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
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

/* Volumes have this many voxels along the longest edge of what they hold. */
enum { VOXELS = 256 };

static double voxel_of(const struct kl_record_list *list)
{
    double longest = 0.0;
    for (int k = 0; k < 3; ++k) {
        double lo = DBL_MAX;
        double hi = -DBL_MAX;
        for (size_t i = 0; i < list->count; ++i) {
            lo = fmin(lo, list->items[i].pos[k]);
            hi = fmax(hi, list->items[i].pos[k]);
        }
        longest = fmax(longest, hi - lo);
    }
    return longest > 0.0 ? longest / VOXELS : 1.0;
}

static kl_status write_vdb(const char *path, const struct kl_record_list *list, struct kl_err *err)
{
    const size_t n = list->count;
    double *positions = NULL;
    float *floats = NULL;    /* normals, irradiance, radius, error */
    int32_t *numbers = NULL; /* level, born */
    kl_status st = kl_alloc_array(&positions, 3 * n, sizeof *positions, err);

    if (st == KL_OK) st = kl_alloc_array(&floats, 8 * n, sizeof *floats, err);
    if (st == KL_OK) st = kl_alloc_array(&numbers, 2 * n, sizeof *numbers, err);
    for (size_t i = 0; st == KL_OK && i < n; ++i) {
        const struct kl_record_item *r = &list->items[i];
        const kl_vec3 normal = kl_oct_decode(r->hot.normal);
        memcpy(positions + 3 * i, r->pos, sizeof r->pos);
        memcpy(floats + 3 * i, &(float[]){normal.x, normal.y, normal.z}, 3 * sizeof(float));
        memcpy(floats + 3 * n + 3 * i, r->cold.irr, sizeof r->cold.irr);
        floats[6 * n + i] = r->hot.radius;
        floats[7 * n + i] = error_of(r);
        numbers[i] = (int32_t)r->level;
        numbers[n + i] = (int32_t)r->born;
    }
    if (st == KL_OK) {
        const struct kl_vdb_points points = {.count = n,
                                             .positions = positions,
                                             .normals = floats,
                                             .irradiance = floats + 3 * n,
                                             .radius = floats + 6 * n,
                                             .error = floats + 7 * n,
                                             .level = numbers,
                                             .born = numbers + n,
                                             .voxel = voxel_of(list)};
        st = kl_vdb_module_write(path, &points, err);
    }
    free(positions);
    free(floats);
    free(numbers);
    return st;
}

static kl_status write_list(const char *path, const char *extension,
                            const struct kl_record_list *list, struct kl_err *err)
{
    if (strcmp(extension, ".vdb") == 0) return write_vdb(path, list, err);
    return write_stream(path, list, strcmp(extension, ".csv") == 0 ? write_csv : write_ply, err);
}

kl_status kl_command_cache_dump(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    const char *extension = o->output != NULL ? strrchr(o->output, '.') : NULL;
    struct kl_record_list list = {0};

    if (extension == NULL) {
        return kl_fail(err, KL_ERR_USAGE, "cache dump: expected -o FILE.csv, FILE.ply or FILE.vdb");
    }
    if (strcmp(extension, ".csv") != 0 && strcmp(extension, ".ply") != 0 &&
        strcmp(extension, ".vdb") != 0) {
        return kl_fail(err, KL_ERR_USAGE, "--output: '%s', expected .csv, .ply or .vdb", o->output);
    }
    kl_status st = kl_record_list_load(o->arguments[0], &list, err);
    if (st == KL_OK) st = kl_folders_make(o->output, false, err);
    if (st == KL_OK) st = write_list(o->output, extension, &list, err);
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
