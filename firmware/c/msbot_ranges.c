/* Ranges of what a program publishes: see msbot_ranges.h. They come with the configuration, as settings
 * `PORT.range.FIELD`, each with the least and the greatest value, "-90 90.5".
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_ranges.h"

#include <string.h>

#define MARK ".range."

/* A field, as it is written in `fields`: NAME:CODE, and perhaps = or < and a count. */
typedef struct {
    const char *name;
    size_t name_size;
    char code, list; /* list: 0, '=' or '<' */
    uint32_t count;
} field;

static size_t size_of(char code)
{
    switch (code) {
    case '?':
    case 'b':
    case 'B':
        return 1;
    case 'h':
    case 'H':
        return 2;
    case 'i':
    case 'I':
    case 'f':
        return 4;
    case 'q':
    case 'Q':
    case 'd':
        return 8;
    default:
        return 0;
    }
}

static bool is_digit(char sign) { return sign >= '0' && sign <= '9'; }

/* The field that `text` begins with; returns where the next one begins, NULL: it is not written so. */
static const char *take_field(const char *text, field *taken)
{
    const char *colon = strchr(text, ':');
    if (colon == NULL || colon == text) {
        return NULL;
    }
    taken->name = text;
    taken->name_size = (size_t)(colon - text);
    taken->code = colon[1];
    taken->list = 0;
    taken->count = 0;
    if (memchr(text, ' ', taken->name_size) != NULL || (size_of(taken->code) == 0 && taken->code != 's')) {
        return NULL;
    }
    text = colon + 2;
    if (taken->code != 's' && (*text == '=' || *text == '<')) {
        taken->list = *text++;
        if (taken->list == '=' && !is_digit(*text)) {
            return NULL;
        }
        for (; is_digit(*text); text++) {
            taken->count = 10 * taken->count + (uint32_t)(*text - '0');
        }
    }
    if (*text == ' ' && text[1] != 0) {
        return text + 1;
    }
    return *text == 0 ? text : NULL;
}

/* Reading the message: CDR, little endian. */

typedef struct {
    const uint8_t *octets;
    size_t size, at;
} reader;

static uint64_t take(reader *from, size_t size)
{
    uint64_t value = 0;
    from->at = (from->at + size - 1) & ~(size - 1);
    if (from->at > from->size || size > from->size - from->at) {
        from->at = from->size + 1; /* everything after it is missing, too */
        return 0;
    }
    for (size_t i = 0; i < size; i++) {
        value |= (uint64_t)from->octets[from->at++] << 8 * i;
    }
    return value;
}

static bool is_broken(const reader *from) { return from->at > from->size; }

static float number(uint64_t octets, char code)
{
    uint32_t low = (uint32_t)octets;
    float single;
    double twice;
    switch (code) {
    case 'b':
        return (float)(int8_t)low;
    case 'h':
        return (float)(int16_t)low;
    case 'i':
        return (float)(int32_t)low;
    case 'q':
        return (float)(int64_t)octets;
    case 'f':
        memcpy(&single, &low, sizeof single);
        return single;
    case 'd':
        memcpy(&twice, &octets, sizeof twice);
        return (float)twice;
    default:
        return (float)octets;
    }
}

/* Numbers in texts. */

/* Reads a number as C's %g writes it; returns where it ends, NULL: it is none. */
static const char *take_float(const char *text, float *value)
{
    bool minus = *text == '-';
    bool fraction = false;
    uint32_t digits = 0;
    int exponent = 0;
    text += minus;
    if (!is_digit(*text)) {
        return NULL;
    }
    for (; is_digit(*text) || (*text == '.' && !fraction); text++) {
        if (*text == '.') {
            fraction = true;
        } else if (digits < 100000000U) {
            digits = 10 * digits + (uint32_t)(*text - '0');
            exponent -= fraction;
        } else {
            exponent += !fraction;
        }
    }
    if (*text == 'e') {
        bool down = text[1] == '-';
        int more = 0;
        text += 1 + (text[1] == '-' || text[1] == '+');
        for (; is_digit(*text) && more < 100; text++) {
            more = 10 * more + (*text - '0');
        }
        exponent += down ? -more : more;
    }
    float scale = 1;
    for (int i = exponent < 0 ? -exponent : exponent; i > 0; i--) {
        scale *= 10;
    }
    *value = exponent < 0 ? (float)digits / scale : (float)digits * scale;
    *value = minus ? -*value : *value;
    return text;
}

static void put(char *text, size_t room, const char *more)
{
    size_t at = strlen(text);
    size_t size = strlen(more);
    size = size < room - 1 - at ? size : room - 1 - at;
    memcpy(text + at, more, size);
    text[at + size] = 0;
}

