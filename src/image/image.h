/* A picture in memory: planar channels of equal size and typed header attributes. */
#ifndef KL_SRC_IMAGE_IMAGE_H
#define KL_SRC_IMAGE_IMAGE_H

#include "src/base/status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    KL_IMAGE_NAME_SIZE = 64,
    KL_IMAGE_MAX_SIDE = 65536,
    KL_IMAGE_MAX_CHANNELS = 1024,
};
/* Values in all channels of one image (4 GiB of them): larger files are refused. */
#define KL_IMAGE_MAX_VALUES ((uint64_t)1 << 30)

/* How a channel is stored in files. */
enum kl_pixel { KL_PIXEL_HALF, KL_PIXEL_FLOAT, KL_PIXEL_UINT };

struct kl_channel {
    char name[KL_IMAGE_NAME_SIZE]; /* "R", "albedo.G", "Z" */
    enum kl_pixel pixel;
    float *data;     /* HALF, FLOAT: width * height values, row by row from the top; else NULL */
    uint32_t *uints; /* UINT: likewise */
};

enum kl_attribute_type {
    KL_ATTRIBUTE_STRING,
    KL_ATTRIBUTE_INT,
    KL_ATTRIBUTE_FLOAT,
    KL_ATTRIBUTE_DOUBLE,
    KL_ATTRIBUTE_V2F,
    KL_ATTRIBUTE_RATIONAL,
    KL_ATTRIBUTE_CHROMATICITIES,
    KL_ATTRIBUTE_M44F,
};

struct kl_attribute {
    char name[KL_IMAGE_NAME_SIZE];
    enum kl_attribute_type type;
    union {
        char *string; /* owned by the image */
        int32_t i;
        float f;
        double d;
        float v2f[2];
        struct {
            int32_t numerator;
            uint32_t denominator;
        } rational;
        float chromaticities[8]; /* x, y of red, green, blue, white */
        float m44f[16];          /* row vectors: p' = p M, as OpenEXR has it */
    } value;
};

/* Read the fields freely; change channels and attributes only through the functions below. */
struct kl_image {
    uint32_t width, height;
    size_t channel_count, channel_capacity;
    struct kl_channel *channels;
    size_t attribute_count, attribute_capacity;
    struct kl_attribute *attributes;
};

/* *out is the caller's: kl_image_destroy, which accepts NULL. */
kl_status kl_image_create(uint32_t width, uint32_t height, struct kl_image **out,
                          struct kl_err *err) KL_MUST_CHECK;
void kl_image_destroy(struct kl_image *image);

/* A new channel of zeros. *data (may be NULL) is set to its values, float or uint32_t, and stays
 * valid until the image is destroyed. KL_ERR_USAGE: the name is taken, empty or too long. */
kl_status kl_image_add_channel(struct kl_image *image, const char *name, enum kl_pixel pixel,
                               void *data, struct kl_err *err) KL_MUST_CHECK;
/* Borrowed until a channel is added or the image is destroyed; NULL where there is none. */
const struct kl_channel *kl_image_find(const struct kl_image *image, const char *name);
/* The channels R, G and B of a layer; NULL, "" or "beauty": the unnamed
 * one. KL_ERR_INPUT: one is missing. */
kl_status kl_image_get_rgb(const struct kl_image *image, const char *layer, const float *rgb[3],
                           struct kl_err *err) KL_MUST_CHECK;

/* Add or replace an attribute; a string is copied. */
kl_status kl_image_set(struct kl_image *image, const struct kl_attribute *attribute,
                       struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_string(struct kl_image *image, const char *name, const char *text,
                              struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_int(struct kl_image *image, const char *name, int32_t value,
                           struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_float(struct kl_image *image, const char *name, float value,
                             struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_double(struct kl_image *image, const char *name, double value,
                              struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_v2f(struct kl_image *image, const char *name, const float value[2],
                           struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_rational(struct kl_image *image, const char *name, int32_t numerator,
                                uint32_t denominator, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_image_set_m44f(struct kl_image *image, const char *name, const float value[16],
                            struct kl_err *err) KL_MUST_CHECK;
/* Borrowed until an attribute is set or the image is destroyed; NULL where there is none. */
const struct kl_attribute *kl_image_get_attribute(const struct kl_image *image, const char *name);
/* The text of a string attribute, else NULL. */
const char *kl_image_get_string(const struct kl_image *image, const char *name);

#ifdef __cplusplus
}
#endif
#endif
