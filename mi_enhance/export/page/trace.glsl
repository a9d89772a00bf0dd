// One sample of each pixel: a direction drawn from the material, the room or the lamp, weighted by the balance heuristic.
// With MATERIAL for the pixels of a material, else for all others: a processor that draws works out both sides of a branch.
#ifdef MATERIAL
%MATERIAL%
#endif
uniform sampler2D env, densities, drawn, wheres, facings, before;
uniform sampler3D distances, measured;
uniform uint frame;
uniform int left;           // of the tile
uniform vec2 shift;
uniform float size, turn, strength, grey, reach, ground;
uniform mat3 camera;
uniform vec4 lamp;          // direction, cosine of its radius
uniform float brightness;   // radiance of the lamp
out vec4 colour;
const float PI = 3.14159265;
uint state;
float random() {
  state = state * 747796405u + 2891336453u;
  uint w = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
  return float(((w >> 22u) ^ w) >> 8u) / 16777216.0;
}
vec2 place(vec3 d) {
  return vec2(fract(atan(d.x, -d.z) / (2.0 * PI) + 0.5 + turn), acos(clamp(d.y, -1.0, 1.0)) / PI);
}
vec3 toRoom() {  // a direction in proportion to the brightness of the map
  ivec2 texel = ivec2(texelFetch(drawn, ivec2(random() * 128.0, random() * 128.0), 0).rg * 255.0 + 0.5);
  float theta = PI * (float(texel.y) + random()) / 64.0, phi = 2.0 * PI * ((float(texel.x) + random()) / 128.0 - 0.5 - turn);
  return vec3(sin(theta) * sin(phi), cos(theta), -sin(theta) * cos(phi));
}
vec3 toLamp() {
  float z = 1.0 - random() * (1.0 - lamp.w), phi = 2.0 * PI * random(), r = sqrt(max(1.0 - z * z, 0.0));
  vec3 s = normalize(abs(lamp.y) < 0.9 ? cross(lamp.xyz, vec3(0, 1, 0)) : cross(lamp.xyz, vec3(1, 0, 0)));
  return r * cos(phi) * s + r * sin(phi) * cross(lamp.xyz, s) + z * lamp.xyz;
}
bool blocked(vec3 p, vec3 d, bool asked) {  // by the ball or the ground: a ray through the grid of distances
  if (reach == 0.0 || !asked) return false;
  vec3 inverse = 1.0 / (d + vec3(equal(d, vec3(0))) * 1e-9), a = (-reach - p) * inverse, b = (reach - p) * inverse;
  vec3 near = min(a, b), far = max(a, b);
  float end = asked ? min(min(far.x, far.y), far.z) : 0.0, t = max(max(max(near.x, near.y), near.z), 0.0);
  for (int k = 0; k < 24 && t < end; k++) {
    float free = 0.6 * textureLod(distances, (p + t * d) / (2.0 * reach) + 0.5, 0.0).r - 0.012;
    if (free < 0.006) return true;
    t += free;
  }
  float fall = d.y < -1e-4 ? (ground - p.y) / d.y : -1.0;
  return fall > 1e-3 && length((p + fall * d).xz) < 3.2;
}
#ifdef MATERIAL
vec3 truth(vec3 wi, vec3 wo) {  // see truth.py
  vec3 h = normalize(wi + wo);
  float s = length(h.xy);
  vec2 e = s > 1e-6 ? h.xy / s : vec2(1, 0);
  float x = dot(wo, vec3(h.z * e, -s)), y = dot(wo.xy, vec2(-e.y, e.x));
  vec3 angles = vec3(sqrt(2.0 / PI * atan(s, h.z)), 2.0 / PI * atan(length(vec2(x, y)), dot(wo, h)), atan(abs(y), x) / PI);
  vec3 n = vec3(textureSize(measured, 0));
  return max(exp(textureLod(measured, (clamp(angles, 0.0, 1.0) * (n - 1.0) + 0.5) / n, 0.0).rgb) - 1e-5, 0.0);
}
#endif
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy) - ivec2(left, 0);
  vec4 hit = texelFetch(wheres, pixel, 0), facing = texelFetch(facings, pixel, 0);
#ifdef MATERIAL
  if (hit.w != 1.0) discard;
#else
  if (hit.w == 1.0) discard;
#endif
  state = (uint(pixel.x) * 1973u + uint(pixel.y) * 9277u + frame * 26699u) | 1u;
  for (int k = 0; k < 3; k++) random();
  vec3 to = camera * normalize(vec3(0.27 * ((vec2(pixel) + 0.5 + shift) / size * 2.0 - 1.0), -1));
  vec3 p = hit.xyz, from = camera * vec3(0, 0, 4.5), f;
  float edge = 1.0;
#ifndef MATERIAL
  if (hit.w == 0.0) {
    float fall = reach > 0.0 && to.y < 0.0 ? (ground - from.y) / to.y : 0.0;
    p = from + fall * to;
    facing = vec4(0, 1, 0, 0);
    edge = fall > 0.0 ? 1.0 - smoothstep(1.6, 3.2, length(p.xz)) : 0.0;
  }
#endif
  vec3 n = facing.xyz, s = normalize(cross(vec3(0, 1, 1e-4), n)), q = cross(n, s);
  vec3 t = cos(facing.w) * s + sin(facing.w) * q, b = cross(n, t);
  vec3 wi = vec3(dot(-to, t), dot(-to, b), dot(-to, n)), u = vec3(random(), random(), random()), wo, d;
  float lampShare = brightness > 0.0 ? 0.25 : 0.0, roomShare = 0.5 - lampShare, chosen = random(), own;
  if (chosen < 0.5) {
#ifdef MATERIAL
    wo = SAMPLE(wi, u);
#else
    float r = sqrt(u.y), phi = 2.0 * PI * u.z;
    wo = vec3(r * cos(phi), r * sin(phi), sqrt(1.0 - u.y));
#endif
    d = wo.x * t + wo.y * b + wo.z * n;
  } else d = chosen < 0.5 + roomShare ? toRoom() : toLamp();
  wo = vec3(dot(d, t), dot(d, b), dot(d, n));
  bool to_lamp = dot(d, lamp.xyz) > lamp.w;
  vec2 uv = place(d);
  vec3 light = strength * texture(env, uv).rgb + (to_lamp ? vec3(brightness) : vec3(0));
  if (blocked(p + 0.06 * n, d, edge > 0.0 && wo.z > 0.0)) light = vec3(grey);
#ifdef MATERIAL
  own = PDF(wi, wo);
  f = EVAL(wi, wo);
#else
  own = wo.z / PI;
  f = vec3(hit.w == 0.0 ? 0.3 : 0.18) / PI;
#endif
  float density = 0.5 * own + roomShare * texture(densities, uv).r / max(sin(uv.y * PI), 1e-4);
  if (to_lamp) density += lampShare / (2.0 * PI * (1.0 - lamp.w));
  vec3 sum = wo.z > 0.0 && wi.z > 0.0 && density > 0.0 ? f * light * (wo.z / density) : vec3(0);
#ifndef MATERIAL
  sum = mix(0.35 * strength * texture(env, place(to)).rgb, sum, edge);
#endif
  vec3 previous = frame == 0u ? vec3(0) : texelFetch(before, ivec2(gl_FragCoord.xy), 0).rgb;
  colour = vec4(previous + sum, 1);
}
