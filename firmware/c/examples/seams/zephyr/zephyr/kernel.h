/* What the example uses of Zephyr's kernel, declared as its documentation says: only to compile it without Zephyr.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef ZEPHYR_KERNEL_SEAM_H
#define ZEPHYR_KERNEL_SEAM_H

#include <stddef.h>
#include <stdint.h>

typedef long atomic_t;
typedef struct {
    int64_t ticks;
} k_timeout_t;

struct k_msgq {
    size_t msg_size;
};

#define K_NO_WAIT ((k_timeout_t){0})
#define K_MSGQ_DEFINE(name, size, most, align) struct k_msgq name = {size}

long atomic_inc(atomic_t *target);
long atomic_dec(atomic_t *target);
long atomic_get(const atomic_t *target);
long atomic_set(atomic_t *target, long value);
int k_msgq_get(struct k_msgq *queue, void *data, k_timeout_t timeout);
int64_t k_uptime_ticks(void);
uint64_t k_ticks_to_us_floor64(uint64_t ticks);

#endif
