/* The program of the example: see pin_board.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "pin_board.h"

#include "msbot_compact.h"

#include <string.h>

enum { DRIVE, LEVEL };

static const msbot_port_type PORTS[] = {
    [DRIVE] = {"drive", "Switch", MSBOT_SUBSCRIBES},
    [LEVEL] = {"level", "Switch", MSBOT_PUBLISHES},
};

static msbot_part part;
static pin_board_pins pins;
static bool driven, safe_value, invert, has_said, said;
static uint32_t repeat_us = 5000000, said_us;

static void drive(bool on)
{
    driven = on;
    pins.drive(pins.context, on != invert);
}

/* Converts seconds as people write them, 0.25 or 5, to microseconds; digits beyond the sixth are ignored. */
static uint32_t read_seconds(const char *text)
{
    uint32_t value = 0;
    uint32_t unit = 1000000;
    bool fraction = false;
    for (; (*text >= '0' && *text <= '9') || *text == '.'; text++) {
        if (*text == '.') {
            fraction = true;
        } else if (!fraction) {
            value = 10 * value + (uint32_t)(*text - '0') * unit;
        } else {
            unit /= 10;
            value += (uint32_t)(*text - '0') * unit;
        }
    }
    return value;
}

static void received(void *context, unsigned port, const uint8_t *message, size_t size)
{
    (void)context;
    if (port == DRIVE && size == 1) { /* Switch { bool on } */
        drive(message[0] != 0);
    }
}

static void setting(void *context, const char *name, const char *value)
{
    (void)context;
    if (strcmp(name, "invert") == 0) {
        invert = strcmp(value, "true") == 0;
        drive(driven);
        has_said = false;
    } else if (strcmp(name, "repeat_s") == 0) {
        repeat_us = read_seconds(value);
    } else if (strcmp(name, "drive.safe.on") == 0) {
        safe_value = strcmp(value, "true") == 0;
    }
}

static void safe(void *context, int port)
{
    (void)context;
    if (port == DRIVE || port == MSBOT_ALL_PORTS) {
        drive(safe_value);
    }
}

msbot_config_error pin_board_init(const pin_board_pins *board, const uint8_t uid[8], uint32_t random, uint32_t bitrate)
{
    msbot_part_config config;
    pins = *board;
    memset(&config, 0, sizeof config);
    memcpy(config.can.uid, uid, 8);
    config.can.codec = &msbot_compact;
    config.can.bitrate = bitrate;
    config.random = random;
    config.part_number = "PIN-BOARD";
    config.nature = MSBOT_NATURE_REAL;
    config.software = "1";
    config.local_name = "board";
    config.ports = PORTS;
    config.port_count = 2;
    config.received = received;
    config.setting = setting;
    config.safe = safe;
    return msbot_part_init(&part, &config);
}

uint32_t pin_board_turn(const msbot_controller *controller)
{
    uint32_t rest_us = msbot_turn(&part, controller);
    uint32_t now_us = controller->micros(controller->context);
    bool on = pins.read(pins.context) != invert;
    if (!msbot_part_is_bound(&part, LEVEL)) {
        has_said = false;
    } else if (!has_said || on != said || now_us - said_us >= repeat_us) {
        const uint8_t message[1] = {on};
        if (msbot_part_publish(&part, LEVEL, message, sizeof message)) {
            has_said = true;
            said = on;
            said_us = now_us;
            return 0;
        }
    }
    return rest_us < 1000 ? rest_us : 1000; /* the pin is read each millisecond */
}

const msbot_part *pin_board_part(void) { return &part; }
