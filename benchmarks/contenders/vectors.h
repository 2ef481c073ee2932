/* WIDTH numbers side by side in a vector register, with a sine and cosine. */
#ifdef __AVX512VL__
#include <immintrin.h>
#endif

typedef double number __attribute__((vector_size(8 * WIDTH)));
typedef long long whole __attribute__((vector_size(8 * WIDTH)));

#define INLINE static inline __attribute__((always_inline))
#if defined __AVX512VL__ && WIDTH == 8
#define OF(operation) _mm512_##operation
#define all_of(mask) (_mm512_movepi64_mask((__m512i)(mask)) == 0xff)
#elif defined __AVX512VL__ && WIDTH == 2
#define OF(operation) _mm_##operation
#define all_of(mask) (_mm_movemask_pd((__m128d)(mask)) == 3)
#endif
#ifdef OF
#define fused(a, b, c) ((number)OF(fmadd_pd)(a, b, c))    /* a b + c */
#define negated(a, b, c) ((number)OF(fnmadd_pd)(a, b, c)) /* c - a b */
#define larger(a, b) ((number)OF(max_pd)(a, b))
#define smaller(a, b) ((number)OF(min_pd)(a, b))
#else
#define fused(a, b, c) ((a) * (b) + (c))
#define negated(a, b, c) ((c) - (a) * (b))
#define larger(a, b) chosen((a) > (b), a, b)
#define smaller(a, b) chosen((a) < (b), a, b)
INLINE int all_of(whole mask)
{
    int all = 1;
    for (int l = 0; l < WIDTH; l++)
        all &= mask[l] != 0;
    return all;
}
#endif

INLINE number chosen(whole mask, number a, number b) { return (number)((mask & (whole)a) | (~mask & (whole)b)); }

INLINE number same(double a) { return (number){0.0} + a; }

/* For |x| up to 1e5: reduction by pi/2 in two parts, then fdlibm's polynomials (Sun Microsystems 1993, freely granted). */
INLINE void sine_cosine(number x, number *sine, number *cosine)
{
    const number shifter = same(0x1.8p52), shifted = fused(x, same(0x1.45f306dc9c883p-1), shifter), n = shifted - shifter;
    const number r = negated(n, same(0x1.1a62633145c07p-54), negated(n, same(0x1.921fb54442d18p+0), x));
    const number z = r * r, w = z * z;
    const number s_low = fused(z, fused(z, same(-1.98412698298579493134e-04), same(8.33333333332248946124e-03)),
                               same(-1.66666666666666324348e-01));
    const number s_high = fused(z, fused(z, same(1.58969099521155010221e-10), same(-2.50507602534068634195e-08)),
                                same(2.75573137070700676789e-06));
    const number c_low = fused(z, fused(z, same(2.48015872894767294178e-05), same(-1.38888888888741095749e-03)),
                               same(4.16666666666666019037e-02));
    const number c_high = fused(z, fused(z, same(-1.13596475577881948265e-11), same(2.08757232129817482790e-09)),
                                same(-2.75573143513906633035e-07));
    const number s = fused(z * r, fused(z * w, s_high, s_low), r);
    const number c = fused(w, fused(z * w, c_high, c_low), negated(same(0.5), z, same(1.0)));
    const whole quarter = (whole)shifted, swap = -(quarter & 1), sign = ((whole){0} + 1) << 63;
    *sine = (number)((whole)chosen(swap, c, s) ^ ((quarter << 62) & sign));
    *cosine = (number)((whole)chosen(swap, s, c) ^ (((quarter + 1) << 62) & sign));
}
