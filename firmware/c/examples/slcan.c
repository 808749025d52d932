/* slcan: see slcan.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "slcan.h"

#include <string.h>

static int digit(char c)
{
    if (c >= '0' && c <= '9') {
        return c - '0';
    }
    c = (char)(c | 0x20);
    return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* Reads a number of that many hexadecimal digits; -1 = it is not one. */
static int64_t number(const char *text, size_t digits)
{
    int64_t value = 0;
    for (size_t i = 0; i < digits; i++) {
        int one = digit(text[i]);
        if (one < 0) {
            return -1;
        }
        value = value << 4 | one;
    }
    return value;
}

/* Reads `tiiil...` or `Tiiiiiiiil...`; the line ends with a NUL, which is no digit. */
static bool read_frame(const char *line, msbot_frame *frame)
{
    bool extended = line[0] == 'T';
    size_t digits = extended ? 8 : 3;
    int64_t id = number(line + 1, digits);
    if (id < 0) {
        return false;
    }
    int64_t size = number(line + 1 + digits, 1);
    if (size < 0 || size > 8) {
        return false;
    }
    frame->id = (uint32_t)id;
    frame->flags = extended ? MSBOT_EXTENDED : 0;
    frame->size = (uint8_t)size;
    for (size_t i = 0; i < (size_t)size; i++) {
        int64_t octet = number(line + 2 + digits + 2 * i, 2);
        if (octet < 0) {
            return false;
        }
        frame->data[i] = (uint8_t)octet;
    }
    return true;
}

/* Takes a command from the computer; true: it was a frame. */
static bool take_line(slcan *adapter, msbot_frame *frame)
{
    const char *line = adapter->line;
    if (adapter->too_long) {
        adapter->write("\a", 1);
        return false;
    }
    switch (line[0]) {
    case 'O':
    case 'C':
        adapter->is_open = line[0] == 'O';
        adapter->write("\r", 1);
        return false;
    case 't':
    case 'T':
        if (!adapter->is_open || !read_frame(line, frame)) {
            adapter->write("\a", 1);
            return false;
        }
        adapter->write(line[0] == 't' ? "z\r" : "Z\r", 2);
        return true;
    case 'V':
        adapter->write("V1013\r", 6);
        return false;
    default: /* bit rate and the like: there is no real bus here */
        adapter->write("\r", 1);
        return false;
    }
}

bool slcan_receive(void *context, msbot_frame *frame)
{
    slcan *adapter = context;
    uint8_t octet = 0;
    while (adapter->read(&octet)) {
        if (octet != '\r') {
            adapter->too_long = adapter->too_long || adapter->size == sizeof adapter->line - 1;
            if (!adapter->too_long) {
                adapter->line[adapter->size++] = (char)octet;
            }
            continue;
        }
        adapter->line[adapter->size] = 0;
        bool is_frame = take_line(adapter, frame);
        adapter->size = 0;
        adapter->too_long = false;
        if (is_frame) {
            return true;
        }
    }
    return false;
}

bool slcan_on_bus(void *context) { return ((const slcan *)context)->is_open; }

/* Written frames are on their way at once. */
unsigned slcan_pending(void *context)
{
    (void)context;
    return 0;
}

bool slcan_has_room(void *context)
{
    (void)context;
    return true;
}

static size_t put(char *text, uint32_t value, unsigned digits)
{
    for (unsigned i = digits; i > 0; i--, value >>= 4) {
        text[i - 1] = "0123456789ABCDEF"[value & 15U];
    }
    return digits;
}

void slcan_send(void *context, const msbot_frame *frame)
{
    slcan *adapter = context;
    char text[32];
    size_t at = 1;
    bool extended = (frame->flags & MSBOT_EXTENDED) != 0;
    text[0] = extended ? 'T' : 't';
    at += put(text + at, frame->id, extended ? 8 : 3);
    at += put(text + at, frame->size, 1);
    for (size_t i = 0; i < frame->size; i++) {
        at += put(text + at, frame->data[i], 2);
    }
    text[at++] = '\r';
    adapter->write(text, at);
}
