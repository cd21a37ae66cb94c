#include "hard_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void *must(void *memory)
{
    if (memory == NULL) fail_msg("out of memory");
    return memory;
}

static char *name_of(const char *what, uint32_t number)
{
    char text[32];
    (void)snprintf(text, sizeof text, "%s %u", what, number);
    return must(strdup(text));
}

static void *grow(void *array, uint32_t count, size_t size)
{
    char *a = must(realloc(array, (count + 1) * size));
    memset(a + count * size, 0, size);
    return a;
}

struct kl_scene *hard_scene(void)
{
    struct kl_scene *s = must(calloc(1, sizeof *s));
    s->path = must(strdup("made in memory"));
    return s;
}

uint32_t hard_material(struct kl_scene *scene, double albedo, double emission)
{
    scene->materials = grow(scene->materials, scene->material_count, sizeof *scene->materials);
    kl_material *m = &scene->materials[scene->material_count];
    *m = (kl_material){.roughness = 1.0f, .ior = 1.5f, .normal_scale = 1.0f, .alpha_cutoff = 0.5f};
    for (int k = 0; k < 3; ++k) {
        m->base_color[k] = (float)albedo;
        m->emission[k] = (float)emission;
    }
    m->base_color[3] = 1.0f;
    for (int k = 0; k < KL_TEX_SLOTS; ++k) {
        m->tex[k] = (kl_texture_use){.texture = KL_NONE, .matrix = {1, 0, 0, 0, 1, 0}};
    }
    return scene->material_count++;
}

uint32_t hard_node(struct kl_scene *scene, const double matrix[16])
{
    scene->nodes = grow(scene->nodes, scene->node_count, sizeof *scene->nodes);
    struct kl_node *n = &scene->nodes[scene->node_count];
    *n = (struct kl_node){.name = name_of("node", scene->node_count),
                          .parent = KL_NONE,
                          .has_matrix = matrix != NULL,
                          .rotation = {0, 0, 0, 1},
                          .scale = {1, 1, 1},
                          .visible = true};
    if (matrix != NULL) memcpy(n->matrix, matrix, sizeof n->matrix);
    return scene->node_count++;
}

static struct kl_mesh *add_mesh(struct kl_scene *scene, uint32_t node, uint32_t material,
                                uint32_t vertices, uint32_t triangles)
{
    const uint32_t number = scene->mesh_count;
    scene->meshes = grow(scene->meshes, number, sizeof *scene->meshes);
    scene->instances = grow(scene->instances, scene->instance_count, sizeof *scene->instances);
    struct kl_mesh *m = &scene->meshes[number];
    *m = (struct kl_mesh){.name = name_of("mesh", number),
                          .material = material,
                          .vertex_count = vertices,
                          .positions = must(calloc(vertices + 4, 3 * sizeof(float))),
                          .normals = must(calloc(vertices + 4, 3 * sizeof(float))),
                          .indices = must(calloc(triangles, 3 * sizeof(uint32_t)))};
    uint32_t object = 0; /* number of the node among mesh nodes */
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        if (scene->instances[i].node == node) {
            object = scene->instances[i].object;
            break;
        }
        if (scene->instances[i].object >= object) object = scene->instances[i].object + 1;
    }
    scene->instances[scene->instance_count++] =
        (struct kl_scene_instance){.mesh = number, .node = node, .skin = KL_NONE, .object = object};
    ++scene->mesh_count;
    return m;
}

static void put_vertex(struct kl_mesh *m, uint32_t i, const double p[3], const double n[3])
{
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int k = 0; k < 3; ++k) {
        m->positions[3 * i + (uint32_t)k] = (float)p[k];
        m->normals[3 * i + (uint32_t)k] = (float)(n[k] / length);
    }
}

static void put_triangle(struct kl_mesh *m, uint32_t a, uint32_t b, uint32_t c)
{
    const uint32_t corners[3] = {a, b, c};
    memcpy(m->indices + 3 * (size_t)m->triangle_count++, corners, sizeof corners);
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; ++k) {
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
    }
}

