/* What the example uses of Arduino, declared as its reference says: only to compile it without the Arduino tools.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef ARDUINO_SEAM_H
#define ARDUINO_SEAM_H

#include <stddef.h>
#include <stdint.h>

#define LOW 0
#define HIGH 1
#define INPUT 0
#define OUTPUT 1
#define LED_BUILTIN 13

void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t level);
int digitalRead(uint8_t pin);
int analogRead(uint8_t pin);
unsigned long micros(void);
void delay(unsigned long ms);
void setup(void);
void loop(void);

#endif
