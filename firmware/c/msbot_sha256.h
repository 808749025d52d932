/* HMAC-SHA-256 (RFC 2104, FIPS 180-4), for keys of up to 64 octets.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_SHA256_H
#define MSBOT_SHA256_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t state[8];
    uint8_t block[64];
    uint32_t size;
} msbot_sha256;

void msbot_sha256_begin(msbot_sha256 *hash);
void msbot_sha256_add(msbot_sha256 *hash, const void *octets, size_t size);
void msbot_sha256_end(msbot_sha256 *hash, uint8_t digest[32]);

void msbot_hmac_begin(msbot_sha256 *hash, const uint8_t *key, size_t size);
void msbot_hmac_end(msbot_sha256 *hash, const uint8_t *key, size_t size, uint8_t digest[32]);

#ifdef __cplusplus
}
#endif

#endif