static void put_quad(struct kl_mesh *m, uint32_t first, const double corner[3], const double u[3],
                     const double v[3])
{
    double n[3];
    cross(u, v, n);
    for (uint32_t i = 0; i < 4; ++i) {
        double p[3];
        for (int k = 0; k < 3; ++k) {
            p[k] = corner[k] + (i == 1 || i == 2 ? u[k] : 0.0) + (i >= 2 ? v[k] : 0.0);
        }
        put_vertex(m, first + i, p, n);
    }
    put_triangle(m, first, first + 1, first + 2);
    put_triangle(m, first, first + 2, first + 3);
}

void hard_quad(struct kl_scene *scene, uint32_t node, uint32_t material, const double corner[3],
               const double edge_u[3], const double edge_v[3])
{
    put_quad(add_mesh(scene, node, material, 4, 2), 0, corner, edge_u, edge_v);
}

void hard_box(struct kl_scene *scene, uint32_t node, uint32_t material, const double lo[3],
              const double hi[3], bool inward)
{
    struct kl_mesh *m = add_mesh(scene, node, material, 24, 12);
    for (int face = 0; face < 6; ++face) {
        const int axis = face / 2;
        const int a = (axis + 1) % 3;
        const int b = (axis + 2) % 3;
        const bool high = face % 2;
        double corner[3], u[3] = {0}, v[3] = {0};
        for (int k = 0; k < 3; ++k)
            corner[k] = lo[k];
        if (high) corner[axis] = hi[axis];
        u[a] = hi[a] - lo[a];
        v[b] = hi[b] - lo[b];
        if (high != inward) {
            put_quad(m, 4 * (uint32_t)face, corner, u, v);
        } else {
            put_quad(m, 4 * (uint32_t)face, corner, v, u);
        }
    }
}

static void sphere_point(uint32_t i, uint32_t j, uint32_t rings, double out[3])
{
    const double t = HARD_PI * i / rings;
    const double p = HARD_PI * (j % (2 * rings)) / rings;
    out[0] = i == 0 || i == rings ? 0.0 : sin(t) * cos(p);
    out[1] = i == 0 ? 1.0 : i == rings ? -1.0 : cos(t);
    out[2] = i == 0 || i == rings ? 0.0 : -sin(t) * sin(p);
}

/* A triangle of its own vertices, so that it may be flat. */
static void put_facet(struct kl_mesh *m, double unit[3][3], const double center[3], double radius,
                      bool smooth, bool inward)
{
    const uint32_t first = 3 * m->triangle_count;
    double e[2][3], n[3];
    for (int k = 0; k < 3; ++k) {
        e[0][k] = unit[1][k] - unit[0][k];
        e[1][k] = unit[2][k] - unit[0][k];
    }
    cross(e[0], e[1], n);
    for (uint32_t v = 0; v < 3; ++v) {
        double p[3], normal[3];
        for (int k = 0; k < 3; ++k) {
            p[k] = center[k] + radius * unit[v][k];
            normal[k] = (inward ? -1.0 : 1.0) * (smooth ? unit[v][k] : n[k]);
        }
        put_vertex(m, first + v, p, normal);
    }
    put_triangle(m, first, first + (inward ? 2 : 1), first + (inward ? 1 : 2));
}

void hard_sphere(struct kl_scene *scene, uint32_t node, uint32_t material, const double center[3],
                 double radius, uint32_t rings, bool smooth, bool inward)
{
    const uint32_t triangles = 4 * rings * (rings - 1);
    struct kl_mesh *m = add_mesh(scene, node, material, 3 * triangles, triangles);
    for (uint32_t i = 0; i < rings; ++i) {
        for (uint32_t j = 0; j < 2 * rings; ++j) {
            double q[4][3], facet[3][3];
            sphere_point(i, j, rings, q[0]);
            sphere_point(i + 1, j, rings, q[1]);
            sphere_point(i + 1, j + 1, rings, q[2]);
            sphere_point(i, j + 1, rings, q[3]);
            if (i + 1 < rings) {
                memcpy(facet, q, sizeof facet);
                put_facet(m, facet, center, radius, smooth, inward);
            }
            if (i == 0) continue;
            memcpy(facet[0], q[0], sizeof facet[0]);
            memcpy(facet[1], q[2], sizeof facet[1]);
            memcpy(facet[2], q[3], sizeof facet[2]);
            put_facet(m, facet, center, radius, smooth, inward);
        }
    }
}

