// The whole picture as one triangle, and what is the same all over it. Pixels get that as flat varyings: a software renderer checks a uniform's bounds
// wherever one is read, and these took half of the time of a picture.
uniform struct {
  int alone;
  vec4 light;
  vec3 strength;
  int first;
  int last;
  float seconds;
  vec3 eye;
  float scale;
  mat4 lamp;
  float texel;
} told;
flat out int alone;
flat out vec4 light;
flat out vec3 strength;
flat out int first;
flat out int last;
flat out float seconds;
flat out vec3 eye;
flat out float scale;
flat out mat4 lamp;
flat out float texel;

void main() {
  alone = told.alone;
  light = told.light;
  strength = told.strength;
  first = told.first;
  last = told.last;
  seconds = told.seconds;
  eye = told.eye;
  scale = told.scale;
  lamp = told.lamp;
  texel = told.texel;
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}
