#include "src/app/commands.h"
#include "src/app/json_text.h"
#include "src/app/scene_file.h"
#include "src/scene/digest.h"
#include "src/scene/flat.h"
#include "src/scene/motion.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>

/* Shutters that are looked at, evenly over the animations; their length [s]: a frame's. */
enum { SHUTTERS = 12 };
static const double shutter = 1.0 / 24.0;

/* The most that moves in one of them. */
struct motion {
    uint32_t rigid, deforming, steps, lights, materials;
};

/* A scene with what it needs at time 0. */
struct survey {
    struct kl_scene *scene;
    uint32_t animation;
    bool moving;
    struct motion motion;
    struct kl_pose *pose;
    struct kl_flat *flat;
    uint64_t triangles; /* after instancing */
    double center[3];   /* [m] world */
    char digest[KL_HASH_HEX_SIZE];
    const char *needs[KL_NEED_NAMES];
};

static uint32_t larger(uint32_t a, uint32_t b)
{
    return a > b ? a : b;
}

/* What moves while a shutter is open about an instant. */
static kl_status look_at_shutter(struct survey *s, const double origin[3], double time,
                                 struct kl_err *err)
{
    const struct kl_motion_span span = {time - 0.5 * shutter, time + 0.5 * shutter, NULL};
    struct kl_pose *pose = NULL;
    struct kl_flat *flat = NULL;
    struct kl_motion *m = NULL;
    kl_status st = kl_pose_create(s->scene, s->animation, time, &pose, err);

    if (st == KL_OK) st = kl_flat_create(s->scene, pose, origin, &flat, err);
    if (st == KL_OK) st = kl_motion_create(s->scene, s->animation, pose, flat, &span, &m, err);
    if (st == KL_OK && m != NULL) {
        s->motion = (struct motion){.rigid = larger(s->motion.rigid, m->rigid_count),
                                    .deforming = larger(s->motion.deforming, m->deforming_count),
                                    .steps = larger(s->motion.steps, m->most_steps),
                                    .lights = larger(s->motion.lights, m->moving_lights),
                                    .materials = larger(s->motion.materials, m->moving_materials)};
    }
    kl_motion_destroy(m);
    kl_flat_destroy(flat);
    kl_pose_destroy(pose);
    return st;
}

static kl_status look_at_motion(struct survey *s, const double origin[3], struct kl_err *err)
{
    double duration = 0.0;
    kl_status st = KL_OK;

    for (uint32_t i = 0; i < s->scene->animation_count; ++i) {
        if (s->animation == KL_NONE || s->animation == i) {
            duration = fmax(duration, s->scene->animations[i].duration);
        }
    }
    for (int i = 0; st == KL_OK && s->moving && i < SHUTTERS; ++i) {
        st = look_at_shutter(s, origin, duration * (i + 0.5) / SHUTTERS, err);
    }
    return st;
}

static kl_status look(struct survey *s, const struct kl_options *o, struct kl_err *err)
{
    double origin[3];
    uint8_t digest[KL_HASH_SIZE];
    kl_status st = kl_scene_file_load(o, &s->scene, &s->animation, err);

    if (st == KL_OK) st = kl_pose_create(s->scene, s->animation, 0.0, &s->pose, err);
    if (st == KL_OK) st = kl_flat_choose_origin(s->scene, s->pose, origin, err);
    if (st == KL_OK) st = kl_flat_create(s->scene, s->pose, origin, &s->flat, err);
    if (st != KL_OK) return st;
    s->moving = kl_scene_is_moving(s->scene, s->animation);
    st = look_at_motion(s, origin, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < s->flat->instance_count; ++i) {
        s->triangles += s->flat->instances[i].triangle_count;
    }
    for (int k = 0; k < 3; ++k) {
        s->center[k] = origin[k] + (double)s->flat->center[k];
    }
    kl_flat_digest(s->flat, digest);
    kl_hash_to_hex(digest, sizeof digest, s->digest);
    kl_need_names(s->flat->view.needs | (s->moving ? KL_NEED_MOTION : 0u), s->needs);
    return KL_OK;
}

static void survey_fini(struct survey *s)
{
    kl_flat_destroy(s->flat);
    kl_pose_destroy(s->pose);
    kl_scene_destroy(s->scene);
}

static const char *light_type(uint32_t type)
{
    if (type == KL_LIGHT_POINT) return "point";
    return type == KL_LIGHT_SPOT ? "spot" : "directional";
}

static const char *projection_name(enum kl_projection projection)
{
    return projection == KL_PERSPECTIVE ? "perspective" : "orthographic";
}

static void print_motion(const struct survey *s)
{
    const struct motion *m = &s->motion;
    if (!s->moving) {
        (void)printf("moves       cameras at most\n");
        return;
    }
    (void)printf(
        "moves       %u rigid, %u deforming, %u lights, %u materials; %u steps in 1/24 s at "
        "most\n",
        m->rigid, m->deforming, m->lights, m->materials, m->steps);
}

