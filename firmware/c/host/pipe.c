/* The firmware on a pipe: the tests call its functions from Python, one length-prefixed request after the other.
 *
 * A request is 2 octets of length, then a letter and its arguments, little endian; each has one answer, 2 octets of
 * length and the result. The request "." flushes the answers so far. Built with the sanitizers.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_can.h"
#include "msbot_compact.h"
#include "msbot_log.h"
#include "msbot_part.h"
#include "msbot_ranges.h"
#include "msbot_sha256.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint8_t request[70000];
static uint8_t answer[70000];
static size_t at, end, answered;

static uint32_t get(size_t octets)
{
    uint32_t value = 0;
    for (size_t i = 0; i < octets; i++) {
        if (at >= end) {
            abort();
        }
        value |= (uint32_t)request[at++] << 8 * i;
    }
    return value;
}

static void put(uint32_t value, size_t octets)
{
    for (size_t i = 0; i < octets; i++) {
        answer[answered++] = (uint8_t)(value >> 8 * i);
    }
}

static void put_octets(const uint8_t *octets, size_t size)
{
    if (size > 0) {
        memcpy(answer + answered, octets, size);
    }
    answered += size;
}

/* A copy with exact bounds for the address sanitizer. */
static uint8_t *copy(const uint8_t *octets, size_t size)
{
    uint8_t *copied = malloc(size ? size : 1);
    if (copied == NULL) {
        abort();
    }
    if (size > 0) {
        memcpy(copied, octets, size);
    }
    return copied;
}

static void put_frame(const msbot_frame *frame)
{
    put(frame->id, 4);
    put(frame->flags, 1);
    put_octets(frame->data, frame->size);
}

static void answer_pieces(uint8_t letter)
{
    static msbot_joiner joiner;
    if (letter == 'J') { /* limit, repeat: a joiner */
        memset(&joiner, 0, sizeof joiner);
        uint16_t limit = (uint16_t)get(2);
        msbot_joiner_reset(&joiner, limit, (uint16_t)get(2));
    } else if (letter == 'j') { /* time, data of a frame: the message that it ends */
        uint32_t now = get(4);
        uint8_t *data = copy(request + at, end - at);
        size_t size = msbot_joiner_take(&joiner, data, end - at, now);
        put_octets(joiner.body, size);
        free(data);
    } else if (letter == 'd') { /* what was dropped, by reason */
        for (int reason = 0; reason < MSBOT_DROPS; reason++) {
            put(joiner.dropped[reason], 2);
        }
    } else if (letter == 'S') { /* FD, counter, message: its frames */
        static msbot_splitter splitter;
        splitter.fd = get(1);
        splitter.q = (uint8_t)get(1);
        splitter.size = (uint16_t)(end - at);
        memcpy(splitter.body, request + at, end - at);
        msbot_splitter_begin(&splitter);
        uint8_t data[64];
        for (size_t size; (size = msbot_splitter_next(&splitter, data)) > 0;) {
            put((uint32_t)size, 1);
            put_octets(data, size);
        }
    } else if (letter == 'C') { /* packet: a short form */
        uint8_t *packet = copy(request + at, end - at);
        uint8_t *form = malloc(end - at + 1);
        put_octets(form, msbot_compress(form, packet, end - at));
        free(packet);
        free(form);
    } else if (letter == 'D') { /* room, form: whether it is one, and the packet */
        size_t room = get(2);
        uint8_t *form = copy(request + at, end - at);
        uint8_t *packet = malloc(room ? room : 1);
        int size = msbot_decompress(packet, room, form, end - at);
        put(size >= 0, 1);
        put_octets(packet, size > 0 ? (size_t)size : 0);
        free(form);
        free(packet);
    } else {
        abort();
    }
}

static msbot_can link_;

static void configure(msbot_can_config *config)
{
    memset(config, 0, sizeof *config);
    for (int i = 0; i < 8; i++) {
        config->uid[i] = (uint8_t)get(1);
    }
    config->codec = get(1) ? &msbot_compact : NULL;
    config->fd = get(1);
    config->fast = get(1);
    config->has_robot = get(1);
    config->robot = get(4);
    config->bitrate = get(4);
    config->seed = get(4);
}

