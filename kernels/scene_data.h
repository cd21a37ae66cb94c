/* The flat scene that host and devices share: arrays of 4-byte scalars only, so that the same bytes
 * serve the C compiler, Embree and OpenCL. Positions are in render space: world space [m] minus
 * the scene's origin. src/scene/flat.h builds it. */
#ifndef KL_KERNELS_SCENE_DATA_H
#define KL_KERNELS_SCENE_DATA_H
#include "kernels/vec.h"

/* What a scene needs: kernels are compiled for the set (-DKL_FEATURES=...), the host asks the
 * scene. A feature that is absent costs nothing on a device. */
#define KL_NEED_TEXTURES      0x001u
#define KL_NEED_ALPHA         0x002u /* alpha mask or blend on some material */
#define KL_NEED_INSTANCES     0x004u /* shared meshes: two-level tracing */
#define KL_NEED_ENVIRONMENT   0x008u
#define KL_NEED_PUNCTUAL      0x010u /* point, spot or directional lights */
#define KL_NEED_EMITTERS      0x020u /* emissive triangles */
#define KL_NEED_VERTEX_COLORS 0x040u
#define KL_NEED_SPECULAR      0x080u /* some material has a specular lobe */
#define KL_NEED_NORMAL_MAPS   0x100u
#define KL_NEED_ENCLOSING     0x400u /* lights fill much of the view: a sky, glowing walls */
#define KL_NEED_MOTION        0x200u /* not only the camera moves while the shutter is open */

#if defined(KL_FEATURES)
#define KL_NEEDS(scene, f) ((KL_FEATURES) & (f))
#else
#define KL_NEEDS(scene, f) ((scene)->needs & (f))
#endif

typedef struct kl_triangle {
    kl_u32 v[3];     /* vertices, counter-clockwise seen from the front */
    kl_u32 material; /* index into materials */
    kl_u32 object;   /* scene instance this triangle belongs to (merged geometry) or KL_NONE */
    kl_u32 light;    /* index into lights if it emits, else KL_NONE */
} kl_triangle;
KL_ASSERT_SIZE(kl_triangle, 24);

/* A run of triangles under one transform. Instance 0 holds all merged geometry, in render space
 * already, with identity transforms. */
typedef struct kl_instance {
    float render_from_object[12]; /* 3x4 row major */
    float object_from_render[12];
    kl_u32 first_triangle, triangle_count;
    kl_u32 object;   /* scene instance, KL_NONE for instance 0: ask the triangle */
    kl_u32 mirrored; /* 1 if the determinant is negative: winding is flipped */
} kl_instance;
KL_ASSERT_SIZE(kl_instance, 112);

#define KL_TEX_BASE_COLOR     0
#define KL_TEX_METAL_ROUGH    1 /* G roughness, B metallic */
#define KL_TEX_NORMAL         2
#define KL_TEX_EMISSIVE       3
#define KL_TEX_SPECULAR       4 /* A, KHR_materials_specular */
#define KL_TEX_SPECULAR_COLOR 5
#define KL_TEX_SLOTS          6

typedef struct kl_texture_use {
    kl_u32 texture;  /* index into textures, KL_NONE if unused */
    kl_u32 uv_set;   /* 0 or 1 */
    float matrix[6]; /* KHR_texture_transform, 2x3 row major: (u', v') = M (u, v, 1) */
} kl_texture_use;
KL_ASSERT_SIZE(kl_texture_use, 32);

#define KL_MAT_DOUBLE_SIDED 0x1u /* emits from both sides */
#define KL_MAT_UNLIT        0x2u /* KHR_materials_unlit: base colour as it is, no light */
#define KL_MAT_ALPHA_MASK   0x4u
#define KL_MAT_ALPHA_BLEND  0x8u

