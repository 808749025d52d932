/* The example on Linux: a process on a SocketCAN interface, for a single-board computer or to try things out.
 *
 *     gcc -O2 -I . msbot_*.c examples/pin_board.c examples/linux_socketcan/main.c -o board
 *     ./board can0 0000000000000001
 *
 * The second word is the part's UID, 16 hexadecimal digits. Each level of the pin that it drives is a line on its standard
 * output, 0 or 1; each 0 or 1 on its standard input is the level of the pin that it reads.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#define _GNU_SOURCE
#include "../pin_board.h"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static int channel = -1;

static bool on_bus(void *context)
{
    (void)context;
    return true;
}

static bool receive(void *context, msbot_frame *frame)
{
    struct can_frame came;
    (void)context;
    if (read(channel, &came, sizeof came) != (ssize_t)sizeof came || came.can_dlc > 8) {
        return false;
    }
    bool extended = (came.can_id & CAN_EFF_FLAG) != 0;
    frame->id = came.can_id & (extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame->flags = (uint8_t)((extended ? MSBOT_EXTENDED : 0) | ((came.can_id & CAN_RTR_FLAG) ? MSBOT_REMOTE : 0));
    frame->size = came.can_dlc;
    memcpy(frame->data, came.data, frame->size);
    return true;
}

/* The kernel keeps the order of the frames. */
static unsigned pending(void *context)
{
    (void)context;
    return 0;
}

static bool has_room(void *context)
{
    struct pollfd ready = {channel, POLLOUT, 0};
    (void)context;
    return poll(&ready, 1, 0) == 1 && (ready.revents & POLLOUT);
}

static void send_frame(void *context, const msbot_frame *frame)
{
    struct can_frame sent;
    (void)context;
    memset(&sent, 0, sizeof sent);
    sent.can_id = frame->id | ((frame->flags & MSBOT_EXTENDED) ? CAN_EFF_FLAG : 0U);
    sent.can_dlc = frame->size;
    memcpy(sent.data, frame->data, frame->size);
    if (write(channel, &sent, sizeof sent) < 0) {
        perror("board: a frame was lost"); /* the streams above repair that */
    }
}

static uint32_t micros(void *context)
{
    struct timespec now;
    (void)context;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000000U + (uint64_t)now.tv_nsec / 1000U);
}

static void drive_pin(void *context, bool high)
{
    static int shown = -1;
    (void)context;
    if (shown != high) {
        shown = high;
        (void)printf("%d\n", high);
        (void)fflush(stdout);
    }
}

static bool read_pin(void *context)
{
    static bool level;
    (void)context;
    char octets[16];
    ssize_t size = read(STDIN_FILENO, octets, sizeof octets);
    for (ssize_t i = 0; i < size; i++) {
        if (octets[i] == '0' || octets[i] == '1') {
            level = octets[i] == '1';
        }
    }
    return level;
}

static bool open_channel(const char *name)
{
    struct sockaddr_can address;
    memset(&address, 0, sizeof address);
    address.can_family = AF_CAN;
    address.can_ifindex = (int)if_nametoindex(name);
    channel = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK, CAN_RAW);
    return channel >= 0 && address.can_ifindex > 0 && bind(channel, (struct sockaddr *)&address, sizeof address) == 0;
}

int main(int count, char **words)
{
    static const pin_board_pins pins = {drive_pin, read_pin, NULL};
    static const msbot_controller controller = {NULL, on_bus, receive, pending, has_room, send_frame, micros};
    uint8_t uid[8];
    if (count != 3 || strlen(words[2]) != 16) {
        (void)fprintf(stderr, "usage: %s INTERFACE UID, for example: %s can0 0000000000000001\n", words[0], words[0]);
        return 2;
    }
    uint64_t number = strtoull(words[2], NULL, 16);
    for (unsigned i = 0; i < 8; i++) {
        uid[i] = (uint8_t)(number >> (56 - 8 * i));
    }
    if (!open_channel(words[1])) {
        perror(words[1]);
        return 1;
    }
    (void)fcntl(STDIN_FILENO, F_SETFL, O_NONBLOCK);
    if (pin_board_init(&pins, uid, micros(NULL) | 1U, 0) != MSBOT_CONFIG_OK) {
        return 1;
    }
    for (;;) {
        uint32_t rest_us = pin_board_turn(&controller);
        struct pollfd news = {channel, POLLIN, 0};
        (void)poll(&news, 1, (int)((rest_us + 999U) / 1000U));
    }
}
