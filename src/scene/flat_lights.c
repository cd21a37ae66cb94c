#include "src/scene/flat_impl.h"

#include "src/base/memory.h"
#include "src/scene/light_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void node_direction(const double m[16], float dir[3])
{
    const double x = -m[8];
    const double y = -m[9];
    const double z = -m[10];
    const double l = sqrt(x * x + y * y + z * z);
    const double s = l > 0.0 ? 1.0 / l : 0.0;
    dir[0] = (float)(x * s);
    dir[1] = (float)(y * s);
    dir[2] = l > 0.0 ? (float)(z * s) : -1.0f;
}

static kl_light punctual_light(const struct kl_scene_light *in, const double m[16],
                               const double origin[3])
{
    kl_light out = {.type = in->type, .triangle = KL_NONE, .leaf = KL_NONE};
    for (int k = 0; k < 3; ++k) {
        out.color[k] = (float)(in->color[k] * in->intensity);
        out.pos[k] = (float)(m[12 + k] - origin[k]);
    }
    node_direction(m, out.dir);
    out.range = (float)in->range;
    const double inner = cos(in->inner_cone);
    const double outer = cos(in->outer_cone);
    out.cone_cos = (float)outer;
    out.cone_scale = (float)(1.0 / fmax(1e-4, inner - outer));
    return out;
}

/* Mean of a material's emissive texture: what choosing lights goes by. */
static kl_vec3 mean_emission(const struct kl_flat *flat, const kl_material *m)
{
    const kl_vec3 factor = kl_v3_load(m->emission);
    const uint32_t number = m->tex[KL_TEX_EMISSIVE].texture;
    double sum[3] = {0.0, 0.0, 0.0};
    if (number == KL_NONE) return factor;
    const kl_texture *t = &flat->textures[number];
    const size_t count = (size_t)t->width * t->height;
    for (size_t i = 0; i < count; ++i) {
        const uint32_t c = flat->texels[t->first_texel + i];
        for (int k = 0; k < 3; ++k) {
            sum[k] += (double)flat->srgb_table[(c >> (8 * k)) & 255u];
        }
    }
    const double scale = count > 0 ? 1.0 / (double)count : 0.0;
    return kl_v3_mul(
        factor, kl_v3((float)(sum[0] * scale), (float)(sum[1] * scale), (float)(sum[2] * scale)));
}

static kl_light triangle_light(const struct kl_flat *flat, uint32_t triangle, kl_vec3 color)
{
    const kl_triangle *t = &flat->triangles[triangle];
    const kl_material *m = &flat->materials[t->material];
    const float *a = flat->positions + 3 * (size_t)t->v[0];
    const float *b = flat->positions + 3 * (size_t)t->v[1];
    const float *c = flat->positions + 3 * (size_t)t->v[2];
    kl_light out = {.type = KL_LIGHT_TRIANGLE, .triangle = triangle};
    double e1[3];
    double e2[3];
    for (int k = 0; k < 3; ++k) {
        e1[k] = (double)b[k] - (double)a[k];
        e2[k] = (double)c[k] - (double)a[k];
        out.pos[k] = a[k];
        out.edge1[k] = (float)e1[k];
        out.edge2[k] = (float)e2[k];
    }
    const double x = e1[1] * e2[2] - e1[2] * e2[1];
    const double y = e1[2] * e2[0] - e1[0] * e2[2];
    const double z = e1[0] * e2[1] - e1[1] * e2[0];
    out.area = (float)(0.5 * sqrt(x * x + y * y + z * z));
    out.color[0] = color.x;
    out.color[1] = color.y;
    out.color[2] = color.z;
    out.two_sided = (m->flags & KL_MAT_DOUBLE_SIDED) != 0;
    out.textured = m->tex[KL_TEX_EMISSIVE].texture != KL_NONE;
    return out;
}

struct light_list {
    kl_light *items;
    uint32_t *sources; /* kl_flat.light_sources */
    size_t count, capacity, source_capacity;
};

static kl_status push_light(struct light_list *list, const kl_light *light, uint32_t source,
                            struct kl_err *err)
{
    kl_status st =
        kl_grow_array(&list->items, &list->capacity, list->count + 1, sizeof *list->items, err);
    if (st == KL_OK) {
        st = kl_grow_array(&list->sources, &list->source_capacity, list->count + 1,
                           sizeof *list->sources, err);
    }
    if (st != KL_OK) return st;
    list->sources[list->count] = source;
    list->items[list->count++] = *light;
    return KL_OK;
}

