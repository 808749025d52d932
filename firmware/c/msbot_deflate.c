/* DEFLATE with the dictionary of the CAN link: see msbot_deflate.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_deflate.h"

#include <stdbool.h>
#include <string.h>

#define DICTIONARY_SIZE 504U

/* Wire format: what every robot says, the CRC-32 is E99DCCC5. */
static const char DICTIONARY[DICTIONARY_SIZE + 1] =
    "\1\7\20\0\0\12\0\21\1\3\0\0\2\0\0\0\0\0\0\0\1\7\20\0\0\13\0\24\4\3\0\0\2\0\0\0\0\0\0\21\1\0077\0\0\14\0\22"
    "\2\3\0\0)\0\0\0\22\0\0\0msbot_masterTopic\0\0\1\15\0\0\0msbot_master\0\0\21\0\1\7\32\0\0\15\0\26\6\3\0\0\14"
    "\0\0\0\0\22\1\0\3\0\0\0\0\0\0\0\0\24\0\0\1\7\224\0\0\16\0\27\7\3\0\0\206\0\0\0\20\0\0\0msbot_inventory\0\30"
    "\0\0\0msbot_inventory_request\0\26\0\0\0msbot_inventory_reply\0\1\0\30\0\0\0msbot_inventory_Request\0\1\0\0"
    "\0\26\0\0\0msbot_inventory_Reply\0\0\21\10\1\20\0\300\26\0\26\200\0\0\1\377\377\0\0\0\0\0\0\10\1\20\0\300"
    "\27\0\27\200\0\0\1\377\377\0\0\0\0\0\0\1\7\26\0\0\17\0\42\2\3\0\0\10\0\0\0\2\0\0\0/\0\0\0\0\21\0\0\1\7\20\0"
    "\0\20\0\23\3\3\0\0\2\0\0\0\0\0\0\21\1\7\31\0\0\21\0\25\5\3\0\0\13\0\0\0\0\42\1\0\3\0\0\0\0\0\0\0\23\0\0\0\1"
    "\7\26\0\0\22\0002\2\3\0\0\10\0\0\0\2\0\0\0/\0\0\0\0\21\0\0\1\7\32\0\0\23\0&\6\3\0\0\14\0\0\0\0002\1\0\3\0\0"
    "\0\0\0\0\0\0\24\0\0\10\1\20\0\300\27\0\27\1\0\0\1\377\377\0\0\0\0\0\0\10\1\20\0\300&\0&\200\0\0\1\377\377\0"
    "\0\0\0\0\0";

/* Writing: one block of fixed codes. */

typedef struct {
    uint8_t *octets;
    size_t size, most;
    uint32_t bits;
    unsigned count;
    bool full;
} bit_writer;

static void put_bits(bit_writer *writer, uint32_t bits, unsigned count)
{
    writer->bits |= bits << writer->count;
    writer->count += count;
    while (writer->count >= 8) {
        if (writer->size < writer->most) {
            writer->octets[writer->size++] = (uint8_t)writer->bits;
        } else {
            writer->full = true;
        }
        writer->bits >>= 8;
        writer->count -= 8;
    }
}

static void put_code(bit_writer *writer, uint32_t code, unsigned count)
{
    while (count-- > 0) {
        put_bits(writer, code >> count & 1U, 1);
    }
}

static void put_symbol(bit_writer *writer, unsigned symbol)
{
    if (symbol < 144) {
        put_code(writer, 0x30U + symbol, 8);
    } else if (symbol < 256) {
        put_code(writer, 0x190U + symbol - 144U, 9);
    } else if (symbol < 280) {
        put_code(writer, symbol - 256U, 7);
    } else {
        put_code(writer, 0xC0U + symbol - 280U, 8);
    }
}

static unsigned high_bit(size_t value)
{
    unsigned bit = 0;
    while (value > 1) {
        value >>= 1;
        bit++;
    }
    return bit;
}

/* Lengths and distances are numbers in groups that double in size: a symbol for the group and the `bits` bits after the
 * leading one, and extra bits for the rest. */
static unsigned extra_bits(size_t number, unsigned bits)
{
    unsigned highest = high_bit(number);
    return highest > bits ? highest - bits : 0;
}

static void put_extra(bit_writer *writer, size_t number, unsigned extra)
{
    put_bits(writer, (uint32_t)(number & ((1U << extra) - 1)), extra);
}

static void put_match(bit_writer *writer, size_t length, size_t distance)
{
    size_t number = length - 3;
    unsigned extra = extra_bits(number, 2);
    put_symbol(writer, 257U + 4U * extra + (unsigned)(number >> extra));
    put_extra(writer, number, extra);
    number = distance - 1;
    extra = extra_bits(number, 1);
    put_code(writer, 2U * extra + (uint32_t)(number >> extra), 5);
    put_extra(writer, number, extra);
}

/* The octets that a match may repeat: the dictionary, followed by the text itself. */
static uint8_t octet_at(const msbot_text *text, size_t i)
{
    if (i < DICTIONARY_SIZE) {
        return (uint8_t)DICTIONARY[i];
    }
    i -= DICTIONARY_SIZE;
    return i < text->heads ? text->head[i] : text->tail[i - text->heads];
}

