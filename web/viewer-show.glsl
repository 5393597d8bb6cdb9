// From radiance, or a map's value, to what is on the screen. RAW and SHOWING are set by viewer-gl.js: a software renderer runs both sides of every
// branch, so what is known before is no branch.
uniform sampler2D response;    // levels of red, green, blue: a row an octave of exposure, 1024 steps each
flat in int first;             // bits of the exposure at its first entry, without the last 13
flat in int last;              // number of its last entry
flat in float seconds;
uniform float most;            // the map's value at the ramp's end
out vec4 shown;

vec3 level(int at) { return texelFetch(response, ivec2(at & 1023, at >> 10), 0).rgb; }

void show(vec3 radiance) {
#if RAW
  shown = vec4(radiance, 1.0);
#else
  // A float's bits, read as a number, run along its logarithm: exponent and ten bits of the mantissa say where in the table it is.
  ivec3 at = clamp((floatBitsToInt(max(radiance * seconds, 0.0)) >> 13) - first, 0, last);
  shown = vec4(level(at.r).r, level(at.g).g, level(at.b).b, 1.0);
#endif
}

/// A ramp whose lightness rises throughout (viewer.js draws the same beside the picture); what is not finite is a blue of its own.
void show_value(float value) {
#if RAW
  shown = vec4(value, value, value, 1.0);
  return;
#endif
  if (isinf(value) || isnan(value)) { shown = vec4(0.35, 0.55, 0.95, 1.0); return; }
  float x = 3.0 * clamp(value / most, 0.0, 1.0);
  vec3 a = vec3(0.05, 0.04, 0.12), b = vec3(0.47, 0.11, 0.43), c = vec3(0.93, 0.41, 0.15), d = vec3(0.99, 1.0, 0.64);
  vec3 colour = x < 1.0 ? mix(a, b, x) : x < 2.0 ? mix(b, c, x - 1.0) : mix(c, d, x - 2.0);
  shown = vec4(colour, 1.0);
}
