/* Runs the step that CasADi generated in front of this text, `traced(state, t, values) -> (next, row)`. */
#include <string.h>

static void advance(const double *state, const double *t, const double *values, double *next, double *row)
{
    const casadi_real *arguments[ARGUMENTS] = {state, t, values};
    casadi_real *results[RESULTS] = {next, row}, reals[REALS];
    casadi_int integers[INTEGERS];
    traced(arguments, results, integers, reals, 0);
}

/* Logs the rows of one robot. */
void run(long count, const double *times, double *state, const double *values, double *rows)
{
    double next[STATES];
    for (long k = 0; k < count; k++) {
        advance(state, &times[k], values, next, rows + k * ROW);
        memcpy(state, next, sizeof next);
    }
}

/* Runs robot after robot; of each its state at the end and the mean squares of its errors are left. */
void run_all(long robots, long count, const double *times, double *states, const double *values, double *mean_squares)
{
    for (long i = 0; i < robots; i++) {
        double next[STATES], row[ROW], squares[ERRORS] = {0.0};
        for (long k = 0; k < count; k++) {
            advance(states + i * STATES, &times[k], values + i * VALUES, next, row);
            memcpy(states + i * STATES, next, sizeof next);
            for (int j = 0; j < ERRORS; j++)
                squares[j] += row[FIRST_ERROR + j] * row[FIRST_ERROR + j];
        }
        for (int j = 0; j < ERRORS; j++)
            mean_squares[i * ERRORS + j] = squares[j] / (double)count;
    }
}
