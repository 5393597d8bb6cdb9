// A point of a mesh, as src/numerics/render shades it.
uniform highp usampler2D where;
uniform highp usampler2D facing;
flat in vec3 eye;
uniform sampler2D tile;            // weights of all materials; it repeats, and is linear between the texels' middles
flat in float scale;               // repeats of the texture a radius of the mesh
flat in mat4 lamp;                 // from the mesh to the shadow map
flat in float texel;               // of the shadow map, in the mesh's radius at depth 1
uniform highp sampler2DShadow shadow;
uniform int weight;                // the material whose weight is shown

vec4 weights_here(vec3 place, vec3 normal, uint packed) {
#if TEXTURED
  return textureLod(tile, unpackUnorm2x16(packed), 0.0);
#else
  vec3 p = scale * place;
  vec3 n2 = normal * normal;
  vec3 parts = n2 * n2;
  parts /= parts.x + parts.y + parts.z;
  return parts.x * textureLod(tile, vec2(p.z, -p.y), 0.0) + parts.y * textureLod(tile, vec2(p.x, -p.z), 0.0) + parts.z * textureLod(tile, vec2(p.x, -p.y), 0.0);
#endif
}

vec3 unfolded(uint packed) {
  vec2 p = 2.0 * unpackUnorm2x16(packed) - 1.0;
  float z = 1.0 - abs(p.x) - abs(p.y);
  vec2 back = (1.0 - abs(p.yx)) * vec2(p.x < 0.0 ? -1.0 : 1.0, p.y < 0.0 ? -1.0 : 1.0);
  return normalize(vec3(z < 0.0 ? back : p, z));
}

/// 1 where nothing stands between the point and the light. The point is moved off its triangle by a texel, so that it does not shadow itself.
float unshadowed(vec3 place, vec3 face) {
  float depth = lamp[0].w * place.x + lamp[1].w * place.y + lamp[2].w * place.z + lamp[3].w;
  vec4 there = lamp * vec4(place + texel * depth * face, 1.0);
  return textureLod(shadow, 0.5 + 0.5 * there.xyz / there.w, 0.0);
}

void main() {
  uvec4 a = texelFetch(where, ivec2(gl_FragCoord.xy), 0);
  uvec4 b = texelFetch(facing, ivec2(gl_FragCoord.xy), 0);
  if (b.w == 0u) discard;
  vec3 place = uintBitsToFloat(a.xyz);
  vec3 smooth_normal = uintBitsToFloat(b.xyz);
  vec3 view = normalize(eye - place);
  vec3 face = unfolded(b.w);
  if (dot(face, view) < 0.0) face = -face;
  vec3 normal = dot(smooth_normal, smooth_normal) > 0.0 ? normalize(smooth_normal) : face;
  if (dot(normal, face) < 0.0) normal = -normal;
  if (dot(normal, view) <= 0.0) normal = face;
  vec4 weights = weights_here(place, normal, a.w);
#if SHOWING == MAP
  show_value(weights[weight]);
#else
  vec3 to_light = towards_light(place);
  Angles at = angles_of(normal, to_light, view);
  bool faces = at.i > 0.0 && at.r > 0.0 && dot(face, to_light) > 0.0;
  show(faces ? unshadowed(place, face) * radiance_of(weights, place, at) : vec3(0.0));
#endif
}
