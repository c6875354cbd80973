/* Answers to action commands: anything may come in on the port. */
#include "capture/wire/action.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct cap_action_ack a = {0, 0};
    if (cap_action_decode(data, size, &a) && (a.number == 0 || size < 8))
        __builtin_trap();
    return 0;
}