uint32_t hard_camera(struct kl_scene *scene, const double eye[3], const double target[3],
                     double yfov)
{
    double back[3], right[3], up[3] = {0, 1, 0}, m[16] = {0};
    double length = 0.0;
    for (int k = 0; k < 3; ++k) {
        back[k] = eye[k] - target[k];
        length += back[k] * back[k];
    }
    for (int k = 0; k < 3; ++k)
        back[k] /= sqrt(length);
    if (fabs(back[1]) > 0.99) {
        up[1] = 0.0;
        up[2] = -1.0;
    }
    cross(up, back, right);
    length = sqrt(right[0] * right[0] + right[1] * right[1] + right[2] * right[2]);
    for (int k = 0; k < 3; ++k)
        right[k] /= length;
    cross(back, right, up);
    for (int k = 0; k < 3; ++k) {
        m[k] = right[k];
        m[4 + k] = up[k];
        m[8 + k] = back[k];
        m[12 + k] = eye[k];
    }
    m[15] = 1.0;
    const uint32_t node = hard_node(scene, m);
    scene->cameras = grow(scene->cameras, scene->camera_count, sizeof *scene->cameras);
    scene->cameras[scene->camera_count] = (struct kl_scene_camera){
        .name = name_of("camera", scene->camera_count), .node = node, .yfov = yfov, .znear = 1e-3};
    return scene->camera_count++;
}

void hard_forget_cameras(struct kl_scene *scene)
{
    while (scene->camera_count > 0)
        free(scene->cameras[--scene->camera_count].name);
}

void hard_sky(struct kl_scene *scene, uint32_t width, uint32_t height, double radiance)
{
    const size_t values = 3 * (size_t)width * height;
    scene->environment = (struct kl_scene_environment){
        .width = width, .height = height, .rgb = must(malloc(values * sizeof(float)))};
    for (size_t i = 0; i < values; ++i)
        scene->environment.rgb[i] = (float)radiance;
}

void hard_sun(struct kl_scene *scene, const double way[3], double illuminance)
{
    const double any[3] = {way[1], way[2], way[0]}; /* not along it, unless all are the same */
    double m[16] = {0}, x[3], y[3], length = 0.0;
    cross(any, way, x);
    for (int k = 0; k < 3; ++k)
        length += x[k] * x[k];
    for (int k = 0; k < 3; ++k) {
        m[k] = x[k] /= sqrt(length);
        m[8 + k] = -way[k]; /* it shines along -Z */
    }
    cross(m + 8, x, y);
    memcpy(m + 4, y, sizeof y);
    m[15] = 1.0;
    const uint32_t node = hard_node(scene, m);
    scene->lights = grow(scene->lights, scene->light_count, sizeof *scene->lights);
    scene->lights[scene->light_count] =
        (struct kl_scene_light){.name = name_of("light", scene->light_count),
                                .node = node,
                                .source = scene->light_count,
                                .type = KL_LIGHT_DIRECTIONAL,
                                .color = {1, 1, 1},
                                .intensity = illuminance};
    ++scene->light_count;
}

void hard_animate(struct kl_scene *scene, uint32_t node, enum kl_channel_path path, uint32_t count,
                  const float *times, const float *values)
{
    if (scene->animation_count == 0) {
        scene->animations = grow(NULL, 0, sizeof *scene->animations);
        scene->animations[0].name = name_of("animation", scene->animation_count++);
    }
    struct kl_animation *a = &scene->animations[0];
    const uint32_t width = path == KL_ROTATION ? 4 : 3;
    a->channels = grow(a->channels, a->channel_count, sizeof *a->channels);
    struct kl_animation_channel *c = &a->channels[a->channel_count++];
    *c = (struct kl_animation_channel){.node = node,
                                       .path = path,
                                       .interpolation = KL_LINEAR,
                                       .key_count = count,
                                       .width = width,
                                       .times = must(malloc(count * sizeof(float))),
                                       .values = must(malloc(count * width * sizeof(float)))};
    memcpy(c->times, times, count * sizeof(float));
    memcpy(c->values, values, count * width * sizeof(float));
    a->duration = fmax(a->duration, (double)times[count - 1]);
}

