/* Header compression on the CAN link (docs/reference/can.md): shortens a message and restores it exactly.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_COMPACT_H
#define MSBOT_COMPACT_H

#include "msbot_can.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Hand it to `msbot_can_config.codec`. */
extern const msbot_codec msbot_compact;

/* Makes the short form of a message, or of any octets; never more than size + 1 octets. */
size_t msbot_compress(uint8_t *form, const uint8_t *packet, size_t size);
/* Restores the message from its short form; -1 = it is not one, or there is no room. `form` must not lie in `packet`. */
int msbot_decompress(uint8_t *packet, size_t room, const uint8_t *form, size_t size);

#ifdef __cplusplus
}
#endif

#endif
