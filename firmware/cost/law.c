/* The baseline of the cost table: the paper's law as one would first write it in C, evaluated explicitly.
   Compiled by arm-none-eabi-gcc -O3 with newlib's expf, see ../build.rs. The diffusive term nu is given. */
#include <math.h>

struct law {
    float start, end, rate; /* funnel: (start - end) exp(-rate t) + end */
    float kappa;            /* gain: kappa s / (1 - |s|) */
    float slope, offset;    /* own dynamics: slope x + offset */
    float period;           /* T in s */
    float x;                /* state */
};

/* One tick at time t in s; returns the input u. */
float law_in_c(struct law *law, float t, float nu)
{
    float psi = (law->start - law->end) * expf(-law->rate * t) + law->end;
    float s = nu / psi;
    if (s > 0.999f)
        s = 0.999f;
    if (s < -0.999f)
        s = -0.999f;
    float u = law->kappa * s / (1.0f - fabsf(s));
    law->x += law->period * (law->slope * law->x + law->offset + u);
    return u;
}

/* newlib's, under a name that Rust's own expf doesn't take. */
float expf_in_c(float x)
{
    return expf(x);
}
