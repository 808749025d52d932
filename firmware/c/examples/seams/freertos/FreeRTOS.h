/* What the example uses of FreeRTOS, declared as its documentation says: only to compile the example without FreeRTOS.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef FREERTOS_SEAM_H
#define FREERTOS_SEAM_H

#include <stdint.h>

typedef long BaseType_t;
typedef unsigned long UBaseType_t;
typedef uint32_t TickType_t;

#define pdFALSE ((BaseType_t)0)
#define pdTRUE ((BaseType_t)1)
#define pdPASS ((BaseType_t)1)
#define pdMS_TO_TICKS(ms) ((TickType_t)(ms))
#define portYIELD_FROM_ISR(woken) ((void)(woken))

#endif
