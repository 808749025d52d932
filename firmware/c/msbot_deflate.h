/* DEFLATE (RFC 1951) as header compression uses it: fixed codes and stored blocks, with a dictionary that both ends know.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_DEFLATE_H
#define MSBOT_DEFLATE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The text to compress: two pieces, one after the other. */
typedef struct {
    const uint8_t *head;
    size_t heads;
    const uint8_t *tail;
    size_t tails;
} msbot_text;

/* Compresses a text to fewer than `most` octets; 0 = not possible. The time grows with the length squared. */
size_t msbot_deflate(uint8_t *octets, size_t most, const msbot_text *text);
/* Restores the text from all these octets; -1 = they are not one, or there is no room for it. */
int msbot_inflate(uint8_t *text, size_t room, const uint8_t *octets, size_t size);

#ifdef __cplusplus
}
#endif

#endif
