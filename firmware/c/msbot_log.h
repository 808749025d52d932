/* Lines of a part's program for the robot's log: `msbot log --follow`, the page, `msbot why`.
 *
 *     static msbot_log lines;
 *     msbot_log_begin(&lines, &part);                                  after msbot_part_init
 *     msbot_log_line(&lines, MSBOT_LOG_WARNING, "it is hot", now_us);
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_LOG_H
#define MSBOT_LOG_H

#include "msbot_part.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MSBOT_LOG_LINE 180 /* octets of a line in UTF-8; a longer one is cut */
#ifndef MSBOT_LOG_OCTETS
#define MSBOT_LOG_OCTETS 256 /* octets of lines that wait for room on the way, and 2 for each; at least 182 */
#endif

typedef enum { MSBOT_LOG_INFO = 1, MSBOT_LOG_WARNING, MSBOT_LOG_ERROR } msbot_log_level;

typedef struct {
    msbot_part *part;
    uint32_t lease;                 /* of the session for which the lines are */
    uint32_t allowance_us, seen_us; /* what lines may still use up, and when that was so */
    uint32_t left_out;              /* lines that came too fast, since the last one that did not */
    uint16_t size;
    uint8_t piece; /* of the first line that waits, the next to be sent */
    uint8_t lines[MSBOT_LOG_OCTETS]; /* level, length, text; level, length, text ... */
} msbot_log;

void msbot_log_begin(msbot_log *log, msbot_part *part);
/* False: the part is not active, or the line is left out, because 5 a second are sent (20 at once) and there is no room;
 * the next line says how many were. */
bool msbot_log_line(msbot_log *log, msbot_log_level level, const char *text, uint32_t now_us);
/* The same for a line that comes once in a long while, however many came before. */
bool msbot_log_rare_line(msbot_log *log, msbot_log_level level, const char *text);

#ifdef __cplusplus
}
#endif

#endif
