// The object as the camera saw it, pixel by pixel, as src/pipeline/relight.rs shades it; beside it, or left of a line, what was measured.
uniform sampler2D positions;
uniform sampler2D normals;
uniform sampler2D views;
uniform sampler2D weight_maps;
uniform sampler2D sigma_maps;
uniform sampler2D residuals;
uniform sampler2D measured;     // radiance, and 1 where it is known
uniform vec2 screen;            // pixels of the picture
uniform vec2 size;              // columns and rows of the maps
uniform int map;                // 0 weight, 1 standard error, 2 residual
uniform int weight;
uniform int comparing;          // 0 fitted alone, 1 a line, 2 side by side
uniform float line;             // where, 0 to 1 of the object's width

void main() {
  vec2 pixel = vec2(gl_FragCoord.x, screen.y - gl_FragCoord.y);
  vec2 room = comparing == 2 ? vec2(0.5 * screen.x, screen.y) : screen;
  bool left = comparing == 2 && pixel.x < room.x;
  if (comparing == 2 && !left) pixel.x -= room.x;
  float scale = min(room.x / size.x, room.y / size.y);
  vec2 at = (pixel - 0.5 * (room - scale * size)) / scale;
  if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, size))) discard;
  ivec2 here = ivec2(at);
  float from_line = at.x - line * size.x;
  if (comparing == 1 && abs(from_line) * scale < 1.0) { shown = vec4(1.0); return; }
  vec4 weights = texelFetch(weight_maps, here, 0);
  if (comparing == 1 && from_line < 0.0 || left) {
    vec4 seen = texelFetch(measured, here, 0);
    if (seen.a == 0.0) discard;
    show(seen.rgb);
    return;
  }
  vec4 sigma = texelFetch(sigma_maps, here, 0);
  if (weights == vec4(0.0) && sigma == vec4(0.0)) discard;
#if SHOWING == MAP
  show_value(map == 0 ? weights[weight] : map == 1 ? sigma[weight] : dot(texelFetch(residuals, here, 0).rgb, vec3(1.0 / 3.0)));
#else
  vec3 place = texelFetch(positions, here, 0).xyz;
  vec3 to_light = towards_light(place);
  Angles at_point = angles_of(texelFetch(normals, here, 0).xyz, to_light, texelFetch(views, here, 0).xyz);
  bool faces = at_point.i > 0.0 && at_point.r > 0.0;
  show(faces ? radiance_of(weights, place, at_point) : vec3(0.0));
#endif
}
