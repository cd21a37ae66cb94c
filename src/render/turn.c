#include "src/render/turn.h"

#include "src/base/clock.h"
#include "src/base/hash.h"

#include <string.h>
#include <time.h>

static const double renew_s = 0.2 * KL_CLAIM_LIFE_S;

static uint64_t hash_work(const struct kl_camera *cameras, uint32_t count)
{
    struct kl_hash hash;
    uint8_t digest[KL_HASH_SIZE];
    uint64_t work = 0;

    kl_hash_init(&hash);
    for (uint32_t i = 0; i < count; ++i) {
        const struct kl_camera *c = &cameras[i];
        const uint32_t numbers[] = {c->width, c->height, c->orthographic};
        const float floats[] = {c->eye.x,      c->eye.y,      c->eye.z,     c->right.x,
                                c->right.y,    c->right.z,    c->up.x,      c->up.y,
                                c->up.z,       c->forward.x,  c->forward.y, c->forward.z,
                                c->half_width, c->half_height};
        kl_hash_update(&hash, numbers, sizeof numbers);
        kl_hash_update(&hash, floats, sizeof floats);
    }
    kl_hash_finish(&hash, digest);
    memcpy(&work, digest, sizeof work);
    return work;
}

kl_status kl_turn_begin(struct kl_turn *turn, const struct kl_store *store,
                        const struct kl_camera *cameras, uint32_t camera_count, struct kl_err *err)
{
    static const struct timespec nap = {0, 250000000};
    const uint64_t work = hash_work(cameras, camera_count);
    bool taken = false;

    for (;;) {
        turn->claim = kl_claim_take(store, work, &taken);
        if (taken) break;
        if (turn->progress != NULL && turn->progress(turn->progress_context, 0, 0.0, 0)) {
            return kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
        }
        (void)nanosleep(&nap, NULL);
    }
    turn->renewed = kl_seconds();
    return KL_OK;
}

bool kl_turn_note(void *turn, int stage, double done, uint32_t records)
{
    struct kl_turn *t = turn;
    const double now = kl_seconds();

    if (now - t->renewed > renew_s) {
        kl_claim_renew(t->claim);
        t->renewed = now;
    }
    return t->progress != NULL && t->progress(t->progress_context, stage, done, records);
}

void kl_turn_end(struct kl_turn *turn)
{
    kl_claim_release(turn->claim);
    turn->claim = NULL;
}
