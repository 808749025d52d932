/* The example as a task of FreeRTOS, whatever the controller: the interrupts of the CAN controller wake it.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "freertos_task.h"

#include "pin_board.h"

static TaskHandle_t task;

static void run(void *parameters)
{
    const msbot_controller *controller = parameters;
    for (;;) {
        uint32_t rest_us = pin_board_turn(controller);
        if (rest_us > 0) {
            TickType_t ticks = pdMS_TO_TICKS(rest_us / 1000U);
            (void)ulTaskNotifyTake(pdTRUE, ticks > 0 ? ticks : 1);
        }
    }
}

bool pin_board_start_task(const msbot_controller *controller, UBaseType_t priority)
{
    return xTaskCreate(run, "msbot", PIN_BOARD_STACK_WORDS, (void *)(uintptr_t)controller, priority, &task) == pdPASS;
}

void pin_board_wake_from_interrupt(void)
{
    BaseType_t woken = pdFALSE;
    if (task != NULL) {
        vTaskNotifyGiveFromISR(task, &woken);
    }
    portYIELD_FROM_ISR(woken);
}
