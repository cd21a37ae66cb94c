#include "src/app/rig.h"

#include "src/app/flight.h"
#include "src/app/folders.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double default_yfov = 0.7;  /* [rad], 40 degrees */
static const double default_start = 0.6; /* [rad] a view from the front, a little from the right */

struct kl_rig {
    const struct kl_scene *scene;
    const struct kl_renderer *renderer;
    const struct kl_options *options;
    uint32_t camera; /* of the scene, if flight is NULL */
    struct kl_flight *flight;
    bool stands; /* the flight is one view for all frames */
};

/* Vertical field of view of the scene's first perspective camera. */
static double scene_yfov(const struct kl_scene *scene)
{
    for (uint32_t i = 0; i < scene->camera_count; ++i) {
        if (scene->cameras[i].projection == KL_PERSPECTIVE) return scene->cameras[i].yfov;
    }
    return default_yfov;
}

static kl_status find_camera(const struct kl_scene *scene, const char *name, uint32_t *out,
                             struct kl_err *err)
{
    char list[256] = "none";
    size_t used = 0;

    for (uint32_t i = 0; i < scene->camera_count; ++i) {
        if (strcmp(scene->cameras[i].name, name) == 0) {
            *out = i;
            return KL_OK;
        }
        const int n = snprintf(list + used, sizeof list - used, "%s'%s'", used > 0 ? ", " : "",
                               scene->cameras[i].name);
        if (n > 0 && used + (size_t)n < sizeof list) used += (size_t)n;
    }
    return kl_fail(err, KL_ERR_USAGE, "--camera: no camera '%s' in the scene, which has: %s", name,
                   list);
}

static kl_status create_orbit(struct kl_rig *rig, struct kl_renderer *renderer, struct kl_err *err)
{
    const struct kl_options *o = rig->options;
    struct kl_flight_orbit orbit = {.yfov = scene_yfov(rig->scene),
                                    .aspect = (double)o->width / (double)o->height,
                                    .start = rig->stands ? default_start : 0.0,
                                    .count = rig->stands ? 1 : o->turntable};
    kl_status st = kl_renderer_set_time(renderer, 0.0, err);

    if (st != KL_OK) return st;
    kl_renderer_get_bounds(renderer, orbit.center, &orbit.radius);
    return kl_flight_create_orbit(&orbit, &rig->flight, err);
}

/* --turntable for the camera. */
static bool orbits(const struct kl_options *o)
{
    return o->turntable > 0 && !o->object_turns;
}

kl_status kl_rig_create(const struct kl_scene *scene, struct kl_renderer *renderer,
                        const struct kl_options *options, struct kl_rig **out, struct kl_err *err)
{
    const struct kl_options *o = options;
    struct kl_rig *rig = NULL;
    kl_status st = kl_alloc_array(&rig, 1, sizeof *rig, err);

    if (st != KL_OK) return st;
    rig->scene = scene;
    rig->renderer = renderer;
    rig->options = options;
    if (o->path != NULL) {
        st = kl_file_expect(o->path, "--path: ", err);
        if (st == KL_OK) {
            st = kl_flight_create_path(o->path, kl_fps_get(o->fps), scene_yfov(scene), &rig->flight,
                                       err);
        }
    } else if (o->camera != NULL) {
        st = find_camera(scene, o->camera, &rig->camera, err);
    } else if (orbits(o) || scene->camera_count == 0) {
        rig->stands = !orbits(o);
        st = create_orbit(rig, renderer, err);
    }
    if (st != KL_OK) {
        kl_rig_destroy(rig);
        return st;
    }
    *out = rig;
    return KL_OK;
}

void kl_rig_destroy(struct kl_rig *rig)
{
    if (rig == NULL) return;
    kl_flight_destroy(rig->flight);
    free(rig);
}

