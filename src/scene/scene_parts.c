#include "src/scene/scene_parts.h"

#include "src/base/hash.h"
#include "src/base/memory.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- digests ---- */

static void add(struct kl_hash *h, const void *data, size_t count, size_t size)
{
    const uint64_t n = data != NULL ? count : 0;
    kl_hash_update(h, &n, sizeof n);
    kl_hash_update(h, data, (size_t)n * size);
}

/* 64 bits of a digest; never 0, which means "nothing of the kind". */
static void finish(const struct kl_hash *h, kl_u32 out[2])
{
    uint8_t digest[KL_HASH_SIZE];
    kl_hash_finish(h, digest);
    memcpy(out, digest, 8);
    if (out[0] == 0 && out[1] == 0) out[0] = 1;
}

static void add_digest(struct kl_hash *h, const kl_u32 digest[2])
{
    kl_hash_update(h, digest, 2 * sizeof *digest);
}

static void digest_mesh(const struct kl_mesh *m, kl_u32 out[2])
{
    const size_t v = m->vertex_count;
    struct kl_hash h;

    kl_hash_init(&h);
    add(&h, m->positions, 3 * v, sizeof *m->positions);
    add(&h, m->normals, 3 * v, sizeof *m->normals);
    add(&h, m->tangents, 4 * v, sizeof *m->tangents);
    for (int set = 0; set < KL_MAX_UV_SETS; ++set) {
        add(&h, m->uv[set], 2 * v, sizeof *m->uv[set]);
    }
    add(&h, m->indices, 3 * (size_t)m->triangle_count, sizeof *m->indices);
    add(&h, m->morph_positions, 3 * v * m->morph_count, sizeof(float));
    add(&h, m->morph_normals, 3 * v * m->morph_count, sizeof(float));
    add(&h, m->morph_tangents, 3 * v * m->morph_count, sizeof(float));
    add(&h, m->joints, v * m->influence_count, sizeof *m->joints);
    add(&h, m->weights, v * m->influence_count, sizeof *m->weights);
    finish(&h, out);
}

static void add_texture(struct kl_hash *h, const struct kl_scene *scene, const kl_texture_use *use,
                        const kl_u32 (*images)[2])
{
    if (use->texture == KL_NONE) return;
    const struct kl_scene_texture *t = &scene->textures[use->texture];
    const uint32_t numbers[] = {t->wrap_s, t->wrap_t, t->nearest, use->uv_set};
    kl_hash_update(h, numbers, sizeof numbers);
    kl_hash_update(h, use->matrix, sizeof use->matrix);
    add_digest(h, images[t->image]);
}

static void digest_surface(const struct kl_scene *scene, const kl_material *material,
                           const kl_u32 (*images)[2], kl_u32 out[2])
{
    kl_material m = *material;
    struct kl_hash h;

    memset(m.emission, 0, sizeof m.emission);
    memset(m.tex, 0, sizeof m.tex);
    kl_hash_init(&h);
    kl_hash_update(&h, &m, sizeof m);
    for (uint32_t slot = 0; slot < KL_TEX_SLOTS; ++slot) {
        if (slot == KL_TEX_EMISSIVE) continue;
        kl_hash_update(&h, &slot, sizeof slot);
        add_texture(&h, scene, &material->tex[slot], images);
    }
    finish(&h, out);
}

static bool is_black(const float c[3])
{
    return !(c[0] > 0.0f) && !(c[1] > 0.0f) && !(c[2] > 0.0f);
}

static void digest_glow(const struct kl_scene *scene, const kl_material *m,
                        const kl_u32 (*images)[2], kl_u32 out[2])
{
    struct kl_hash h;

    out[0] = 0;
    out[1] = 0;
    if (is_black(m->emission) || (m->flags & KL_MAT_UNLIT)) return;
    kl_hash_init(&h);
    const uint32_t two_sided = m->flags & KL_MAT_DOUBLE_SIDED;
    kl_hash_update(&h, m->emission, sizeof m->emission);
    kl_hash_update(&h, &two_sided, sizeof two_sided);
    add_texture(&h, scene, &m->tex[KL_TEX_EMISSIVE], images);
    finish(&h, out);
}

