/* The program of the example: a part that drives one pin and reports the level of another (parts/pin-board.toml).
 *
 * The same file runs on every controller of the examples; a board provides two functions for its pins.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef PIN_BOARD_H
#define PIN_BOARD_H

#include "msbot_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    void (*drive)(void *context, bool high);
    bool (*read)(void *context);
    void *context;
} pin_board_pins;

/* `uid` is the microcontroller's own number; `random` is anything that differs from one start to the next. */
msbot_config_error pin_board_init(const pin_board_pins *board, const uint8_t uid[8], uint32_t random, uint32_t bitrate);
/* One turn of the program; returns how long it may rest, in microseconds. */
uint32_t pin_board_turn(const msbot_controller *controller);
const msbot_part *pin_board_part(void);

#ifdef __cplusplus
}
#endif

#endif
