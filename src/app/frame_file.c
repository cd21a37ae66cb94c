#include "src/app/frame_file.h"

#include "src/app/folders.h"
#include "src/app/version.h"
#include "src/base/hash.h"
#include "src/image/exr.h"
#include "src/image/png.h"
#include "src/render/frame.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define FINGERPRINT "keeplight.fingerprint"

/* Layers that --aov names; "none" is beauty alone. */
static const char *wanted_layers(const struct kl_job *job)
{
    const char *aov = job->options->aov;
    return aov != NULL && strcmp(aov, "none") == 0 ? "" : aov;
}

kl_status kl_frame_file_create(const struct kl_job *job, struct kl_image **out, struct kl_err *err)
{
    struct kl_image *image = NULL;
    kl_status st = kl_image_create(job->options->width, job->options->height, &image, err);

    if (st == KL_OK) st = kl_frame_add_layers(image, wanted_layers(job), err);
    if (st == KL_OK) st = kl_frame_add_layers(image, "cache.weight,cache.error", err);
    if (st != KL_OK) {
        kl_image_destroy(image);
        return st;
    }
    *out = image;
    return KL_OK;
}

double kl_frame_file_error(const struct kl_image *image)
{
    const struct kl_channel *weight = kl_image_find(image, "cache.weight");
    const struct kl_channel *error = kl_image_find(image, "cache.error");
    const size_t count = (size_t)image->width * image->height;
    double sum = 0.0;
    size_t served = 0;

    if (weight == NULL || error == NULL) return -1.0;
    for (size_t i = 0; i < count; ++i) {
        if (!(weight->data[i] > 0.0f)) continue;
        sum += (double)error->data[i];
        ++served;
    }
    return served > 0 ? sum / (double)served : -1.0;
}

/* World to camera for row vectors: x right, y up, z forward from the eye. */
static void camera_matrix(const struct kl_job *job, const struct kl_camera *c, float m[16])
{
    const kl_vec3 axes[3] = {c->right, c->up, c->forward};
    double origin[3];

    kl_renderer_get_origin(job->renderer, origin);
    const double eye[3] = {origin[0] + (double)c->eye.x, origin[1] + (double)c->eye.y,
                           origin[2] + (double)c->eye.z};
    memset(m, 0, 16 * sizeof *m);
    for (int k = 0; k < 3; ++k) {
        const double axis[3] = {(double)axes[k].x, (double)axes[k].y, (double)axes[k].z};
        double shift = 0.0;
        for (int j = 0; j < 3; ++j) {
            m[4 * j + k] = (float)axis[j];
            shift -= axis[j] * eye[j];
        }
        m[12 + k] = (float)shift;
    }
    m[15] = 1.0f;
}

static kl_status set_standard(const struct kl_job *job, size_t i, struct kl_image *image,
                              struct kl_err *err)
{
    const struct kl_options *o = job->options;
    const time_t now = time(NULL);
    struct tm utc;
    char date[32] = "";
    float matrix[16];
    kl_status st = KL_OK;

    if (gmtime_r(&now, &utc) != NULL) {
        (void)strftime(date, sizeof date, "%Y:%m:%d %H:%M:%S", &utc);
    }
    camera_matrix(job, &job->frames[i].camera, matrix);
    st = kl_image_set_string(image, "capDate", date, err);
    if (st == KL_OK) st = kl_image_set_float(image, "utcOffset", 0.0f, err);
    if (st == KL_OK) {
        st = kl_image_set_rational(image, "framesPerSecond", o->fps.numerator, o->fps.denominator,
                                   err);
    }
    if (st == KL_OK) st = kl_image_set_m44f(image, "worldToCamera", matrix, err);
    return st;
}

static kl_status set_digest(struct kl_image *image, const char *name, const uint8_t *digest,
                            struct kl_err *err)
{
    char text[KL_HASH_HEX_SIZE];
    kl_hash_to_hex(digest, KL_HASH_SIZE, text);
    return kl_image_set_string(image, name, text, err);
}

static kl_status set_provenance(const struct kl_job *job, const struct kl_frame_file *file,
                                struct kl_image *image, struct kl_err *err)
{
    const struct kl_options *o = job->options;
    const struct kl_job_frame *frame = &job->frames[file->index];
    struct kl_renderer_info info;
    struct kl_cache_state state;
    uint8_t settings[KL_DIGEST_SIZE];
    char shutter[64];
    char generation[32];
    kl_status st = KL_OK;