static msbot_frame get_frame(void)
{
    msbot_frame frame = {0, 0, 0, {0}};
    frame.id = get(4);
    frame.flags = (uint8_t)get(1);
    frame.size = (uint8_t)(end - at);
    memcpy(frame.data, request + at, end - at);
    return frame;
}

static void answer_link(uint8_t letter)
{
    if (letter == 'l') { /* configuration: a link */
        msbot_can_config config;
        configure(&config);
        msbot_can_init(&link_, &config);
    } else if (letter == 's') {
        msbot_can_start(&link_);
    } else if (letter == 'o') {
        msbot_can_stop(&link_);
    } else if (letter == 'f') { /* time, frame */
        uint32_t now = get(4);
        msbot_frame frame = get_frame();
        msbot_can_receive(&link_, &frame, now);
    } else if (letter == 't') {
        msbot_can_tick(&link_, get(4));
    } else if (letter == 'n') { /* frames in the controller: the next one, or nothing */
        msbot_frame frame;
        if (msbot_can_next(&link_, get(1), &frame)) {
            put_frame(&frame);
        }
    } else if (letter == 'r') {
        msbot_can_drained(&link_, get(4));
    } else if (letter == 'e') { /* events, reason, node, use, state, reason of STOP; when `tick` is due */
        uint32_t due = 0;
        put(msbot_can_events(&link_), 1);
        put(link_.reason, 1);
        put(link_.node_id, 1);
        put(link_.use, 1);
        put(link_.state, 1);
        put(link_.stop_reason, 1);
        put(msbot_can_timer(&link_, &due), 1);
        put(due, 4);
    } else if (letter == 'w') { /* packet: whether it is taken */
        put(msbot_can_send(&link_, request + at, end - at), 1);
    } else if (letter == 'p') { /* reason: say STOP */
        msbot_can_say_stop(&link_, (uint8_t)get(1));
    } else if (letter == 'R') { /* the packet that came */
        uint8_t packet[MSBOT_CAN_MTU + 1] = {0};
        put_octets(packet, msbot_can_read(&link_, packet, sizeof packet));
    } else if (letter == 'x') { /* what the link has dropped, by reason */
        for (int reason = 0; reason < MSBOT_DROPS; reason++) {
            put(link_.in.dropped[reason], 2);
        }
    } else {
        answer_pieces(letter);
    }
}

/* A part. Its events are recorded and returned with the next "I". */

static msbot_part part;
static msbot_log log_;
static msbot_ranges ranges;
static char fields[MSBOT_PART_PORTS][100];
static uint8_t story[60000];
static size_t told;
static char texts[1000];
static uint8_t key[64];
static msbot_port_type ports[2 * MSBOT_PART_PORTS];
static bool with_functions = true;

static void tell(uint8_t letter, const void *octets, size_t size)
{
    if (told + size + 3 > sizeof story) {
        abort();
    }
    story[told++] = (uint8_t)(size + 1);
    story[told++] = (uint8_t)((size + 1) >> 8);
    story[told++] = letter;
    memcpy(story + told, octets, size);
    told += size;
}

static void received(void *context, unsigned port, const uint8_t *message, size_t size)
{
    uint8_t octets[MSBOT_XRCE_LARGEST + 1] = {(uint8_t)port};
    (void)context;
    memcpy(octets + 1, message, size);
    tell('r', octets, size + 1);
}

static void setting(void *context, const char *name, const char *value)
{
    char text[1000] = {0};
    (void)context;
    tell('s', text, (size_t)snprintf(text, sizeof text, "%s=%s", name, value));
}

static void safe(void *context, int port)
{
    const uint8_t octet = (uint8_t)port;
    (void)context;
    tell('z', &octet, 1);
}

static void changed(void *context, msbot_part_state state)
{
    const uint8_t octet = (uint8_t)state;
    (void)context;
    tell('c', &octet, 1);
}

