// The shadow map needs where vertices are, alone.
uniform mat4 camera;
layout(location = 0) in vec3 position;

void main() { gl_Position = camera * vec4(position, 1.0); }
