/* What the example uses of Zephyr's CAN drivers; see zephyr/kernel.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef ZEPHYR_CAN_SEAM_H
#define ZEPHYR_CAN_SEAM_H

#include <zephyr/kernel.h>

struct device;

#define CAN_FRAME_IDE 1U
#define CAN_FRAME_RTR 2U
#define CAN_FILTER_IDE 1U

struct can_frame {
    uint32_t id;
    uint8_t dlc;
    uint8_t flags;
    uint8_t data[8];
};

struct can_filter {
    uint32_t id, mask;
    uint8_t flags;
};

enum can_state {
    CAN_STATE_ERROR_ACTIVE,
    CAN_STATE_ERROR_WARNING,
    CAN_STATE_ERROR_PASSIVE,
    CAN_STATE_BUS_OFF,
    CAN_STATE_STOPPED
};

struct can_bus_err_cnt {
    uint8_t tx_err_cnt, rx_err_cnt;
};

typedef void (*can_tx_callback_t)(const struct device *device, int error, void *user_data);

int can_start(const struct device *device);
int can_get_state(const struct device *device, enum can_state *state, struct can_bus_err_cnt *errors);
int can_add_rx_filter_msgq(const struct device *device, struct k_msgq *queue, const struct can_filter *filter);
int can_send(const struct device *device, const struct can_frame *frame, k_timeout_t timeout,
             can_tx_callback_t callback, void *user_data);

#endif