/* Where a surface lets light through belongs to its shape. All 0: nowhere. */
static void digest_holes(const struct kl_scene *scene, const kl_material *m,
                         const kl_u32 (*images)[2], kl_u32 out[2])
{
    const uint32_t mode = m->flags & (KL_MAT_ALPHA_MASK | KL_MAT_ALPHA_BLEND);
    struct kl_hash h;

    out[0] = 0;
    out[1] = 0;
    if (mode == 0) return;
    kl_hash_init(&h);
    kl_hash_update(&h, &mode, sizeof mode);
    kl_hash_update(&h, &m->alpha_cutoff, sizeof m->alpha_cutoff);
    kl_hash_update(&h, &m->base_color[3], sizeof m->base_color[3]);
    add_texture(&h, scene, &m->tex[KL_TEX_BASE_COLOR], images);
    finish(&h, out);
}

/* Digests that several objects share. */
struct shared {
    kl_u32 (*meshes)[2], (*surfaces)[2], (*glows)[2], (*holes)[2], (*images)[2];
};

static void shared_fini(struct shared *s)
{
    free(s->meshes);
    free(s->surfaces);
    free(s->glows);
    free(s->holes);
    free(s->images);
}

static kl_status shared_init(const struct kl_scene *scene, struct shared *s, struct kl_err *err)
{
    *s = (struct shared){0};
    kl_status st = kl_alloc_array(&s->meshes, scene->mesh_count, sizeof *s->meshes, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&s->surfaces, scene->material_count, sizeof *s->surfaces, err);
    }
    if (st == KL_OK) st = kl_alloc_array(&s->glows, scene->material_count, sizeof *s->glows, err);
    if (st == KL_OK) st = kl_alloc_array(&s->holes, scene->material_count, sizeof *s->holes, err);
    if (st == KL_OK) st = kl_alloc_array(&s->images, scene->image_count, sizeof *s->images, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < scene->image_count; ++i) {
        const struct kl_scene_image *image = &scene->images[i];
        const uint32_t size[] = {image->width, image->height};
        struct kl_hash h;
        kl_hash_init(&h);
        kl_hash_update(&h, size, sizeof size);
        add(&h, image->texels, 4 * (size_t)image->width * image->height, 1);
        finish(&h, s->images[i]);
    }
    const kl_u32(*images)[2] = (const kl_u32(*)[2])s->images;
    for (uint32_t i = 0; i < scene->material_count; ++i) {
        digest_surface(scene, &scene->materials[i], images, s->surfaces[i]);
        digest_glow(scene, &scene->materials[i], images, s->glows[i]);
        digest_holes(scene, &scene->materials[i], images, s->holes[i]);
    }
    for (uint32_t i = 0; i < scene->mesh_count; ++i) {
        digest_mesh(&scene->meshes[i], s->meshes[i]);
    }
    return KL_OK;
}

/* ---- parts ---- */

static void set_name(kl_part *part, uint32_t kind, const char *name)
{
    part->kind = kind;
    /* The label is for people: cut between characters of UTF-8, and no control characters. */
    size_t n = 0;
    while (n + 1 < KL_PART_LABEL && name[n] != '\0') {
        part->label[n] = (char)((unsigned char)name[n] < 32 ? '?' : name[n]);
        ++n;
    }
    if (name[n] != '\0') {
        while (n > 0 && ((unsigned char)name[n] & 0xc0) == 0x80) {
            part->label[--n] = '\0';
        }
    }
}

/* Names for comparing: the n-th of a name is another one than the first. */
struct full_name {
    const char *name;
    uint32_t kind, part;
};

