// The eight reflection models, as src/numerics/brdf has them: BRDF = rho_d / pi + rho_s lobe(angles, beta). MODEL, MATERIALS, RHO_D, RHO_S and
// BETA2 are set by viewer-gl.js before this text: what is known before is neither read for every pixel, nor is there a loop over it.
precision highp float;
precision highp int;
precision highp sampler2D;

flat in int alone;          // one material instead of the mixture, or -1
flat in vec4 light;         // a lamp's position with 1, or the direction of a distant light with 0
flat in vec3 strength;      // intensity, or irradiance

const float PI = 3.14159265358979;
const float LEAST_COSINE = 1e-6;
const float LARGEST_TAN2 = 1e12;
const float F0 = 0.04;

struct Angles { float i; float r; float tan2; float iv; };

Angles angles_of(vec3 normal, vec3 to_light, vec3 view) {
  vec3 middle = to_light + view;
  float along = dot(normal, middle);
  vec3 across = cross(normal, middle);
  return Angles(dot(normal, to_light), dot(normal, view), dot(across, across) / (along * along), dot(to_light, view));
}

Angles bounded(Angles a) {
  return Angles(max(a.i, LEAST_COSINE), max(a.r, LEAST_COSINE), clamp(a.tan2, 0.0, LARGEST_TAN2), clamp(a.iv, -1.0, 1.0));
}

float jacobian(Angles a) { return 0.25 / (a.i * a.r); }
float cos_difference(Angles a) { return sqrt(0.5 * (1.0 + a.iv)); }

float v_cavity(Angles a) {
  return min(2.0 * inversesqrt(1.0 + a.tan2) * min(a.i, a.r) / cos_difference(a), 1.0);
}

float fresnel_gain(Angles a) {
  float x = 1.0 - cos_difference(a);
  return 1.0 + (1.0 / F0 - 1.0) * x * x * x * x * x;
}

/// ln(1 + x); single precision has lost the digits of a small x in 1 + x.
float log_of_one_and(float x) { return x < 0.01 ? x * (1.0 - x * (0.5 - x / 3.0)) : log(1.0 + x); }

/// What the roughness is compared with, and the factor: the part of a lobe that does not depend on the roughness.
vec2 fixed_part(Angles a) {
#if MODEL == LAMBERT
  return vec2(0.0);
#elif MODEL == BLINN_PHONG
  return vec2(log_of_one_and(a.tan2), (1.0 + a.tan2) * jacobian(a) / PI);
#elif MODEL == TORRANCE_SPARROW
  float half_angle = atan(sqrt(a.tan2));
  return vec2(half_angle * half_angle, v_cavity(a) * jacobian(a) / PI);
#elif MODEL == COOK_TORRANCE
  float inverse = 1.0 + a.tan2;
  return vec2(a.tan2, inverse * inverse * v_cavity(a) * fresnel_gain(a) * jacobian(a) / PI);
#elif MODEL == WARD
  return vec2(a.tan2, inversesqrt(a.i * a.r) / (4.0 * PI));
#elif MODEL == WARD_DUER
  float sum2 = (a.i + a.r) * (a.i + a.r);
  return vec2(a.tan2, 2.0 * (1.0 + a.iv) / (sum2 * sum2) / PI);
#elif MODEL == LAFORTUNE
  float cos_mirror = 2.0 * a.i * a.r - a.iv;
  if (cos_mirror <= 1e-4) return vec2(0.0);
  cos_mirror = min(cos_mirror, 1.0);
  return vec2(-2.0 * log(cos_mirror), 1.0 / (PI * cos_mirror * cos_mirror));
#elif MODEL == GGX
  float inverse = 1.0 + a.tan2;
  return vec2(a.tan2, inverse * inverse * fresnel_gain(a) * jacobian(a) / PI);
#endif
}

#if MODEL == GGX
float root(float cosine, float beta2) { return sqrt(1.0 + beta2 * (1.0 / (cosine * cosine) - 1.0)); }
#endif

float lobe(Angles a, vec2 known, float beta2) {
#if MODEL == GGX
  float x = 1.0 + known.x / beta2;
  return known.y * 4.0 / (beta2 * x * x * (1.0 + root(a.i, beta2)) * (1.0 + root(a.r, beta2)));
#else
  return known.y * exp(-known.x / beta2) / beta2;
#endif
}

/// Towards the light from a point.
vec3 towards_light(vec3 point) { return normalize(light.xyz - light.w * point); }

/// What a material adds to the BRDF.
#define SHARE(m) gamma[m] * (RHO_D[m] / PI + RHO_S[m] * lobe(a, known, BETA2[m]))

/// Irradiance on a surface there that faces it.
vec3 irradiance(vec3 point) {
  vec3 way = light.xyz - point;
  return light.w == 0.0 ? strength : strength / dot(way, way);
}

/// Radiance of a lit point (paper Eq. 1-4).
vec3 radiance_of(vec4 weights, vec3 point, Angles at) {
  vec4 gamma = alone < 0 ? weights : vec4(equal(ivec4(0, 1, 2, 3), ivec4(alone)));
  Angles a = bounded(at);
  vec2 known = fixed_part(a);
  vec3 brdf = SHARE(0);
#if MATERIALS > 1
  brdf += SHARE(1);
#endif
#if MATERIALS > 2
  brdf += SHARE(2);
#endif
#if MATERIALS > 3
  brdf += SHARE(3);
#endif
  return irradiance(point) * at.i * brdf;
}
