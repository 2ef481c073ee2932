/* Study 1 as fast as it was made by hand. Error and control are turned into the robot's frame, where Dhat is diagonal and
   nothing is computed twice; the reference is tabled once; WIDTH robots lie side by side (for one robot, half idles). */
#include <stddef.h>
#include <stdlib.h>

typedef struct { /* as it comes, for one robot */
    double r, b, d, L, m_C, m_w, I_m, I_C, K1, K2;
    double b1[2], b2[2], alpha[2], Gamma[6], lower[6];
    double center[2], radius, rate, sample_time;
} Parameters;

typedef struct { /* what a step needs of it; h is the sample time, T the true base parameters (30) */
    number h, L, inverse_L, keep_v, hT2, hT4, hT5, keep_omega, hT6;
    number b1[2], b2[2], alpha[2], gain[6], lower[6];
} Constants;

typedef struct {
    number x, y, phi, v, omega, theta[6];
} State;

typedef struct {
    number e[2], sum, difference; /* of the voltages */
} Signals;

typedef struct { /* of the reference at one time */
    double y[2], minus_y_dot[2], y_ddot[2];
} Point;

static void prepare(const Parameters *p, int lane, Constants *k)
{
    const double h = p->sample_time, mass = p->m_C + 2.0 * p->m_w;
    const double inertia = p->I_C + 2.0 * p->I_m + p->m_C * p->d * p->d + 2.0 * p->m_w * p->b * p->b;
    const double damping = 2.0 * p->K2 / (p->r * p->r);
    k->h[lane] = h;
    k->L[lane] = p->L;
    k->inverse_L[lane] = 1.0 / p->L;
    k->keep_v[lane] = 1.0 - h * damping / mass;
    k->hT2[lane] = h * p->m_C * p->d / mass;
    k->hT4[lane] = h * p->m_C * p->d / inertia;
    k->hT5[lane] = h * p->K1 / (p->r * mass);
    k->keep_omega[lane] = 1.0 - h * damping * p->b * p->b / inertia;
    k->hT6[lane] = h * p->K1 * p->b / (p->r * inertia);
    for (int i = 0; i < 2; i++) {
        k->b1[i][lane] = p->b1[i];
        k->b2[i][lane] = p->b2[i];
        k->alpha[i][lane] = p->alpha[i];
    }
    const double factor[6] = {1.0, 1.0, p->L, p->L, 1.0, p->L};
    for (int j = 0; j < 6; j++) {
        k->gain[j][lane] = h * p->Gamma[j] * factor[j];
        k->lower[j][lane] = p->lower[j];
    }
}

/* One sample from the state, which is replaced; tells where Dhat is regular. */
INLINE whole step(const Constants *k, const Point *to, State *z, Signals *now)
{
    const number v = z->v, omega = z->omega, *theta = z->theta;
    number s, c;
    sine_cosine(z->phi, &s, &c);

    const number turned = k->L * omega;
    const number e0 = fused(k->L, c, z->x - to->y[0]), e1 = fused(k->L, s, z->y - to->y[1]);
    const number rate0 = fused(c, v, negated(s, turned, same(to->minus_y_dot[0])));
    const number rate1 = fused(s, v, fused(c, turned, same(to->minus_y_dot[1])));
    const number E0 = fused(k->alpha[0], e0, rate0), E1 = fused(k->alpha[1], e1, rate1);
    const number eta0 = negated(k->b1[0], rate0, negated(k->b2[0], e0, same(to->y_ddot[0])));
    const number eta1 = negated(k->b1[1], rate1, negated(k->b2[1], e1, same(to->y_ddot[1])));

    const number ahead = fused(c, E0, s * E1), aside = negated(s, E0, c * E1);
    const number wanted = fused(c, eta0, s * eta1), wanted_aside = negated(s, eta0, c * eta1);
    const number square = omega * omega, product = omega * v;
    const number inverse = 1.0 / (theta[4] * theta[5]); /* one division for two */
    const number sum = fused(theta[0], v, fused(k->L - theta[1], square, wanted)) * (theta[5] * inverse);
    const number turning = fused(theta[3] - k->inverse_L, product, wanted_aside * k->inverse_L);
    const number difference = fused(theta[2], omega, turning) * (theta[4] * inverse);

    const number side = k->L * theta[5], both = theta[4] * side;
    const number skew = s * c * negated(side, side, theta[4] * theta[4]);
    const whole regular = both * both >= skew * skew * 1e-18;
    now->e[0] = e0;
    now->e[1] = e1;
    now->sum = sum;
    now->difference = difference;

    const number direction[6] = {-(v * ahead), square * ahead, -(omega * aside), -(product * aside),
                                 sum * ahead, difference * aside};
    for (int j = 0; j < 6; j++)
        z->theta[j] = larger(fused(k->gain[j], direction[j], theta[j]), k->lower[j]);
    const number advance = k->h * v;
    z->x = fused(advance, c, z->x);
    z->y = fused(advance, s, z->y);
    z->phi = fused(k->h, omega, z->phi);
    z->v = fused(k->hT5, sum, fused(k->hT2, square, k->keep_v * v));
    z->omega = fused(k->hT6, difference, negated(k->hT4, product, k->keep_omega * omega));
    return regular;
}

