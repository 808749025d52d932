/* The example on an Arduino, over the library CAN of Sandeep Mistry (MCP2515 shields, ESP32): 500 kbit/s, drives
 * LED_BUILTIN, reads pin 2. Put the files of firmware/c and examples/pin_board.[ch] into this folder.
 *
 * The part needs 5 kB of RAM: enough on an ESP32, a SAMD or an STM32, too much for an Uno.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include <Arduino.h>
#include <CAN.h>

extern "C" {
#include "pin_board.h"
}

static const uint8_t UID[8] = {'A', 'R', 'D', 0, 0, 0, 0, 1};  // another one for each board

static bool on_bus(void *) { return true; }

static bool receive(void *, msbot_frame *frame)
{
    if (CAN.parsePacket() == 0) {  // none of ours is empty
        return false;
    }
    frame->id = static_cast<uint32_t>(CAN.packetId());
    frame->flags = static_cast<uint8_t>((CAN.packetExtended() ? MSBOT_EXTENDED : 0) | (CAN.packetRtr() ? MSBOT_REMOTE : 0));
    frame->size = 0;
    while (CAN.available() && frame->size < 8) {
        frame->data[frame->size++] = static_cast<uint8_t>(CAN.read());
    }
    return true;
}

// The library waits in endPacket() until a frame has left.
static unsigned pending(void *) { return 0; }

static bool has_room(void *) { return true; }

static void send(void *, const msbot_frame *frame)
{
    if (frame->flags & MSBOT_EXTENDED) {
        CAN.beginExtendedPacket(static_cast<long>(frame->id));
    } else {
        CAN.beginPacket(static_cast<int>(frame->id));
    }
    for (uint8_t i = 0; i < frame->size; i++) {
        CAN.write(frame->data[i]);
    }
    CAN.endPacket();
}

static uint32_t clock_us(void *) { return static_cast<uint32_t>(micros()); }

static const msbot_controller CONTROLLER = {nullptr, on_bus, receive, pending, has_room, send, clock_us};

static void drive(void *, bool high) { digitalWrite(LED_BUILTIN, high ? HIGH : LOW); }

static bool read_pin(void *) { return digitalRead(2) == HIGH; }

static const pin_board_pins PINS = {drive, read_pin, nullptr};

void setup()
{
    digitalWrite(LED_BUILTIN, LOW);  // before it is an output
    pinMode(LED_BUILTIN, OUTPUT);
    pinMode(2, INPUT);
    while (!CAN.begin(500000)) {
        delay(100);
    }
    const uint32_t noise = static_cast<uint32_t>(analogRead(0)) << 16;
    while (pin_board_init(&PINS, UID, (static_cast<uint32_t>(micros()) ^ noise) | 1U, 500000) != MSBOT_CONFIG_OK) {
        delay(100);  // msbot_config_words says what is wrong
    }
}

void loop() { pin_board_turn(&CONTROLLER); }
