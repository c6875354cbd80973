#include "capture/pixel/transfer.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

/* L of V; LINEAR: V itself. */
static double transfer_light_of(enum cap_transfer t, double v)
{
    if (t == CAP_TRANSFER_SRGB)
        return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
    if (t == CAP_TRANSFER_BT709)
        return v < 0.081 ? v / 4.5 : pow((v + 0.099) / 1.099, 1 / 0.45);
    return v;
}

enum { LEAST_BITS = 8, MOST_BITS = 16 };

/* Tables of 8, 9 ... 16 bits one after the other; the table of b bits starts at 2^b - 2^8. */
static uint32_t light[2][(2 << MOST_BITS) - (1 << LEAST_BITS)];
static atomic_bool made[2][MOST_BITS - LEAST_BITS + 1];
static pthread_mutex_t making = PTHREAD_MUTEX_INITIALIZER;

const uint32_t *cap_transfer_table(enum cap_transfer t, int bits)
{
    int curve = t == CAP_TRANSFER_BT709;
    uint32_t *table = light[curve] + ((size_t)1 << bits) - (1 << LEAST_BITS);
    if (atomic_load_explicit(&made[curve][bits - LEAST_BITS], memory_order_acquire))
        return table;
    pthread_mutex_lock(&making);
    uint32_t full = (1u << bits) - 1;
    bool mine = !atomic_load(&made[curve][bits - LEAST_BITS]);
    for (uint32_t v = 0; v <= full && mine; v++)
        table[v] = (uint32_t)lrint(transfer_light_of(t, (double)v / full) * CAP_LIGHT_ONE);
    atomic_store_explicit(&made[curve][bits - LEAST_BITS], true, memory_order_release);
    pthread_mutex_unlock(&making);
    return table;
}
