#include "src/image/image.h"

#include "src/base/memory.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

kl_status kl_image_create(uint32_t width, uint32_t height, struct kl_image **out,
                          struct kl_err *err)
{
    struct kl_image *image = NULL;

    if (width == 0 || height == 0 || width > KL_IMAGE_MAX_SIDE || height > KL_IMAGE_MAX_SIDE) {
        return kl_fail(err, KL_ERR_USAGE, "image size %u x %u is not within 1 to %d", width, height,
                       KL_IMAGE_MAX_SIDE);
    }
    kl_status st = kl_alloc_array(&image, 1, sizeof *image, err);
    if (st != KL_OK) return st;
    image->width = width;
    image->height = height;
    *out = image;
    return KL_OK;
}

void kl_image_destroy(struct kl_image *image)
{
    if (image == NULL) return;
    for (size_t i = 0; i < image->channel_count; ++i) {
        free(image->channels[i].data);
        free(image->channels[i].uints);
    }
    for (size_t i = 0; i < image->attribute_count; ++i) {
        struct kl_attribute *attribute = &image->attributes[i];
        if (attribute->type == KL_ATTRIBUTE_STRING) free(attribute->value.string);
    }
    free(image->channels);
    free(image->attributes);
    free(image);
}

static kl_status check_name(const char *what, const char *name, struct kl_err *err)
{
    const size_t size = strlen(name);

    if (size == 0 || size >= KL_IMAGE_NAME_SIZE) {
        return kl_fail(err, KL_ERR_USAGE, "%s name \"%.80s\": %zu bytes, expected 1 to %d", what,
                       name, size, KL_IMAGE_NAME_SIZE - 1);
    }
    return KL_OK;
}

kl_status kl_image_add_channel(struct kl_image *image, const char *name, enum kl_pixel pixel,
                               void *data, struct kl_err *err)
{
    const uint64_t pixels = (uint64_t)image->width * image->height;
    void *values = NULL;
    kl_status st = check_name("channel", name, err);

    if (st != KL_OK) return st;
    if (kl_image_find(image, name) != NULL) {
        return kl_fail(err, KL_ERR_USAGE, "channel %s: twice in one image", name);
    }
    if (image->channel_count >= KL_IMAGE_MAX_CHANNELS ||
        pixels * (image->channel_count + 1) > KL_IMAGE_MAX_VALUES) {
        return kl_fail(err, KL_ERR_USAGE,
                       "channel %s: the image would be too large (%u x %u x %zu)", name,
                       image->width, image->height, image->channel_count + 1);
    }
    st = kl_grow_array(&image->channels, &image->channel_capacity, image->channel_count + 1,
                       sizeof *image->channels, err);
    if (st != KL_OK) return st;
    st = kl_alloc_array(&values, (size_t)pixels, sizeof(float), err);
    if (st != KL_OK) return st;
    struct kl_channel *channel = &image->channels[image->channel_count++];
    memset(channel, 0, sizeof *channel);
    memcpy(channel->name, name, strlen(name) + 1);
    channel->pixel = pixel;
    if (pixel == KL_PIXEL_UINT) {
        channel->uints = values;
    } else {
        channel->data = values;
    }
    if (data != NULL) memcpy(data, &values, sizeof values);
    return KL_OK;
}

const struct kl_channel *kl_image_find(const struct kl_image *image, const char *name)
{
    for (size_t i = 0; i < image->channel_count; ++i) {
        if (strcmp(image->channels[i].name, name) == 0) return &image->channels[i];
    }
    return NULL;
}

kl_status kl_image_get_rgb(const struct kl_image *image, const char *layer, const float *rgb[3],
                           struct kl_err *err)
{
    const bool is_named = layer != NULL && layer[0] != '\0' && strcmp(layer, "beauty") != 0;
    char name[KL_IMAGE_NAME_SIZE];

    for (int c = 0; c < 3; ++c) {
        const int length = snprintf(name, sizeof name, "%s%s%c", is_named ? layer : "",
                                    is_named ? "." : "", "RGB"[c]);
        const bool fits = length > 0 && (size_t)length < sizeof name;
        const struct kl_channel *channel = fits ? kl_image_find(image, name) : NULL;
        if (channel == NULL || channel->data == NULL) {
            return kl_fail(err, KL_ERR_INPUT, "no half or float channel %s in the image", name);
        }
        rgb[c] = channel->data;
    }
    return KL_OK;
}