void hard_move(struct kl_scene *scene, double scale, const double offset[3])
{
    const double m[16] = {scale, 0, 0,     0, 0,         scale,     0,         0,
                          0,     0, scale, 0, offset[0], offset[1], offset[2], 1};
    scene->nodes = must(realloc(scene->nodes, (scene->node_count + 1) * sizeof *scene->nodes));
    memmove(scene->nodes + 1, scene->nodes, scene->node_count * sizeof *scene->nodes);
    ++scene->node_count;
    scene->nodes[0] = (struct kl_node){.name = must(strdup("all")),
                                       .parent = KL_NONE,
                                       .has_matrix = true,
                                       .scale = {1, 1, 1},
                                       .visible = true};
    memcpy(scene->nodes[0].matrix, m, sizeof m);
    for (uint32_t i = 1; i < scene->node_count; ++i) {
        struct kl_node *n = &scene->nodes[i];
        n->parent = n->parent == KL_NONE ? 0 : n->parent + 1;
    }
    for (uint32_t i = 0; i < scene->instance_count; ++i)
        ++scene->instances[i].node;
    for (uint32_t i = 0; i < scene->camera_count; ++i) {
        ++scene->cameras[i].node;
        scene->cameras[i].znear *= scale;
    }
    for (uint32_t i = 0; i < scene->light_count; ++i)
        ++scene->lights[i].node;
}

struct kl_scene *hard_room(void)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t tall_node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.6, 0.0);
    const uint32_t dark = hard_material(s, 0.3, 0.0);
    const uint32_t lamp = hard_material(s, 0.0, 10.0);
    const uint32_t white = hard_material(s, 0.8, 0.0);

    for (int k = 0; k < 3; ++k) {
        s->materials[grey].base_color[k] = (float[]){0.75f, 0.55f, 0.4f}[k];
    }
    hard_box(s, node, grey, (double[]){-1, -1, -1}, (double[]){1, 1, 1}, true);
    hard_quad(s, node, lamp, (double[]){-0.4, 0.98, -0.4}, (double[]){0.8, 0, 0},
              (double[]){0, 0, 0.8});
    hard_box(s, node, white, (double[]){0.1, -1, -0.1}, (double[]){0.7, -0.4, 0.5}, false);
    hard_box(s, tall_node, dark, (double[]){-0.7, -1, -0.7}, (double[]){-0.1, 0.2, -0.1}, false);
    (void)hard_camera(s, (double[]){0, 0, 0.95}, (double[]){0, -0.1, 0}, 1.4);
    return s;
}

static void check(kl_status st, const struct kl_err *err)
{
    if (st != KL_OK) fail_msg("%s", err->msg);
}

void hard_begin(struct hard_stage *stage, struct kl_scene *scene, enum kl_indirect indirect,
                double error, uint32_t rays, bool carry)
{
    const struct kl_renderer_settings settings = {.indirect = indirect,
                                                  .device = "embree",
                                                  .error = error,
                                                  .rays = rays,
                                                  .animation = KL_NONE,
                                                  .carry = carry};
    struct kl_err err = {0};

    *stage = (struct hard_stage){.scene = scene, .indirect = indirect};
    check(kl_renderer_create(scene, &settings, &stage->renderer, &err), &err);
}

void hard_go(struct hard_stage *stage, double time, double shutter)
{
    const struct kl_renderer_instants instants = {.reference = time,
                                                  .open = time - 0.5 * shutter,
                                                  .close = time + 0.5 * shutter,
                                                  .before = stage->time};
    struct kl_err err = {0};

    check(kl_renderer_set_instants(stage->renderer, &instants, &err), &err);
    stage->time = time;
    if (stage->indirect != KL_INDIRECT_CACHE) return;
    check(kl_renderer_open_cache(stage->renderer, stage->store, KL_STORE_EXTEND, &err), &err);
}

void hard_open(struct hard_stage *stage, struct kl_scene *scene, enum kl_indirect indirect,
               double error, uint32_t rays)
{
    hard_begin(stage, scene, indirect, error, rays, false);
    hard_go(stage, 0.0, 0.0);
}

void hard_close(struct hard_stage *stage)
{
    kl_renderer_destroy(stage->renderer);
    kl_scene_destroy(stage->scene);
}