/* Appends a number as %g does. */
static void put_float(char *text, size_t room, float value)
{
    char written[20] = "";
    char *end = written;
    float size = value < 0 ? -value : value;
    float scale = 1;
    int exponent = 5; /* of ten, for the first of six digits */
    if (!(size <= 3.4028234e38F)) {
        put(text, room, value < 0 ? "-inf" : size > 0 ? "inf" : "nan");
        return;
    }
    while (size > 0 && size * scale < 99999.5F && scale < 1e37F) {
        scale *= 10;
        exponent--;
    }
    while (size / scale >= 999999.5F) {
        scale *= 10;
        exponent++;
    }
    uint32_t digits = (uint32_t)((exponent > 5 ? size / scale : size * scale) + 0.5F);
    if (digits == 0) {
        put(text, room, "0");
        return;
    }
    bool scientific = exponent < -4 || exponent >= 6;
    int places = scientific ? 5 : 5 - exponent; /* of the six digits, those behind the point */
    for (; places > 0 && digits % 10 == 0; places--) {
        digits /= 10;
    }
    char turned[12];
    int count = 0;
    for (; digits > 0 || count <= places; digits /= 10) {
        turned[count++] = (char)('0' + digits % 10);
    }
    if (value < 0) {
        *end++ = '-';
    }
    while (count > 0) {
        *end++ = turned[--count];
        if (count == places && places > 0) {
            *end++ = '.';
        }
    }
    if (scientific) {
        int power = exponent < 0 ? -exponent : exponent;
        *end++ = 'e';
        *end++ = exponent < 0 ? '-' : '+';
        *end++ = (char)('0' + power / 10);
        *end++ = (char)('0' + power % 10);
    }
    *end = 0;
    put(text, room, written);
}

/* Looking. */

/* The first value of a field that is outside; false: there is none. The reader stands behind the field afterwards. */
static bool find_outside(reader *from, const field *one, bool wanted, const float ends[2], float *value)
{
    bool found = false;
    if (one->code == 's') {
        uint64_t size = take(from, 4);
        from->at = is_broken(from) || size > from->size - from->at ? from->size + 1 : from->at + (size_t)size;
        return false;
    }
    uint64_t count = one->list == 0 ? 1 : one->list == '=' ? one->count : take(from, 4);
    for (; count > 0 && !is_broken(from); count--) {
        float taken = number(take(from, size_of(one->code)), one->code);
        if (wanted && !found && !is_broken(from) && one->code != '?' && !(ends[0] <= taken && taken <= ends[1])) {
            found = true;
            *value = taken;
        }
    }
    return found;
}

static void say(msbot_ranges *ranges, unsigned port, unsigned place, const char *name, float value, const char *text)
{
    char line[MSBOT_LOG_LINE + 1] = "";
    char least[20] = "";
    uint32_t bit = 1UL << (place < 31 ? place : 31);
    if (ranges->log == NULL || (ranges->said[port] & bit) != 0) {
        return;
    }
    put(least, sizeof least, text);
    char *blank = strchr(least, ' ');
    if (blank != NULL) {
        *blank = 0;
    }
    put(line, sizeof line, ranges->part->config.ports[port].name);
    put(line, sizeof line, ": ");
    put(line, sizeof line, name);
    put(line, sizeof line, " is published as ");
    put_float(line, sizeof line, value);
    put(line, sizeof line, "; the robot's library says ");
    put(line, sizeof line, least);
    put(line, sizeof line, " to ");
    put(line, sizeof line, strchr(text, ' ') + 1);
    if (msbot_log_rare_line(ranges->log, MSBOT_LOG_WARNING, line)) {
        ranges->said[port] |= bit;
    }
}

static bool is_outside(msbot_ranges *ranges, unsigned port, const char *name, const char *text, reader from)
{
    float ends[2];
    field one;
    const char *middle = take_float(text, &ends[0]);
    if (middle == NULL || *middle != ' ') {
        return false; /* of a master that says it in another way */
    }
    const char *end = take_float(middle + 1, &ends[1]);
    if (end == NULL || *end != 0) {
        return false;
    }
    const char *fields = ranges->fields[port];
    for (unsigned place = 0; *fields != 0 && !is_broken(&from); place++) {
        float value = 0;
        fields = take_field(fields, &one);
        if (fields == NULL) {
            break; /* not so: msbot_ranges_watch has read them */
        }
        bool wanted = strlen(name) == one.name_size && memcmp(name, one.name, one.name_size) == 0;
        if (find_outside(&from, &one, wanted, ends, &value)) {
            say(ranges, port, place, name, value, text);
            return true;
        }
    }
    return false;
}

static void look(void *context, unsigned port, const uint8_t *message, size_t size)
{
    msbot_ranges *ranges = context;
    const char *port_name = ranges->part->config.ports[port].name;
    size_t length = strlen(port_name);
    size_t at = 0;
    bool outside = false;
    const char *name;
    const char *value;
    while (ranges->fields[port] != NULL && msbot_part_next_setting(ranges->part, &at, &name, &value)) {
        if (strncmp(name, port_name, length) == 0 && strncmp(name + length, MARK, strlen(MARK)) == 0) {
            const reader from = {message, size, 0};
            outside = is_outside(ranges, port, name + length + strlen(MARK), value, from) || outside;
        }
    }
    ranges->out_of_range += outside;
}

void msbot_ranges_begin(msbot_ranges *ranges, msbot_part *part, msbot_log *log)
{
    memset(ranges, 0, sizeof *ranges);
    ranges->part = part;
    ranges->log = log;
    part->look = look;
    part->ranges = ranges;
}

bool msbot_ranges_watch(msbot_ranges *ranges, unsigned port, const char *fields)
{
    field one;
    if (port >= ranges->part->config.port_count || ranges->part->config.ports[port].does != MSBOT_PUBLISHES ||
        *fields == 0) {
        return false;
    }
    for (const char *rest = fields; *rest != 0;) {
        rest = take_field(rest, &one);
        if (rest == NULL) {
            return false;
        }
    }
    ranges->fields[port] = fields;
    return true;
}
