/* Header compression: see msbot_compact.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_compact.h"

#include "msbot_deflate.h"

#include <stdbool.h>
#include <string.h>

static uint16_t u16(const uint8_t *octets) { return (uint16_t)(octets[0] | octets[1] << 8); }

/* Header compression. */

enum {
    FORM_WRITER = 0,
    FORM_READER = 8,
    FORM_REQUEST = 16,
    FORM_REPLY = 18,
    FORM_WRITE_DATA = 20,
    FORM_DATA = 21,
    FORM_STATUS = 22,
    FORM_FRAGMENT = 23,
    FORM_LAST_FRAGMENT = 24,
    FORM_ON_STREAM = 25,
    FORM_ACKNACK = 26,
    FORM_HEARTBEAT = 27,
    FORM_LOGIN = 28,
    FORM_FIXED = 29,
    FORM_NO_STREAM = 30,
    ESCAPE = 0x1F,
    DEFLATED = 0x5F
};

enum { WRITE_DATA = 7, DATA = 9, STATUS = 5, ACKNACK = 10, HEARTBEAT = 11, FRAGMENT = 13 };

/* Messages that are always the same, without their header. */
static const char FIXED[] =
    "\4\1\13\0\0\0XRCE\1\0\1\17\0\2\1\10\0\0\12\377\375\2\0\0\0\6\1\34\0\0\12\377\375\0\0\1\15XRCE\1\0\1\17\0\1"
    "\15\0\1\0\0\0\0\0\0\0\6\1\34\0\0\12\377\375\0\1\1\15XRCE\1\0\1\17\0\1\15\0\1\0\0\0\0\0\0\0\2\1\10\0\0\0\377"
    "\376\1\0\0\0\6\1\10\0\0\0\377\376\0\0\0\0\3\1\4\0\0\2\377\376\5\1\6\0\0\2\377\376\0\0\14\1\0\0";
static const uint8_t FIXED_SIZES[] = {15, 12, 32, 32, 12, 12, 8, 10, 4};

static const uint8_t *fixed_message(unsigned number)
{
    const char *fixed = FIXED;
    for (unsigned i = 0; i < number; i++) {
        fixed += FIXED_SIZES[i];
    }
    return (const uint8_t *)fixed;
}

static const uint8_t LOGIN[] = {0x80, 0, 0, 0, 0, 1, 16, 0, 'X', 'R', 'C', 'E', 1, 0, 1, 15};

/* A short form: a few octets of its own (head), then some of the packet (tail). */
typedef struct {
    uint8_t head[8];
    uint8_t heads;
    const uint8_t *tail;
    size_t tails;
} short_form;

/* A code, and what follows it. */
static void set_form(short_form *form, unsigned code, const uint8_t *tail, size_t tails)
{
    form->head[0] = (uint8_t)code;
    form->heads = 1;
    form->tail = tail;
    form->tails = tails;
}

static uint16_t request_by_rule(uint8_t stream, uint16_t sequence)
{
    return (uint16_t)((stream >= 0x80 ? 0xA000U : 0x8000U) | (sequence & 0x1FFFU));
}

static bool shorten_write(short_form *form, const uint8_t *packet, size_t size, unsigned code)
{
    size_t length = u16(packet + 6);
    size_t end = 8 + length;
    if (packet[5] != 1 || length < 4 || size != ((end + 3) & ~(size_t)3)) {
        return false;
    }
    for (size_t i = end; i < size; i++) {
        if (packet[i] != 0) {
            return false;
        }
    }
    unsigned place = ((unsigned)packet[10] << 4 | packet[11] >> 4) - 1; /* object number 1 is the first place */
    unsigned kind = packet[11] & 15U;
    bool by_rule = ((unsigned)packet[8] << 8 | packet[9]) == request_by_rule(packet[1], u16(packet + 2));
    unsigned which = FORM_WRITE_DATA;
    if (by_rule && kind == 5 && place < 8) {
        which = FORM_WRITER + place;
    } else if (by_rule && kind == 7 && place < 2) {
        which = FORM_REQUEST + place;
    }
    size_t skip = which == FORM_WRITE_DATA ? 8 : 12;
    set_form(form, code | which, packet + skip, end - skip);
    memcpy(form->head + 1, packet + 2, 2); /* the sequence number */
    form->heads = 3;
    return true;
}

static void shorten_on_stream(short_form *form, const uint8_t *packet, size_t size, unsigned code)
{
    code |= packet[1] == 0x80 ? 0x20U : 0U;
    if (packet[4] == WRITE_DATA && shorten_write(form, packet, size, code)) {
        return;
    }
    set_form(form, code | FORM_ON_STREAM, packet + 2, size - 2);
}

