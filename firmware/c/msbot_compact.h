/* Header compression on the CAN link (docs/reference/can.md): a short form of a message and back, exactly.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_COMPACT_H
#define MSBOT_COMPACT_H

#include "msbot_can.h"

/* Hand it to `msbot_can_config.codec`. */
extern const msbot_codec msbot_compact;

/* A form of the message, or of any octets; never more than size + 1 octets. */
size_t msbot_compress(uint8_t *form, const uint8_t *packet, size_t size);
/* The message of which that is a form; -1 = it is none, or there is no room for it. `form` may not lie in `packet`. */
int msbot_decompress(uint8_t *packet, size_t room, const uint8_t *form, size_t size);

#endif