static struct kl_attribute *find_attribute(const struct kl_image *image, const char *name)
{
    for (size_t i = 0; i < image->attribute_count; ++i) {
        if (strcmp(image->attributes[i].name, name) == 0) return &image->attributes[i];
    }
    return NULL;
}

kl_status kl_image_set(struct kl_image *image, const struct kl_attribute *attribute,
                       struct kl_err *err)
{
    char *text = NULL;
    kl_status st = check_name("attribute", attribute->name, err);

    if (st != KL_OK) return st;
    st = kl_grow_array(&image->attributes, &image->attribute_capacity, image->attribute_count + 1,
                       sizeof *image->attributes, err);
    if (st != KL_OK) return st;
    if (attribute->type == KL_ATTRIBUTE_STRING) {
        st = kl_copy_string(&text, attribute->value.string, err);
        if (st != KL_OK) return st;
    }
    struct kl_attribute *slot = find_attribute(image, attribute->name);
    if (slot == NULL) {
        slot = &image->attributes[image->attribute_count++];
    } else if (slot->type == KL_ATTRIBUTE_STRING) {
        free(slot->value.string);
    }
    *slot = *attribute;
    if (text != NULL) slot->value.string = text;
    return KL_OK;
}

/* A name that is too long becomes an empty one, which kl_image_set refuses. */
static struct kl_attribute name_attribute(const char *name, enum kl_attribute_type type)
{
    struct kl_attribute attribute = {.type = type};
    const size_t size = strlen(name);

    if (size < KL_IMAGE_NAME_SIZE) memcpy(attribute.name, name, size);
    return attribute;
}

kl_status kl_image_set_string(struct kl_image *image, const char *name, const char *text,
                              struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_STRING);
    char *copy = NULL;
    kl_status st = kl_copy_string(&copy, text, err);

    if (st != KL_OK) return st;
    attribute.value.string = copy;
    st = kl_image_set(image, &attribute, err);
    free(copy);
    return st;
}

kl_status kl_image_set_int(struct kl_image *image, const char *name, int32_t value,
                           struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_INT);

    attribute.value.i = value;
    return kl_image_set(image, &attribute, err);
}

kl_status kl_image_set_float(struct kl_image *image, const char *name, float value,
                             struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_FLOAT);

    attribute.value.f = value;
    return kl_image_set(image, &attribute, err);
}

kl_status kl_image_set_double(struct kl_image *image, const char *name, double value,
                              struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_DOUBLE);

    attribute.value.d = value;
    return kl_image_set(image, &attribute, err);
}

kl_status kl_image_set_v2f(struct kl_image *image, const char *name, const float value[2],
                           struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_V2F);

    memcpy(attribute.value.v2f, value, sizeof attribute.value.v2f);
    return kl_image_set(image, &attribute, err);
}

kl_status kl_image_set_rational(struct kl_image *image, const char *name, int32_t numerator,
                                uint32_t denominator, struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_RATIONAL);

    attribute.value.rational.numerator = numerator;
    attribute.value.rational.denominator = denominator;
    return kl_image_set(image, &attribute, err);
}

kl_status kl_image_set_m44f(struct kl_image *image, const char *name, const float value[16],
                            struct kl_err *err)
{
    struct kl_attribute attribute = name_attribute(name, KL_ATTRIBUTE_M44F);

    memcpy(attribute.value.m44f, value, sizeof attribute.value.m44f);
    return kl_image_set(image, &attribute, err);
}

const struct kl_attribute *kl_image_get_attribute(const struct kl_image *image, const char *name)
{
    return find_attribute(image, name);
}

const char *kl_image_get_string(const struct kl_image *image, const char *name)
{
    const struct kl_attribute *attribute = find_attribute(image, name);

    if (attribute == NULL || attribute->type != KL_ATTRIBUTE_STRING) return NULL;
    return attribute->value.string;
}