    kl_renderer_get_info(job->renderer, &info);
    kl_renderer_get_cache(job->renderer, &state);
    kl_job_settings_digest(job, file->index, settings);
    (void)snprintf(shutter, sizeof shutter, "%gf at %+gf", o->shutter.length, o->shutter.offset);
    (void)snprintf(generation, sizeof generation, "%llu", (unsigned long long)state.generation);
    st = kl_image_set_string(image, "keeplight.version", KL_VERSION " (" KL_COMMIT ")", err);
    if (st == KL_OK) st = kl_image_set_string(image, "keeplight.command", o->command_line, err);
    if (st == KL_OK) st = set_digest(image, "keeplight.scene", info.scene_digest, err);
    if (st == KL_OK) st = set_digest(image, "keeplight.settings", settings, err);
    if (st == KL_OK) st = kl_image_set_string(image, "keeplight.generation", generation, err);
    if (st == KL_OK) st = kl_image_set_string(image, FINGERPRINT, file->fingerprint, err);
    if (st == KL_OK) st = kl_image_set_int(image, "keeplight.frame", frame->frame, err);
    if (st == KL_OK)
        st = kl_image_set_double(image, "keeplight.time", frame->instants.reference, err);
    if (st == KL_OK) st = kl_image_set_string(image, "keeplight.shutter", shutter, err);
    if (st == KL_OK) st = kl_image_set_int(image, "keeplight.spp", (int32_t)o->spp, err);
    if (st == KL_OK) st = kl_image_set_double(image, "keeplight.seconds", file->seconds, err);
    return st;
}

/* The layers that were asked for, copied: `image` has those of the report too. */
static kl_status select_layers(const struct kl_job *job, const struct kl_image *image,
                               struct kl_image **out, struct kl_err *err)
{
    const size_t bytes = (size_t)image->width * image->height * sizeof(float);
    struct kl_image *copy = NULL;
    kl_status st = kl_image_create(image->width, image->height, &copy, err);

    if (st == KL_OK) st = kl_frame_add_layers(copy, wanted_layers(job), err);
    for (size_t i = 0; st == KL_OK && i < copy->channel_count; ++i) {
        const struct kl_channel *to = &copy->channels[i];
        const struct kl_channel *from = kl_image_find(image, to->name);
        if (to->pixel == KL_PIXEL_UINT) {
            memcpy(to->uints, from->uints, bytes);
        } else {
            memcpy(to->data, from->data, bytes);
        }
    }
    if (st != KL_OK) {
        kl_image_destroy(copy);
        return st;
    }
    *out = copy;
    return KL_OK;
}

kl_status kl_frame_file_write(const struct kl_job *job, const struct kl_frame_file *file,
                              struct kl_image *image, struct kl_err *err)
{
    struct kl_image *copy = NULL;
    char preview[KL_JOB_PATH_SIZE];
    kl_status st = kl_folders_make(file->path, false, err);

    if (st == KL_OK && wanted_layers(job) != NULL) {
        st = select_layers(job, image, &copy, err);
        if (st == KL_OK) image = copy;
    }
    if (st == KL_OK) st = set_standard(job, file->index, image, err);
    if (st == KL_OK) st = set_provenance(job, file, image, err);
    if (st == KL_OK && job->options->png) {
        st = kl_path_with_extension(file->path, "png", preview, sizeof preview, err);
        if (st == KL_OK) st = kl_png_write(preview, image, NULL, err);
    }
    if (st == KL_OK) st = kl_exr_write(file->path, image, err);
    kl_image_destroy(copy);
    return st;
}

kl_status kl_frame_file_read(void *context, const char *path, bool *complete,
                             char text[KL_FINGERPRINT_SIZE], struct kl_err *err)
{
    struct kl_image *header = NULL;
    struct kl_err ignored;

    (void)context;
    (void)err;
    *complete = false;
    text[0] = '\0';
    if (kl_exr_read_header(path, &header, complete, &ignored) != KL_OK) {
        *complete = false; /* not an image, or cut off in its header: rendered anew */
        return KL_OK;
    }
    const char *found = kl_image_get_string(header, FINGERPRINT);
    if (found != NULL) (void)snprintf(text, KL_FINGERPRINT_SIZE, "%s", found);
    kl_image_destroy(header);
    return KL_OK;
}