static int fixed_number(const uint8_t *body, size_t size)
{
    for (unsigned i = 0; i < sizeof FIXED_SIZES; i++) {
        if (size == FIXED_SIZES[i] && memcmp(body, fixed_message(i), size) == 0) {
            return (int)i;
        }
    }
    return -1;
}

static void shorten_outside(short_form *form, const uint8_t *packet, size_t size, unsigned code)
{
    int number = fixed_number(packet + 4, size - 4);
    bool report = size == 13 && packet[5] == 1 && u16(packet + 6) == 5;
    if (report && (packet[4] == ACKNACK || packet[4] == HEARTBEAT)) {
        uint16_t usual = packet[4] == ACKNACK ? 0 : u16(packet + 8);
        size_t tails = packet[12] != 0x80 ? 5 : u16(packet + 10) == usual ? 2 : 4;
        set_form(form, code | (packet[4] == ACKNACK ? FORM_ACKNACK : FORM_HEARTBEAT), packet + 8, tails);
    } else if (number >= 0) {
        set_form(form, code | FORM_FIXED, packet, 0);
        form->head[form->heads++] = (uint8_t)number;
    } else {
        set_form(form, code | FORM_NO_STREAM, packet + 4, size - 4);
    }
}

/* The forms that suit what a part sends; a sender may choose any. */
static void shorten(short_form *form, const uint8_t *packet, size_t size)
{
    form->heads = 0;
    form->tail = packet;
    form->tails = size;
    if (size == 0 || packet[0] < 0x80) {
        set_form(form, ESCAPE, packet, size);
        return;
    }
    if (size < 8 || packet[0] > 0x82) {
        return;
    }
    bool no_stream = packet[1] == 0 && packet[2] == 0 && packet[3] == 0;
    unsigned code = packet[0] == 0x82 ? 0x40U : 0U;
    if (packet[0] == 0x80) {
        if (size == 24 && memcmp(packet, LOGIN, sizeof LOGIN) == 0 && packet[21] == 0 &&
            (packet[20] == 0x81 || packet[20] == 0x82)) {
            set_form(form, (packet[20] == 0x82 ? 0x40U : 0U) | FORM_LOGIN, packet, 0);
            memcpy(form->head + 1, packet + 16, 4);
            memcpy(form->head + 5, packet + 22, 2);
            form->heads = 7;
        }
    } else if (packet[1] == 0x01 || packet[1] == 0x80) {
        shorten_on_stream(form, packet, size, code);
    } else if (no_stream) {
        shorten_outside(form, packet, size, code);
    }
}

size_t msbot_compress(uint8_t *form, const uint8_t *packet, size_t size)
{
    short_form made;
    shorten(&made, packet, size);
    size_t shorter = made.heads + made.tails;
    uint8_t kind = made.heads ? made.head[0] & 0x1FU : 0;
    /* Only messages that set up a session are deflated: samples must not wait for the search. */
    if (shorter > 7 && (kind == FORM_ON_STREAM || kind == FORM_NO_STREAM)) {
        msbot_text text = {made.head, made.heads, made.tail, made.tails};
        size_t squeezed = msbot_deflate(form + 1, shorter - 1, &text);
        if (squeezed > 0) {
            form[0] = DEFLATED;
            return squeezed + 1;
        }
    }
    memcpy(form, made.head, made.heads);
    memcpy(form + made.heads, made.tail, made.tails);
    return shorter;
}

/* Writes head, tail and zeros one after the other; the tail may lie anywhere in the packet. */
static int put_packet(uint8_t *packet, size_t room, const uint8_t *head, size_t heads, const uint8_t *tail,
                      size_t tails, size_t zeros)
{
    if (heads + tails + zeros > room) {
        return -1;
    }
    memmove(packet + heads, tail, tails);
    memcpy(packet, head, heads);
    memset(packet + heads + tails, 0, zeros);
    return (int)(heads + tails + zeros);
}

