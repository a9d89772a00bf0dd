// What is not the material stays as it was: it gets a sample in every other frame.
uniform sampler2D wheres, before;
uniform int left;
out vec4 colour;
void main() {
  if (texelFetch(wheres, ivec2(gl_FragCoord.xy) - ivec2(left, 0), 0).w == 1.0) discard;
  colour = texelFetch(before, ivec2(gl_FragCoord.xy), 0);
}