struct kl_image *hard_render(struct hard_stage *stage, uint32_t camera, uint32_t width,
                             uint32_t height, uint32_t spp)
{
    struct kl_renderer_frame frame = {.frame = 1, .spp = spp};
    struct kl_image *image = NULL;
    struct kl_err err = {0};

    check(kl_renderer_camera(stage->renderer, camera, stage->time, width, height, &frame.camera,
                             &err),
          &err);
    frame.before = frame.camera;
    const struct kl_renderer_fill fill = {
        .cameras = &frame.camera, .camera_count = 1, .keep = stage->store != NULL};
    if (stage->indirect == KL_INDIRECT_CACHE) {
        check(kl_renderer_fill(stage->renderer, &fill, &stage->stats, &err), &err);
    }
    check(kl_image_create(width, height, &image, &err), &err);
    check(kl_frame_add_layers(image, "all", &err), &err);
    check(kl_renderer_frame(stage->renderer, &frame, image, &stage->counts, &stage->bad, &err),
          &err);
    return image;
}

struct kl_image *hard_image(struct kl_scene *scene, enum kl_indirect indirect, uint32_t side,
                            uint32_t spp, uint32_t *records)
{
    struct hard_stage stage;
    struct kl_cache_state state;

    hard_open(&stage, scene, indirect, 0.1, 256); /* coarse, so quick */
    struct kl_image *image = hard_render(&stage, 0, side, side, spp);
    if (records != NULL) kl_renderer_get_cache(stage.renderer, &state);
    if (records != NULL) *records = state.records[0] + state.records[1];
    assert_int_equal(stage.bad, 0);
    hard_close(&stage);
    return image;
}

static const uint32_t *ids_of(const struct kl_image *image)
{
    const struct kl_channel *c = kl_image_find(image, "id");
    assert_non_null(c);
    return c->uints;
}

static const float *channel_of(const struct kl_image *image, const char *name)
{
    const struct kl_channel *c = kl_image_find(image, name);
    if (c == NULL) fail_msg("no channel %s", name);
    return c->data;
}

struct hard_spread hard_measure(const struct kl_image *image, const char *channel)
{
    const float *data = channel_of(image, channel);
    const uint32_t *ids = ids_of(image);
    struct hard_spread s = {.lowest = HUGE_VAL, .highest = -HUGE_VAL};
    double square = 0.0;

    for (size_t i = 0; i < (size_t)image->width * image->height; ++i) {
        if (ids[i] == KL_NONE) continue;
        const double v = (double)data[i];
        s.mean += v;
        square += v * v;
        s.lowest = fmin(s.lowest, v);
        s.highest = fmax(s.highest, v);
        ++s.pixels;
    }
    assert_true(s.pixels > 0);
    s.mean /= s.pixels;
    s.deviation = sqrt(fmax(0.0, square / s.pixels - s.mean * s.mean));
    return s;
}

double hard_difference(const struct kl_image *a, const struct kl_image *b, const char *channel,
                       double *ratio)
{
    const float *p = channel_of(a, channel);
    const float *q = channel_of(b, channel);
    const uint32_t *ids_a = ids_of(a);
    const uint32_t *ids_b = ids_of(b);
    double sum_a = 0.0, sum_b = 0.0, square = 0.0;
    size_t n = 0;

    assert_int_equal(a->width * a->height, b->width * b->height);
    for (size_t i = 0; i < (size_t)a->width * a->height; ++i) {
        if (ids_a[i] == KL_NONE || ids_b[i] == KL_NONE) continue;
        const double d = (double)p[i] - (double)q[i];
        sum_a += (double)p[i];
        sum_b += (double)q[i];
        square += d * d;
        ++n;
    }
    assert_true(n > 0 && sum_b > 0.0);
    if (ratio != NULL) *ratio = sum_a / sum_b;
    return sqrt(square / (double)n) / (sum_b / (double)n);
}

void hard_expect(const char *what, double value, double wanted, double tolerance)
{
    print_message("%s: %.6g, wanted %.6g +- %.2g\n", what, value, wanted, tolerance);
    if (!(fabs(value - wanted) <= tolerance)) fail_msg("%s", what);
}
