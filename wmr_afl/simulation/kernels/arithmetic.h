/* Arithmetic that the vectorizer takes: no branches, no calls. */
#include <math.h>

/* A call that stays would keep the loop around it from being vectorized. */
#define ALWAYS_INLINE static inline __attribute__((always_inline))

#define LARGEST_ANGLE 1.0e8 /* [rad]; beyond, the reduction below loses digits and libm takes over */
ALWAYS_INLINE int is_far(double x) { return fabs(x) > LARGEST_ANGLE && fabs(x) < INFINITY; }

/* One instruction each: the larger or smaller of both, b if either is not a number. */
ALWAYS_INLINE double larger_or(double a, double b) { return a > b ? a : b; }
ALWAYS_INLINE double smaller_or(double a, double b) { return a < b ? a : b; }
/* The same, but a if a is not a number. */
ALWAYS_INLINE double larger(double a, double b) { const double r = larger_or(a, b); return a == a ? r : a; }
ALWAYS_INLINE double smaller(double a, double b) { const double r = smaller_or(a, b); return a == a ? r : a; }
ALWAYS_INLINE double sign(double a) { const double r = a < 0.0 ? -1.0 : a; return a > 0.0 ? 1.0 : r; }

/* Sine and cosine without branches. The angle is reduced by n pi/2 in three parts (Cody and Waite): the first difference
   is exact, the third part lies below the smallest rest. Polynomials on |r| <= pi/4 with the coefficients of fdlibm's
   kernels (Sun Microsystems 1993, freely granted). 2 ulp in all. The shifter leaves n in the last bits of the sum. */
ALWAYS_INLINE void sincos_fast(double x, double *s, double *c)
{
    union { double value; unsigned long long bits; } shifted, sine, cosine;
    const double shifter = 0x1.8p52;
    shifted.value = fma(x, 0x1.45f306dc9c883p-1, shifter); /* 2/pi */
    const double n = shifted.value - shifter;
    const double r = fma(n, 0x1.f1976b7ed8fbcp-110, fma(-n, 0x1.1a62633145c07p-54, fma(-n, 0x1.921fb54442d18p+0, x)));
    const double z = r * r;
    const double ps = fma(z, fma(z, fma(z, fma(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08),
                      2.75573137070700676789e-06), -1.98412698298579493134e-04), 8.33333333332248946124e-03);
    const double pc = fma(z, fma(z, fma(z, fma(z, fma(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09),
                      -2.75573143513906633035e-07), 2.48015872894767294178e-05), -1.38888888888741095749e-03), 4.16666666666666019037e-02);
    sine.value = fma(z * r, fma(z, ps, -1.66666666666666324348e-01), r);
    cosine.value = fma(z * z, pc, fma(-0.5, z, 1.0));
    const unsigned long long sign = 1ull << 63, odd = shifted.bits & 1; /* number of quarter turns */
    const unsigned long long first = odd ? cosine.bits : sine.bits, second = odd ? sine.bits : cosine.bits;
    sine.bits = first ^ (shifted.bits << 62 & sign);
    cosine.bits = second ^ ((shifted.bits + 1) << 62 & sign);
    *s = sine.value;
    *c = cosine.value;
}
