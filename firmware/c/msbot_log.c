/* A program's log: see msbot_log.h; the rules and the messages are those of src/msbot/part/join/part_log.py.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_log.h"

#include <string.h>

#define LINE_US 200000U   /* a line, for ever */
#define BURST_US 4000000U /* 20 lines at once */
#define LAST_PIECE 0x80U

enum { PIECE = 12, HEAD = 2 };

static bool is_current(msbot_log *log)
{
    if (log->part->state != MSBOT_ACTIVE) {
        return false;
    }
    if (log->lease != log->part->lease) { /* what was on its way in an earlier session is gone with it */
        log->lease = log->part->lease;
        log->size = 0;
        log->piece = 0;
    }
    return true;
}

/* Sends what waits; false when there is no room. */
static bool book(void *context)
{
    msbot_log *log = context;
    while (is_current(log) && log->size > 0) {
        size_t length = log->lines[1];
        size_t at = (size_t)PIECE * log->piece;
        size_t rest = length - at;
        uint8_t told[5 + PIECE] = {(uint8_t)log->lease, (uint8_t)(log->lease >> 8), (uint8_t)(log->lease >> 16),
                                   (uint8_t)(log->lease >> 24)};
        told[4] = (uint8_t)(log->piece | (unsigned)log->lines[0] << 4 | (rest <= PIECE ? LAST_PIECE : 0U));
        memcpy(told + 5, log->lines + HEAD + at, rest < PIECE ? rest : PIECE);
        if (!msbot_part_tell(log->part, told, sizeof told)) {
            return false;
        }
        log->piece++;
        if (rest <= PIECE) {
            log->size = (uint16_t)(log->size - HEAD - length);
            log->piece = 0;
            memmove(log->lines, log->lines + HEAD + length, log->size);
        }
    }
    return true;
}

/* What is sent of a text: no letter is cut in two. */
static size_t sent_of(const char *text, size_t length)
{
    if (length <= MSBOT_LOG_LINE) {
        return length;
    }
    length = MSBOT_LOG_LINE - 3;
    while (length > 0 && ((uint8_t)text[length] & 0xC0U) == 0x80U) {
        length--;
    }
    return length;
}

static bool add(msbot_log *log, msbot_log_level level, const char *text)
{
    size_t given = strlen(text);
    size_t kept = sent_of(text, given);
    size_t length = kept < given ? kept + 3 : given > 0 ? given : 1; /* an empty line is a blank */
    if (log->size + HEAD + length > sizeof log->lines) {
        return false;
    }
    uint8_t *line = log->lines + log->size;
    line[0] = (uint8_t)level;
    line[1] = (uint8_t)length;
    line[HEAD] = ' ';
    for (size_t i = 0; i < kept; i++) {
        uint8_t sign = (uint8_t)text[i];
        line[HEAD + i] = sign < 32 || sign == 127 ? ' ' : sign;
    }
    if (kept < given) {
        static const uint8_t ellipsis[3] = {0xE2, 0x80, 0xA6};
        memcpy(line + HEAD + kept, ellipsis, sizeof ellipsis);
    }
    log->size = (uint16_t)(log->size + HEAD + length);
    return true;
}

/* Says how many lines were left out; false when there is no room. */
static bool confess(msbot_log *log)
{
    char text[60] = "          lines were left out: 5 a second are sent";
    char *begin = text + 9;
    uint32_t left = log->left_out;
    if (left == 0) {
        return true;
    }
    for (; left > 0; left /= 10) {
        *--begin = (char)('0' + left % 10);
    }
    if (!add(log, MSBOT_LOG_WARNING, log->left_out == 1 ? "1 line was left out: 5 a second are sent" : begin)) {
        return false;
    }
    log->left_out = 0;
    return true;
}

void msbot_log_begin(msbot_log *log, msbot_part *part)
{
    memset(log, 0, sizeof *log);
    log->part = part;
    log->allowance_us = BURST_US;
    part->book_log = book;
    part->log = log;
}

bool msbot_log_rare_line(msbot_log *log, msbot_log_level level, const char *text)
{
    return is_current(log) && add(log, level, text);
}

bool msbot_log_line(msbot_log *log, msbot_log_level level, const char *text, uint32_t now_us)
{
    if (!is_current(log)) {
        return false;
    }
    uint32_t passed_us = now_us - log->seen_us;
    uint32_t used_us = BURST_US - log->allowance_us;
    log->seen_us = now_us;
    log->allowance_us += passed_us < used_us ? passed_us : used_us;
    if (log->allowance_us < LINE_US || !confess(log) || !add(log, level, text)) {
        log->left_out++;
        return false;
    }
    log->allowance_us -= LINE_US;
    return true;
}
