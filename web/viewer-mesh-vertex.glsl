// A mesh, about its middle and in lengths of its radius.
uniform mat4 camera;
uniform float repeats;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
out vec3 place;
out vec3 smooth_normal;
out vec2 texture_place;

void main() {
  place = position;
  smooth_normal = normal;
  texture_place = repeats * uv;
  gl_Position = camera * vec4(position, 1.0);
}