static void print_text(const struct survey *s)
{
    const struct kl_scene *scene = s->scene;

    (void)printf("scene       %s\n", scene->path);
    (void)printf("digest      %s\n", s->digest);
    (void)printf("geometry    %llu triangles, %u meshes, %u instances",
                 (unsigned long long)s->triangles, scene->mesh_count, scene->instance_count);
    if (scene->dropped_triangles > 0) {
        (void)printf(", %u unusable triangles left out", scene->dropped_triangles);
    }
    (void)printf("\nbounds      centre %.4g %.4g %.4g m, radius %.4g m\n", s->center[0],
                 s->center[1], s->center[2], (double)s->flat->radius);
    (void)printf("materials   %u, with %u textures\n", scene->material_count, scene->texture_count);
    (void)printf("lights      %u (%u in the file's list)\n", s->flat->light_count,
                 scene->light_count);
    if (scene->environment.width > 0) {
        (void)printf("sky         %ux%u\n", scene->environment.width, scene->environment.height);
    }
    for (uint32_t i = 0; i < scene->camera_count; ++i) {
        (void)printf("camera      '%s', %s%s\n", scene->cameras[i].name,
                     projection_name(scene->cameras[i].projection),
                     kl_node_is_animated(scene, s->animation, scene->cameras[i].node) ? ", moves"
                                                                                      : "");
    }
    for (uint32_t i = 0; i < scene->animation_count; ++i) {
        (void)printf("animation   '%s', %.4g s, %u channels\n", scene->animations[i].name,
                     scene->animations[i].duration, scene->animations[i].channel_count);
    }
    print_motion(s);
    (void)printf("needs       ");
    for (size_t i = 0; s->needs[i] != NULL; ++i) {
        (void)printf("%s%s", i > 0 ? ", " : "", s->needs[i]);
    }
    (void)printf("%s\n", s->needs[0] == NULL ? "nothing special" : "");
}

static json_t *describe_motion(const struct motion *m)
{
    return json_pack("{s:I,s:I,s:I,s:I,s:I}", "rigid", (json_int_t)m->rigid, "deforming",
                     (json_int_t)m->deforming, "lights", (json_int_t)m->lights, "materials",
                     (json_int_t)m->materials, "steps", (json_int_t)m->steps);
}

/* Appends to lists ignore failures: json_pack in describe then gets fewer entries only where memory
 * is out, and kl_json_write reports that. */
static json_t *describe_cameras(const struct survey *s)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < s->scene->camera_count; ++i) {
        const struct kl_scene_camera *c = &s->scene->cameras[i];
        (void)json_array_append_new(
            list, json_pack("{s:s,s:s,s:f,s:b}", "name", c->name, "projection",
                            projection_name(c->projection), "yfov", c->yfov, "moves",
                            (int)kl_node_is_animated(s->scene, s->animation, c->node)));
    }
    return list;
}

static json_t *describe_lights(const struct survey *s)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < s->scene->light_count; ++i) {
        const struct kl_scene_light *l = &s->scene->lights[i];
        (void)json_array_append_new(list,
                                    json_pack("{s:s,s:s,s:f}", "name", l->name, "type",
                                              light_type(l->type), "intensity", l->intensity));
    }
    return list;
}

static json_t *describe_animations(const struct survey *s)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < s->scene->animation_count; ++i) {
        const struct kl_animation *a = &s->scene->animations[i];
        (void)json_array_append_new(list, json_pack("{s:s,s:f,s:I}", "name", a->name, "duration",
                                                    a->duration, "channels",
                                                    (json_int_t)a->channel_count));
    }
    return list;
}

static json_t *describe(const struct survey *s)
{
    const struct kl_scene *scene = s->scene;
    json_t *needs = json_array();

    for (size_t i = 0; s->needs[i] != NULL; ++i) {
        (void)json_array_append_new(needs, json_string(s->needs[i]));
    }
    return json_pack(
        "{s:s,s:s,s:I,s:I,s:I,s:I,s:I,s:I,s:I,s:{s:[fff],s:f},s:o,s:o,s:o,s:b,s:o,s:o,s:[ii]}",
        "path", scene->path, "digest", s->digest, "triangles", (json_int_t)s->triangles,
        "dropped_triangles", (json_int_t)scene->dropped_triangles, "meshes",
        (json_int_t)scene->mesh_count, "instances", (json_int_t)scene->instance_count, "materials",
        (json_int_t)scene->material_count, "textures", (json_int_t)scene->texture_count, "lights",
        (json_int_t)s->flat->light_count, "bounds", "center", s->center[0], s->center[1],
        s->center[2], "radius", (double)s->flat->radius, "cameras", describe_cameras(s),
        "punctual_lights", describe_lights(s), "animations", describe_animations(s), "moving",
        (int)s->moving, "motion", describe_motion(&s->motion), "needs", needs, "sky",
        (int)scene->environment.width, (int)scene->environment.height);
}

static kl_status write_json(const struct survey *s, const char *path, struct kl_err *err)
{
    json_t *root = describe(s);
    if (root == NULL) return kl_fail(err, KL_ERR_NO_MEMORY, "scene: out of memory");
    kl_status st = kl_json_write(root, path, err);
    json_decref(root);
    return st;
}

kl_status kl_command_scene(const struct kl_options *options, struct kl_err *err)
{
    struct survey survey = {0};
    kl_status st = look(&survey, options, err);

    if (st == KL_OK && options->json) st = write_json(&survey, options->json_file, err);
    if (st == KL_OK && (!options->json || options->json_file != NULL)) print_text(&survey);
    survey_fini(&survey);
    return st;
}