static void identify(void *context)
{
    (void)context;
    tell('i', "", 0);
}

static const char *get_text(size_t *used)
{
    char *text = texts + *used;
    do {
        texts[*used] = (char)get(1);
    } while (texts[(*used)++] != 0);
    return text;
}

/* Serves by the first octet of a request: the request again, a sentence, too much. */
static int serve(void *context, const uint8_t *asked, size_t size, uint8_t *reply)
{
    uint8_t octets[MSBOT_XRCE_LARGEST + 1] = {*(const uint8_t *)context};
    memcpy(octets + 1, asked, size);
    tell('q', octets, size + 1);
    if (size > 0 && asked[0] == 'r') {
        static char sentence[301];
        memset(sentence, 'w', sizeof sentence - 1); /* too long: it is cut */
        return msbot_refuse(reply, sentence);
    }
    if (size > 0 && asked[0] == 'n') {
        return -1;
    }
    if (size > 0 && asked[0] == 'l') {
        return MSBOT_PART_REPLY + 1;
    }
    memcpy(reply, asked, size);
    return (int)size;
}

static void replied(void *context, const uint8_t *reply, size_t size, const char *why)
{
    uint8_t octets[MSBOT_XRCE_LARGEST + 2] = {(uint8_t)(uintptr_t)context, why != NULL};
    size = why != NULL ? strlen(why) : size;
    memcpy(octets + 2, why != NULL ? (const uint8_t *)why : reply, size);
    tell('y', octets, size + 2);
}

static void make_part(void)
{
    static const uint8_t numbers[MSBOT_PART_PORTS] = {0, 1, 2, 3, 4, 5, 6};
    size_t used = 0;
    msbot_part_config config;
    memset(&config, 0, sizeof config);
    configure(&config.can);
    config.random = get(4);
    config.nature = MSBOT_NATURE_SIMULATED;
    config.software = "1.2";
    config.part_number = get_text(&used);
    config.local_name = get_text(&used);
    for (int i = 0; i < 4; i++) {
        const char *expected = get_text(&used);
        config.robot[i] = *expected ? expected : NULL;
    }
    config.key_size = get(1);
    for (size_t i = 0; i < config.key_size; i++) {
        key[i] = (uint8_t)get(1);
    }
    config.key = config.key_size ? key : NULL;
    config.port_count = get(1);
    for (unsigned i = 0; i < config.port_count; i++) {
        ports[i].does = (uint8_t)get(1);
        ports[i].name = get_text(&used);
        ports[i].type = get_text(&used);
    }
    config.ports = ports;
    config.received = received;
    config.setting = setting;
    config.safe = safe;
    config.changed = changed;
    config.identify = identify;
    told = 0;
    put(msbot_part_init(&part, &config), 1);
    if (part.config.port_count > 0) {
        msbot_log_begin(&log_, &part);
        msbot_ranges_begin(&ranges, &part, &log_);
    }
    for (unsigned i = 0; i < part.config.port_count && with_functions; i++) {
        (void)msbot_part_serve(&part, i, serve, (void *)(uintptr_t)&numbers[i]);
    }
}

static void put_part(void)
{
    uint32_t due = 0;
    put(part.state, 1);
    put(part.link.node_id, 1);
    put(part.stopped, 1);
    put(part.beats, 4);
    put(part.missed_beats, 4);
    put(part.dropped, 2);
    put(part.client.refused, 2);
    put(part.client.dropped, 2);
    put(msbot_part_timer(&part, &due), 1);
    put(due, 4);
    put_octets(story, told);
    told = 0;
}

