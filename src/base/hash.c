#include "src/base/hash.h"

#define XXH_INLINE_ALL /* compiled with our flags, so it uses the vectors of this machine */
#include <xxhash.h>

#include <string.h>

_Static_assert(sizeof(XXH3_state_t) <= sizeof(struct kl_hash), "state does not fit");
_Static_assert(_Alignof(XXH3_state_t) <= _Alignof(struct kl_hash), "state is not aligned");

static XXH3_state_t *state_get(struct kl_hash *hash)
{
    return (XXH3_state_t *)(void *)hash->state;
}

void kl_hash_init(struct kl_hash *hash)
{
    memset(hash, 0, sizeof *hash);
    (void)XXH3_128bits_reset(state_get(hash));
}

void kl_hash_update(struct kl_hash *hash, const void *data, size_t size)
{
    if (size > 0) (void)XXH3_128bits_update(state_get(hash), data, size);
}

void kl_hash_finish(const struct kl_hash *hash, uint8_t digest[KL_HASH_SIZE])
{
    struct kl_hash copy = *hash;
    XXH128_canonical_t canonical;

    XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state_get(&copy)));
    memcpy(digest, canonical.digest, KL_HASH_SIZE);
}

uint64_t kl_hash_block(const void *data, size_t size)
{
    return size > 0 ? XXH3_64bits(data, size) : XXH3_64bits("", 0);
}

void kl_hash_to_hex(const uint8_t *digest, size_t size, char *text)
{
    static const char digits[] = "0123456789abcdef";

    for (size_t i = 0; i < size; ++i) {
        text[2 * i] = digits[digest[i] >> 4];
        text[2 * i + 1] = digits[digest[i] & 15];
    }
    text[2 * size] = '\0';
}
