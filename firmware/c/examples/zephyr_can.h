/* A CAN controller of Zephyr (3.5 and later) as a `msbot_controller`, classic CAN.
 *
 *     static zephyr_can can;
 *     static const msbot_controller controller = {&can, zephyr_can_on_bus, zephyr_can_receive, zephyr_can_pending,
 *                                                 zephyr_can_has_room, zephyr_can_send, zephyr_can_micros};
 *     zephyr_can_open(&can, DEVICE_DT_GET(DT_CHOSEN(zephyr_canbus)));
 *     pin_board_init(&pins, uid, sys_rand32_get() | 1U, 500000);
 *     for (;;) { k_usleep(pin_board_turn(&controller)); }
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef ZEPHYR_CAN_H
#define ZEPHYR_CAN_H

#include <zephyr/drivers/can.h>
#include <zephyr/kernel.h>

#include "msbot_can.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    const struct device *device;
    atomic_t pending;
} zephyr_can;

int zephyr_can_open(zephyr_can *can, const struct device *device); /* 0, or Zephyr's error */

bool zephyr_can_on_bus(void *context);
bool zephyr_can_receive(void *context, msbot_frame *frame);
unsigned zephyr_can_pending(void *context);
bool zephyr_can_has_room(void *context);
void zephyr_can_send(void *context, const msbot_frame *frame);
uint32_t zephyr_can_micros(void *context);

#ifdef __cplusplus
}
#endif

#endif
