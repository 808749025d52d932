/* A CAN controller of Zephyr: see zephyr_can.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "zephyr_can.h"

#include <string.h>

#define QUEUE_FRAMES 32
#ifdef CAN_FILTER_DATA /* up to Zephyr 3.5 a filter says that it lets data frames through */
#define DATA_FRAMES CAN_FILTER_DATA
#else
#define DATA_FRAMES 0
#endif

K_MSGQ_DEFINE(zephyr_can_queue, sizeof(struct can_frame), QUEUE_FRAMES, 4);

static void frame_sent(const struct device *device, int error, void *context)
{
    (void)device;
    (void)error;
    (void)atomic_dec(&((zephyr_can *)context)->pending);
}

int zephyr_can_open(zephyr_can *can, const struct device *device)
{
    static const struct can_filter all[2] = {{.flags = DATA_FRAMES}, {.flags = CAN_FILTER_IDE | DATA_FRAMES}};
    can->device = device;
    (void)atomic_set(&can->pending, 0);
    for (size_t i = 0; i < 2; i++) {
        int filter = can_add_rx_filter_msgq(device, &zephyr_can_queue, &all[i]);
        if (filter < 0) {
            return filter;
        }
    }
    return can_start(device);
}

bool zephyr_can_on_bus(void *context)
{
    zephyr_can *can = context;
    enum can_state state = CAN_STATE_STOPPED;
    return can_get_state(can->device, &state, NULL) == 0 && state != CAN_STATE_BUS_OFF && state != CAN_STATE_STOPPED;
}

bool zephyr_can_receive(void *context, msbot_frame *frame)
{
    struct can_frame came;
    (void)context;
    if (k_msgq_get(&zephyr_can_queue, &came, K_NO_WAIT) != 0) {
        return false;
    }
    bool is_remote = (came.flags & CAN_FRAME_RTR) != 0;
    frame->id = came.id;
    frame->flags = (uint8_t)(((came.flags & CAN_FRAME_IDE) ? MSBOT_EXTENDED : 0) | (is_remote ? MSBOT_REMOTE : 0));
    frame->size = (uint8_t)(is_remote ? 0 : came.dlc > 8 ? 8 : came.dlc);
    memcpy(frame->data, came.data, frame->size);
    return true;
}

unsigned zephyr_can_pending(void *context)
{
    /* Drivers may send equal identifiers in another order: one frame of a packet at a time (see bxcan.h). */
    return atomic_get(&((zephyr_can *)context)->pending) > 0 ? 2 : 0;
}

bool zephyr_can_has_room(void *context) { return atomic_get(&((zephyr_can *)context)->pending) < 3; }

void zephyr_can_send(void *context, const msbot_frame *frame)
{
    zephyr_can *can = context;
    struct can_frame sent;
    memset(&sent, 0, sizeof sent);
    sent.id = frame->id;
    sent.dlc = frame->size;
    sent.flags = (frame->flags & MSBOT_EXTENDED) ? CAN_FRAME_IDE : 0;
    memcpy(sent.data, frame->data, frame->size);
    (void)atomic_inc(&can->pending);
    if (can_send(can->device, &sent, K_NO_WAIT, frame_sent, can) != 0) {
        (void)atomic_dec(&can->pending); /* lost: the streams above repair that */
    }
}

uint32_t zephyr_can_micros(void *context)
{
    (void)context;
    return (uint32_t)k_ticks_to_us_floor64((uint64_t)k_uptime_ticks());
}
