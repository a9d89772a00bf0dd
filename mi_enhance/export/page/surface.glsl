// What is seen in each pixel: its place and what it is, its normal and the angle of its tangent.
uniform mat3 camera;
uniform vec2 shift;  // of the film, in pixels from the middle of each
uniform float size, reach;
#ifdef VERTEX
layout(location = 0) in vec3 place;
layout(location = 1) in float part;
layout(location = 2) in vec4 facing;
out vec3 position, normal, tangent;
flat out float kind;
vec3 unfolded(vec2 p) {
  vec3 v = vec3(p, 1.0 - abs(p.x) - abs(p.y));
  if (v.z < 0.0) v.xy = (1.0 - abs(p.yx)) * vec2(p.x < 0.0 ? -1 : 1, p.y < 0.0 ? -1 : 1);
  return v;
}
void main() {
  kind = part;
  position = (2.0 * place - 1.0) * reach;
  normal = unfolded(facing.xy);
  tangent = unfolded(facing.zw);
  vec3 v = position * camera;  // seen from the camera
  float depth = 4.5 - v.z;
  gl_Position = vec4(v.xy / 0.27 - 2.0 / size * shift * depth, 1.2 * depth - 3.3, depth);
}
#else
layout(location = 0) out vec4 where;
layout(location = 1) out vec4 facing;
#ifdef BALL
in vec3 position, normal, tangent;
flat in float kind;
#endif
float angle(vec3 n, vec3 t) {  // of a tangent, from the direction in which trace.glsl has 0
  vec3 s = normalize(cross(vec3(0, 1, 1e-4), n));
  return atan(dot(t, cross(n, s)), dot(t, s));
}
void main() {
  vec3 from = camera * vec3(0, 0, 4.5);
#ifdef BALL
  vec3 n = normalize(normal), back = normalize(from - position);
  n = normalize(n + max(0.02 - dot(n, back), 0.0) * back);  // a shading normal may face away at the rim
  where = vec4(position, kind);
  facing = vec4(n, angle(n, tangent));
#else
  vec3 to = camera * normalize(vec3(0.27 * ((gl_FragCoord.xy + shift) / size * 2.0 - 1.0), -1));
  float b = dot(from, to), root = b * b - dot(from, from) + 1.0;
  if (root < 0.0) discard;
  vec3 n = normalize(from + (-b - sqrt(root)) * to);
  where = vec4(n, 1);
  facing = vec4(n, 0);
#endif
}
#endif
