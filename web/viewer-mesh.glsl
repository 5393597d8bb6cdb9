// What of a mesh is seen in a pixel: its place, its normal, its triangle's normal and where it is in the texture, as bits. Triangles are small, and
// a renderer works in squares of four pixels: shading is left to viewer-shade.glsl, which does each pixel once.
precision highp float;
precision highp int;
in vec3 place;
in vec3 smooth_normal;
in vec2 texture_place;
layout(location = 0) out uvec4 where;
layout(location = 1) out uvec4 facing;

/// A unit vector as a point of a square (octahedron, unfolded), never 0.
uint folded(vec3 n) {
  vec2 p = n.xy * (1.0 / (abs(n.x) + abs(n.y) + abs(n.z)));
  vec2 back = (1.0 - abs(p.yx)) * vec2(p.x < 0.0 ? -1.0 : 1.0, p.y < 0.0 ? -1.0 : 1.0);
  return max(packUnorm2x16(0.5 + 0.5 * (n.z < 0.0 ? back : p)), 1u);
}

void main() {
  where = uvec4(floatBitsToUint(place), packUnorm2x16(fract(texture_place)));
  facing = uvec4(floatBitsToUint(smooth_normal), folded(cross(dFdx(place), dFdy(place))));
}
