/* Runs a part on a CAN controller: see msbot_controller.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_controller.h"

#define LONGEST_REST_US 1000000U
#define FRAMES_A_TURN 32 /* after these it is the application's turn */

uint32_t msbot_turn(msbot_part *part, const msbot_controller *controller)
{
    void *context = controller->context;
    uint32_t now_us = controller->micros(context);
    bool on_bus = controller->on_bus(context);
    bool was_on_bus = part->link.state != MSBOT_CAN_OFF;
    if (on_bus && !was_on_bus) {
        msbot_part_start(part);
    } else if (!on_bus && was_on_bus) {
        msbot_part_stop(part, now_us);
    }
    msbot_frame frame;
    for (int i = 0; i < FRAMES_A_TURN && controller->receive(context, &frame); i++) {
        if (on_bus) {
            msbot_part_receive(part, &frame, now_us);
        }
    }
    msbot_part_tick(part, now_us);
    if (on_bus && controller->pending(context) == 0) {
        msbot_part_drained(part, now_us);
    }
    while (on_bus && controller->has_room(context) &&
           msbot_part_next(part, controller->pending(context), &frame, now_us)) {
        controller->send(context, &frame);
    }
    uint32_t at = 0;
    if (!msbot_part_timer(part, &at)) {
        return LONGEST_REST_US;
    }
    int32_t rest_us = (int32_t)(at - now_us);
    return rest_us <= 0 ? 0 : (uint32_t)rest_us < LONGEST_REST_US ? (uint32_t)rest_us : LONGEST_REST_US;
}