kl_light kl_flat_punctual(const struct kl_scene *scene, const struct kl_pose *pose, uint32_t light,
                          const double origin[3])
{
    const struct kl_scene_light *in = kl_pose_light(scene, pose, light);
    return punctual_light(in, pose->world_from_node + 16 * (size_t)in->node, origin);
}

/* Punctual lights of visible nodes; `far`: the directional ones or the others. */
static kl_status add_punctual(const struct kl_scene *scene, const struct kl_pose *pose,
                              const struct kl_flat *flat, bool far, struct light_list *list,
                              struct kl_err *err)
{
    for (uint32_t i = 0; i < scene->light_count; ++i) {
        const struct kl_scene_light *in = &scene->lights[i];
        if ((in->type == KL_LIGHT_DIRECTIONAL) != far || !scene->nodes[in->node].visible) continue;
        const kl_light light = kl_flat_punctual(scene, pose, i, flat->origin);
        if (!(kl_light_power(&light) > 0.0f)) continue;
        kl_status st = push_light(list, &light, i, err);
        if (st != KL_OK) return st;
    }
    return KL_OK;
}

static kl_status add_triangles(struct kl_flat *flat, struct light_list *list, struct kl_err *err)
{
    kl_vec3 *means = NULL;
    kl_status st = kl_alloc_array(&means, flat->material_count, sizeof *means, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < flat->material_count; ++i) {
        means[i] = (flat->materials[i].flags & KL_MAT_UNLIT)
                       ? kl_v3_splat(0.0f)
                       : mean_emission(flat, &flat->materials[i]);
    }
    for (uint32_t t = 0; st == KL_OK && t < flat->instances[0].triangle_count; ++t) {
        const kl_vec3 color = means[flat->triangles[t].material];
        if (kl_is_black(color)) continue;
        const kl_light light = triangle_light(flat, t, color);
        if (!(kl_light_power(&light) > 0.0f) || !isfinite(kl_light_power(&light))) continue;
        flat->triangles[t].light = (uint32_t)list->count;
        st = push_light(list, &light, flat->triangles[t].object, err);
    }
    free(means);
    return st;
}

/* Steps of a float CDF below 1 are 6e-8: a texel beside a sun would be lost. */
static const double least_probability = 1.0 / (1 << 20);

/* cdf[0 .. n] from n weights: probabilities proportional to them, where not 0 at least the least
 * one. All 0: uniform. The weights are overwritten. */
static void make_cdf(double *weights, size_t n, float *cdf)
{
    double total = 0.0;
    double raised = 0.0;
    double run = 0.0;

    for (size_t i = 0; i < n; ++i)
        total += weights[i];
    for (size_t i = 0; i < n; ++i) {
        double p = total > 0.0 ? weights[i] / total : 1.0;
        if (weights[i] > 0.0) p = fmax(p, least_probability);
        weights[i] = p;
        raised += p;
    }
    for (size_t i = 0; i < n; ++i) {
        cdf[i] = (float)(run / raised);
        run += weights[i];
    }
    cdf[n] = 1.0f;
}

/* Cumulative sums over columns and rows, weighted by solid angle. */
static kl_status fill_cdfs(struct kl_flat *flat, struct kl_err *err)
{
    const size_t w = flat->view.env.width;
    const size_t h = flat->view.env.height;
    double *columns = NULL;
    kl_status st = kl_alloc_array(&columns, w + h, sizeof *columns, err);

    if (st != KL_OK) return st;
    double *rows = columns + w;
    for (size_t y = 0; y < h; ++y) {
        const double sine = sin(3.14159265358979323846 * ((double)y + 0.5) / (double)h);
        for (size_t x = 0; x < w; ++x) {
            const float *t = flat->env_texels + 3 * (y * w + x);
            columns[x] = (double)t[0] + (double)t[1] + (double)t[2];
            rows[y] += columns[x] * sine;
        }
        make_cdf(columns, w, flat->env_columns + y * (w + 1));
    }
    make_cdf(rows, h, flat->env_rows);
    free(columns);
    return KL_OK;
}

