/* What irradiance records may depend on: objects, lights, the environment; and how a set of them is
 * written in 64 bits. The list of parts lies in cache files as it is. */
#ifndef KL_KERNELS_PARTS_H
#define KL_KERNELS_PARTS_H
#include "kernels/vec.h"

#define KL_PART_OBJECT      0u /* a node with a mesh */
#define KL_PART_LIGHT       1u /* a punctual light */
#define KL_PART_ENVIRONMENT 2u
#define KL_PART_SETTINGS    3u /* what the records were gathered with; no part of the scene */
#define KL_PART_KINDS       4u
#define KL_PART_LABEL       24
#define KL_PARTS_MAX        65536u

/* Digests are 64 bits each; 0: the part has nothing of the kind. */
typedef struct kl_part {
    kl_u32 kind;       /* KL_PART_* */
    float power;       /* luminance that it sends, to compare with itself; >= 0 */
    kl_u32 name[2];    /* who it is: kind, name, and which one of that name */
    kl_u32 shape[2];   /* mesh; of a light: its type, range and cone */
    kl_u32 place[2];   /* where it is at this instant, bones and morphs included */
    kl_u32 surface[2]; /* material but its emission, with textures */
    kl_u32 glow[2];    /* emission; of a light: its colour and intensity */
    float box_min[3];  /* [m] render space; of a light or the environment: all zero */
    float box_max[3];
    char label[KL_PART_LABEL]; /* its name, cut short, at least one zero byte at the end */
} kl_part;
KL_ASSERT_SIZE(kl_part, 96);

/* Which of 64 bits stand for a part. Parts may share a bit, so a set of bits says at least what it
 * should; the bits of what rays hit and of what lit it are apart, as a lamp lights nearly all. */
#define KL_TOUCH_OBJECTS     48u /* bits 0..47: rays hit the object */
#define KL_TOUCH_LIGHTS      15u /* bits 48..62: the light, or the glowing object, lit what they hit */
#define KL_TOUCH_NONE        255u /* no bit */
#define KL_TOUCH_ENVIRONMENT 63u

KL_FN kl_u32 kl_part_hit_bit(const kl_part *part)
{
    return part->name[0] % KL_TOUCH_OBJECTS;
}
KL_FN kl_u32 kl_part_light_bit(const kl_part *part)
{
    if (part->kind == KL_PART_ENVIRONMENT) return KL_TOUCH_ENVIRONMENT;
    return KL_TOUCH_OBJECTS + part->name[1] % KL_TOUCH_LIGHTS;
}

#endif