typedef struct kl_material {
    float base_color[4]; /* linear Rec. 709, and alpha */
    float emission[3];   /* [nit] on the front, strength included */
    float metallic, roughness;
    float alpha_cutoff;
    float normal_scale;
    float specular;          /* KHR_materials_specular factor */
    float specular_color[3]; /* ditto, may exceed 1 */
    float ior;               /* dielectric; 1.5 is glTF's */
    kl_u32 flags;            /* KL_MAT_* */
    kl_u32 pad[3];
    kl_texture_use tex[KL_TEX_SLOTS];
} kl_material;
KL_ASSERT_SIZE(kl_material, 272);

#define KL_WRAP_REPEAT 0u
#define KL_WRAP_CLAMP  1u
#define KL_WRAP_MIRROR 2u

typedef struct kl_texture {
    kl_u32 first_texel; /* into texels: RGBA8, row by row from the top */
    kl_u32 width, height;
    kl_u32 wrap_s, wrap_t; /* KL_WRAP_* */
    kl_u32 nearest;        /* 1: no filtering */
    kl_u32 srgb;           /* 1: RGB decodes through the sRGB curve, A never */
    kl_u32 pad;
} kl_texture;
KL_ASSERT_SIZE(kl_texture, 32);

#define KL_LIGHT_POINT       0u
#define KL_LIGHT_SPOT        1u
#define KL_LIGHT_DIRECTIONAL 2u
#define KL_LIGHT_TRIANGLE    3u
#define KL_LIGHT_ENVIRONMENT 4u

typedef struct kl_light {
    kl_u32 type;      /* KL_LIGHT_* */
    kl_u32 triangle;  /* KL_LIGHT_TRIANGLE: index into triangles (instance 0), else KL_NONE */
    kl_u32 leaf;      /* its node in the light tree; KL_NONE: infinitely far */
    float range;      /* [m] KHR_lights_punctual range, 0 = unlimited */
    float color[3];   /* point, spot: [cd]; directional: [lx]; triangle: [nit] untextured */
    float cone_scale; /* spot: 1 / (cos inner - cos outer) */
    float pos[3];     /* point, spot: position; triangle: vertex 0 [m], render space */
    float cone_cos;   /* spot: cos outer */
    float dir[3];     /* spot, directional: unit, the way the light travels */
    float area;       /* triangle: [m^2] */
    float edge1[3];   /* triangle: v1 - v0 */
    kl_u32 two_sided; /* triangle */
    float edge2[3];   /* triangle: v2 - v0 */
    kl_u32 textured;  /* triangle: emission comes from the material's texture */
} kl_light;
KL_ASSERT_SIZE(kl_light, 96);

/* Binary tree over the lights that are somewhere: Conty Estevez and Kulla, "Importance Sampling of
 * Many Lights with Adaptive Tree Splitting", HPG 2018. Node 0 is the root. */
typedef struct kl_light_node {
    float center[3]; /* of a sphere that holds all lights below */
    float radius;    /* [m] */
    float axis[3];   /* emitting normals lie within a cone about it */
    float cos_cone;  /* -1: any direction */
    float sin_cone;
    float power;      /* of all lights below, luminance */
    kl_u32 parent;    /* KL_NONE at the root */
    kl_u32 child;     /* first of two neighbouring children; KL_NONE at a leaf */
    kl_u32 light;     /* at a leaf */
    kl_u32 two_sided; /* 1: also emits against the cone */
    kl_u32 pad[2];
} kl_light_node;
KL_ASSERT_SIZE(kl_light_node, 64);

/* Lat-long environment: kernels/lights.h holds the mapping. */
typedef struct kl_environment {
    kl_u32 width, height; /* 0 x 0: none */
    kl_u32 light;         /* index into lights */
    float scale;          /* multiplies the texels */
} kl_environment;

/* How an instance moves while the shutter is open: `steps` states at evenly spaced times from
 * opening (0) to closing (1), straight between them. Either matrices, in place of the instance's
 * own, or vertices, in place of the flat arrays'. */