size_t msbot_deflate(uint8_t *octets, size_t most, const msbot_text *text)
{
    size_t end = DICTIONARY_SIZE + text->heads + text->tails;
    bit_writer writer = {octets, 0, most - 1, 0, 0, false};
    put_bits(&writer, 3, 3); /* the last block, with fixed codes */
    for (size_t at = DICTIONARY_SIZE; at < end && !writer.full;) {
        size_t best = 0;
        size_t from = 0;
        for (size_t start = at; start-- > 0;) {
            size_t length = 0;
            while (at + length < end && length < 257 && octet_at(text, start + length) == octet_at(text, at + length)) {
                length++;
            }
            if (length > best) {
                best = length;
                from = start;
            }
        }
        if (best >= 3) {
            put_match(&writer, best, at - from);
            at += best;
        } else {
            put_symbol(&writer, octet_at(text, at));
            at++;
        }
    }
    put_symbol(&writer, 256);
    put_bits(&writer, 0, 7);
    return writer.full ? 0 : writer.size;
}

/* Reading. */

typedef struct {
    const uint8_t *octets;
    size_t size, at;
    unsigned bit; /* of the octet before `at`; 0 = none is left of it */
    bool short_of;
} bit_reader;

static unsigned take_bit(bit_reader *reader)
{
    if (reader->bit == 0) {
        if (reader->at >= reader->size) {
            reader->short_of = true;
            return 0;
        }
        reader->at++;
    }
    unsigned value = reader->octets[reader->at - 1] >> reader->bit & 1U;
    reader->bit = (reader->bit + 1) & 7U;
    return value;
}

static unsigned take_bits(bit_reader *reader, unsigned count)
{
    unsigned value = 0;
    for (unsigned i = 0; i < count; i++) {
        value |= take_bit(reader) << i;
    }
    return value;
}

static unsigned take_code(bit_reader *reader, unsigned code, unsigned count)
{
    while (count-- > 0) {
        code = code << 1 | take_bit(reader);
    }
    return code;
}

static unsigned take_symbol(bit_reader *reader)
{
    unsigned code = take_code(reader, 0, 7);
    if (code <= 0x17) {
        return 256 + code;
    }
    code = take_code(reader, code, 1);
    if (code <= 0xBF) {
        return code - 0x30;
    }
    return code <= 0xC7 ? code - 0xC0 + 280 : take_code(reader, code, 1) - 0x190 + 144;
}

/* The number of a symbol (see `extra_bits`). */
static size_t take_number(bit_reader *reader, unsigned symbol, unsigned bits)
{
    unsigned extra = symbol < 2U << bits ? 0 : (symbol >> bits) - 1;
    return ((size_t)(symbol - (extra << bits)) << extra) + take_bits(reader, extra);
}

/* Copies a match to `text`, which has `at` octets so far; 0 = the match makes no sense. */
static size_t inflate_match(bit_reader *reader, unsigned symbol, uint8_t *text, size_t room, size_t at)
{
    size_t length = symbol == 285 ? 258 : take_number(reader, symbol - 257, 2) + 3;
    unsigned code = take_code(reader, 0, 5);
    if (symbol > 285 || code > 29) {
        return 0;
    }
    size_t distance = take_number(reader, code, 1) + 1;
    if (reader->short_of || distance > at + DICTIONARY_SIZE || length > room - at) {
        return 0;
    }
    for (size_t i = 0; i < length; i++, at++) {
        text[at] = distance > at ? (uint8_t)DICTIONARY[DICTIONARY_SIZE + at - distance] : text[at - distance];
    }
    return length;
}

static int inflate_stored(bit_reader *reader, uint8_t *text, size_t room, size_t at)
{
    reader->bit = 0;
    size_t length = take_bits(reader, 16);
    unsigned complement = take_bits(reader, 16);
    if (reader->short_of || (length ^ complement) != 0xFFFF || length > room - at || length > reader->size - reader->at) {
        return -1;
    }
    memcpy(text + at, reader->octets + reader->at, length);
    reader->at += length;
    return (int)(at + length);
}

static int inflate_fixed(bit_reader *reader, uint8_t *text, size_t room, size_t at)
{
    for (;;) {
        unsigned symbol = take_symbol(reader);
        if (reader->short_of) {
            return -1;
        }
        if (symbol == 256) {
            return (int)at;
        }
        if (symbol < 256) {
            if (at >= room) {
                return -1;
            }
            text[at++] = (uint8_t)symbol;
        } else {
            size_t length = inflate_match(reader, symbol, text, room, at);
            if (length == 0) {
                return -1;
            }
            at += length;
        }
    }
}

int msbot_inflate(uint8_t *text, size_t room, const uint8_t *octets, size_t size)
{
    bit_reader reader = {octets, size, 0, 0, false};
    int at = 0;
    for (bool last = false; !last && at >= 0;) {
        last = take_bit(&reader) != 0;
        unsigned kind = take_bits(&reader, 2);
        if (kind > 1 || reader.short_of) {
            return -1;
        }
        at = kind == 0 ? inflate_stored(&reader, text, room, (size_t)at)
                       : inflate_fixed(&reader, text, room, (size_t)at);
    }
    return at >= 0 && reader.at == size ? at : -1;
}
