/* A custom transport of the Micro XRCE-DDS client: see micro_xrce_dds.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "micro_xrce_dds.h"

#include <string.h>

/* One turn: frames go to the link until it has a whole packet, which stays there until `read` takes it. */
static void turn(msbot_uxr *can)
{
    const msbot_controller *controller = can->controller;
    void *context = controller->context;
    uint32_t now_us = controller->micros(context);
    bool on_bus = controller->on_bus(context);
    if (!on_bus && can->link.state != MSBOT_CAN_OFF) {
        msbot_can_stop(&can->link);
    } else if (on_bus && can->link.state == MSBOT_CAN_OFF) {
        msbot_can_start(&can->link);
    }
    msbot_frame frame;
    while (can->link.packet == 0 && controller->receive(context, &frame)) {
        msbot_can_receive(&can->link, &frame, now_us);
    }
    msbot_can_tick(&can->link, now_us);
    if (controller->pending(context) == 0) {
        msbot_can_drained(&can->link, now_us);
    }
    while (on_bus && controller->has_room(context) && msbot_can_next(&can->link, controller->pending(context), &frame)) {
        controller->send(context, &frame);
    }
    can->stopped = can->stopped || (msbot_can_events(&can->link) & MSBOT_EVENT_STOP) != 0;
}

static bool is_joined(const msbot_uxr *can) { return can->link.node_id > 0; }

static bool has_packet(const msbot_uxr *can) { return can->link.packet > 0; }

static bool has_sent(const msbot_uxr *can) { return !can->link.out.waiting; }

/* Takes turns until the condition holds, or the time is over. */
static bool take_turns(msbot_uxr *can, bool (*holds)(const msbot_uxr *can), uint32_t most_us)
{
    const msbot_controller *controller = can->controller;
    uint32_t began_us = controller->micros(controller->context);
    for (;;) {
        turn(can);
        uint32_t passed_us = controller->micros(controller->context) - began_us;
        if (holds(can) || passed_us >= most_us) {
            return holds(can);
        }
        if (can->wait != NULL) {
            can->wait(most_us - passed_us < 1000U ? most_us - passed_us : 1000U);
        }
    }
}

bool msbot_uxr_open(uxrCustomTransport *transport)
{
    msbot_uxr *can = transport->args;
    msbot_can_init(&can->link, &can->config);
    return take_turns(can, is_joined, MSBOT_UXR_OPEN_US);
}

bool msbot_uxr_close(uxrCustomTransport *transport)
{
    msbot_uxr *can = transport->args;
    msbot_can_stop(&can->link);
    return true;
}

size_t msbot_uxr_write(uxrCustomTransport *transport, const uint8_t *packet, size_t size, uint8_t *error)
{
    msbot_uxr *can = transport->args;
    if (!take_turns(can, has_sent, MSBOT_UXR_WRITE_US) || !msbot_can_send(&can->link, packet, size)) {
        *error = 1;
        return 0;
    }
    turn(can);
    return size;
}

size_t msbot_uxr_read(uxrCustomTransport *transport, uint8_t *packet, size_t room, int timeout_ms, uint8_t *error)
{
    msbot_uxr *can = transport->args;
    uint8_t whole[MSBOT_CAN_MTU + 1];
    (void)take_turns(can, has_packet, timeout_ms > 0 ? 1000U * (uint32_t)timeout_ms : 0U);
    size_t size = msbot_can_read(&can->link, whole, sizeof whole);
    if (size == 0 || size > room) {
        *error = 1;
        return 0;
    }
    memcpy(packet, whole, size);
    return size;
}