typedef struct kl_moving {
    kl_u32 steps;        /* 0: it does not move; 1: at all times as in its only step */
    kl_u32 deforms;      /* 1: vertices, 0: matrices */
    kl_u32 first;        /* its first matrix, or its first vertex in the step arrays */
    kl_u32 first_vertex; /* vertices: where they are in the flat arrays */
    kl_u32 vertex_count; /* vertices of a step */
} kl_moving;
KL_ASSERT_SIZE(kl_moving, 20);

#define KL_TIME_REFERENCE 0.5f /* shutter centre: where records live */
#define KL_VALUE_STEPS    33   /* states of a light or a material that changes */
#define KL_SHUTTER_TIMES  257  /* of a shutter's curve */

/* The view that every kernel function takes. Not shared bytes: each side fills its own. */
typedef struct kl_scene_view {
    kl_u32 needs;          /* KL_NEED_* */
    kl_u32 light_count;    /* infinitely far ones first */
    kl_u32 far_count;      /* directional lights and the environment */
    float far_probability; /* of choosing among them, uniformly */
    kl_u32 instance_count;
    float scene_radius;               /* [m] of the bounding sphere of everything, > 0 */
    const KL_GLOBAL float *positions; /* 3 per vertex */
    const KL_GLOBAL float *normals;   /* 3 per vertex, unit */
    const KL_GLOBAL float *tangents;  /* 4 per vertex if KL_NEED_NORMAL_MAPS */
    const KL_GLOBAL float *uvs;       /* 4 per vertex (set 0, set 1) if KL_NEED_TEXTURES */
    const KL_GLOBAL float *colors;    /* 4 per vertex if KL_NEED_VERTEX_COLORS */
    const KL_GLOBAL kl_triangle *triangles;
    const KL_GLOBAL kl_instance *instances;
    const KL_GLOBAL kl_material *materials;
    const KL_GLOBAL kl_texture *textures;
    const KL_GLOBAL kl_u32 *texels;
    const KL_GLOBAL float *srgb_table; /* 256 linear values */
    const KL_GLOBAL kl_light *lights;
    const KL_GLOBAL kl_light_node *light_nodes;
    const KL_GLOBAL float *env_texels;  /* 3 per texel, linear */
    const KL_GLOBAL float *env_rows;    /* height + 1: CDF over rows */
    const KL_GLOBAL float *env_columns; /* height x (width + 1): CDF in each row */
    const KL_GLOBAL kl_u32 *touch_bits; /* of lights, then of objects: kernels/parts.h */
    kl_environment env;
    const KL_GLOBAL struct kl_bvh_node *bvh_nodes; /* kernels/bvh.h; NULL: Embree traces */
    const KL_GLOBAL struct kl_bvh_leaf *bvh_leaves;
    const KL_GLOBAL kl_u32 *bvh_roots; /* instance_count roots, then the top level's */
    /* With KL_NEED_MOTION; else not read. */
    const KL_GLOBAL float *shutter_times;    /* KL_SHUTTER_TIMES: when the shutter has let in 0, ...
                                              * all of the light; in [0, 1] */
    const KL_GLOBAL kl_moving *moving;       /* per instance */
    const KL_GLOBAL float *step_matrices;    /* 3x4 row major, render space from object space */
    const KL_GLOBAL float *step_positions;   /* 3 per vertex of a step */
    const KL_GLOBAL float *step_normals;     /* ditto */
    const KL_GLOBAL float *step_tangents;    /* ditto, if KL_NEED_NORMAL_MAPS */
    const KL_GLOBAL kl_u32 *light_motion;    /* per light: KL_NONE: constant; triangle: its
                                              * instance; else its place in step_lights */
    const KL_GLOBAL kl_light *step_lights;   /* KL_VALUE_STEPS each */
    const KL_GLOBAL kl_u32 *material_motion; /* per material: place in step_materials or KL_NONE */
    const KL_GLOBAL kl_material *step_materials; /* KL_VALUE_STEPS each */
#if !KL_DEVICE
    const void *tracer; /* struct kl_tracer of src/trace, read by kl_trace_* on the host */
#endif
} kl_scene_view;

#endif