/* First and last key of the chosen animations; false where there is none. */
static bool animation_range(const struct kl_scene *scene, uint32_t animation, double *first,
                            double *last)
{
    bool found = false;

    for (uint32_t a = 0; a < scene->animation_count; ++a) {
        const struct kl_animation *anim = &scene->animations[a];
        if (animation != KL_NONE && animation != a) continue;
        for (uint32_t c = 0; c < anim->channel_count; ++c) {
            const struct kl_animation_channel *channel = &anim->channels[c];
            const double begin = (double)channel->times[0];
            const double end = (double)channel->times[channel->key_count - 1];
            *first = found ? fmin(*first, begin) : begin;
            *last = found ? fmax(*last, end) : end;
            found = true;
        }
    }
    return found;
}

/* Whether one frame differs from the next: a still camera in a still scene needs one. */
static bool moves(const struct kl_rig *rig, uint32_t animation)
{
    return kl_renderer_is_moving(rig->renderer) || kl_rig_moves(rig, animation);
}

kl_status kl_rig_frames(const struct kl_rig *rig, uint32_t animation, struct kl_frames *out,
                        struct kl_err *err)
{
    const struct kl_options *o = rig->options;
    const double fps = kl_fps_get(o->fps);
    /* Keys are floats: a key that is meant to be on a frame may miss it by this much. */
    const double slack = 1e-3;
    double first = 1.0 / fps;
    double last = first;
    char text[64];

    if (o->has_frames) {
        kl_status st = kl_alloc_array(&out->frames, o->frames.count, sizeof *out->frames, err);
        if (st != KL_OK) return st;
        memcpy(out->frames, o->frames.frames, o->frames.count * sizeof *out->frames);
        out->count = o->frames.count;
        return KL_OK;
    }
    if (o->turntable > 0) {
        last = (double)o->turntable / fps;
    } else if (o->path != NULL) {
        kl_flight_get_range(rig->flight, &first, &last);
    } else if (moves(rig, animation)) {
        (void)animation_range(rig->scene, animation, &first, &last);
    }
    const double from = ceil(first * fps - slack);
    const double to = fmax(from, floor(last * fps + slack));
    if (fabs(from) > KL_FRAME_LIMIT || fabs(to) > KL_FRAME_LIMIT) {
        return kl_fail(err, KL_ERR_USAGE, "the animation is too long; choose --frames");
    }
    (void)snprintf(text, sizeof text, "%.0f-%.0f", from + 0.0, to + 0.0);
    return kl_frames_parse(text, out, err);
}

struct kl_interval kl_rig_interval(const struct kl_rig *rig, int32_t frame)
{
    const struct kl_options *o = rig->options;
    return kl_shutter_interval(&o->shutter, o->fps, frame);
}

bool kl_rig_moves(const struct kl_rig *rig, uint32_t animation)
{
    return rig->flight != NULL
               ? !rig->stands
               : kl_node_is_animated(rig->scene, animation, rig->scene->cameras[rig->camera].node);
}

kl_status kl_rig_camera(const struct kl_rig *rig, int32_t frame, double fraction,
                        struct kl_camera *out, struct kl_err *err)
{
    const struct kl_options *o = rig->options;
    const struct kl_shutter instant = {0.0, fraction};
    struct kl_look view;
    double origin[3];

    if (rig->flight == NULL) {
        const double time = kl_shutter_interval(&instant, o->fps, frame).reference;
        return kl_renderer_camera(rig->renderer, rig->camera, time, o->width, o->height, out, err);
    }
    kl_flight_get_view(rig->flight, rig->stands ? 1 : frame, rig->stands ? 0.0 : fraction, &view);
    kl_renderer_get_origin(rig->renderer, origin);
    *out =
        kl_camera_look_at(view.eye, view.target, view.up, view.yfov, origin, o->width, o->height);
    return KL_OK;
}

int64_t kl_rig_sample_number(const struct kl_rig *rig, int32_t frame)
{
    const int64_t count = rig->options->turntable;
    return count > 0 ? ((frame - 1) % count + count) % count + 1 : frame;
}
