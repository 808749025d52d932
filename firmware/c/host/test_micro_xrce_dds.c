/* The custom transport for the Micro XRCE-DDS client, with a master that gives an address and sends every packet back.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "examples/micro_xrce_dds.h"

#include "msbot_compact.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition) \
    do { \
        if (!(condition)) { \
            printf("%s:%d: not true: %s\n", __FILE__, __LINE__, #condition); \
            exit(1); \
        } \
    } while (0)

static bool is_there; /* the master */
static uint32_t clock_us;
static msbot_frame waiting[256];
static unsigned waiting_size;
static msbot_joiner up;
static msbot_splitter down;

static void say(const msbot_frame *frame)
{
    CHECK(waiting_size < 256);
    waiting[waiting_size++] = *frame;
}

static void master_hears(const msbot_frame *frame)
{
    msbot_frame answer = {0x02000000U | 7U << 10 | 2U << 8 | 5U, MSBOT_EXTENDED, 8, {0}};
    if (frame->flags & MSBOT_EXTENDED) {
        memcpy(answer.data, frame->data, 8);
        say(&answer);
        msbot_joiner_reset(&up, MSBOT_CAN_MTU + 1, 200);
        return;
    }
    size_t size = msbot_joiner_take(&up, frame->data, frame->size, clock_us);
    if (size > 0) {
        memcpy(down.body, up.body, size);
        down.size = (uint16_t)size;
        msbot_splitter_begin(&down);
        while ((answer.size = (uint8_t)msbot_splitter_next(&down, answer.data)) > 0) {
            answer.id = 0x185;
            answer.flags = 0;
            say(&answer);
        }
    }
}

static bool on_bus(void *context)
{
    (void)context;
    return true;
}

static bool receive(void *context, msbot_frame *frame)
{
    (void)context;
    if (waiting_size == 0) {
        return false;
    }
    *frame = waiting[0];
    waiting_size--;
    memmove(waiting, waiting + 1, waiting_size * sizeof *waiting);
    return true;
}

static unsigned pending(void *context)
{
    (void)context;
    return 0;
}

static bool has_room(void *context)
{
    (void)context;
    return true;
}

static void send(void *context, const msbot_frame *frame)
{
    (void)context;
    if (is_there) {
        master_hears(frame);
    }
}

static uint32_t micros(void *context)
{
    (void)context;
    return clock_us += 10;
}

static void rest(uint32_t us) { clock_us += us; }

int main(void)
{
    static const msbot_controller controller = {NULL, on_bus, receive, pending, has_room, send, micros};
    static msbot_uxr can;
    static const uint8_t stop = 1;
    uxrCustomTransport transport = {&can};
    uint8_t packet[MSBOT_CAN_MTU];
    uint8_t back[MSBOT_CAN_MTU];
    uint8_t error = 0;
    can.controller = &controller;
    can.config.uid[0] = 1;
    can.config.codec = &msbot_compact;
    can.wait = rest;
    uint32_t began_us = clock_us;
    CHECK(!msbot_uxr_open(&transport) && clock_us - began_us >= MSBOT_UXR_OPEN_US); /* nobody is there */
    CHECK(msbot_uxr_write(&transport, packet, 1, &error) == 0 && error != 0);
    is_there = true;
    CHECK(msbot_uxr_open(&transport));
    for (size_t size = 1; size <= sizeof packet; size++) {
        for (size_t i = 0; i < size; i++) {
            packet[i] = (uint8_t)(0x81 + i * size);
        }
        CHECK(msbot_uxr_write(&transport, packet, size, &error) == size);
        memset(back, 0, sizeof back);
        CHECK(msbot_uxr_read(&transport, back, sizeof back, 10, &error) == size);
        CHECK(memcmp(packet, back, size) == 0);
    }
    began_us = clock_us;
    CHECK(msbot_uxr_read(&transport, back, sizeof back, 10, &error) == 0 && clock_us - began_us >= 10000);
    CHECK(msbot_uxr_write(&transport, packet, 100, &error) == 100);
    CHECK(msbot_uxr_read(&transport, back, 50, 10, &error) == 0); /* larger than the library's buffer */
    CHECK(!can.stopped);
    say(&(msbot_frame){0x008, 0, 1, {stop}});
    CHECK(msbot_uxr_read(&transport, back, sizeof back, 0, &error) == 0 && can.stopped);
    CHECK(msbot_uxr_close(&transport) && can.link.state == MSBOT_CAN_OFF);
    return 0;
}