static int expand_on_stream(uint8_t *packet, size_t room, const uint8_t *form, size_t size)
{
    if (size < 3) {
        return -1;
    }
    uint8_t kind = form[0] & 0x1FU;
    uint8_t head[16] = {form[0] & 0x40U ? 0x82 : 0x81, form[0] & 0x20U ? 0x80 : 0x01, form[1], form[2], WRITE_DATA, 1};
    const uint8_t *tail = form + 3;
    size_t tails = size - 3;
    size_t heads = 8;
    size_t zeros = 0;
    if (kind == FORM_ON_STREAM) {
        head[4] = 0; /* the submessages are in the tail */
        heads = 4;
    } else if (kind == FORM_STATUS) {
        if (tails != 3 && tails != 4 && tails != 6) {
            return -1;
        }
        head[4] = STATUS;
        memcpy(head + 8, tail, tails); /* the rest is 0: OK */
        if (tails == 3) {
            head[11] = head[10];
            head[10] = 0;
        }
        heads = 14;
        tails = 0;
    } else if (kind == FORM_FRAGMENT || kind == FORM_LAST_FRAGMENT) {
        head[4] = FRAGMENT;
        head[5] = kind == FORM_LAST_FRAGMENT ? 3 : 1;
    } else if (kind >= FORM_WRITE_DATA) {
        head[4] = kind == FORM_DATA ? DATA : WRITE_DATA;
        if (tails < 4) {
            return -1;
        }
    } else {
        bool reader = (kind >= FORM_READER && kind < FORM_REQUEST) || kind >= FORM_REPLY;
        unsigned object = kind < FORM_READER    ? 0x05U + 16U * (kind + 1U)
                          : kind < FORM_REQUEST ? 0x06U + 16U * (kind - FORM_READER + 1U)
                                                : 0x07U + 16U * ((kind & 1U) + 1U);
        unsigned request = reader ? 0xC000U | object : request_by_rule(head[1], u16(form + 1));
        head[4] = reader ? DATA : WRITE_DATA;
        head[8] = (uint8_t)(request >> 8);
        head[9] = (uint8_t)request;
        head[11] = (uint8_t)object;
        heads = 12;
        if (kind >= FORM_REPLY) {
            if (tails < 2) {
                return -1;
            }
            unsigned related = u16(tail);
            head[12] = (uint8_t)(0x80U | (related >> 8 & 0x3FU));
            head[13] = (uint8_t)related;
            head[15] = (uint8_t)object;
            heads = 16;
            zeros = related >> 14;
            tail += 2;
            tails -= 2;
        }
    }
    size_t contents = heads - 8 + tails + zeros;
    head[6] = (uint8_t)contents;
    head[7] = (uint8_t)(contents >> 8);
    if (head[4] == WRITE_DATA) {
        zeros = -contents & 3U; /* as clients send it */
    }
    return put_packet(packet, room, head, heads, tail, tails, zeros);
}

static int expand_outside(uint8_t *packet, size_t room, const uint8_t *form, size_t size)
{
    uint8_t kind = form[0] & 0x1FU;
    uint8_t head[24] = {form[0] & 0x40U ? 0x82 : 0x81, 0, 0, 0};
    const uint8_t *tail = form + 1;
    size_t tails = size - 1;
    size_t heads = 4;
    if (kind == FORM_FIXED) {
        if (tails != 1 || (tail[0] & 0x7FU) >= sizeof FIXED_SIZES) {
            return -1;
        }
        unsigned number = tail[0] & 0x7FU;
        head[0] = tail[0] & 0x80U ? 0x80 : head[0];
        tail = fixed_message(number);
        tails = FIXED_SIZES[number];
    } else if (kind == FORM_LOGIN) {
        if (tails != 6) {
            return -1;
        }
        head[20] = head[0]; /* the session */
        memcpy(head, LOGIN, sizeof LOGIN);
        memcpy(head + 16, tail, 4);
        memcpy(head + 22, tail + 4, 2);
        heads = 24;
        tails = 0;
    } else if (kind != FORM_NO_STREAM) {
        if (tails != 2 && tails != 4 && tails != 5) {
            return -1;
        }
        head[4] = kind == FORM_ACKNACK ? ACKNACK : HEARTBEAT;
        head[5] = 1;
        head[6] = 5;
        memcpy(head + 8, tail, tails);
        if (tails == 2 && kind == FORM_HEARTBEAT) {
            memcpy(head + 10, tail, 2);
        }
        head[12] = tails == 5 ? tail[4] : 0x80;
        heads = 13;
        tails = 0;
    }
    return put_packet(packet, room, head, heads, tail, tails, 0);
}

int msbot_decompress(uint8_t *packet, size_t room, const uint8_t *form, size_t size)
{
    if (size > 0 && form[0] == DEFLATED) {
        int short_size = msbot_inflate(packet, room, form + 1, size - 1);
        if (short_size <= 0 || packet[0] == DEFLATED) {
            return -1;
        }
        /* Moved to the end of the buffer, so that the restored message can grow from the start. */
        size = (size_t)short_size;
        form = packet + room - size;
        memmove(packet + room - size, packet, size);
    }
    if (size == 0) {
        return -1;
    }
    uint8_t code = form[0];
    if (code >= 0x80 || code == ESCAPE) {
        size_t skip = code == ESCAPE ? 1 : 0;
        return put_packet(packet, room, &code, 0, form + skip, size - skip, 0);
    }
    if ((code & 0x1FU) <= FORM_ON_STREAM) {
        return expand_on_stream(packet, room, form, size);
    }
    if ((code & 0x20U) || (code & 0x1FU) > FORM_NO_STREAM) {
        return -1;
    }
    return expand_outside(packet, room, form, size);
}

const msbot_codec msbot_compact = {msbot_compress, msbot_decompress};
