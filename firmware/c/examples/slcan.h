/* A CAN controller over a serial line: the board is adapter and node in one.
 *
 * The computer speaks the slcan protocol (LAWICEL CANUSB) to it, as to a CANable: `slcand`, or
 * `can:slcan:/dev/ttyACM0`. The computer receives the node's frames as frames of the bus, and vice versa. For boards
 * without a CAN transceiver, and for emulators.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef SLCAN_H
#define SLCAN_H

#include "msbot_can.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    bool (*read)(uint8_t *octet); /* false: nothing has come */
    void (*write)(const char *octets, size_t size);
    char line[32];
    uint8_t size;
    bool is_open, too_long;
} slcan;

bool slcan_on_bus(void *context); /* the computer has opened the channel */
bool slcan_receive(void *context, msbot_frame *frame);
unsigned slcan_pending(void *context);
bool slcan_has_room(void *context);
void slcan_send(void *context, const msbot_frame *frame);

#ifdef __cplusplus
}
#endif

#endif