static kl_status add_environment(const struct kl_scene *scene, struct kl_flat *flat, uint32_t light,
                                 struct kl_err *err)
{
    const struct kl_scene_environment *env = &scene->environment;
    const size_t texels = (size_t)env->width * env->height;
    if (texels == 0) return KL_OK;
    kl_status st = kl_alloc_array(&flat->env_texels, 3 * texels, sizeof(float), err);
    if (st == KL_OK) {
        st = kl_alloc_array(&flat->env_rows, (size_t)env->height + 1, sizeof(float), err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&flat->env_columns, ((size_t)env->width + 1) * env->height,
                            sizeof(float), err);
    }
    if (st != KL_OK) return st;
    memcpy(flat->env_texels, env->rgb, 3 * texels * sizeof(float));
    flat->view.env = (kl_environment){env->width, env->height, light, 1.0f};
    flat->view.needs |= KL_NEED_ENVIRONMENT;
    return fill_cdfs(flat, err);
}

/* From this share of the surfaces' area on, glowing ones count as enclosing. */
static const double enclosing_share = 0.05;

static bool lights_enclose(const struct kl_flat *flat)
{
    double glowing = 0.0;
    double all = 0.0;
    if (flat->view.env.width > 0) return true;
    for (uint32_t t = 0; t < flat->instances[0].triangle_count; ++t) {
        const uint32_t light = flat->triangles[t].light;
        const double area = (double)triangle_light(flat, t, kl_v3_splat(0.0f)).area;
        all += area;
        if (light != KL_NONE) glowing += area;
    }
    return glowing > enclosing_share * all;
}

kl_status kl_flat_list_lights(const struct kl_scene *scene, const struct kl_pose *pose,
                              struct kl_flat *flat, struct kl_flat_lights *out, struct kl_err *err)
{
    const kl_light sky = {.type = KL_LIGHT_ENVIRONMENT,
                          .triangle = KL_NONE,
                          .leaf = KL_NONE,
                          .color = {1.0f, 1.0f, 1.0f}};
    struct light_list list = {0};
    kl_status st = add_punctual(scene, pose, flat, true, &list, err);

    if (st == KL_OK && scene->environment.width > 0) st = push_light(&list, &sky, KL_NONE, err);
    const size_t far_count = list.count;
    if (st == KL_OK) st = add_punctual(scene, pose, flat, false, &list, err);
    const size_t near_count = list.count - far_count;
    if (st == KL_OK) st = add_triangles(flat, &list, err);
    *out = (struct kl_flat_lights){list.items, list.sources, (uint32_t)list.count,
                                   (uint32_t)far_count, (uint32_t)near_count};
    if (st != KL_OK) kl_flat_lights_fini(out);
    return st;
}

float kl_flat_far_probability(const struct kl_flat_lights *lights)
{
    if (lights->far_count == 0) return 0.0f;
    return lights->far_count == lights->count ? 1.0f : 0.5f;
}

void kl_flat_lights_fini(struct kl_flat_lights *lights)
{
    free(lights->items);
    free(lights->sources);
    *lights = (struct kl_flat_lights){0};
}

kl_status kl_flat_add_lights(const struct kl_scene *scene, const struct kl_pose *pose,
                             struct kl_flat *flat, struct kl_err *err)
{
    struct kl_flat_lights list;
    kl_status st = kl_flat_list_lights(scene, pose, flat, &list, err);

    if (st != KL_OK) return st;
    st = add_environment(scene, flat, list.far_count - 1, err);
    if (st == KL_OK) {
        st = kl_light_tree_build(list.items, list.far_count, list.count, NULL, &flat->light_nodes,
                                 &flat->light_node_count, err);
    }
    if (st != KL_OK) {
        kl_flat_lights_fini(&list);
        return st;
    }
    flat->lights = list.items;
    flat->light_sources = list.sources;
    flat->light_count = list.count;
    flat->view.light_count = list.count;
    flat->view.far_count = list.far_count;
    flat->view.far_probability = kl_flat_far_probability(&list);
    if (lights_enclose(flat)) flat->view.needs |= KL_NEED_ENCLOSING;
    if (list.far_count + list.near_count > 0) flat->view.needs |= KL_NEED_PUNCTUAL;
    if (list.count > list.far_count + list.near_count) flat->view.needs |= KL_NEED_EMITTERS;
    return KL_OK;
}
