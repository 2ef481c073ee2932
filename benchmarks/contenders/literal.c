/* Study 1 straight from the paper's equations, numbers in parentheses: one robot after another, libm, small loops. */
#include <math.h>
#include <stddef.h>
#include <string.h>

/* Loops over samples call the step: inside them, what does not change is computed once. */
#define INLINE static inline __attribute__((always_inline))

typedef struct {
    double r, b, d, L, m_C, m_w, I_m, I_C, K1, K2;
    double b1[2], b2[2], alpha[2];
    double Gamma[6], lower[6];
    double center[2], radius, rate; /* of the reference (92) */
    double sample_time;
} Parameters;

typedef struct {
    double x[5]; /* x, y, phi, v, omega */
    double theta_hat[6];
} State;

typedef struct {
    double x[5], u[2], e[2], theta_hat[6];
} Row;

static const double SINGULAR = 1e-9;

/* (15): x' for the voltages u */
INLINE void state_derivative(const Parameters *restrict p, const double x[5], const double u[2], double rate[5])
{
    const double phi = x[2], v = x[3], omega = x[4];
    const double mass = p->m_C + 2.0 * p->m_w;
    const double inertia = p->I_C + 2.0 * p->I_m + p->m_C * p->d * p->d + 2.0 * p->m_w * p->b * p->b;
    const double force = p->K1 / p->r * (u[0] + u[1]) - 2.0 * p->K2 / (p->r * p->r) * v + p->m_C * p->d * omega * omega;
    const double torque = p->K1 * p->b / p->r * (u[0] - u[1]) - 2.0 * p->K2 * p->b * p->b / (p->r * p->r) * omega
                        - p->m_C * p->d * v * omega;
    rate[0] = v * cos(phi);
    rate[1] = v * sin(phi);
    rate[2] = omega;
    rate[3] = force / mass;
    rate[4] = torque / inertia;
}

/* One sample from the state, which is replaced; gives how far Dhat is from singular. */
INLINE double step(const Parameters *restrict p, double t, State *restrict state, Row *restrict row)
{
    const double *x = state->x, *theta = state->theta_hat;
    const double phi = x[2], v = x[3], omega = x[4], L = p->L;
    const double sine = sin(phi), cosine = cos(phi);

    /* the reference (92) with its derivatives */
    const double along = cos(p->rate * t), across = sin(p->rate * t);
    const double y_r[2] = {p->center[0] + p->radius * along, p->center[1] + p->radius * across};
    const double y_r_dot[2] = {-p->radius * p->rate * across, p->radius * p->rate * along};
    const double y_r_ddot[2] = {-p->radius * p->rate * p->rate * along, -p->radius * p->rate * p->rate * across};

    /* the outputs (17) with their rates (19), the tracking error, the filtered error (34), the outer loop (27) */
    const double y[2] = {x[0] + L * cosine, x[1] + L * sine};
    const double y_dot[2] = {v * cosine - L * omega * sine, v * sine + L * omega * cosine};
    double e[2], E1[2], eta[2];
    for (int i = 0; i < 2; i++) {
        const double e_dot = y_dot[i] - y_r_dot[i];
        e[i] = y[i] - y_r[i];
        E1[i] = e_dot + p->alpha[i] * e[i];
        eta[i] = y_r_ddot[i] - p->b1[i] * e_dot - p->b2[i] * e[i];
    }

    /* the Lie derivatives (86), (87) and the decoupling matrix (22), at the estimates */
    const double lie_f2_h[2] = {-v * omega * sine - L * omega * omega * cosine,
                                v * omega * cosine - L * omega * omega * sine};
    const double v_drift = -theta[0] * v + theta[1] * omega * omega;
    const double omega_drift = -theta[2] * omega - theta[3] * v * omega;
    const double lie_q_lie_f_h[2] = {cosine * v_drift - L * sine * omega_drift,
                                     sine * v_drift + L * cosine * omega_drift};
    const double D[2][2] = {
        {cosine * theta[4] - L * sine * theta[5], cosine * theta[4] + L * sine * theta[5]},
        {sine * theta[4] + L * cosine * theta[5], sine * theta[4] - L * cosine * theta[5]},
    };

    /* the law (25) */
    const double right[2] = {eta[0] - lie_f2_h[0] - lie_q_lie_f_h[0], eta[1] - lie_f2_h[1] - lie_q_lie_f_h[1]};
    const double determinant = D[0][0] * D[1][1] - D[0][1] * D[1][0];
    const double u[2] = {
        (D[1][1] * right[0] - D[0][1] * right[1]) / determinant,
        (D[0][0] * right[1] - D[1][0] * right[0]) / determinant,
    };
    const double regularity = fabs(determinant) / (sqrt(D[0][0] * D[0][0] + D[0][1] * D[0][1])
                                                   * sqrt(D[1][0] * D[1][0] + D[1][1] * D[1][1]));

    memcpy(row->x, x, sizeof row->x);
    memcpy(row->u, u, sizeof row->u);
    memcpy(row->e, e, sizeof row->e);
    memcpy(row->theta_hat, theta, sizeof row->theta_hat);

    /* the regressor (89), and the adaptation theta_hat' = Gamma W^T E1 (25), within its bounds */
    const double W[2][6] = {
        {-v * cosine, omega * omega * cosine, omega * L * sine, v * omega * L * sine,
         (u[0] + u[1]) * cosine, -(u[0] - u[1]) * L * sine},
        {-v * sine, omega * omega * sine, -omega * L * cosine, -v * omega * L * cosine,
         (u[0] + u[1]) * sine, (u[0] - u[1]) * L * cosine},
    };
    for (int j = 0; j < 6; j++) {
        const double moved = theta[j] + p->sample_time * p->Gamma[j] * (W[0][j] * E1[0] + W[1][j] * E1[1]);
        state->theta_hat[j] = moved < p->lower[j] ? p->lower[j] : moved;
    }

    double rate[5];
    state_derivative(p, x, u, rate);
    for (int i = 0; i < 5; i++)
        state->x[i] += p->sample_time * rate[i];
    return regularity;
}

/* Runs one robot for `count` samples and logs them; gives the first sample with a singular Dhat, or -1. */
long run(const Parameters *restrict p, size_t count, State *restrict state, Row *restrict rows)
{
    long failed = -1;
    for (size_t k = 0; k < count; k++)
        if (!(step(p, (double)k * p->sample_time, state, &rows[k]) >= SINGULAR) && failed < 0)
            failed = (long)k;
    return failed;
}

/* Runs robot after robot; of each its state at the end and the mean squares of its error are left. */
void run_all(size_t robots, const Parameters *restrict p, size_t count, State *restrict states,
             double (*mean_squares)[2], long *failed)
{
    for (size_t i = 0; i < robots; i++) {
        double squares[2] = {0.0, 0.0};
        failed[i] = -1;
        for (size_t k = 0; k < count; k++) {
            Row row;
            if (!(step(&p[i], (double)k * p[i].sample_time, &states[i], &row) >= SINGULAR) && failed[i] < 0)
                failed[i] = (long)k;
            squares[0] += row.e[0] * row.e[0];
            squares[1] += row.e[1] * row.e[1];
        }
        mean_squares[i][0] = squares[0] / (double)count;
        mean_squares[i][1] = squares[1] / (double)count;
    }
}
