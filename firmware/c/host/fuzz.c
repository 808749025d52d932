/* A fuzz target (libFuzzer): a part receives whatever the octets make, and each packet is shortened and restored.
 *
 *     clang -g -O1 -fsanitize=fuzzer,address,undefined -I .. fuzz.c ../msbot_*.c -o fuzz && ./fuzz
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_compact.h"
#include "msbot_controller.h"

#include <stdlib.h>
#include <string.h>

static const msbot_port_type PORTS[] = {{"drive", "Switch", MSBOT_SUBSCRIBES},
                                        {"level", "Switch", MSBOT_PUBLISHES},
                                        {"photo", "Switch -> Switch", MSBOT_SERVES},
                                        {"look", "Switch -> Switch", MSBOT_CALLS}};

static void received(void *context, unsigned port, const uint8_t *message, size_t size)
{
    (void)context;
    (void)message;
    if (port != 0 || size > MSBOT_XRCE_LARGEST) {
        abort();
    }
}

static void setting(void *context, const char *name, const char *value)
{
    (void)context;
    if (strlen(name) + strlen(value) > MSBOT_PART_CONFIGURATION) {
        abort();
    }
}

static void safe(void *context, int port)
{
    (void)context;
    if (port < MSBOT_ALL_PORTS || port > 3) {
        abort();
    }
}

static msbot_part part;
static uint32_t now_us;

static void say_all(void)
{
    msbot_frame frame;
    for (int i = 0; i < 100 && msbot_part_next(&part, 0, &frame, now_us); i++) {
        if (frame.size > MSBOT_CAN_DATA) {
            abort();
        }
    }
    msbot_part_drained(&part, now_us);
}

static void hear(uint32_t id, uint8_t flags, const uint8_t *data, size_t size)
{
    msbot_frame frame = {id, flags, (uint8_t)(size > 8 ? 8 : size), {0}};
    memcpy(frame.data, data, frame.size);
    msbot_part_receive(&part, &frame, now_us);
    say_all();
}

static void come_back(const uint8_t *octets, size_t size)
{
    uint8_t form[300];
    uint8_t packet[300];
    size = size > 250 ? 250 : size;
    size_t shorter = msbot_compress(form, octets, size);
    int whole = msbot_decompress(packet, sizeof packet, form, shorter);
    if (shorter > size + 1 || whole != (int)size || memcmp(packet, octets, size) != 0) {
        abort();
    }
    (void)msbot_decompress(packet, sizeof packet, octets, size);
}

static void begin(bool codec)
{
    static const uint8_t key[16] = {1};
    static const uint8_t login[] = {0x81, 0, 0, 0, 4, 1, 11, 0, 0, 0, 'X', 'R', 'C', 'E', 1, 0, 1, 15, 0};
    msbot_part_config config;
    memset(&config, 0, sizeof config);
    config.can.uid[0] = 1;
    config.can.codec = codec ? &msbot_compact : NULL;
    config.can.bitrate = 500000;
    config.random = 1;
    config.part_number = "PIN-BOARD";
    config.local_name = "board";
    config.key = key;
    config.key_size = sizeof key;
    config.ports = PORTS;
    config.port_count = 4;
    config.received = received;
    config.setting = setting;
    config.safe = safe;
    now_us = 0;
    (void)msbot_part_init(&part, &config);
    msbot_part_start(&part);
    say_all();
    hear(0x02000000U | 2U << 8 | 5U, MSBOT_EXTENDED, config.can.uid, 8);
    msbot_xrce_receive(&part.client, login, sizeof login, now_us);
    say_all();
}

int LLVMFuzzerTestOneInput(const uint8_t *octets, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *octets, size_t size)
{
    if (size < 1) {
        return 0;
    }
    begin(octets[0] & 1U);
    come_back(octets + 1, size - 1);
    for (size_t at = 1; at + 1 < size;) {
        uint8_t what = octets[at];
        size_t length = octets[at + 1] % 64U;
        at += 2;
        length = length > size - at ? size - at : length;
        const uint8_t *rest = octets + at;
        at += length;
        now_us += (uint32_t)(what >> 4) * 40000U;
        switch (what & 7U) {
        case 0:
            hear(0x180U + 5U, 0, rest, length);
            break;
        case 1:
            hear(0x700U, 0, rest, length);
            break;
        case 2:
            hear(0x02000000U | what, MSBOT_EXTENDED, rest, length);
            break;
        case 3:
            hear(0x008U, 0, rest, length);
            break;
        case 4:
            msbot_part_tick(&part, now_us);
            say_all();
            break;
        case 5:
            (void)msbot_part_publish(&part, what >> 3 & 1U, rest, length);
            say_all();
            break;
        default: { /* a packet of the session */
            uint8_t packet[68] = {part.client.session, what & 0x40U ? 0x80 : what & 0x20U ? 1 : 0};
            packet[2] = (uint8_t)(part.client.handled + 1);
            packet[3] = (uint8_t)((part.client.handled + 1) >> 8);
            memcpy(packet + 4, rest, length);
            msbot_xrce_receive(&part.client, packet, length + 4, now_us);
            say_all();
        }
        }
    }
    return 0;
}