static void answer_part(uint8_t letter)
{
    if (letter == 'A') { /* configuration: a part */
        make_part();
    } else if (letter == 'B') {
        msbot_part_start(&part);
    } else if (letter == 'H') {
        msbot_part_stop(&part, get(4));
    } else if (letter == 'F') { /* time, frame */
        uint32_t now = get(4);
        msbot_frame frame = get_frame();
        msbot_part_receive(&part, &frame, now);
    } else if (letter == 'V') { /* time, packet: as if the link had brought it */
        uint32_t now = get(4);
        uint8_t *packet = copy(request + at, end - at);
        msbot_xrce_receive(&part.client, packet, end - at, now);
        free(packet);
    } else if (letter == 'T') {
        msbot_part_tick(&part, get(4));
    } else if (letter == 'N') { /* frames in the controller, time: the next one, or nothing */
        msbot_frame frame;
        unsigned pending = get(1);
        if (msbot_part_next(&part, pending, &frame, get(4))) {
            put_frame(&frame);
        }
    } else if (letter == 'Q') {
        msbot_part_drained(&part, get(4));
    } else if (letter == 'U') { /* port, message: whether it is taken */
        unsigned port = get(1);
        put(msbot_part_publish(&part, port, request + at, end - at), 1);
    } else if (letter == 'G') { /* level, time, text: whether it is taken for the log */
        msbot_log_level level = (msbot_log_level)get(1);
        uint32_t now = get(4);
        put(msbot_log_line(&log_, level, (const char *)request + at, now), 1);
    } else if (letter == 'a') { /* port, fields: whether the ranges of the port are watched from now on */
        unsigned port = get(1);
        char *kept = fields[port % MSBOT_PART_PORTS];
        snprintf(kept, sizeof fields[0], "%s", (const char *)request + at);
        put(msbot_ranges_watch(&ranges, port, kept), 1);
        put(ranges.out_of_range, 4);
    } else if (letter == 'E') { /* whether the program has functions that serve: before the part is made */
        with_functions = get(1) != 0;
    } else if (letter == 'L') { /* port, number of the call, timeout, time, request: why it is not sent */
        unsigned port = get(1);
        uintptr_t number = get(1);
        uint32_t timeout = get(4);
        uint32_t now = get(4);
        const char *why = msbot_part_call(&part, port, request + at, end - at, timeout, replied, (void *)number, now);
        put_octets((const uint8_t *)(why != NULL ? why : ""), why != NULL ? strlen(why) : 0);
    } else if (letter == 'W') { /* number of an error: what it says */
        const char *words = msbot_config_words((msbot_config_error)get(1));
        put_octets((const uint8_t *)words, strlen(words));
    } else if (letter == 'K') { /* reason: say STOP */
        msbot_part_say_stop(&part, (uint8_t)get(1));
    } else if (letter == 'P') { /* pressed, time: how a STOP button stands */
        bool pressed = get(1) != 0;
        msbot_part_hold_stop(&part, pressed, get(4));
    } else if (letter == 'I') { /* how it stands, and what happened */
        put_part();
    } else if (letter == 'M') { /* key size, key, octets: their HMAC */
        uint8_t digest[32];
        msbot_sha256 hash;
        size_t size = get(1);
        msbot_hmac_begin(&hash, request + at, size);
        msbot_sha256_add(&hash, request + at + size, end - at - size);
        msbot_hmac_end(&hash, request + at, size, digest);
        put_octets(digest, sizeof digest);
    } else if (letter == 'O') { /* nonce, session key: the proof of the part's key */
        uint8_t proof[16];
        at += 16;
        msbot_part_prove(&part.config, request + 1, get(4), proof);
        put_octets(proof, sizeof proof);
    } else {
        answer_link(letter);
    }
}

int main(void)
{
    uint8_t length[2];
    while (fread(length, 1, 2, stdin) == 2) {
        end = (size_t)(length[0] | length[1] << 8);
        at = 0;
        if (fread(request, 1, end, stdin) != end) {
            return 1;
        }
        if (end == 1 && request[0] == '.') {
            fflush(stdout);
            continue;
        }
        answered = 2;
        answer_part((uint8_t)get(1));
        answer[0] = (uint8_t)(answered - 2);
        answer[1] = (uint8_t)((answered - 2) >> 8);
        fwrite(answer, 1, answered, stdout);
    }
    return 0;
}
