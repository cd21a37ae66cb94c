/* What a cache depends on, as numbers that change when it changes. */
#ifndef KL_SRC_SCENE_DIGEST_H
#define KL_SRC_SCENE_DIGEST_H

#include "src/base/hash.h"
#include "src/scene/flat.h"

/* Of everything that light transport sees at this instant: geometry, materials, textures, lights,
 * environment, relative to the origin. Cameras do not count. */
void kl_flat_digest(const struct kl_flat *flat, uint8_t digest[KL_HASH_SIZE]);

#endif
