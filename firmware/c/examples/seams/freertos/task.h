/* See FreeRTOS.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef FREERTOS_TASK_SEAM_H
#define FREERTOS_TASK_SEAM_H

#include "FreeRTOS.h"

typedef struct tskTaskControlBlock *TaskHandle_t;
typedef void (*TaskFunction_t)(void *);

BaseType_t xTaskCreate(TaskFunction_t code, const char *name, uint16_t stack_words, void *parameters,
                       UBaseType_t priority, TaskHandle_t *created);
uint32_t ulTaskNotifyTake(BaseType_t clear, TickType_t ticks);
void vTaskNotifyGiveFromISR(TaskHandle_t task, BaseType_t *woken);

#endif