static int compare_names(const void *a, const void *b)
{
    const struct full_name *x = a;
    const struct full_name *y = b;
    if (x->kind != y->kind) return x->kind < y->kind ? -1 : 1;
    const int order = strcmp(x->name, y->name);
    if (order != 0) return order;
    return (x->part > y->part) - (x->part < y->part);
}

static void identify(kl_part *parts, struct full_name *names, uint32_t count)
{
    uint32_t same = 0;
    qsort(names, count, sizeof *names, compare_names);
    for (uint32_t i = 0; i < count; ++i) {
        const bool again = i > 0 && names[i].kind == names[i - 1].kind &&
                           strcmp(names[i].name, names[i - 1].name) == 0;
        same = again ? same + 1 : 0;
        struct kl_hash h;
        kl_hash_init(&h);
        kl_hash_update(&h, &names[i].kind, sizeof names[i].kind);
        kl_hash_update(&h, names[i].name, strlen(names[i].name) + 1);
        kl_hash_update(&h, &same, sizeof same);
        finish(&h, parts[names[i].part].name);
    }
}

/* Where an instance is: its node, and what bends it. */
static void add_place(struct kl_hash *h, const struct kl_scene *scene, const struct kl_pose *pose,
                      uint32_t i)
{
    const struct kl_scene_instance *inst = &scene->instances[i];
    const struct kl_node *node = &scene->nodes[inst->node];

    if (inst->skin == KL_NONE) {
        kl_hash_update(h, pose->world_from_node + 16 * (size_t)inst->node, 16 * sizeof(double));
    } else {
        const struct kl_skin *skin = &scene->skins[inst->skin];
        add(h, skin->inverse_bind, 16 * (size_t)skin->joint_count, sizeof(double));
        for (uint32_t k = 0; k < skin->joint_count; ++k) {
            kl_hash_update(h, pose->world_from_node + 16 * (size_t)skin->joints[k],
                           16 * sizeof(double));
        }
    }
    if (scene->meshes[inst->mesh].morph_count > 0 && pose->weights[inst->node] != NULL) {
        add(h, pose->weights[inst->node], node->weight_count, sizeof(double));
    }
}

/* Instances of one object follow each other. Returns where the next object starts. */
static uint32_t digest_object(const struct kl_scene *scene, const struct kl_pose *pose,
                              const struct shared *shared, uint32_t first, kl_part *part)
{
    struct kl_hash shape;
    struct kl_hash place;
    struct kl_hash surface;
    struct kl_hash glow;
    bool glows = false;
    float power = 0.0f;
    uint32_t i = first;

    kl_hash_init(&shape);
    kl_hash_init(&place);
    kl_hash_init(&surface);
    kl_hash_init(&glow);
    for (;
         i < scene->instance_count && scene->instances[i].object == scene->instances[first].object;
         ++i) {
        const struct kl_mesh *mesh = &scene->meshes[scene->instances[i].mesh];
        add_digest(&shape, shared->meshes[scene->instances[i].mesh]);
        add_digest(&shape, shared->holes[mesh->material]);
        add_place(&place, scene, pose, i);
        add_digest(&surface, shared->surfaces[mesh->material]);
        add(&surface, mesh->colors, 4 * (size_t)mesh->vertex_count, sizeof *mesh->colors);
        add_digest(&glow, shared->glows[mesh->material]);
        power += kl_luminance(kl_v3_load(scene->materials[mesh->material].emission));
        glows =
            glows || shared->glows[mesh->material][0] != 0 || shared->glows[mesh->material][1] != 0;
    }
    finish(&shape, part->shape);
    finish(&place, part->place);
    finish(&surface, part->surface);
    if (glows) finish(&glow, part->glow);
    part->power = fminf(power, FLT_MAX);
    return i;
}