static Point *table(const Parameters *p, size_t count)
{
    Point *points = malloc((count + WIDTH) * sizeof *points);
    for (size_t k = 0; k < count; k += WIDTH) {
        number angle, s, c;
        for (int l = 0; l < WIDTH; l++)
            angle[l] = p->rate * ((double)(k + l) * p->sample_time);
        sine_cosine(angle, &s, &c);
        for (int l = 0; l < WIDTH; l++) {
            const double along = p->radius * c[l], across = p->radius * s[l], squared = p->rate * p->rate;
            points[k + l] = (Point){{p->center[0] + along, p->center[1] + across},
                                    {p->rate * across, -p->rate * along},
                                    {-squared * along, -squared * across}};
        }
    }
    return points;
}

/* Runs one robot for `count` samples from `state` and logs them; gives the first sample with a singular Dhat, or -1.
   Numbers are stored one by one: gathering them into vectors first would keep the ports busy that the step needs. */
__attribute__((optimize("no-tree-slp-vectorize")))
long run(const Parameters *p, size_t count, const double *state, double (*rows)[15])
{
    Constants k;
    State z;
    Signals now;
    long failed = -1;
    number *flat = &z.x;
    for (int l = 0; l < WIDTH; l++) {
        prepare(p, l, &k);
        for (int i = 0; i < 11; i++)
            flat[i][l] = state[i];
    }
    Point *points = table(p, count);
    for (size_t i = 0; i < count; i++) {
        const State at = z;
        if (!all_of(step(&k, &points[i], &z, &now)) && failed < 0)
            failed = (long)i;
        double *row = rows[i];
        row[0] = at.x[0], row[1] = at.y[0], row[2] = at.phi[0], row[3] = at.v[0], row[4] = at.omega[0];
        row[5] = 0.5 * (now.sum[0] + now.difference[0]);
        row[6] = 0.5 * (now.sum[0] - now.difference[0]);
        row[7] = now.e[0][0], row[8] = now.e[1][0];
        for (int j = 0; j < 6; j++)
            row[9 + j] = at.theta[j][0];
    }
    free(points);
    return failed;
}

/* Runs WIDTH robots at a time, all on the first one's circle; of each its state at the end and the mean squares of its
   error are left. */
void run_all(size_t robots, const Parameters *p, size_t count, double (*states)[11], double (*mean_squares)[2],
             long *failed)
{
    Point *points = table(p, count);
    for (size_t first = 0; first < robots; first += WIDTH) {
        Constants k;
        State z;
        Signals now;
        number *flat = &z.x, squares[2] = {{0.0}, {0.0}};
        for (int l = 0; l < WIDTH; l++) {
            const size_t robot = first + l < robots ? first + l : robots - 1;
            prepare(&p[robot], l, &k);
            for (int i = 0; i < 11; i++)
                flat[i][l] = states[robot][i];
            failed[robot] = -1;
        }
        for (size_t i = 0; i < count; i++) {
            const whole regular = step(&k, &points[i], &z, &now);
            if (!all_of(regular))
                for (int l = 0; l < WIDTH && first + l < robots; l++)
                    if (!regular[l] && failed[first + l] < 0)
                        failed[first + l] = (long)i;
            squares[0] = fused(now.e[0], now.e[0], squares[0]);
            squares[1] = fused(now.e[1], now.e[1], squares[1]);
        }
        for (int l = 0; l < WIDTH && first + l < robots; l++) {
            for (int i = 0; i < 11; i++)
                states[first + l][i] = flat[i][l];
            mean_squares[first + l][0] = squares[0][l] / (double)count;
            mean_squares[first + l][1] = squares[1][l] / (double)count;
        }
    }
    free(points);
}
