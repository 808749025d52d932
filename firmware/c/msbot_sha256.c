/* HMAC-SHA-256: see msbot_sha256.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_sha256.h"

#include <string.h>

static const uint32_t ROUND[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5, 0xd807aa98,
    0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174, 0xe49b69c1, 0xefbe4786,
    0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da, 0x983e5152, 0xa831c66d, 0xb00327c8,
    0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967, 0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13,
    0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85, 0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819,
    0xd6990624, 0xf40e3585, 0x106aa070, 0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a,
    0x5b9cca4f, 0x682e6ff3, 0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7,
    0xc67178f2};

static const uint32_t START[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                  0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};

static uint32_t turn(uint32_t value, unsigned bits) { return value >> bits | value << (32 - bits); }

static void mix(msbot_sha256 *hash)
{
    uint32_t words[64];
    uint32_t s[8];
    for (size_t i = 0; i < 16; i++) {
        const uint8_t *octets = hash->block + 4 * i;
        words[i] = (uint32_t)octets[0] << 24 | (uint32_t)octets[1] << 16 | (uint32_t)octets[2] << 8 | octets[3];
    }
    for (size_t i = 16; i < 64; i++) {
        uint32_t early = words[i - 15];
        uint32_t late = words[i - 2];
        words[i] = words[i - 16] + words[i - 7] + (turn(early, 7) ^ turn(early, 18) ^ early >> 3) +
                   (turn(late, 17) ^ turn(late, 19) ^ late >> 10);
    }
    memcpy(s, hash->state, sizeof s);
    for (size_t i = 0; i < 64; i++) {
        uint32_t choice = (s[4] & s[5]) ^ (~s[4] & s[6]);
        uint32_t majority = (s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]);
        uint32_t one = s[7] + (turn(s[4], 6) ^ turn(s[4], 11) ^ turn(s[4], 25)) + choice + ROUND[i] + words[i];
        uint32_t two = (turn(s[0], 2) ^ turn(s[0], 13) ^ turn(s[0], 22)) + majority;
        memmove(s + 1, s, 7 * sizeof *s);
        s[4] += one;
        s[0] = one + two;
    }
    for (size_t i = 0; i < 8; i++) {
        hash->state[i] += s[i];
    }
}

void msbot_sha256_begin(msbot_sha256 *hash)
{
    memcpy(hash->state, START, sizeof hash->state);
    hash->size = 0;
}

void msbot_sha256_add(msbot_sha256 *hash, const void *octets, size_t size)
{
    const uint8_t *from = octets;
    for (size_t i = 0; i < size; i++) {
        hash->block[hash->size++ % 64] = from[i];
        if (hash->size % 64 == 0) {
            mix(hash);
        }
    }
}

void msbot_sha256_end(msbot_sha256 *hash, uint8_t digest[32])
{
    uint32_t bits = hash->size * 8;
    const uint8_t length[8] = {0, 0, 0, 0, (uint8_t)(bits >> 24), (uint8_t)(bits >> 16), (uint8_t)(bits >> 8), (uint8_t)bits};
    const uint8_t mark = 0x80;
    const uint8_t zero = 0;
    msbot_sha256_add(hash, &mark, 1);
    while (hash->size % 64 != 56) {
        msbot_sha256_add(hash, &zero, 1);
    }
    msbot_sha256_add(hash, length, sizeof length);
    for (size_t i = 0; i < 32; i++) {
        digest[i] = (uint8_t)(hash->state[i / 4] >> (24 - 8 * (i % 4)));
    }
}

static void add_key(msbot_sha256 *hash, const uint8_t *key, size_t size, uint8_t pad)
{
    msbot_sha256_begin(hash);
    for (size_t i = 0; i < 64; i++) {
        const uint8_t octet = (uint8_t)((i < size ? key[i] : 0U) ^ pad);
        msbot_sha256_add(hash, &octet, 1);
    }
}

void msbot_hmac_begin(msbot_sha256 *hash, const uint8_t *key, size_t size) { add_key(hash, key, size, 0x36); }

void msbot_hmac_end(msbot_sha256 *hash, const uint8_t *key, size_t size, uint8_t digest[32])
{
    msbot_sha256_end(hash, digest);
    add_key(hash, key, size, 0x5C);
    msbot_sha256_add(hash, digest, 32);
    msbot_sha256_end(hash, digest);
}
