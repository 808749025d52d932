/* Whether what a program publishes is in the range that the robot's library declares (docs/reference/library.md).
 *
 *     static msbot_ranges ranges;
 *     msbot_ranges_begin(&ranges, &part, &lines);          after msbot_part_init; `lines`: a msbot_log, or NULL
 *     msbot_ranges_watch(&ranges, DIAL, "percent:f");
 *
 * A value outside is published as it is, because only the program knows what is wrong; it is counted, and once for each
 * field the robot's log gets a sentence.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_RANGES_H
#define MSBOT_RANGES_H

#include "msbot_log.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    msbot_part *part;
    msbot_log *log;
    const char *fields[MSBOT_PART_PORTS];
    uint32_t said[MSBOT_PART_PORTS]; /* a bit for each field, the last one for all from the 32nd on */
    uint32_t out_of_range;           /* messages with a value outside of its range */
} msbot_ranges;

void msbot_ranges_begin(msbot_ranges *ranges, msbot_part *part, msbot_log *log);
/* Looks at what is published at a port. `fields` has a word `NAME:KIND` for each field of its messages, in their order:
 * `x:f y:f`. Kinds: ? bool; b B int8 uint8; h H 16 bits; i I 32; q Q 64; f d float32 float64; s string. A number or bool
 * may be a list: `f=6` has six elements, `f<360` at most 360, `f<` any number. A field of a structure: `tip.x:f`. False:
 * there is no such port, it does not publish, or the fields are not written so. */
bool msbot_ranges_watch(msbot_ranges *ranges, unsigned port, const char *fields);

#ifdef __cplusplus
}
#endif

#endif
