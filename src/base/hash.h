/* XXH3, 128 and 64 bits: digests and checksums against accidents, not against attackers. The same
 * bytes give the same result on every machine. */
#ifndef KL_SRC_BASE_HASH_H
#define KL_SRC_BASE_HASH_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define KL_HASH_ALIGN alignas(64)
extern "C" {
#else
#define KL_HASH_ALIGN _Alignas(64)
#endif

enum { KL_HASH_SIZE = 16, KL_HASH_HEX_SIZE = 2 * KL_HASH_SIZE + 1 };

/* A running hash. Padding counts like any other byte: feed fields, not structs with holes. */
struct kl_hash {
    KL_HASH_ALIGN unsigned char state[576]; /* XXH3_state_t */
};

void kl_hash_init(struct kl_hash *hash);
/* `data` may be NULL where `size` is 0. */
void kl_hash_update(struct kl_hash *hash, const void *data, size_t size);
/* The digest so far, big-endian as XXH128 prints it; more updates may follow. */
void kl_hash_finish(const struct kl_hash *hash, uint8_t digest[KL_HASH_SIZE]);

/* XXH3 of one block: the checksum of cache files. */
uint64_t kl_hash_block(const void *data, size_t size);

/* Lower-case hexadecimal and a zero byte: `text` holds 2 * size + 1. */
void kl_hash_to_hex(const uint8_t *digest, size_t size, char *text);

#ifdef __cplusplus
}
#endif
#endif
