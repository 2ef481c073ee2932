/* What comes beside a step of an exported controller: the buffer asked once a sample with a setpoint every five, or with
   OF_REFERENCE the experiment's own reference. */
#include "controller_buffer.h"
#include "controller_reference.h"
#include "measure.h"

#define SAMPLE_US 20000u

int main(void)
{
    static controller_buffer buffer;
    controller_setpoint setpoint;
    controller_buffer_init(&buffer, 500000u, 1000000u);
    for (uint32_t i = 0u; i < 500u; i++) {
        const uint32_t now_us = i * SAMPLE_US;
        if ((i % 5u) == 0u) {
            controller_reference(1e-6 * (double)(now_us + (5u * SAMPLE_US)), &setpoint);
            (void)controller_buffer_push(&buffer, now_us + (5u * SAMPLE_US), &setpoint);
        }
#ifdef OF_REFERENCE
        begin_step();
        controller_reference(1e-6 * (double)now_us, &setpoint);
        end_step();
#else
        begin_step();
        (void)controller_buffer_at(&buffer, now_us, &setpoint);
        end_step();
#endif
    }
    print_measured();
    return 0;
}