static void digest_light(const struct kl_scene_light *light, const struct kl_pose *pose,
                         kl_part *part)
{
    struct kl_hash h;

    kl_hash_init(&h);
    kl_hash_update(&h, &light->type, sizeof light->type);
    kl_hash_update(&h, &light->range, sizeof light->range);
    if (light->type == KL_LIGHT_SPOT) {
        kl_hash_update(&h, &light->inner_cone, sizeof light->inner_cone);
        kl_hash_update(&h, &light->outer_cone, sizeof light->outer_cone);
    }
    finish(&h, part->shape);
    kl_hash_init(&h);
    kl_hash_update(&h, pose->world_from_node + 16 * (size_t)light->node, 16 * sizeof(double));
    finish(&h, part->place);
    kl_hash_init(&h);
    for (int k = 0; k < 3; ++k) {
        const double power = light->color[k] * light->intensity;
        kl_hash_update(&h, &power, sizeof power);
    }
    if (light->intensity > 0.0) finish(&h, part->glow);
    const double luminance =
        0.2126 * light->color[0] + 0.7152 * light->color[1] + 0.0722 * light->color[2];
    part->power = (float)fmin(fmax(light->intensity * luminance, 0.0), (double)FLT_MAX);
}

static void digest_environment(const struct kl_flat *flat, kl_part *part)
{
    const kl_environment *env = &flat->view.env;
    const uint32_t size[] = {env->width, env->height};
    struct kl_hash h;

    kl_hash_init(&h);
    kl_hash_update(&h, size, sizeof size);
    kl_hash_update(&h, &env->scale, sizeof env->scale);
    add(&h, flat->env_texels, 3 * (size_t)env->width * env->height, sizeof(float));
    finish(&h, part->glow);
}

static void grow_box(kl_part *part, kl_vec3 p)
{
    const float q[3] = {p.x, p.y, p.z};
    for (int k = 0; k < 3; ++k) {
        part->box_min[k] = fminf(part->box_min[k], q[k]);
        part->box_max[k] = fmaxf(part->box_max[k], q[k]);
    }
}

/* Boxes of the triangles as they are traced. */
static void set_boxes(const struct kl_flat *flat, kl_part *parts, uint32_t objects)
{
    for (uint32_t i = 0; i < objects; ++i) {
        for (int k = 0; k < 3; ++k) {
            parts[i].box_min[k] = FLT_MAX;
            parts[i].box_max[k] = -FLT_MAX;
        }
    }
    for (uint32_t i = 0; i < flat->instance_count; ++i) {
        const kl_instance *inst = &flat->instances[i];
        for (uint32_t t = 0; t < 3 * inst->triangle_count; ++t) {
            const kl_triangle *tri = &flat->triangles[inst->first_triangle + t / 3];
            const uint32_t object = inst->object != KL_NONE ? inst->object : tri->object;
            if (object >= objects) continue;
            grow_box(&parts[object],
                     kl_affine_point(inst->render_from_object,
                                     kl_v3_load(flat->positions + 3 * (size_t)tri->v[t % 3])));
        }
    }
    for (uint32_t i = 0; i < objects; ++i) {
        for (int k = 0; k < 3; ++k) {
            if (parts[i].box_min[k] <= parts[i].box_max[k]) continue;
            parts[i].box_min[k] = 0.0f; /* an object without triangles */
            parts[i].box_max[k] = 0.0f;
        }
    }
}

static uint32_t count_objects(const struct kl_scene *scene)
{
    const uint32_t n = scene->instance_count;
    return n > 0 ? scene->instances[n - 1].object + 1 : 0;
}

static void fill_parts(const struct kl_scene *scene, const struct kl_pose *pose,
                       const struct kl_flat *flat, const struct shared *shared,
                       struct full_name *names, struct kl_scene_parts *out)
{
    kl_part *parts = out->items;
    uint32_t n = out->object_count;

