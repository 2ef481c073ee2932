/* Arithmetic that the vectorizer takes: no branches, no calls. */
#include <math.h>

/* A call that stays would keep the loop around it from being vectorized. */
#define ALWAYS_INLINE static inline __attribute__((always_inline))

#define LARGEST_ANGLE 1.0e8 /* beyond, libm takes over */
ALWAYS_INLINE int is_far(double x) { return fabs(x) > LARGEST_ANGLE && fabs(x) < INFINITY; }

/* One instruction each: the larger or smaller of both, b where either is no number. */
ALWAYS_INLINE double larger_or(double a, double b) { return a > b ? a : b; }
ALWAYS_INLINE double smaller_or(double a, double b) { return a < b ? a : b; }
/* The same, where a that is no number stays. */
ALWAYS_INLINE double larger(double a, double b) { const double r = larger_or(a, b); return a == a ? r : a; }
ALWAYS_INLINE double smaller(double a, double b) { const double r = smaller_or(a, b); return a == a ? r : a; }
ALWAYS_INLINE double sign(double a) { const double r = a < 0.0 ? -1.0 : a; return a > 0.0 ? 1.0 : r; }

/* Sine and cosine without branches: the angle is reduced by pi/2 in three parts (Cody and Waite), the rest by polynomials
   with the coefficients of fdlibm's kernels (Sun Microsystems 1993, freely granted), correct to 1 ulp on |x| <= pi/4. The
   first difference is exact, so that 2 ulp hold while n pi/2 is told by three doubles well below the smallest rest. */
ALWAYS_INLINE void sincos_fast(double x, double *s, double *c)
{
    const double shifter = 0x1.8p52;
    const double shifted = x * 0x1.45f306dc9c883p-1 + shifter; /* 2/pi */
    const double n = shifted - shifter;
    const double r0 = fma(-n, 0x1.921fb54442d18p+0, x);
    const double p = n * 0x1.1a62633145c07p-54, tail = fma(n, 0x1.1a62633145c07p-54, -p);
    const double r1 = r0 - p;
    const double lost = fma(n, 0x1.f1976b7ed8fbcp-110, ((r0 - r1) - p) - tail);
    const double r = r1, z = r * r, w = z * z;
    const double ps = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
                    + z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10);
    const double v = z * r;
    const double sine = r - ((z * (0.5 * lost - v * ps) - lost) - v * -1.66666666666666324348e-01);
    const double pc = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05))
                    + w * w * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    const double half = 0.5 * z, head = 1.0 - half;
    const double cosine = head + (((1.0 - head) - half) + (z * pc - r * lost));
    const double quarter = n - 4.0 * floor(0.25 * n); /* 0, 1, 2 or 3 */
    const int swap = (quarter == 1.0) | (quarter == 3.0);
    const double a = swap ? cosine : sine, b = swap ? sine : cosine;
    *s = quarter >= 2.0 ? -a : a;
    *c = (quarter == 1.0) | (quarter == 2.0) ? -b : b;
}
