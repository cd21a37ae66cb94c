/* The scene as the file means it, in plain C, independent of the file format. Built once by
 * src/import, then constant: any number of threads may read it.
 *
 * Spaces: "object" is a mesh's own space, "world" is glTF's world [m], +Y up, right-handed. World
 * matrices are double, so that a scene far from the origin loses nothing. Time is in seconds.
 * Colours are linear Rec. 709. */
#ifndef KL_SRC_SCENE_SCENE_H
#define KL_SRC_SCENE_SCENE_H

#include "kernels/scene_data.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { KL_MAX_UV_SETS = 2 };

/* One glTF primitive: triangles of one material. All indices are checked, all floats finite, all
 * normals unit length; degenerate triangles are gone. Arrays are owned by the scene. */
struct kl_mesh {
    char *name;        /* never NULL */
    uint32_t material; /* index into kl_scene.materials, always valid */
    uint32_t vertex_count, triangle_count;
    float *positions;          /* 3 per vertex [m] */
    float *normals;            /* 3 per vertex; made flat or smooth where the file has none */
    float *tangents;           /* 4 per vertex (w = handedness) if the material has a normal map */
    float *uv[KL_MAX_UV_SETS]; /* 2 per vertex or NULL */
    float *colors;             /* 4 per vertex linear RGBA or NULL */
    uint32_t *indices;         /* 3 per triangle, < vertex_count */
    /* Morph targets: displacements, target-major (target t, vertex v, xyz). */
    uint32_t morph_count;
    float *morph_positions, *morph_normals, *morph_tangents; /* 3 per vertex per target, or NULL */
    /* Skin weights, 4 influences per joint set: joint numbers of the instance's skin. */
    uint32_t influence_count; /* 0, 4 or 8 per vertex */
    uint16_t *joints;         /* influence_count per vertex, < the skin's joint count */
    float *weights;           /* influence_count per vertex, sums to 1 */
};

struct kl_node {
    char *name;        /* never NULL */
    uint32_t parent;   /* index into nodes, always < this node's own; or KL_NONE */
    bool has_matrix;   /* local transform is `matrix`, else T * R * S */
    double matrix[16]; /* column major, as glTF writes it */
    double translation[3], rotation[4] /* x y z w, unit */, scale[3];
    uint32_t weight_count; /* default morph weights of the node's mesh */
    double *weights;
    bool visible; /* in the scene that is rendered */
    bool turns;   /* it and all below stand on the plate: kl_scene_set_plate */
};

/* A mesh at a node. A glTF mesh of n primitives at a node is n instances. */
struct kl_scene_instance {
    uint32_t mesh, node;
    uint32_t skin;   /* index into skins or KL_NONE */
    uint32_t object; /* number of the node among mesh nodes: the `id` AOV */
};

struct kl_skin {
    uint32_t joint_count;
    uint32_t *joints;     /* node indices */
    double *inverse_bind; /* 16 per joint, column major */
};

enum kl_projection { KL_PERSPECTIVE, KL_ORTHOGRAPHIC };

struct kl_scene_camera {
    char *name; /* the node's name, else the camera's, else "camera N" */
    uint32_t node;
    uint32_t source; /* number in the file's list: what animations name */
    enum kl_projection projection;
    double yfov;        /* [rad] perspective */
    double aspect;      /* width / height, 0 if the file leaves it to the image */
    double xmag, ymag;  /* [m] orthographic: half width and height */
    double znear, zfar; /* [m], zfar 0 = infinite */
};

struct kl_scene_light { /* KHR_lights_punctual */
    char *name;
    uint32_t node;                 /* shines along the node's own -Z */
    uint32_t source;               /* number in the file's list: what animations name */
    uint32_t type;                 /* KL_LIGHT_POINT, _SPOT or _DIRECTIONAL */
    double color[3], intensity;    /* point and spot [cd], directional [lx] */
    double range;                  /* [m], 0 = unlimited */
    double inner_cone, outer_cone; /* [rad] */
};

struct kl_scene_image { /* RGBA8, rows from the top, as encoded in the file */
    char *name;
    uint32_t width, height;
    uint8_t *texels; /* 4 * width * height */
};

struct kl_scene_texture {
    uint32_t image;          /* index into images */
    uint32_t wrap_s, wrap_t; /* KL_WRAP_* */
    bool nearest;            /* magnification without filtering */
};

enum kl_interpolation { KL_STEP, KL_LINEAR, KL_CUBIC_SPLINE };
enum kl_channel_path {
    KL_TRANSLATION,
    KL_ROTATION,
    KL_SCALE,
    KL_WEIGHTS,
    /* KHR_animation_pointer. Lights and cameras by their `source`: */
    KL_LIGHT_COLOR,
    KL_LIGHT_INTENSITY,
    KL_LIGHT_RANGE,
    KL_LIGHT_INNER_CONE,
    KL_LIGHT_OUTER_CONE,
    KL_CAMERA_YFOV,
    KL_CAMERA_XMAG,
    KL_CAMERA_YMAG,
    /* Materials by their number: */
    KL_MATERIAL_BASE_COLOR,
    KL_MATERIAL_METALLIC,
    KL_MATERIAL_ROUGHNESS,
    KL_MATERIAL_NORMAL_SCALE,
    KL_MATERIAL_ALPHA_CUTOFF,
    KL_MATERIAL_EMISSIVE_FACTOR,
    KL_MATERIAL_EMISSIVE_STRENGTH,
    KL_MATERIAL_IOR,
    KL_MATERIAL_SPECULAR,
    KL_MATERIAL_SPECULAR_COLOR,
};
static inline bool kl_path_is_of_node(enum kl_channel_path path)
{
    return path <= KL_WEIGHTS;
}