    for (uint32_t i = 0; i < n; ++i) {
        parts[i].kind = KL_PART_OBJECT; /* also where a node's mesh has nothing to draw */
        names[i] = (struct full_name){"", KL_PART_OBJECT, i};
    }
    for (uint32_t i = 0; i < scene->instance_count;) {
        const struct kl_scene_instance *inst = &scene->instances[i];
        const char *name = scene->nodes[inst->node].name;
        set_name(&parts[inst->object], KL_PART_OBJECT, name);
        names[inst->object].name = name;
        i = digest_object(scene, pose, shared, i, &parts[inst->object]);
    }
    for (uint32_t i = 0; i < scene->light_count; ++i) {
        if (!scene->nodes[scene->lights[i].node].visible) continue;
        set_name(&parts[n], KL_PART_LIGHT, scene->lights[i].name);
        names[n] = (struct full_name){scene->lights[i].name, KL_PART_LIGHT, n};
        digest_light(kl_pose_light(scene, pose, i), pose, &parts[n++]);
    }
    if (flat->view.env.width > 0) {
        set_name(&parts[n], KL_PART_ENVIRONMENT, "");
        names[n] = (struct full_name){"", KL_PART_ENVIRONMENT, n};
        digest_environment(flat, &parts[n++]);
    }
    out->count = n;
    identify(parts, names, n);
    set_boxes(flat, parts, out->object_count);
}

/* Tell rays which bit stands for what they meet. Lights of the scene that give no light have a part
 * but no place among the flat ones. */
static void set_touch_bits(const struct kl_scene *scene, const struct kl_scene_parts *parts,
                           struct kl_flat *flat)
{
    const uint32_t lights = flat->light_count;

    for (uint32_t i = 0; i < parts->object_count; ++i) {
        flat->touch_bits[lights + i] = kl_part_hit_bit(&parts->items[i]);
    }
    for (uint32_t i = 0; i < lights; ++i) {
        const uint32_t source = flat->light_sources[i];
        uint32_t part = parts->object_count;
        if (flat->lights[i].type == KL_LIGHT_ENVIRONMENT) {
            flat->touch_bits[i] = KL_TOUCH_ENVIRONMENT;
            continue;
        }
        if (flat->lights[i].type == KL_LIGHT_TRIANGLE) {
            part = source;
        } else {
            for (uint32_t k = 0; k < source; ++k) {
                part += scene->nodes[scene->lights[k].node].visible;
            }
        }
        flat->touch_bits[i] = kl_part_light_bit(&parts->items[part]);
    }
}

kl_status kl_parts_init(const struct kl_scene *scene, const struct kl_pose *pose,
                        struct kl_flat *flat, struct kl_scene_parts *out, struct kl_err *err)
{
    const uint32_t objects = count_objects(scene);
    const uint64_t most = (uint64_t)objects + scene->light_count + 2;
    struct full_name *names = NULL;
    struct shared shared = {0};

    *out = (struct kl_scene_parts){.object_count = objects};
    if (most > KL_PARTS_MAX) return KL_OK;
    kl_status st = kl_alloc_array(&out->items, (size_t)most, sizeof *out->items, err);
    if (st == KL_OK) st = kl_alloc_array(&names, (size_t)most, sizeof *names, err);
    if (st == KL_OK) st = shared_init(scene, &shared, err);
    if (st == KL_OK) {
        fill_parts(scene, pose, flat, &shared, names, out);
        set_touch_bits(scene, out, flat);
    }
    shared_fini(&shared);
    free(names);
    if (st != KL_OK) kl_parts_fini(out);
    return st;
}

void kl_parts_add_settings(struct kl_scene_parts *parts, const char *label)
{
    if (parts->items == NULL) return;
    set_name(&parts->items[parts->count++], KL_PART_SETTINGS, label);
}

void kl_parts_fini(struct kl_scene_parts *parts)
{
    free(parts->items);
    *parts = (struct kl_scene_parts){0};
}
