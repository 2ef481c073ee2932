/* An exported controller in a bare-metal loop, as QEMU runs it: a timer's interrupt measures, steps and drives, and the
   main loop plans. The stream of setpoints ends; the buffer's time-out brings the robot to rest.

   What a real board replaces stands between BOARD and END OF BOARD. */
#include "controller.h"
#include "controller_buffer.h"
#include "controller_reference.h"
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#define SAMPLE_US 20000u /* as CONTROLLER_SAMPLE_TIME */
#define SETPOINT_US 100000u /* from one setpoint to the next */
#define AHEAD_US 200000u /* they are sent before they are due */
#define TIMEOUT_US 500000u /* so long the last velocity goes on */
#define STOP_US 1000000u /* and so long braking lasts */
#define STREAM_US 8000000u /* then the planner falls silent */
#define END_US 12000000u

/* BOARD: registers of the Cortex-M's own timer, and its clock. */
#define CLOCK_HZ 25000000u
#define SYSTICK ((volatile uint32_t *)0xE000E010u) /* control, reload, value */

static void start_timer(void)
{
    SYSTICK[1] = (CLOCK_HZ / 1000000u * SAMPLE_US) - 1u;
    SYSTICK[2] = 0u;
    SYSTICK[0] = 7u; /* the processor's clock, with its interrupt */
}

static inline void lock(void)
{
    __asm volatile("cpsid i" ::: "memory");
}

static inline void unlock(void)
{
    __asm volatile("cpsie i" ::: "memory");
}

static inline void wait_for_interrupt(void)
{
    __asm volatile("wfi" ::: "memory");
}

/* Instead of sensors and motors: a point mass that turns, with its motors' torque and back-EMF, in steps of a sample. */
static struct {
    float x;
    float y;
    float phi;
    float v;
    float omega;
} robot = { 0.0f, 0.1f, 0.4f, 0.0f, 0.0f };

static void measure(controller_real x[CONTROLLER_X])
{
    x[CONTROLLER_X_x] = robot.x;
    x[CONTROLLER_X_y] = robot.y;
    x[CONTROLLER_X_phi] = robot.phi;
    x[CONTROLLER_X_v] = robot.v;
    x[CONTROLLER_X_omega] = robot.omega;
}

static void drive(const controller_real u[CONTROLLER_U])
{
    const float dt = 1e-6f * (float)SAMPLE_US;
    const float radius = 0.15f, half_width = 0.75f, torque = 7.2f, back_emf = 2.59f, mass = 40.0f, inertia = 18.0f;
    const float right = u[CONTROLLER_U_u_r], left = u[CONTROLLER_U_u_l];
    const float rate_right = (robot.v + (half_width * robot.omega)) / radius;
    const float rate_left = (robot.v - (half_width * robot.omega)) / radius;
    const float push_right = ((torque * right) - (back_emf * rate_right)) / radius;
    const float push_left = ((torque * left) - (back_emf * rate_left)) / radius;
    robot.v += dt * (push_right + push_left) / mass;
    robot.omega += dt * half_width * (push_right - push_left) / inertia;
    robot.phi += dt * robot.omega;
    robot.x += dt * robot.v * cosf(robot.phi);
    robot.y += dt * robot.v * sinf(robot.phi);
}
/* END OF BOARD */

/* What the last sample came to. The interrupt writes it, the main loop copies it with interrupts off. */
typedef struct {
    uint32_t now_us;
    controller_status status;
    controller_buffer_status stream;
    float off; /* [m] from the setpoint */
    float speed; /* [m/s] */
    controller_real u[CONTROLLER_U];
} sample;

static controller_state state;
static controller_buffer buffer;
static sample last;

void SysTick_Handler(void);

void SysTick_Handler(void)
{
    static uint32_t now_us = 0u;
    controller_real x[CONTROLLER_X];
    controller_setpoint reference;
    controller_diagnostics diagnostics;
    now_us += SAMPLE_US;
    measure(x);
    last.now_us = now_us;
    last.stream = controller_buffer_at(&buffer, now_us, &reference);
    if (last.stream != CONTROLLER_BUFFER_EMPTY) {
        last.status = controller_step(&state, 1e-6f * (float)SAMPLE_US, x, &reference, last.u, &diagnostics);
        last.off = hypotf(diagnostics.error[0], diagnostics.error[1]);
    } else {
        last.u[CONTROLLER_U_u_r] = 0.0f; /* no setpoint yet, which is not a setpoint of zero */
        last.u[CONTROLLER_U_u_l] = 0.0f;
    }
    last.speed = robot.v;
    drive(last.u);
}

static sample copied(void)
{
    sample now;
    lock();
    now = last;
    unlock();
    return now;
}

/* The planner: here the reference of the experiment; on a robot, whatever tells where to go. */
static controller_push_status plan(uint32_t due_us)
{
    controller_setpoint setpoint;
    controller_push_status pushed;
    controller_reference(1e-6 * (double)due_us, &setpoint);
    lock(); /* a buffer is for one context at a time */
    pushed = controller_buffer_push(&buffer, due_us, &setpoint);
    unlock();
    return pushed;
}

int main(void)
{
    static const char *const streams[] = { "empty", "fresh", "holding", "stopping", "stopped" };
    uint32_t due_us = 0u, printed_us = 0u;
    int printed = -1;
    sample now = { 0 };
    controller_init(&state);
    controller_buffer_init(&buffer, TIMEOUT_US, STOP_US);
    start_timer();
    while (now.now_us < END_US) {
        wait_for_interrupt();
        now = copied();
        if ((now.now_us >= SETPOINT_US) && (now.now_us < STREAM_US) && (now.now_us + AHEAD_US >= due_us)) {
            due_us = (due_us == 0u) ? (now.now_us + SETPOINT_US) : (due_us + SETPOINT_US);
            if (plan(due_us) != CONTROLLER_PUSH_OK) {
                (void)puts("a setpoint was refused");
                return 1;
            }
        }
        if (now.status != CONTROLLER_OK) {
            (void)printf("status %d\n", (int)now.status);
            return 1;
        }
        if (((int)now.stream != printed) || (now.now_us - printed_us >= 1000000u)) {
            (void)printf("%5.2f s %-8s %6.3f m off, %6.3f m/s, %5.2f and %5.2f V\n", 1e-6 * (double)now.now_us,
                streams[now.stream], (double)now.off, (double)now.speed, (double)now.u[CONTROLLER_U_u_r],
                (double)now.u[CONTROLLER_U_u_l]);
            printed = (int)now.stream;
            printed_us = now.now_us;
        }
    }
    if ((now.stream != CONTROLLER_BUFFER_STOPPED) || !(fabsf(now.speed) < 0.001f) || !(now.off < 0.001f)) {
        (void)puts("the robot has not come to rest at its last setpoint");
        return 1;
    }
    (void)puts("STOPPED, and at rest");
    return 0;
}