struct kl_animation_channel {
    uint32_t node; /* or light, camera, material: as the path has it */
    enum kl_channel_path path;
    enum kl_interpolation interpolation;
    uint32_t key_count; /* >= 1 */
    uint32_t width;     /* values per key: 1, 3, 4 or the number of weights */
    float *times;       /* [s], strictly increasing */
    float *values;      /* width per key; cubic: in-tangent, value, out-tangent */
};

struct kl_animation {
    char *name;
    double duration; /* [s] last key */
    uint32_t channel_count;
    struct kl_animation_channel *channels;
};

struct kl_scene_environment {
    uint32_t width, height; /* 0 x 0: none */
    float *rgb;             /* 3 per texel, rows from the top (+Y), all finite, >= 0 */
};

struct kl_scene_glow {
    float factor[3], strength;
};

/* A plate that turns once about +Y in `count` frames; frame 1 is as the file has it. */
struct kl_plate {
    uint32_t count;   /* 0: no plate */
    double fps;       /* [1/s] */
    double centre[3]; /* [m] world: the axis goes through it */
};

struct kl_scene {
    char *path;
    struct kl_plate plate;
    uint32_t mesh_count, node_count, instance_count, skin_count, camera_count, light_count;
    uint32_t material_count, image_count, texture_count, animation_count;
    struct kl_mesh *meshes;
    struct kl_node *nodes;               /* parents before children */
    struct kl_scene_instance *instances; /* only those of visible nodes */
    struct kl_skin *skins;
    struct kl_scene_camera *cameras;
    struct kl_scene_light *lights;
    kl_material *materials;      /* the shared form; tex[].texture indexes `textures` */
    struct kl_scene_glow *glows; /* per material: emission is their product */
    struct kl_scene_image *images;
    struct kl_scene_texture *textures;
    struct kl_animation *animations;
    struct kl_scene_environment environment;
    uint32_t dropped_triangles; /* degenerate or not finite */
};

/* Put what the scene shows on a plate that turns once in `count` frames, for ever: frame count + 1
 * is frame 1 bit for bit where nothing else moves. All top-level nodes with a mesh or a skeleton
 * turn, with what hangs on them; lamps (whose meshes only glow), punctual lights and cameras that
 * are top-level nodes stay. */
kl_status kl_scene_set_plate(struct kl_scene *scene, double fps, uint32_t count,
                             struct kl_err *err) KL_MUST_CHECK;
/* World from world on the plate at `time` [s]. */
void kl_plate_matrix(const struct kl_plate *turn, double time, double out[16]);

/* Frees everything; accepts NULL. */
void kl_scene_destroy(struct kl_scene *scene);

/* The scene at one instant: where every node is, and what else animations change. */
struct kl_pose {
    uint32_t node_count;
    double *world_from_node; /* 16 per node, column major */
    double **weights;        /* morph weights per node, NULL where the node has none */
    /* The scene's arrays as they are now; NULL where no animation changes any of them. Names in
     * them are borrowed. */
    struct kl_scene_light *lights;
    struct kl_scene_camera *cameras;
    kl_material *materials;
};

static inline const struct kl_scene_light *kl_pose_light(const struct kl_scene *scene,
                                                         const struct kl_pose *pose, uint32_t i)
{
    return pose->lights != NULL ? &pose->lights[i] : &scene->lights[i];
}
static inline const struct kl_scene_camera *kl_pose_camera(const struct kl_scene *scene,
                                                           const struct kl_pose *pose, uint32_t i)
{
    return pose->cameras != NULL ? &pose->cameras[i] : &scene->cameras[i];
}
static inline const kl_material *kl_pose_material(const struct kl_scene *scene,
                                                  const struct kl_pose *pose, uint32_t i)
{
    return pose->materials != NULL ? &pose->materials[i] : &scene->materials[i];
}

/* Evaluate all animations (or, with `animation` not KL_NONE, that one) at `time` [s]; before the
 * first and after the last key a channel holds its end value. glTF 2.0 section 3.11 and appendix C.
 * *out is then the caller's: kl_pose_destroy. Fails only for lack of memory. */
kl_status kl_pose_create(const struct kl_scene *scene, uint32_t animation, double time,
                         struct kl_pose **out, struct kl_err *err) KL_MUST_CHECK;
void kl_pose_destroy(struct kl_pose *pose); /* accepts NULL */

/* Vertices of a mesh after morphing (weights) and skinning. For a skinned instance the result is
 * in world space (glTF ignores the node's own transform then), else in object space. */
struct kl_deformed {
    bool in_world;
    double *positions; /* 3 per vertex; double, as they may be world coordinates */
    float *normals;    /* 3 per vertex, unit */
    float *tangents;   /* 4 per vertex or NULL */
};
bool kl_instance_is_deformed(const struct kl_scene *scene, uint32_t instance);
kl_status kl_instance_deform(const struct kl_scene *scene, const struct kl_pose *pose,
                             uint32_t instance, struct kl_deformed *out,
                             struct kl_err *err) KL_MUST_CHECK;
void kl_deformed_fini(struct kl_deformed *deformed);

/* Whether node `n` (or an ancestor), or what hangs on it, changes over time in the animations
 * chosen. */
bool kl_node_is_animated(const struct kl_scene *scene, uint32_t animation, uint32_t node);
/* Whether instance `i` moves or deforms in the animations chosen. */
bool kl_instance_is_animated(const struct kl_scene *scene, uint32_t animation, uint32_t instance);
/* Whether anything but cameras changes: instances, punctual lights, morph weights, skins,
 * materials. */
bool kl_scene_is_moving(const struct kl_scene *scene, uint32_t animation);

#ifdef __cplusplus
}
#endif
#endif
