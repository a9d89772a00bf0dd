// A tile of the sum of all samples as a picture, or its error: the difference to the tile of another model.
uniform sampler2D total;
uniform float frames, exposure, scale;
uniform ivec2 corner;   // of the tile on the canvas
uniform int tile, other, line;  // where the tiles begin in the sum; other < 0: no error; the line between models
out vec4 colour;
vec3 shown(ivec2 at) {
  vec3 v = clamp(texelFetch(total, at, 0).rgb * (exp2(exposure) / frames), 0.0, 1.0);
  return mix(12.92 * v, 1.055 * pow(max(v, 1e-6), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy) - corner, at = ivec2((vec2(pixel) + 0.5) * scale);
  vec3 v = shown(at + ivec2(tile, 0));
  if (other >= 0) {
    float error = dot(abs(v - shown(at + ivec2(other, 0))), vec3(4.0));  // white: a mean of a quarter of the range
    v = clamp(vec3(error, error - 1.0, error - 2.0), 0.0, 1.0);
  }
  colour = vec4(pixel.x == line ? vec3(1) : v, 1);
}
